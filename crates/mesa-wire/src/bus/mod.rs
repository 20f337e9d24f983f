//! The register bus: 32-bit registers at 16-bit byte addresses.
//!
//! A bus has one primitive: a list of accesses, run in order on the hardware, on a word buffer. The
//! list holds indices and no borrowed slices, so that it can be built once, encoded
//! ([`RegisterBus::prepare`]) and run every cycle. The [`Reply`] indicates whether the writes were
//! executed. Time is a [`Clock`]: virtual in simulation.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

pub mod advice;
mod erased;
mod error;
mod fault;

#[cfg(feature = "std")]
mod host_clock;
mod layer;
mod list;
mod pci_address;

pub use erased::DynBus;
pub use error::{BusError, BusErrorKind, CustomError, LinkError};
pub use fault::Fault;
#[cfg(feature = "std")]
pub use host_clock::{HostClock, SPIN};
pub use layer::{BusLayer, ClockedBus};
pub use list::{AccessList, ListForm};
pub use pci_address::{PciAddress, PciAddressError};

pub use crate::time::Instant;

use alloc::vec::Vec;
use core::time::Duration;

/// Direction in which an access moves its words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// From the register into the word buffer.
    Read,
    /// From the word buffer into the register.
    Write,
}

/// One access: `count` adjacent registers from `address` on (4 bytes apart), and the position of
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

    /// Accesses that write single words to these addresses, in order, and their word buffer.
    pub fn writes(all: impl IntoIterator<Item = (u16, u32)>) -> (Vec<Self>, Vec<u32>) {
        let all = (0..).zip(all);
        all.map(|(n, (address, word))| (Self::write(address, n, 1), word))
            .unzip()
    }

    /// A write of `count` registers from the buffer, from index `first` on.
    pub const fn write(address: u16, first: u16, count: u16) -> Self {
        Self::new(Direction::Write, address, first, count)
    }

    /// An access in the given direction.
    pub const fn new(direction: Direction, address: u16, first: u16, count: u16) -> Self {
        Self {
            address,
            direction,
            first,
            count,
        }
    }

    /// Checks that the registers exist, and that the words are in a buffer of `words` words. A bus
    /// checks all accesses of a list before it runs any.
    ///
    /// # Errors
    /// [`BusError::BadAccess`].
    pub const fn check(self, words: usize) -> Result<(), BusError> {
        if self.is_sound() && self.words().end <= words {
            return Ok(());
        }
        Err(BusError::BadAccess {
            access: self,
            words,
        })
    }

    /// True if all registers exist.
    const fn is_sound(self) -> bool {
        let end = (self.address as u32).saturating_add((self.count as u32).saturating_mul(4));
        self.address.is_multiple_of(4) && end <= 0x1_0000
    }

    /// The indices of the words in the buffer.
    pub const fn words(&self) -> core::ops::Range<usize> {
        let first = self.first as usize;
        first..first.saturating_add(self.count as usize)
    }
}

/// A request that the board holds a part of a list back until its next period begins.
///
/// The board's clock then paces the cycle: [`start`](RegisterBus::start) sends the list, and
/// [`finish`](RegisterBus::finish) returns after the next period has begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Hold {
    /// Index of the first access that waits for the period; all later ones wait too.
    pub before: usize,
    /// Longest wait.
    pub limit: Duration,
}

/// Result of running a list: evidence about the writes, and about other masters.
///
/// A bus starts from [`CERTAIN`](Self::CERTAIN) or [`UNKNOWN`](Self::UNKNOWN) and sets what it
/// knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Reply {
    /// True if all earlier writes since the previous reply, and those of this list, were executed
    /// exactly once and in order. Do not trust values that depend on the last write otherwise.
    pub certain: bool,
    /// Writes that this reply proves missing: not executed by the board, or not in time.
    pub lost_writes: u32,
    /// Packets of another master of the same board: see [`BusStatistics::foreign_packets`].
    pub foreign_packets: u32,
    /// Time for which the board held the list back, if it was asked to: the part of its period that
    /// the host left unused.
    pub slack: Option<Duration>,
}

impl Reply {
    /// All writes have arrived: the reply of a bus that cannot lose anything.
    pub const CERTAIN: Self = Self {
        certain: true,
        lost_writes: 0,
        foreign_packets: 0,
        slack: None,
    };
    /// No reply was expected: the fate of the writes is not known yet.
    pub const UNKNOWN: Self = Self {
        certain: false,
        ..Self::CERTAIN
    };

    /// Sets whether the writes were executed exactly once and in order.
    #[must_use]
    pub const fn with_certain(self, certain: bool) -> Self {
        Self { certain, ..self }
    }

    /// Sets the number of writes that this reply proves missing.
    #[must_use]
    pub const fn with_lost_writes(self, lost_writes: u32) -> Self {
        Self {
            lost_writes,
            ..self
        }
    }

    /// Sets the number of packets of another master.
    #[must_use]
    pub const fn with_foreign_packets(self, foreign_packets: u32) -> Self {
        Self {
            foreign_packets,
            ..self
        }
    }

