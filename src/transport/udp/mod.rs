//! LBP16 over UDP: the bus of the Ethernet boards.
//!
//! One exchange is one packet out and at most one packet back. Neighbouring registers share a
//! command; lists that are run every cycle are encoded once ([`RegisterBus::prepare`]).
//!
//! Requests and write packets are numbered through scratch registers of the board (FACTS 10.1),
//! and the board counts its packets: a reply is taken for the request that waits for it and for no
//! other, and a write packet that the board did not execute, or executed late or twice, is noticed
//! with the next replies.

mod encoding;
mod error;
mod ledger;
mod link;
mod matching;
mod receiving;
mod runs;

pub use error::UdpError;
pub use link::{Link, LinkError, SocketOptions, UdpLink};

use core::time::Duration;
use std::net::SocketAddrV4;

use crate::bus::{Access, BusStatistics, Clock, Direction, Hold, Instant, RegisterBus, Reply};
use crate::ethernet::Lbp16Board;
use crate::lbp16::MAX_PACKET;
use encoding::{Encoding, Manner, write_packet};
use ledger::{Kind, Ledger};
use matching::Requests;
use receiving::Wait;

/// Room for more than [`MAX_PACKET`](crate::lbp16::MAX_PACKET), so that a longer datagram shows.
const RECEIVE_BUFFER: usize = 2048;

/// How long a board is watched for packets of other hosts before anything is written to it: a cycle
/// of 100 Hz sends ten packets in it.
const WATCH: Duration = Duration::from_millis(50);
/// So many packets more than ours, and more than our own can have become on the way, are others'.
const OTHERS: u16 = 4;
/// More than a board can receive in that time: its counts began again.
const TOO_MANY: u16 = 0x8000;

/// No deadline that follows a period is shorter.
const SHORTEST_DEADLINE: Duration = Duration::from_micros(100);

/// How long an exchange may take, and how often one of set-up is tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UdpConfig {
    /// Deadline of the exchanges of the cycle, from the moment the request is sent.
    /// They are tried once. As long as it is the default, it follows the period of the driver.
    pub cycle_deadline: Duration,
    /// Deadline of each try of the exchanges of set-up.
    pub setup_deadline: Duration,
    /// How often an exchange of set-up is tried, at least once.
    pub setup_tries: u32,
    /// Talk to the board also while another program or host does. False: see [`UdpBus::new`].
    pub beside_others: bool,
}

impl Default for UdpConfig {
    /// 800 us in the cycle, which leaves time in a period of 1 ms; ten tries of 20 ms at set-up.
    fn default() -> Self {
        Self {
            cycle_deadline: Duration::from_micros(800),
            setup_deadline: Duration::from_millis(20),
            setup_tries: 10,
            beside_others: false,
        }
    }
}

/// The registers of an Ethernet board.
///
/// - [`exchange`](RegisterBus::exchange) is for set-up: writes are acknowledged, and what is lost
///   is repeated a bounded number of times. A packet that writes is repeated only after the board
///   was asked whether it has executed it.
/// - [`start`](RegisterBus::start) and [`finish`](RegisterBus::finish) are for the cycle: one try. A
///   list that only writes is sent and not waited for; that it was lost is noticed with the next
///   reply, which tells so.
/// - What is [held back](Hold) waits in the board for the reference of its DPLL (manual: 7I97,
///   "SPACE 4 LBP TIMER/UTILITY AREA"), which needs a firmware that has one.
///
/// # Real time
/// An exchange of the cycle is bounded by [`UdpConfig::cycle_deadline`], one that is held back by that
/// and its own limit, and does not allocate.
#[derive(Debug)]
pub struct UdpBus<L: Link = UdpLink> {
    link: L,
    config: UdpConfig,
    requests: Requests,
    ledger: Ledger,
    statistics: BusStatistics,
    /// Lists prepared so far.
    prepared: u32,
    /// The list that was started, and whose reply is waited for.
    started: Option<(u32, Wait)>,
    /// Whether a list was run: only then are there writes that replies tell something of.
    is_cyclic: bool,
    /// What replies told since it was last said.
    news: Reply,
    packet: Box<[u8; MAX_PACKET]>,
    reply: Box<[u8; RECEIVE_BUFFER]>,
}

