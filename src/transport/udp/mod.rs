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
mod others;
mod receiving;

pub use encoding::UdpList;
pub use error::{BLOCKED, UdpError};
pub(super) use link::poll_for;
pub use link::{Link, UdpLink};

use core::time::Duration;
use std::net::SocketAddrV4;

use crate::bus::{
    Access, BoardIdentity, BusError, BusErrorKind, BusStatistics, Clock, Direction, Effort, Hold,
    Instant, RegisterBus, Reply,
};
use crate::ethernet::Lbp16Board;
use crate::fraction::Fraction;
use crate::lbp16::MAX_PACKET;
use crate::tally::Tally;
use ledger::{Kind, Ledger};
use matching::Requests;
use others::Others;
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
    others: Others,
    statistics: BusStatistics,
    /// Lists prepared so far.
    prepared: u32,
    /// The list that was started, and whose reply is waited for.
    started: Option<(u32, Wait)>,
    /// Whether a list was run: only then are there writes that replies tell something of.
    is_cyclic: bool,
    /// What replies showed since it was last reported.
    news: Reply,
    /// The packet of writes that are made for once.
    once: UdpList,
    /// The packet that asks which board it is.
    identity: UdpList,
    packet: Box<[u8; MAX_PACKET]>,
    reply: Box<[u8; RECEIVE_BUFFER]>,
}

impl UdpBus<UdpLink> {
    /// Opens the board at `address`; its port is 27181 unless it was given otherwise.
    ///
    /// # Errors
    /// When there is no such network, nobody listens, or no reply comes within
    /// `setup_tries * setup_deadline`.
    pub fn connect(address: SocketAddrV4, config: UdpConfig) -> Result<Self, UdpError> {
        let link = UdpLink::connect(address)?;
        #[cfg(feature = "log")]
        for option in &link.refused {
            log::info!(target: "mesa_hal", "{address}: this host does not allow {option}; round trips may be longer");
        }
        Self::new(link, config)
    }
}

impl<L: Link> UdpBus<L> {
    /// A bus over `link`. Asks the board first, so that a bus that exists has a board behind it.
    ///
    /// A board takes orders from everybody, and two programs that drive the same one end in
    /// movements that neither has ordered. So the board is only watched at first, and nothing is
    /// written if somebody else drives it ([`check_alone`](Self::check_alone)). Somebody who begins
    /// later is noticed in the cycle: [`BusStatistics::others`].
    /// [`UdpConfig::beside_others`] leaves out both.
    pub fn new(link: L, config: UdpConfig) -> Result<Self, UdpError> {
        let mut bus = Self::unasked(link, config);
        bus.check_alone()?;
        // Without these, numbers that an earlier program left would look like writes that were
        // executed, or like a lost one.
        bus.set_up(&UdpList::clearing()?, &mut [])?;
        bus.identity = UdpList::identity()?;
        let contact = UdpList::answered(Some(Kind::Acknowledged), &[], 0)?;
        bus.set_up(&contact, &mut [])?;
        (bus.statistics, bus.others) = Default::default();
        Ok(bus)
    }

    /// Fails if somebody else drives the board behind `link`. It changes nothing there, for who has a
    /// bus of the board already and has not used it for a while: [`check_alone`](Self::check_alone).
    pub fn check_free(link: L, config: UdpConfig) -> Result<(), UdpError> {
        Self::unasked(link, config).check_alone()
    }

    fn unasked(link: L, config: UdpConfig) -> Self {
        Self {
            link,
            config,
            requests: Requests::default(),
            ledger: Ledger::starting_after(0),
            others: Others::default(),
            statistics: BusStatistics::default(),
            prepared: 0,
            started: None,
            is_cyclic: false,
            news: Reply::CERTAIN,
            once: UdpList::with_room(),
            identity: UdpList::default(),
            packet: Box::new([0; MAX_PACKET]),
            reply: Box::new([0; RECEIVE_BUFFER]),
        }
    }

    /// The link, to ask it for what is its own.
    pub fn link(&mut self) -> &mut L {
        &mut self.link
    }

    /// Fails if somebody else drives the board: when its count of packets (RXUDPCount; manual: 7I97,
    /// "MEMORY SPACE 6 LAYOUT") grows by more than ours within 50 ms ([`UdpError::OtherHost`]), which is
    /// about 100 packets a second. Writes nothing but a request's number. Call it after a pause,
    /// before anything is driven; [`new`](Self::new) does.
    ///
    /// # Real time
    /// Not for the cycle: it waits.
    pub fn check_alone(&mut self) -> Result<(), UdpError> {
        if self.config.beside_others {
            return Ok(());
        }
        self.set_up(&UdpList::question()?, &mut [])?;
        let (before, sent) = (self.ledger.received, self.statistics.exchanges);
        let start = self.link.now();
        self.link.sleep_until(start.after(WATCH));
        self.set_up(&UdpList::question()?, &mut [])?;
        let within = self.link.now().since(start);
        let own = self.statistics.exchanges.wrapping_sub(sent) as u16;
        let (Some(before), Some(after)) = (before, self.ledger.received) else {
            return Ok(());
        };
        // Each of ours, and those of before that are late, may have come twice.
        let packets = after.wrapping_sub(before).wrapping_sub(own);
        let others = own.saturating_add(OTHERS)..TOO_MANY;
        if others.contains(&packets) {
            self.statistics.others.tally(packets.into());
            return Err(UdpError::OtherHost { packets, within });
        }
        Ok(())
    }

    /// An exchange of set-up, repeated until it is done or the tries are used up.
    fn set_up(&mut self, list: &UdpList, words: &mut [u32]) -> Result<(), UdpError> {
        self.repeated(list, words, self.config.setup_deadline)
    }

