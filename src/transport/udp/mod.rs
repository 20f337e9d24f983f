//! LBP16 over UDP: the bus of the Ethernet boards.
//!
//! [`UdpBus`] needs a [`PacketLink`], which carries datagrams and has a clock: `UdpLink` is a
//! socket of an operating system (feature `std`); on a microcontroller it is made from a network
//! stack ([how](crate::guides::microcontroller)).
//!
//! One exchange is one packet out and at most one packet back. Neighbouring registers share a
//! command; lists that run every cycle are encoded once ([`RegisterBus::prepare`]).
//!
//! Requests and write packets are numbered through scratch registers of the board (FACTS 10.1), and
//! the board counts its packets: a reply is accepted only for the request that it answers, and a
//! write packet that the board did not execute, or executed late or twice, is detected with the
//! next replies.

mod encoding;
mod error;
mod ledger;
mod link;
mod matching;
mod others;
mod receiving;
#[cfg(feature = "std")]
mod socket;
mod wait;

use encoding::UdpList;
pub use link::PacketLink;
#[cfg(feature = "std")]
pub use socket::UdpLink;
#[cfg(feature = "std")]
pub(super) use socket::poll_for;

use alloc::boxed::Box;
use core::time::Duration;
#[cfg(feature = "std")]
use std::net::SocketAddrV4;

use crate::bus::{
    Access, AccessList, BoardIdentity, BusError, BusStatistics, Clock, Direction, Effort, Hold,
    Instant, RegisterBus, Reply,
};
use crate::ethernet::Lbp16Board;
use crate::fraction::Fraction;
use crate::lbp16::MAX_PACKET;
use crate::tally::Tally;
use error::{is_lasting, of_tries};
use ledger::{Ledger, WriteEvidence};
use matching::Requests;
use others::Others;
use wait::Wait;

/// Room for more than [`MAX_PACKET`](crate::lbp16::MAX_PACKET), so that a longer datagram is
/// detected.
const RECEIVE_BUFFER: usize = 2048;

/// Time that a board is watched for packets of other hosts before anything is written to it: a
/// cycle of 100 Hz sends ten packets in it.
const WATCH_TIME: Duration = Duration::from_millis(50);
/// Number of surplus packets that shows another host, in addition to one duplicate of each of our
/// own.
const SURPLUS_LIMIT: u16 = 4;
/// More packets than a board can receive in that time: its count was restarted.
const RESTARTED_COUNT: u16 = 0x8000;

/// Lower limit of a deadline that follows the period.
const SHORTEST_DEADLINE: Duration = Duration::from_micros(100);

/// Deadlines of the exchanges, and the number of tries at set-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UdpConfig {
    /// Deadline of the exchanges of the cycle, from the sending of the request. Each is tried once.
    /// The default value is replaced by one that follows the period of the driver.
    pub cycle_deadline: Duration,
    /// Deadline of each try of the exchanges of set-up.
    pub setup_deadline: Duration,
    /// Number of tries of an exchange of set-up, at least one.
    pub setup_tries: u32,
    /// Use the board even while another program or host does. False: see [`UdpBus::new`].
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
/// - [`exchange`](RegisterBus::exchange) is for set-up: writes are acknowledged, and lost packets
///   are repeated a bounded number of times. A packet that writes is repeated only after a query of
///   the board has shown that it was not executed.
/// - [`start`](RegisterBus::start) and [`finish`](RegisterBus::finish) are for the cycle: one try.
///   A list that only writes is sent without waiting for a reply; its loss is detected and reported
///   with the next reply.
/// - A list that is [held back](Hold) waits in the board for the reference of its DPLL (manual:
///   7I97, "SPACE 4 LBP TIMER/UTILITY AREA"), which needs a firmware that has one.
///
/// # Real time
/// An exchange of the cycle is bounded by [`UdpConfig::cycle_deadline`], one that is held back by
/// that plus its own limit. Neither allocates.
#[derive(Debug)]
pub struct UdpBus<
    #[cfg(feature = "std")] L: PacketLink = UdpLink,
    #[cfg(not(feature = "std"))] L: PacketLink,
