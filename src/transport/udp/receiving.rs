//! Waiting for a reply, and what else comes meanwhile.

use core::time::Duration;

use super::encoding::Encoding;
use super::ledger::Asked;
use super::matching::Match;
use super::{Link, UdpBus, UdpError};
use crate::bus::{Instant, Reply};
use crate::lbp16::MAX_PACKET;

/// The reply that is waited for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wait {
    pub request: u32,
    /// The writes that were sent before it.
    pub asked: Asked,
    /// The whole account was asked for.
    pub detailed: bool,
    pub started: Instant,
    /// How long it may take, ...
    pub deadline: Duration,
    /// ... and how long the board may wait besides.
    pub held: Duration,
}

/// Datagrams that are looked through after the deadline, for one that came before it.
const MAX_OVERTIME: u32 = 64;

impl<L: Link> UdpBus<L> {
    /// Waits for the reply to a request, and throws away everything else that comes.
    pub(super) fn receive(&mut self, encoding: &Encoding, wait: Wait) -> Result<usize, UdpError> {
        let result = self.receive_until(encoding, wait);
        if result.is_err() {
            self.requests.give_up();
        }
        result
    }

    fn receive_until(&mut self, encoding: &Encoding, wait: Wait) -> Result<usize, UdpError> {
        let Wait { request, .. } = wait;
        let deadline = wait.deadline.saturating_add(wait.held);
        let until = wait.started.after(deadline);
        let mut instead = None;
        let mut overtime = 0;
        let mut strange = 0;
        loop {
            let received = self.link.receive(self.reply.as_mut_slice(), until);
            let waited = self.link.now().since(wait.started);
            match received {
                Ok(Some(length)) => {
                    match self.sort(encoding, length, wait, waited)? {
                        Some(got) if got == request => return Ok(length),
                        Some(got) => {
                            instead = Some(UdpError::Stale {
                                request,
                                got,
                                waited,
                            });
                        }
                        None => strange += 1,
                    }
                    // What came in time may still lie in the socket, but not without end.
                    overtime += u32::from(waited > deadline);
                    if overtime < MAX_OVERTIME {
                        continue;
                    }
                }
                Ok(None) => {}
                Err(link) => {
                    // Should a reply come after all, it is late.
                    self.statistics.lost += 1;
                    return Err(UdpError::Link { link, waited });
                }
            }
            self.statistics.lost += 1;
            let nothing = match strange {
                0 => UdpError::Lost { request, waited },
                datagrams => UdpError::Foreign {
                    request,
                    datagrams,
                    waited,
                },
            };
            return Err(instead.unwrap_or(nothing));
        }
    }

    /// Counts what came as what it is; the number of the request it answers, if it answers one.
    fn sort(
        &mut self,
        encoding: &Encoding,
        length: usize,
        wait: Wait,
        waited: Duration,
    ) -> Result<Option<u32>, UdpError> {
        let Wait {
            request,
            asked,
            detailed,
            deadline,
            held,
            ..
        } = wait;
        let expected = encoding.reply_len(detailed);
        let counted = &mut self.statistics;
        if length > MAX_PACKET {
            // No board sends that, and what is at its end may be the middle of it.
            counted.foreign += 1;
            return Ok(None);
        }
        let reply = self.reply.get(..length).unwrap_or(&[]);
        let Some(number) = Encoding::number(reply) else {
            counted.short += 1;
            return Ok(None);
        };
        // What the board did not wait for its clock was lost on the way: the words are that old.
        let told = encoding.waited_us(reply).unwrap_or(0);
        let told = Duration::from_micros(told.into()).min(held);
        let deadline = deadline.saturating_add(told);
        match self.requests.classify(number) {
            Match::Current if length != expected => {
                counted.short += 1;
                return Err(UdpError::Short {
                    request,
                    expected,
                    got: length,
                    waited,
                });
            }
            Match::Current if waited > deadline => {
                counted.late += 1;
                return Err(UdpError::Late {
                    request,
                    waited,
                    by: waited.saturating_sub(deadline),
                });
            }
            Match::Current => {
                counted.bytes_received += length as u64;
                let news = encoding
                    .account(reply, detailed)
                    .map(|told| self.ledger.hear(told, asked));
                let news = news.unwrap_or_default();
                counted.lost_writes += u64::from(news.lost);
                let found = u64::from(news.found);
                counted.lost_writes = counted.lost_writes.saturating_sub(found);
                counted.late_writes += u64::from(news.late);
                counted.repeated_writes += u64::from(news.repeated);
                counted.unconfirmed_writes += u64::from(news.unconfirmed);
                counted.doubts += u64::from(news.doubt);
                // What comes late is not lost any more, but it was.
                let missing = (news.lost + news.late).saturating_sub(news.found);
                if self.is_cyclic {
                    self.news = self.news.and(Reply {
                        certain: !news.doubt,
                        lost_writes: missing,
                        slack: None,
                    });
                }
            }
            Match::Late => {
                counted.late += 1;
                counted.lost = counted.lost.saturating_sub(1);
            }
            Match::Duplicate => counted.duplicate += 1,
            Match::Stale => counted.stale += 1,
            Match::Foreign => {
                if length < expected {
                    counted.short += 1;
                } else {
                    counted.foreign += 1;
                }
                return Ok(None);
            }
        }
        Ok(Some(number))
    }
}