/// A list of accesses as packets.
#[derive(Clone, Debug)]
pub struct UdpList {
    accesses: Box<[Access]>,
    number: u32,
    encoding: Encoding,
    /// How long the board may hold it back.
    held: Duration,
}

impl UdpList {
    /// Bytes of the packet that is sent, without the headers of lower layers.
    pub fn request_bytes(&self) -> usize {
        self.encoding.request_len()
    }

    /// Bytes of its reply; 0 if it has none. A reply that tells of packets that were lost has 16
    /// more.
    pub fn reply_bytes(&self) -> usize {
        self.encoding.reply_len(false)
    }
}

impl AsRef<[Access]> for UdpList {
    fn as_ref(&self) -> &[Access] {
        &self.accesses
    }
}

impl UdpBus<UdpLink> {
    /// Opens the board at `address`; its port is 27181 unless it was told otherwise.
    ///
    /// # Errors
    /// When there is no such network, nobody listens, or no reply comes within
    /// `setup_tries * setup_deadline`.
    pub fn connect(address: SocketAddrV4, config: UdpConfig) -> Result<Self, UdpError> {
        let link = UdpLink::connect(address).map_err(|link| UdpError::Link {
            link,
            waited: Duration::ZERO,
        })?;
        #[cfg(feature = "log")]
        for option in link.options().refused() {
            log::info!("{address}: this host does not allow {option}; round trips may be longer");
        }
        Self::new(link, config)
    }

    /// Which of the helpful socket options this host allowed.
    pub fn socket_options(&self) -> SocketOptions {
        self.link.options()
    }
}

impl<L: Link> UdpBus<L> {
    /// A bus over `link`. Asks the board first, so that a bus that exists has a board behind it.
    ///
    /// A board takes orders from everybody, and two programs that drive the same one end in
    /// movements that neither has ordered. So the board is only watched at first: when its count of
    /// packets (RXUDPCount; manual: 7I97, "MEMORY SPACE 6 LAYOUT") grows by more than ours within 50 ms, somebody
    /// else drives it, and nothing is written ([`UdpError::OtherHost`]). Somebody who sends less
    /// than about 100 packets a second, or begins later, is not noticed by that.
    /// [`UdpConfig::beside_others`] leaves it out.
    pub fn new(link: L, config: UdpConfig) -> Result<Self, UdpError> {
        let mut bus = Self {
            link,
            config,
            requests: Requests::starting_after(0),
            ledger: Ledger::starting_after(0),
            statistics: BusStatistics::default(),
            prepared: 0,
            started: None,
            is_cyclic: false,
            news: Reply::CERTAIN,
            packet: Box::new([0; MAX_PACKET]),
            reply: Box::new([0; RECEIVE_BUFFER]),
        };
        if !config.beside_others {
            bus.watch_for_others()?;
        }
        // Without these, numbers that an earlier program left would look like writes that were
        // executed, or like a lost one.
        bus.with_retries(&Encoding::clearing()?, &[], &mut [])?;
        bus.with_retries(&Encoding::first_contact()?, &[], &mut [])?;
        bus.statistics = BusStatistics::default();
        Ok(bus)
    }

    /// The link, to ask it for what is its own.
    pub fn link(&mut self) -> &mut L {
        &mut self.link
    }

    /// Sets how long exchanges may take from now on.
    pub fn set_config(&mut self, config: UdpConfig) {
        self.config = config;
    }

    /// Fails if the board receives more packets than ours. Writes nothing but a request's number.
    fn watch_for_others(&mut self) -> Result<(), UdpError> {
        self.with_retries(&Encoding::question()?, &[], &mut [])?;
        let (before, sent) = (self.ledger.received(), self.statistics.exchanges);
        let start = self.link.now();
        self.link.sleep_until(start.after(WATCH));
        self.with_retries(&Encoding::question()?, &[], &mut [])?;
        let within = self.link.now().since(start);
        let own = (self.statistics.exchanges - sent) as u16;
        let (Some(before), Some(after)) = (before, self.ledger.received()) else {
            return Ok(());
        };
        // Each of ours, and those of before that are late, may have come twice.
        let packets = after.wrapping_sub(before).wrapping_sub(own);
        let others = own.saturating_add(OTHERS)..TOO_MANY;
        if others.contains(&packets) {
            return Err(UdpError::OtherHost { packets, within });
        }
        Ok(())
    }