> {
    link: L,
    config: UdpConfig,
    /// The deadline of the cycle follows the period, because no other one was given.
    is_following: bool,
    requests: Requests,
    ledger: Ledger,
    others: Others,
    statistics: BusStatistics,
    /// Number of lists prepared so far.
    prepared: u32,
    /// The list that was started and whose reply is awaited.
    started: Option<(u32, Wait)>,
    /// True once a list was run: before that, there are no writes on which replies could report.
    is_cyclic: bool,
    /// Findings of the replies since the last report.
    replies: Reply,
    /// The packet of writes that are encoded for a single use.
    once: UdpList,
    /// The packet that requests the board's identity.
    identity: UdpList,
    packet: Box<[u8; MAX_PACKET]>,
    reply: Box<[u8; RECEIVE_BUFFER]>,
}

#[cfg(feature = "std")]
impl UdpBus<UdpLink> {
    /// Opens the board at `address`; its port is 27181 unless configured otherwise.
    ///
    /// # Errors
    /// The network does not exist, no program listens at the port, or no reply arrives within
    /// `setup_tries * setup_deadline`.
    pub fn connect(address: SocketAddrV4, config: UdpConfig) -> Result<Self, BusError> {
        let link = UdpLink::connect(address)?;
        #[cfg(feature = "log")]
        for option in &link.refused {
            log::info!(target: "mesa_hal", "{address}: this host does not allow {option}; round trips may be longer");
        }
        Self::new(link, config)
    }
}

impl<L: PacketLink> UdpBus<L> {
    /// A bus over `link`. Queries the board first, so that every bus that exists has a board behind
    /// it.
    ///
    /// A board executes packets from any sender, and two programs that drive the same board cause
    /// movements that neither has commanded. So the board is only watched at first, and nothing is
    /// written if another host drives it ([`check_alone`](Self::check_alone)). A sender that starts
    /// later is detected in the cycle: [`BusStatistics::foreign_packets`].
    /// [`UdpConfig::beside_others`] disables both checks.
    pub fn new(link: L, config: UdpConfig) -> Result<Self, BusError> {
        let mut bus = Self::unasked(link, config);
        bus.check_alone()?;
        // Without this, numbers left by an earlier program would look like executed writes, or like
        // a lost one.
        bus.set_up(&UdpList::clearing()?, &mut [])?;
        bus.identity = UdpList::identity()?;
        let contact = UdpList::answered(Some(WriteEvidence::Acknowledged), &[], 0)?;
        bus.set_up(&contact, &mut [])?;
        (bus.statistics, bus.others) = Default::default();
        Ok(bus)
    }

    /// Fails if another host drives the board behind `link`. Writes nothing but the number of a
    /// request. With a bus of the board that has been idle for a while, call
    /// [`check_alone`](Self::check_alone) instead.
    pub fn check_free(link: L, config: UdpConfig) -> Result<(), BusError> {
        Self::unasked(link, config).check_alone()
    }

    fn unasked(link: L, config: UdpConfig) -> Self {
        Self {
            link,
            config,
            is_following: config.cycle_deadline == UdpConfig::default().cycle_deadline,
            requests: Requests::default(),
            ledger: Ledger::starting_after(0),
            others: Others::default(),
            statistics: BusStatistics::default(),
            prepared: 0,
            started: None,
            is_cyclic: false,
            replies: Reply::CERTAIN,
            once: UdpList::with_room(),
            identity: UdpList::default(),
            packet: Box::new([0; MAX_PACKET]),
            reply: Box::new([0; RECEIVE_BUFFER]),
        }
    }

    /// Access to the link, for settings and status of its own.
    pub fn link(&mut self) -> &mut L {
        &mut self.link
    }

