//! The register bus: 32-bit registers at 16-bit byte addresses.
//!
//! A bus has one primitive, [`RegisterBus::exchange`]: a list of accesses, run in order on the
//! hardware, on a word buffer. The list holds indices and no borrowed slices, so that it can be
//! built once, kept, pre-encoded ([`RegisterBus::prepare`]) and run every cycle.
//! Time belongs to the bus too, because in simulation it is virtual.

mod error;
mod image;
#[allow(dead_code)]
pub mod process_image;

pub use error::{BusError, BusErrorKind};
pub use image::{
    CycleImage, ImageError, ImageLimits, ImagePlan, ImageSize, ReadPhase, ReadSlot, Tier,
    WritePhase, WriteSlot,
};

use alloc::boxed::Box;
use core::time::Duration;

/// A point on the clock of a bus: nanoseconds since an origin of the bus's own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
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
        let nanos = duration.as_nanos();
        if nanos > u64::MAX as u128 {
            return Self(u64::MAX);
        }
        Self(self.0.saturating_add(nanos as u64))
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
        Self {
            address,
            direction: Direction::Read,
            first,
            count,
        }
    }

    /// A write of `count` registers from the buffer, from `first` on.
    pub const fn write(address: u16, first: u16, count: u16) -> Self {
        Self {
            address,
            direction: Direction::Write,
            first,
            count,
        }
    }

    /// The indices of the words in the buffer.
    pub const fn words(&self) -> core::ops::Range<usize> {
        self.first as usize..self.first as usize + self.count as usize
    }
}

/// An access list that a bus has checked and, where that helps, encoded.
#[derive(Debug)]
pub struct Prepared {
    accesses: Box<[Access]>,
    slot: usize,
}

impl Prepared {
    /// For implementors of [`RegisterBus::prepare`]: the list, and what the bus finds its own
    /// encoding by.
    pub fn new(accesses: &[Access], slot: usize) -> Self {
        Self {
            accesses: accesses.into(),
            slot,
        }
    }

    /// The list.
    pub fn accesses(&self) -> &[Access] {
        &self.accesses
    }

    /// What the bus finds its own encoding by.
    pub fn slot(&self) -> usize {
        self.slot
    }
}

/// What a bus counted since it was made. Buses that can not lose anything leave all at zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
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
    /// one. They are not counted as lost any more. A bus that can remember only so many takes one
    /// that comes very late for a repeated one.
    pub late_writes: u64,
    /// Executions of write exchanges that were executed before: the network doubled them, or
    /// another program writes to this board.
    pub repeated_writes: u64,
    /// Write exchanges that nothing is known of, because too many others followed before the board
    /// was heard again.
    pub unconfirmed_writes: u64,
    /// Exchanges that left it uncertain whether the newest write was the last that was executed, or
    /// whether nothing else was since the exchange before. What depends on the last write must not
    /// be trusted after one of them.
    pub doubts: u64,
    /// Bytes sent, without the headers of lower layers.
    pub bytes_sent: u64,
    /// Bytes received and accepted, without the headers of lower layers.
    pub bytes_received: u64,
}

/// The most accesses of one exchange that [`RegisterBus::write_some`] makes.
const SOME: usize = 64;

/// 32-bit registers at 16-bit byte addresses, and the time at which they are accessed.
///
/// Implement [`exchange`](Self::exchange), [`now`](Self::now) and [`wait`](Self::wait); the rest is
/// provided on top. A `&mut B` is a bus as well.
///
/// # Real time
/// `exchange_prepared` is bounded by the deadline of the bus and does not allocate: it is what the
/// cycle uses. The others belong to set-up: they are bounded, but may allocate and try again.
pub trait RegisterBus {
    /// What can go wrong.
    type Error: BusError;