    /// An exchange of set-up, repeated until it is done or the tries are used up.
    ///
    /// What writes is repeated only if the board says that it has not executed it; if it has, and
    /// only the reply was lost, the reads alone are repeated.
    fn with_retries(
        &mut self,
        encoding: &Encoding,
        accesses: &[Access],
        words: &mut [u32],
    ) -> Result<(), UdpError> {
        let deadline = self.config.setup_deadline;
        let mut tries = self.config.setup_tries;
        loop {
            match self.transact(encoding, words, deadline) {
                Ok(length) => {
                    self.take(encoding, length, words);
                    return Ok(());
                }
                Err(error) => tries = another_try(tries, error)?,
            }
            if encoding.kind().is_some() && self.ask_whether_executed(&mut tries)? {
                let reads: Vec<Access> = only_reads(accesses).collect();
                if reads.is_empty() {
                    return Ok(());
                }
                return self.with_retries(
                    &Encoding::accesses(&reads, ACKNOWLEDGED)?,
                    &reads,
                    words,
                );
            }
        }
    }

    /// Whether the board has executed the newest write, of which no reply came.
    fn ask_whether_executed(&mut self, tries: &mut u32) -> Result<bool, UdpError> {
        let deadline = self.config.setup_deadline;
        let question = Encoding::question()?;
        loop {
            match self.transact(&question, &[], deadline) {
                Ok(_) => return Ok(self.ledger.is_executed()),
                Err(error) => *tries = another_try(*tries, error)?,
            }
        }
    }

    /// One packet out and, if it is answered, its reply: how many bytes of it were received.
    fn transact(
        &mut self,
        encoding: &Encoding,
        words: &[u32],
        deadline: Duration,
    ) -> Result<usize, UdpError> {
        match self.send(encoding, words, deadline, Duration::ZERO)? {
            Some(wait) => self.receive(encoding, wait),
            None => Ok(0),
        }
    }

    /// One packet out, which the board may hold back for `held`. If it is answered, nobody waits any
    /// more for a reply to the one before.
    fn send(
        &mut self,
        encoding: &Encoding,
        words: &[u32],
        deadline: Duration,
        held: Duration,
    ) -> Result<Option<Wait>, UdpError> {
        let kind = encoding.kind();
        let write = kind.map(|kind| self.ledger.open_write(kind));
        let started = self.link.now();
        let wait = encoding.is_answered().then(|| {
            self.statistics.lost += u64::from(self.started.take().is_some());
            Wait {
                request: self.requests.open(),
                asked: self.ledger.open_request(),
                detailed: self.ledger.wants_details(),
                started,
                deadline,
                held,
            }
        });
        let packet = encoding.packet(self.packet.as_mut_slice(), words, wait, write);
        self.statistics.exchanges += 1;
        self.statistics.bytes_sent += packet.len() as u64;
        self.link.send(packet).map_err(|link| UdpError::Link {
            link,
            waited: Duration::ZERO,
        })?;
        Ok(wait)
    }

    /// Takes the words of the reply that was received.
    fn take(&mut self, encoding: &Encoding, length: usize, words: &mut [u32]) {
        let reply = self.reply.get(..length).unwrap_or(&[]);
        encoding.take(reply, words);
    }
}

const ACKNOWLEDGED: Manner = Manner {
    acknowledged: true,
    wait: None,
};

fn only_reads(accesses: &[Access]) -> impl Iterator<Item = Access> + '_ {
    let read = |access: &&Access| access.direction == Direction::Read;
    accesses.iter().filter(read).copied()
}

/// How many tries are left after `error`; or `error` itself if there are none, or no use in one.
fn another_try(tries: u32, error: UdpError) -> Result<u32, UdpError> {
    let passing = matches!(
        error,
        UdpError::Lost { .. }
            | UdpError::Foreign { .. }
            | UdpError::Late { .. }
            | UdpError::Stale { .. }
            | UdpError::Short { .. }
            | UdpError::Link { .. }
    );
    match tries {
        0 | 1 => Err(error),
        _ if !passing => Err(error),
        _ => Ok(tries - 1),
    }
}

impl<L: Link> Lbp16Board for UdpBus<L> {
    type Error = UdpError;