    /// An exchange whose error says how often and for how long it was tried.
    fn repeated(
        &mut self,
        list: &UdpList,
        words: &mut [u32],
        deadline: Duration,
    ) -> Result<(), UdpError> {
        let start = self.link.now();
        let mut left = self.config.setup_tries;
        let done = self.with_retries(list, words, deadline, &mut left);
        done.map_err(|last| {
            let tries = self.config.setup_tries.saturating_sub(left);
            last.of_tries(tries.saturating_add(1), self.link.now().since(start))
        })
    }

    /// What writes is repeated only if the board says that it has not executed it; if it has, and
    /// only the reply was lost, the reads alone are repeated.
    fn with_retries(
        &mut self,
        list: &UdpList,
        words: &mut [u32],
        deadline: Duration,
        tries: &mut u32,
    ) -> Result<(), UdpError> {
        while let Err(error) = self.transact(list, words, deadline) {
            let kind = error.kind();
            let lasts = matches!(kind, BusErrorKind::Occupied | BusErrorKind::Invalid)
                || matches!(error, UdpError::Link { kind, .. } if error::is_blocked(kind));
            if lasts || *tries <= 1 {
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

    /// One packet out, and its reply.
    fn transact(
        &mut self,
        list: &UdpList,
        words: &mut [u32],
        deadline: Duration,
    ) -> Result<(), UdpError> {
        match self.send(list, words, deadline)? {
            Some(wait) => self.receive(list, wait, words),
            None => Ok(()),
        }
    }

    /// One packet out. If it is answered, nobody waits any
    /// more for a reply to the one before.
    fn send(
        &mut self,
        list: &UdpList,
        words: &[u32],
        deadline: Duration,
    ) -> Result<Option<Wait>, UdpError> {
        let write = list.kind.map(|kind| self.ledger.open_write(kind));
        let started = self.link.now();
        let wait = list.is_answered.then(|| {
            let is_given_up = self.started.take().is_some();
            self.statistics.lost.tally(is_given_up.into());
            Wait {
                request: self.requests.open(),
                asked: self.ledger.open_request(),
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

impl<L: Link> Lbp16Board for UdpBus<L> {
    type Error = UdpError;

    fn run_commands(
        &mut self,
        commands: &[u8],
        reply: &mut [u8],
        deadline: Duration,
    ) -> Result<(), UdpError> {
        let list = UdpList::answered(None, commands, reply.len())?;
        self.repeated(&list, &mut [], deadline)?;
        for (target, byte) in reply.iter_mut().zip(self.reply.iter()) {
            *target = *byte;
        }
        Ok(())
    }

    fn send(&mut self, commands: &[u8]) -> Result<(), UdpError> {
        self.ledger.lose_count();
        Ok(self.link.send(commands)?)
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

    fn sleep(&mut self, duration: Duration) {
        self.link.sleep(duration);
    }
}

impl<L: Link> RegisterBus for UdpBus<L> {
    type Error = UdpError;
    type List = UdpList;
    /// The board's timer does that.
    const CAN_HOLD: bool = true;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), UdpError> {
        let list = UdpList::new(accesses, true, None)?;
        list.check_words(words.len())?;
        self.set_up(&list, words)
    }

    /// The board can wait for up to 65.535 ms. Of the time that a reply takes, what the board
    /// waited does not count for the deadline: whatever it waits, its words are as new as those of
    /// other lists.
    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<UdpList, UdpError> {
        self.prepared = self.prepared.wrapping_add(1);
        let mut list = UdpList::new(accesses, false, hold)?;
        list.number = self.prepared;
        Ok(list)
    }

    fn start(&mut self, list: &UdpList, words: &[u32]) -> Result<(), UdpError> {
        list.check_words(words.len())?;
        self.is_cyclic = true;
        let deadline = self.config.cycle_deadline;
        if let Some(wait) = self.send(list, words, deadline)? {
            self.started = Some((list.number, wait));
        }
        Ok(())
    }

    fn finish(&mut self, list: &UdpList, words: &mut [u32]) -> Result<Reply, UdpError> {
        if !list.is_answered {
            return Ok(Reply::UNHEARD);
        }
        list.check_words(words.len())?;
        let is_its = |(number, _): &mut (u32, Wait)| *number == list.number;
        let Some((_, wait)) = self.started.take_if(is_its) else {
            return Err(UdpError::NotStarted);
        };
        self.receive(list, wait, words)?;
        let waited = list.waited_us(self.reply.as_slice()).map(u64::from);
        let news = core::mem::replace(&mut self.news, Reply::CERTAIN);
        Ok(Reply {
            slack: waited.map(Duration::from_micros),
            ..news
        })
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), UdpError> {
        self.is_cyclic = true;
        let mut once = core::mem::take(&mut self.once);
        let sent = once.encode(accesses, false, None).and_then(|()| {
            once.check_words(words.len())?;
            self.send(&once, words, Duration::ZERO)
        });
        self.once = once;
        sent.map(drop)
    }

    /// The deadline of [`UdpConfig::default`] becomes 80 % of the period, and at least 100 us.
    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        let is_default = self.config.cycle_deadline == UdpConfig::default().cycle_deadline;
        let following = || period.fraction(4, 5).max(SHORTEST_DEADLINE);
        if let Some(deadline) = deadline.or_else(|| is_default.then(following)) {
            self.config.cycle_deadline = deadline;
        }
    }

    /// By its MAC address and its card's name (manual: 7I97, "ETHERNET EEPROM LAYOUT" and "SPACE 7:
    /// LBP READ ONLY AREA").
    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, UdpError> {
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

#[cfg(test)]
mod tests;
