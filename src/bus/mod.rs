//! The register bus: 32-bit registers at 16-bit byte addresses.
//!
//! A bus has one primitive: a list of accesses, run in order on the hardware, on a word buffer. The
//! list holds indices and no borrowed slices, so that it can be built once, encoded
//! ([`RegisterBus::prepare`]) and run every cycle. What became of the writes, the [`Reply`] tells.
//! Time is a [`Clock`]: virtual in simulation.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod error;
mod image;

#[cfg(feature = "std")]
mod host_clock;

pub use error::{BusError, BusErrorKind};
#[cfg(feature = "std")]
pub use host_clock::HostClock;
#[cfg(feature = "std")]
pub(crate) use host_clock::SPIN;
pub(crate) use image::{Ask, Exchanges};
pub use image::{
    CycleLists, ImageError, ImagePlan, Phase, ReadSlot, Setting, Stage, Words, WriteSlot,
};
pub(crate) use image::{Exchanged, Way};

use alloc::boxed::Box;
use alloc::vec::Vec;
use core::fmt::Debug;
use core::time::Duration;

/// A point on the clock of a bus: nanoseconds since an origin of the bus's own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(transparent))]
pub struct Instant(u64);

impl Instant {
    /// The point `nanos` nanoseconds after the origin.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the origin.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Time from `earlier` to here; zero if `earlier` is later.
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// The point `duration` later; the end of time if that overflows.
    #[must_use]
    pub const fn after(self, duration: Duration) -> Self {
        match duration.as_nanos() {
            nanos @ 0..=0xFFFF_FFFF_FFFF_FFFF => Self(self.0.saturating_add(nanos as u64)),
            _ => Self(u64::MAX),
        }
    }
}

/// Which way an access moves its words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// From the register into the word buffer.
    Read,
    /// From the word buffer into the register.
    Write,
}

/// One access: `count` neighbouring registers from `address` on (4 bytes apart), and the place of
/// their words in the buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Access {
    /// Byte address of the first register; a multiple of 4.
    pub address: u16,
    /// Read or write.
    pub direction: Direction,
    /// Index of the first word in the buffer.
    pub first: u16,
    /// Number of registers, and words.
    pub count: u16,
}

impl Access {
    /// A read of `count` registers into the buffer from `first` on.
    pub const fn read(address: u16, first: u16, count: u16) -> Self {
        Self::new(Direction::Read, address, first, count)
    }

    /// Writes of single words to these addresses, in order, and the words.
    pub(crate) fn writes(all: impl IntoIterator<Item = (u16, u32)>) -> (Vec<Self>, Vec<u32>) {
        let all = (0..).zip(all);
        all.map(|(n, (address, word))| (Self::write(address, n, 1), word))
            .unzip()
    }

    /// A write of `count` registers from the buffer, from `first` on.
    pub const fn write(address: u16, first: u16, count: u16) -> Self {
        Self::new(Direction::Write, address, first, count)
    }

    const fn new(direction: Direction, address: u16, first: u16, count: u16) -> Self {
        Self {
            address,
            direction,
            first,
            count,
        }
    }

    /// The indices of the words in the buffer.
    pub const fn words(&self) -> core::ops::Range<usize> {
        let first = self.first as usize;
        first..first.saturating_add(self.count as usize)
    }
}

/// Until when the board holds a part of a list back: the beginning of its own next period.
///
/// With that the board's clock paces the cycle: [`start`](RegisterBus::start) sends the list, and
/// [`finish`](RegisterBus::finish) returns when the next period has begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Hold {
    /// The accesses from this one on wait for the period, and all after it.
    pub before: usize,
    /// They wait no longer than this.
    pub limit: Duration,
}

/// What a reply showed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reply {
    /// Everything that was written before, and with this list, was executed exactly once and in
    /// order, since the reply before. What depends on the last write must not be trusted
    /// otherwise.
    pub certain: bool,
    /// Writes that, as is known since this reply, the board has not executed, or not in time.
    pub lost_writes: u32,
    /// Packets of somebody else who drives the board as well: [`BusStatistics::others`].
    pub others: u32,
    /// How long the board held the list back, if it was to: what the host had left of its period.
    pub slack: Option<Duration>,
}

impl Reply {
    /// All that was written has arrived: what a bus says on which nothing can be lost.
    pub const CERTAIN: Self = Self {
        certain: true,
        lost_writes: 0,
        others: 0,
        slack: None,
    };
    /// No reply was to come: nothing is known of the writes yet.
    pub const UNHEARD: Self = Self {
        certain: false,
        ..Self::CERTAIN
    };

    /// What this reply and a `later` one showed together.
    #[must_use]
    pub const fn and(self, later: Self) -> Self {
        Self {
            certain: self.certain && later.certain,
            lost_writes: self.lost_writes.saturating_add(later.lost_writes),
            others: self.others.saturating_add(later.others),
            slack: later.slack,
        }
    }
}