    fn run_commands(
        &mut self,
        commands: &[u8],
        reply: &mut [u8],
        deadline: Duration,
    ) -> Result<(), UdpError> {
        let encoding = Encoding::raw(commands, reply.len())?;
        let mut tries = self.config.setup_tries;
        loop {
            match self.transact(&encoding, &[], deadline) {
                Ok(_) => {
                    for (target, byte) in reply.iter_mut().zip(self.reply.iter()) {
                        *target = *byte;
                    }
                    return Ok(());
                }
                Err(error) => tries = another_try(tries, error)?,
            }
        }
    }

    fn send(&mut self, commands: &[u8]) -> Result<(), UdpError> {
        self.ledger.lose_count();
        self.link.send(commands).map_err(|link| UdpError::Link {
            link,
            waited: Duration::ZERO,
        })
    }
}

impl<L: Link> Clock for UdpBus<L> {
    fn now(&mut self) -> Instant {
        self.link.now()
    }

    fn wait(&mut self, duration: Duration) {
        let until = self.link.now().after(duration);
        self.link.sleep_until(until);
    }
}

impl<L: Link> RegisterBus for UdpBus<L> {
    type Error = UdpError;
    type List = UdpList;
    /// The board's timer does that.
    const CAN_HOLD: bool = true;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), UdpError> {
        let encoding = Encoding::accesses(accesses, ACKNOWLEDGED)?;
        encoding.check_words(words.len())?;
        self.with_retries(&encoding, accesses, words)
    }

    /// The board can wait for up to 65.535 ms. Of the time that a reply takes, what the board
    /// waited does not count for the deadline: whatever it waits, its words are as new as those of
    /// other lists.
    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<UdpList, UdpError> {
        let mut wait = None;
        if let Some(Hold { before, limit }) = hold {
            let limit_us = u16::try_from(limit.as_micros());
            let limit_us = limit_us.map_err(|_| UdpError::LongHold { limit })?;
            wait = Some((before, limit_us));
        }
        let acknowledged = wait.is_some();
        let encoding = Encoding::accesses(accesses, Manner { acknowledged, wait })?;
        let held = wait.map_or(0, |(_, limit_us)| limit_us);
        self.prepared += 1;
        Ok(UdpList {
            accesses: accesses.into(),
            number: self.prepared,
            encoding,
            held: Duration::from_micros(held.into()),
        })
    }

    fn start(&mut self, list: &UdpList, words: &[u32]) -> Result<(), UdpError> {
        list.encoding.check_words(words.len())?;
        self.is_cyclic = true;
        let deadline = self.config.cycle_deadline;
        if let Some(wait) = self.send(&list.encoding, words, deadline, list.held)? {
            self.started = Some((list.number, wait));
        }
        Ok(())
    }

    fn finish(&mut self, list: &UdpList, words: &mut [u32]) -> Result<Reply, UdpError> {
        if !list.encoding.is_answered() {
            return Ok(Reply::UNHEARD);
        }
        list.encoding.check_words(words.len())?;
        let is_its = |(number, _): &mut (u32, Wait)| *number == list.number;
        let Some((_, wait)) = self.started.take_if(is_its) else {
            return Err(UdpError::NotStarted);
        };
        let length = self.receive(&list.encoding, wait)?;
        self.take(&list.encoding, length, words);
        let reply = self.reply.get(..length).unwrap_or(&[]);
        let waited = list.encoding.waited_us(reply).map(u64::from);
        let news = core::mem::replace(&mut self.news, Reply::CERTAIN);
        Ok(Reply {
            slack: waited.map(Duration::from_micros),
            ..news
        })
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), UdpError> {
        self.is_cyclic = true;
        let write = self.ledger.open_write(Kind::Alone);
        let all = accesses.iter().copied();
        let packet = write_packet(self.packet.as_mut_slice(), all, words, write)?;
        self.statistics.exchanges += 1;
        self.statistics.bytes_sent += packet.len() as u64;
        self.link.send(packet).map_err(|link| UdpError::Link {
            link,
            waited: Duration::ZERO,
        })
    }

    /// The deadline of [`UdpConfig::default`] becomes 80 % of the period, and at least 100 us.
    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        let is_default = self.config.cycle_deadline == UdpConfig::default().cycle_deadline;
        let following = || (period.saturating_mul(4) / 5).max(SHORTEST_DEADLINE);
        if let Some(deadline) = deadline.or_else(|| is_default.then(following)) {
            self.config.cycle_deadline = deadline;
        }
    }

    fn statistics(&self) -> BusStatistics {
        self.statistics
    }
}

#[cfg(test)]
mod tests;