    /// Sets the time for which the board held the list back.
    #[must_use]
    pub const fn with_slack(self, slack: Option<Duration>) -> Self {
        Self { slack, ..self }
    }

    /// The combined result of this reply and a `later` one.
    #[must_use]
    pub const fn and(self, later: Self) -> Self {
        Self {
            certain: self.certain && later.certain,
            lost_writes: self.lost_writes.saturating_add(later.lost_writes),
            foreign_packets: self.foreign_packets.saturating_add(later.foreign_packets),
            slack: later.slack,
        }
    }
}

/// Identity of the board at the end of a bus: data that no other board shares, whatever its
/// firmware.
///
/// The default value is for a bus whose board cannot be exchanged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct BoardIdentity {
    /// The MAC address, high byte first.
    pub mac: [u8; 6],
    /// The card's name, padded as on the board.
    pub card: [u8; 16],
}

impl BoardIdentity {
    /// The identity of the board with this MAC address and card name.
    pub const fn new(mac: [u8; 6], card: [u8; 16]) -> Self {
        Self { mac, card }
    }
}

/// Effort to spend on an exchange outside of lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// A single attempt within the deadline of the cycle, without allocation.
    Once,
    /// Like an [`exchange`](RegisterBus::exchange): repeated if a packet is lost.
    Repeated,
}

/// Statistics of a bus since its creation. All counts stay zero on a bus that cannot lose anything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BusStatistics {
    /// Exchanges attempted.
    pub exchanges: u64,
    /// Replies that arrived after their deadline and were discarded.
    pub late: u64,
    /// Exchanges without any reply.
    pub lost: u64,
    /// Replies to an earlier request, discarded.
    pub stale: u64,
    /// Duplicate replies.
    pub duplicate: u64,
    /// Replies with too few or too many bytes.
    pub short: u64,
    /// Datagrams that are not replies, or not from the board.
    pub foreign: u64,
    /// Write exchanges that the board has not executed.
    pub lost_writes: u64,
    /// Write exchanges that were executed after a reply had shown them missing, or after a newer
    /// write. They are removed from the count of lost writes. A bus with a bounded memory counts a
    /// very late one as repeated.
    pub late_writes: u64,
    /// Repeated executions of one write exchange: the network duplicated it, or another program
    /// writes to this board.
    pub repeated_writes: u64,
    /// Write exchanges whose fate is unknown: too many others followed before the next reply.
    pub unconfirmed_writes: u64,
    /// Exchanges after which it is uncertain whether the newest write was executed last, or whether
    /// anything else was executed since the exchange before. Do not trust values that depend on the
    /// last write after such an exchange.
    pub doubts: u64,
    /// Packets that the board received beyond those of this bus, while another master drives it. A
    /// master that sends at least 100 packets/s all the time is detected within 1 s, and again in
    /// every second in which it continues; bursts shorter than 0.2 s are not detected. Detection
    /// needs at least ten replies per second. Lost packets of this bus reduce the count, and every
    /// duplicate reply raises the threshold by four packets, as evidence of duplicate requests.
    pub foreign_packets: u64,
    /// Bytes sent, without the headers of lower layers.
    pub bytes_sent: u64,
    /// Bytes received and accepted, without the headers of lower layers.
    pub bytes_received: u64,
}

impl BusStatistics {
    /// Statistics of a bus that only counts its exchanges.
    #[must_use]
    pub fn of_exchanges(exchanges: u64) -> Self {
        Self {
            exchanges,
            ..Self::default()
        }
    }

    /// All counts in the order of the fields, for storage as words.
    #[must_use]
    pub const fn counts(&self) -> [u64; 15] {
        let Self {
            exchanges,
            late,
            lost,
            stale,
            duplicate,
            short,
            foreign,
            lost_writes,
            late_writes,
            repeated_writes,
            unconfirmed_writes,
            doubts,
            foreign_packets,
            bytes_sent,
            bytes_received,
        } = *self;
        [
            exchanges,
            late,
            lost,
            stale,
            duplicate,
            short,
            foreign,
            lost_writes,
            late_writes,
            repeated_writes,
            unconfirmed_writes,
            doubts,
            foreign_packets,
            bytes_sent,
            bytes_received,
        ]
    }

    /// The statistics whose [`counts`](Self::counts) these are.
    #[must_use]
    pub const fn from_counts(counts: [u64; 15]) -> Self {
        let [
            exchanges,
            late,
            lost,
            stale,
            duplicate,
            short,
            foreign,
            lost_writes,
            late_writes,
            repeated_writes,
            unconfirmed_writes,
            doubts,
            foreign_packets,
            bytes_sent,
            bytes_received,
        ] = counts;
        Self {
            exchanges,
            late,
            lost,
            stale,
            duplicate,
            short,
            foreign,
            lost_writes,
            late_writes,
            repeated_writes,
            unconfirmed_writes,
            doubts,
            foreign_packets,
            bytes_sent,
            bytes_received,
        }
    }
}