    /// Fails if another host drives the board, i.e. if the board's packet count (RXUDPCount;
    /// manual: 7I97, "MEMORY SPACE 6 LAYOUT") grows by more than our own packets within 50 ms
    /// ([`BusError::OtherHost`]), which is about 100 packets/s. Writes nothing but the number of a
    /// request. Call it after a pause, before anything is driven; [`new`](Self::new) does.
    ///
    /// # Real time
    /// Not for the cycle: it waits.
    pub fn check_alone(&mut self) -> Result<(), BusError> {
        if self.config.beside_others {
            return Ok(());
        }
        self.set_up(&UdpList::question()?, &mut [])?;
        let (before, sent) = (self.ledger.received, self.statistics.exchanges);
        let start = self.link.now();
        self.link.sleep_until(start.after(WATCH_TIME));
        self.set_up(&UdpList::question()?, &mut [])?;
        let within = self.link.now().since(start);
        let own = self.statistics.exchanges.wrapping_sub(sent) as u16;
        let (Some(before), Some(after)) = (before, self.ledger.received) else {
            return Ok(());
        };
        // Each of our packets, and earlier ones that are late, may have arrived twice.
        let packets = after.wrapping_sub(before).wrapping_sub(own);
        let others = own.saturating_add(SURPLUS_LIMIT)..RESTARTED_COUNT;
        if others.contains(&packets) {
            self.statistics.foreign_packets.tally(packets.into());
            return Err(BusError::OtherHost { packets, within });
        }
        Ok(())
    }

    /// An exchange of set-up, repeated until it succeeds or the tries are used up.
    fn set_up(&mut self, list: &UdpList, words: &mut [u32]) -> Result<(), BusError> {
        self.repeated(list, words, self.config.setup_deadline)
    }

    /// An exchange whose error contains the number of tries and the total time.
    fn repeated(
        &mut self,
        list: &UdpList,
        words: &mut [u32],
        deadline: Duration,
    ) -> Result<(), BusError> {
        let start = self.link.now();
        let mut left = self.config.setup_tries;
        let done = self.with_retries(list, words, deadline, &mut left);
        done.map_err(|last| {
            let tries = self.config.setup_tries.saturating_sub(left);
            of_tries(last, tries.saturating_add(1), self.link.now().since(start))
        })
    }

    /// A list that writes is repeated only if the board reports it as not executed; if it was
    /// executed and only the reply was lost, the reads alone are repeated.
    fn with_retries(
        &mut self,
        list: &UdpList,
        words: &mut [u32],
        deadline: Duration,
        tries: &mut u32,
    ) -> Result<(), BusError> {
        while let Err(error) = self.transact(list, words, deadline) {
            if is_lasting(error) || *tries <= 1 {
                return Err(error);
            }
            *tries = tries.saturating_sub(1);
            if list.kind.is_none() {
                continue;
            }
            self.with_retries(&UdpList::question()?, &mut [], deadline, tries)?;
            if self.ledger.is_executed() {
                let mut reads = list.accesses.clone();
                reads.retain(|access| access.direction == Direction::Read);
                if reads.is_empty() {
                    return Ok(());
                }
                return self.set_up(&UdpList::new(&reads, true, None)?, words);
            }
        }
        Ok(())
    }

    /// Sends one packet and receives its reply.
    fn transact(
        &mut self,
        list: &UdpList,
        words: &mut [u32],
        deadline: Duration,
    ) -> Result<(), BusError> {
        match self.send(list, words, deadline)? {
            Some(wait) => self.receive(list, wait, words),
            None => Ok(()),
        }
    }

    /// Sends one packet. If it is answered, the wait for the previous reply ends.
    fn send(
        &mut self,
        list: &UdpList,
        words: &[u32],
        deadline: Duration,
    ) -> Result<Option<Wait>, BusError> {
        let write = list.kind.map(|kind| self.ledger.open_write(kind));
        let started = self.link.now();
        let wait = list.is_answered.then(|| {
            let is_given_up = self.started.take().is_some();
            self.statistics.lost.tally(is_given_up.into());
            Wait {
                request: self.requests.open(),
                ledger: self.ledger.open_request(),
                detailed: self.ledger.wants_details(),
                started,
                deadline,
                sent: self.statistics.exchanges.saturating_add(1),
            }
        });
        let packet = list.packet(self.packet.as_mut_slice(), words, wait, write);
        self.statistics.exchanges.tally(1);
        self.statistics.bytes_sent.tally(packet.len() as u64);
        self.link.send(packet)?;
        Ok(wait)
    }
}