/// Which board is at the end of a bus: what no other board has, whatever its firmware.
///
/// The default is that of a bus whose board cannot be exchanged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct BoardIdentity {
    /// The MAC address, high byte first.
    pub mac: [u8; 6],
    /// The card's name as the board pads it.
    pub card: [u8; 16],
}

/// How much an exchange outside of lists is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// One try with the deadline of the cycle, without allocation.
    Once,
    /// As an [`exchange`](RegisterBus::exchange): repeated when it is lost.
    Repeated,
}

/// The list of a bus that has no form of its own for lists, and [holds](RegisterBus::CAN_HOLD) nothing
/// back.
pub type AccessList = Box<[Access]>;

/// What a bus counted since it was made. Buses that can not lose anything leave all at zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BusStatistics {
    /// Exchanges tried.
    pub exchanges: u64,
    /// Replies that came after their deadline, and were thrown away.
    pub late: u64,
    /// Exchanges without any reply.
    pub lost: u64,
    /// Replies to an earlier request, thrown away.
    pub stale: u64,
    /// Replies that came twice.
    pub duplicate: u64,
    /// Replies with too few or too many bytes.
    pub short: u64,
    /// Datagrams that are no replies, or are not from the board.
    pub foreign: u64,
    /// Write exchanges that the board has not executed.
    pub lost_writes: u64,
    /// Write exchanges that were executed after a reply had shown them missing, or after a newer
    /// one. They are not counted as lost any more. A bus that remembers a limited number takes one
    /// that comes very late for a repeated one.
    pub late_writes: u64,
    /// Executions of write exchanges that were executed before: the network duplicated them, or
    /// another program writes to this board.
    pub repeated_writes: u64,
    /// Write exchanges that nothing is known of, because too many others followed before the board
    /// was heard again.
    pub unconfirmed_writes: u64,
    /// Exchanges that left it uncertain whether the newest write was the last that was executed, or
    /// whether nothing else was since the exchange before. What depends on the last write must not
    /// be trusted after one of them.
    pub doubts: u64,
    /// Packets that the board has received beyond ours, when somebody else drives it: who sends at
    /// least 100 a second all the time is noticed within a second, and again in each while he does;
    /// bursts of less than a fifth of a second are not. Replies have to come ten times a second for
    /// that, what is lost of ours makes others' look less, and each reply that comes twice stands for
    /// four packets of ours that did.
    pub others: u64,
    /// Bytes sent, without the headers of lower layers.
    pub bytes_sent: u64,
    /// Bytes received and accepted, without the headers of lower layers.
    pub bytes_received: u64,
}

/// The time of a bus: virtual in simulation, the host's otherwise.
pub trait Clock {
    /// The time. Never goes back.
    fn now(&mut self) -> Instant;

    /// Lets `duration` pass.
    fn wait(&mut self, duration: Duration);

    /// Lets at least `duration` pass, without using a CPU meanwhile: cheaper than [`wait`](Self::wait),
    /// and less exact. The same where nothing is cheaper.
    fn sleep(&mut self, duration: Duration) {
        self.wait(duration);
    }
}

impl<C: Clock + ?Sized> Clock for &mut C {
    fn now(&mut self) -> Instant {
        (**self).now()
    }

    fn wait(&mut self, duration: Duration) {
        (**self).wait(duration);
    }

    fn sleep(&mut self, duration: Duration) {
        (**self).sleep(duration);
    }
}

/// 32-bit registers at 16-bit byte addresses.
///
/// A bus that has no packets implements [`exchange`](Self::exchange), and with [`AccessList`]:
///
/// ```
/// use mesa_hal::bus::{Access, AccessList, Direction, Hold, RegisterBus, Reply};
///
/// #[derive(Debug)]
/// struct Memory([u32; 16]);
///
/// impl RegisterBus for Memory {
///     type Error = core::convert::Infallible;
///     type List = AccessList;
///
///     fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), Self::Error> {
///         for access in accesses {
///             for (n, word) in words[access.words()].iter_mut().enumerate() {
///                 let register = &mut self.0[usize::from(access.address / 4) + n];
///                 match access.direction {
///                     Direction::Read => *word = *register,
///                     Direction::Write => *register = *word,
///                 }
///             }
///         }
///         Ok(())
///     }
///
///     fn prepare(&mut self, list: &[Access], _: Option<Hold>) -> Result<AccessList, Self::Error> {
///         Ok(list.into())
///     }
///
///     fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, Self::Error> {
///         self.exchange(list, words)?;
///         Ok(Reply::CERTAIN)
///     }
/// }
///
/// let mut bus = Memory([7; 16]);
/// bus.write(0x0C, 9)?;
/// let list = bus.prepare(&[Access::read(0x08, 0, 2)], None)?;
/// let mut words = [0; 2];
/// assert!(bus.run(&list, &mut words)?.certain);
/// assert_eq!(words, [7, 9]);
/// # Ok::<(), core::convert::Infallible>(())
/// ```
///
/// A driver needs the bus to be a [`Clock`] as well. A `&mut B` is a bus, too.
///
/// # Real time
/// `start`, `finish` and `run` are bounded by the deadline of the bus and do not allocate: they are
/// what the cycle uses. The others belong to set-up: they are bounded, but may allocate and try
/// again.
pub trait RegisterBus {
    /// What can go wrong.
    type Error: BusError;