/// The clock of a bus: virtual in simulation, the host's otherwise.
pub trait Clock {
    /// The current time; never goes back.
    fn now(&mut self) -> Instant;

    /// Waits for `duration`.
    fn wait(&mut self, duration: Duration);

    /// Waits for at least `duration` without using a CPU meanwhile: cheaper than
    /// [`wait`](Self::wait), and less exact. Defaults to `wait`.
    fn sleep(&mut self, duration: Duration) {
        self.wait(duration);
    }
}

/// A bus of 32-bit registers at 16-bit byte addresses.
///
/// A bus without packets implements [`exchange`](Self::exchange) alone:
///
/// ```
/// use mesa_wire::bus::{Access, BusError, Direction, RegisterBus};
///
/// #[derive(Debug)]
/// struct Memory([u32; 0x4000]);
///
/// impl RegisterBus for Memory {
///     fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
///         accesses.iter().try_for_each(|access| access.check(words.len()))?;
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
/// }
///
/// let mut bus = Memory([7; 0x4000]);
/// bus.write(0x0C, 9)?;
/// let list = bus.prepare(&[Access::read(0x08, 0, 2)], None)?;
/// let mut words = [0; 2];
/// assert!(bus.run(&list, &mut words)?.certain);
/// assert_eq!(words, [7, 9]);
/// # Ok::<(), BusError>(())
/// ```
///
/// A driver also needs the bus to be a [`Clock`]. A `&mut B` of such a bus is one as well. What
/// changes a part of another bus is a [`BusLayer`].
///
/// # Real time
/// `start`, `finish` and `run` are bounded by the deadline of the bus and do not allocate: the
/// cycle uses them. The other methods belong to set-up: they are bounded, but may allocate and
/// retry.
pub trait RegisterBus {
    /// True if the board can hold a part of a list back until its next period ([`Hold`]).
    fn can_hold(&self) -> bool {
        false
    }

    /// Runs `accesses` in order on `words`.
    ///
    /// On Ethernet this is one packet out and one packet back, repeated if it is lost. On failure,
    /// no word of the buffer that a read names has changed.
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError>;

    /// Checks a list against the limits of the bus and encodes it. The provided method does
    /// neither.
    ///
    /// `hold` may only be given to a bus that [supports it](Self::can_hold).
    fn prepare(
        &mut self,
        accesses: &[Access],
        _hold: Option<Hold>,
    ) -> Result<AccessList, BusError> {
        Ok(AccessList::new(accesses))
    }

    /// Starts a list that was prepared on this bus: sends its writes and requests its reads.
    /// [`finish`](Self::finish) ends it; nothing else may run in between.
    ///
    /// A bus on which nothing can be in flight leaves all work to `finish`, as the provided method
    /// does.
    fn start(&mut self, _list: &AccessList, _words: &[u32]) -> Result<(), BusError> {
        Ok(())
    }

    /// Takes the reply to the started list. On failure, no word has changed.
    ///
    /// A list without reads may have no reply: the fate of its writes is then unknown until a later
    /// reply ([`Reply::UNKNOWN`]). The provided method makes an [`exchange`](Self::exchange), after
    /// which all writes are certain.
    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        self.exchange(list.as_ref(), words)?;
        Ok(Reply::CERTAIN)
    }

    /// Runs a list: [`start`](Self::start), then [`finish`](Self::finish).
    fn run(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        self.start(list, words)?;
        self.finish(list, words)
    }

    /// Writes `accesses` as one exchange of the cycle, without a prepared list: for writes that
    /// differ from cycle to cycle.
    ///
    /// A bus whose exchanges are packets sends one packet, without waiting for a reply and without
    /// allocation. The provided method makes an [`exchange`](Self::exchange).
    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.exchange(accesses, words)
    }

    /// Sets the period of the cycle, and the `deadline` of its exchanges from now on. With `None`
    /// the deadline follows the period, unless another one was given when the bus was created. A
    /// bus on which nothing can be late ignores the call.
    fn set_cycle(&mut self, _period: Duration, _deadline: Option<Duration>) {}

    /// Identifies the board that answers. A driver compares it with the board of its start before
    /// it writes the set-up again. A bus behind which the board can be exchanged implements this
    /// method, and a [`BusLayer`] passes the call on.
    ///
    /// # Errors
    /// Errors of an exchange.
    fn board(&mut self, _effort: Effort) -> Result<BoardIdentity, BusError> {
        Ok(BoardIdentity::default())
    }

    /// Statistics so far, for display. A program decides what to do next by the [`Reply`].
    fn statistics(&self) -> BusStatistics {
        BusStatistics::default()
    }

    /// Reads one register.
    fn read(&mut self, address: u16) -> Result<u32, BusError> {
        let mut word = [0];
        self.exchange(&[Access::read(address, 0, 1)], &mut word)?;
        let [word] = word;
        Ok(word)
    }

    /// Writes one register.
    fn write(&mut self, address: u16, value: u32) -> Result<(), BusError> {
        self.exchange(&[Access::write(address, 0, 1)], &mut [value])
    }
}