impl<L: PacketLink> Lbp16Board for UdpBus<L> {
    fn run_commands(
        &mut self,
        commands: &[u8],
        reply: &mut [u8],
        deadline: Duration,
    ) -> Result<(), BusError> {
        let list = UdpList::answered(None, commands, reply.len())?;
        self.repeated(&list, &mut [], deadline)?;
        for (target, byte) in reply.iter_mut().zip(self.reply.iter()) {
            *target = *byte;
        }
        Ok(())
    }

    fn send(&mut self, commands: &[u8]) -> Result<(), BusError> {
        self.ledger.lose_count();
        Ok(self.link.send(commands)?)
    }
}

impl<L: PacketLink> Clock for UdpBus<L> {
    fn now(&mut self) -> Instant {
        self.link.now()
    }

    fn wait(&mut self, duration: Duration) {
        let until = self.link.now().after(duration);
        self.link.sleep_until(until);
    }

    fn sleep(&mut self, duration: Duration) {
        self.link.sleep(duration);
    }
}

impl<L: PacketLink> RegisterBus for UdpBus<L> {
    /// The board's timer holds lists back.
    fn can_hold(&self) -> bool {
        true
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        let list = UdpList::new(accesses, true, None)?;
        list.check_words(words.len())?;
        self.set_up(&list, words)
    }

    /// The board can wait for up to 65.535 ms. Time that the board waited does not count for the
    /// deadline of the reply: its words are as new as those of other lists, however long it waited.
    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<AccessList, BusError> {
        self.prepared = self.prepared.wrapping_add(1);
        let mut list = UdpList::new(accesses, false, hold)?;
        list.number = self.prepared;
        Ok(AccessList::encoded(list))
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), BusError> {
        let list = UdpList::of(list)?;
        list.check_words(words.len())?;
        self.is_cyclic = true;
        let deadline = self.config.cycle_deadline;
        if let Some(wait) = self.send(list, words, deadline)? {
            self.started = Some((list.number, wait));
        }
        Ok(())
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        let list = UdpList::of(list)?;
        if !list.is_answered {
            return Ok(Reply::UNKNOWN);
        }
        list.check_words(words.len())?;
        let is_its = |(number, _): &mut (u32, Wait)| *number == list.number;
        let Some((_, wait)) = self.started.take_if(is_its) else {
            return Err(BusError::NotStarted);
        };
        self.receive(list, wait, words)?;
        let waited = list.waited_us(self.reply.as_slice()).map(u64::from);
        let replies = core::mem::replace(&mut self.replies, Reply::CERTAIN);
        Ok(replies.with_slack(waited.map(Duration::from_micros)))
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.is_cyclic = true;
        let mut once = core::mem::take(&mut self.once);
        let encoded = once.encode(accesses, false, None);
        let encoded = encoded.and_then(|()| once.check_words(words.len()));
        let sent = match encoded {
            Ok(()) => self.send(&once, words, Duration::ZERO).map(drop),
            Err(error) => Err(error),
        };
        self.once = once;
        sent
    }

    /// The deadline of [`UdpConfig::default`] becomes 80 % of the period, and at least 100 us.
    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        let following = || period.fraction(4, 5).max(SHORTEST_DEADLINE);
        if let Some(deadline) = deadline.or_else(|| self.is_following.then(following)) {
            self.config.cycle_deadline = deadline;
        }
    }

    /// MAC address and card name of the board (manual: 7I97, "ETHERNET EEPROM LAYOUT" and "SPACE 7:
    /// LBP READ ONLY AREA").
    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, BusError> {
        let list = core::mem::take(&mut self.identity);
        let result = match effort {
            Effort::Once => self.transact(&list, &mut [], self.config.cycle_deadline),
            Effort::Repeated => self.set_up(&list, &mut []),
        };
        self.identity = list;
        result.map(|()| UdpList::board(self.reply.as_slice()))
    }

    fn statistics(&self) -> BusStatistics {
        self.statistics
    }
}

#[cfg(all(test, feature = "std"))]
mod tests;