    /// Runs `accesses` in order on `words`.
    ///
    /// On Ethernet this is one packet out and, if anything is read, one packet back. When it
    /// fails, no word of the buffer that a read names has been changed.
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), Self::Error>;

    /// The time on the clock of the bus. Never goes back.
    fn now(&mut self) -> Instant;

    /// Lets `duration` pass.
    fn wait(&mut self, duration: Duration);

    /// Checks a list against the limits of the bus and keeps it in the form it is run in.
    fn prepare(&mut self, accesses: &[Access]) -> Result<Prepared, Self::Error> {
        Ok(Prepared::new(accesses, 0))
    }

    /// [`exchange`](Self::exchange) of a list that was prepared on this bus.
    fn exchange_prepared(
        &mut self,
        prepared: &Prepared,
        words: &mut [u32],
    ) -> Result<(), Self::Error> {
        self.exchange(prepared.accesses(), words)
    }

    /// Writes those accesses of a list that are `wanted`, in order and as one exchange of the cycle:
    /// for lists of which another part is written each time. All of them are writes.
    ///
    /// A bus whose exchanges are packets does it in one packet, without waiting and without
    /// allocation. The provided function makes one [`exchange`](Self::exchange) of up to 64
    /// accesses each.
    fn write_some(
        &mut self,
        accesses: &[Access],
        wanted: &[bool],
        words: &mut [u32],
    ) -> Result<(), Self::Error> {
        let mut chunk = [Access::write(0, 0, 0); SOME];
        let mut count = 0;
        for (access, _) in accesses.iter().zip(wanted).filter(|(_, wanted)| **wanted) {
            if let Some(place) = chunk.get_mut(count) {
                *place = *access;
                count += 1;
            }
            if count == SOME {
                self.exchange(&chunk, words)?;
                count = 0;
            }
        }
        match chunk.get(..count) {
            Some([]) | None => Ok(()),
            Some(rest) => self.exchange(rest, words),
        }
    }

    /// Prepares a list that only reads, to be run at the beginning of the board's next period: the
    /// board holds it back until then, but not longer than `limit`. With that the board's clock
    /// paces the cycle: [`post`](Self::post) it after the writes, and [`collect`](Self::collect)
    /// returns when the next period has begun.
    ///
    /// `None`: this bus can not do that.
    fn prepare_paced(
        &mut self,
        _accesses: &[Access],
        _limit: Duration,
    ) -> Result<Option<Prepared>, Self::Error> {
        Ok(None)
    }

    /// Sends the request of a prepared list that only reads, without waiting for the reply. A bus
    /// on which requests can not be under way does it all in [`collect`](Self::collect).
    fn post(&mut self, _prepared: &Prepared) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Takes the reply to the request that was posted last. If that was another list, or any
    /// other exchange came between, it is [`exchange_prepared`](Self::exchange_prepared).
    fn collect(&mut self, prepared: &Prepared, words: &mut [u32]) -> Result<(), Self::Error> {
        self.exchange_prepared(prepared, words)
    }

    /// How long the board held the last list back, if that was a paced one: what the host had left
    /// of its period.
    fn slack(&self) -> Option<Duration> {
        None
    }

    /// Sets how long an exchange of the cycle may take from now on. A bus on which nothing can be
    /// late ignores it.
    fn set_cycle_deadline(&mut self, _deadline: Duration) {}

    /// The cycle has this period: a deadline that nobody has set otherwise follows it.
    fn follow_period(&mut self, _period: Duration) {}

    /// What was counted so far.
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

    /// Reads neighbouring registers into `words`.
    fn read_block(&mut self, address: u16, words: &mut [u32]) -> Result<(), Self::Error> {
        self.exchange(&[Access::read(address, 0, words.len() as u16)], words)
    }
}

impl<B: RegisterBus + ?Sized> RegisterBus for &mut B {
    type Error = B::Error;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), Self::Error> {
        (**self).exchange(accesses, words)
    }

    fn now(&mut self) -> Instant {
        (**self).now()
    }

    fn wait(&mut self, duration: Duration) {
        (**self).wait(duration);
    }

    fn prepare(&mut self, accesses: &[Access]) -> Result<Prepared, Self::Error> {
        (**self).prepare(accesses)
    }

    fn exchange_prepared(
        &mut self,
        prepared: &Prepared,
        words: &mut [u32],
    ) -> Result<(), Self::Error> {
        (**self).exchange_prepared(prepared, words)
    }

    fn write_some(
        &mut self,
        accesses: &[Access],
        wanted: &[bool],
        words: &mut [u32],
    ) -> Result<(), Self::Error> {
        (**self).write_some(accesses, wanted, words)
    }

    fn prepare_paced(
        &mut self,
        accesses: &[Access],
        limit: Duration,
    ) -> Result<Option<Prepared>, Self::Error> {
        (**self).prepare_paced(accesses, limit)
    }

    fn post(&mut self, prepared: &Prepared) -> Result<(), Self::Error> {
        (**self).post(prepared)
    }

    fn collect(&mut self, prepared: &Prepared, words: &mut [u32]) -> Result<(), Self::Error> {
        (**self).collect(prepared, words)
    }

    fn slack(&self) -> Option<Duration> {
        (**self).slack()
    }

    fn set_cycle_deadline(&mut self, deadline: Duration) {
        (**self).set_cycle_deadline(deadline);
    }

    fn follow_period(&mut self, period: Duration) {
        (**self).follow_period(period);
    }

    fn statistics(&self) -> BusStatistics {
        (**self).statistics()
    }
}