    /// A list of accesses that the bus has checked, in the form it is run in. It still tells what
    /// they are.
    type List: AsRef<[Access]> + Debug + Send;

    /// Whether the board can hold a part of a list back until its next period ([`Hold`]).
    const CAN_HOLD: bool = false;

    /// Runs `accesses` in order on `words`.
    ///
    /// On Ethernet this is one packet out and one packet back, repeated when it is lost. When it
    /// fails, no word of the buffer that a read names has been changed.
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), Self::Error>;

    /// Checks a list against the limits of the bus and brings it into the form it is run in.
    ///
    /// `hold` is for a bus that [can](Self::CAN_HOLD) do that.
    fn prepare(
        &mut self,
        accesses: &[Access],
        hold: Option<Hold>,
    ) -> Result<Self::List, Self::Error>;

    /// Begins to run a list that was prepared on this bus: what it writes is sent, and what it reads
    /// is asked for. [`finish`](Self::finish) ends it; nothing else may be run in between.
    ///
    /// A bus on which nothing can be in flight leaves it all to `finish`, as the provided function
    /// does.
    fn start(&mut self, _list: &Self::List, _words: &[u32]) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Takes the reply to the list that was started. When it fails, no word has been changed.
    ///
    /// A list that reads nothing may have no reply: then nothing is known of its writes before a
    /// later one ([`Reply::UNHEARD`]).
    fn finish(&mut self, list: &Self::List, words: &mut [u32]) -> Result<Reply, Self::Error>;

    /// [`start`](Self::start) and [`finish`](Self::finish).
    fn run(&mut self, list: &Self::List, words: &mut [u32]) -> Result<Reply, Self::Error> {
        self.start(list, words)?;
        self.finish(list, words)
    }

    /// Writes `accesses` as one exchange of the cycle, without a list that was prepared: for writes of
    /// which each time another part is made.
    ///
    /// A bus whose exchanges are packets does it in one packet, without waiting and without
    /// allocation. The provided function makes an [`exchange`](Self::exchange).
    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), Self::Error> {
        self.exchange(accesses, words)
    }

    /// The cycle has this period, and its exchanges may take `deadline` from now on. `None`: what they
    /// may take follows the period, unless the bus was made with something else. A bus on which
    /// nothing can be late ignores it.
    fn set_cycle(&mut self, _period: Duration, _deadline: Option<Duration>) {}

    /// Which board answers: a driver compares it with the board that it was started with before it
    /// writes a set-up again. A bus behind which another board can answer implements it, and one
    /// that is around another bus passes it on.
    ///
    /// # Errors
    /// Those of an exchange.
    fn board(&mut self, _effort: Effort) -> Result<BoardIdentity, Self::Error> {
        Ok(BoardIdentity::default())
    }

    /// What was counted so far: for people. What to do next, a [`Reply`] tells.
    fn statistics(&self) -> BusStatistics {
        BusStatistics::default()
    }

    /// Reads one register.
    fn read(&mut self, address: u16) -> Result<u32, Self::Error> {
        let mut word = [0];
        self.exchange(&[Access::read(address, 0, 1)], &mut word)?;
        let [word] = word;
        Ok(word)
    }

    /// Writes one register.
    fn write(&mut self, address: u16, value: u32) -> Result<(), Self::Error> {
        self.exchange(&[Access::write(address, 0, 1)], &mut [value])
    }
}

impl<B: RegisterBus + ?Sized> RegisterBus for &mut B {
    type Error = B::Error;
    type List = B::List;
    const CAN_HOLD: bool = B::CAN_HOLD;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), B::Error> {
        (**self).exchange(accesses, words)
    }

    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<B::List, B::Error> {
        (**self).prepare(accesses, hold)
    }

    fn start(&mut self, list: &B::List, words: &[u32]) -> Result<(), B::Error> {
        (**self).start(list, words)
    }

    fn finish(&mut self, list: &B::List, words: &mut [u32]) -> Result<Reply, B::Error> {
        (**self).finish(list, words)
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), B::Error> {
        (**self).write_all(accesses, words)
    }

    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        (**self).set_cycle(period, deadline);
    }

    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, B::Error> {
        (**self).board(effort)
    }

    fn statistics(&self) -> BusStatistics {
        (**self).statistics()
    }
}
