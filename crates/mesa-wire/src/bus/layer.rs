//! Layers around a bus.

use core::time::Duration;

use super::{
    Access, AccessList, BoardIdentity, BusError, BusStatistics, Clock, Effort, Hold, Instant,
    RegisterBus, Reply,
};

/// A bus with its clock: the two traits that a driver needs. Every such type has it.
pub trait ClockedBus: RegisterBus + Clock {}

impl<B: RegisterBus + Clock + ?Sized> ClockedBus for B {}

/// A layer around a bus: it says only what it changes, and everything else is passed on to the bus
/// inside. Every layer is a [`RegisterBus`] and a [`Clock`].
///
/// A layer that counts the exchanges of the cycle:
///
/// ```
/// use mesa_wire::bus::{AccessList, BusError, BusLayer, ClockedBus, Reply};
///
/// struct Counted<B> {
///     inner: B,
///     cycles: u64,
/// }
///
/// impl<B: ClockedBus> BusLayer for Counted<B> {
///     type Inner = B;
///
///     fn inner(&self) -> &B {
///         &self.inner
///     }
///
///     fn inner_mut(&mut self) -> &mut B {
///         &mut self.inner
///     }
///
///     fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
///         self.cycles += 1;
///         self.inner.finish(list, words)
///     }
/// }
/// ```
///
/// The functions have the names and the meaning of those of [`RegisterBus`] and [`Clock`]. One that
/// is not here ([`run`](RegisterBus::run), [`read`](RegisterBus::read),
/// [`write`](RegisterBus::write)) is made of these.
pub trait BusLayer {
    /// The bus inside.
    type Inner: ClockedBus + ?Sized;

    /// The bus inside.
    fn inner(&self) -> &Self::Inner;

    /// The bus inside, to be used.
    fn inner_mut(&mut self) -> &mut Self::Inner;

    /// As [`RegisterBus::can_hold`].
    fn can_hold(&self) -> bool {
        self.inner().can_hold()
    }

    /// As [`RegisterBus::exchange`].
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.inner_mut().exchange(accesses, words)
    }

    /// As [`RegisterBus::prepare`].
    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<AccessList, BusError> {
        self.inner_mut().prepare(accesses, hold)
    }

    /// As [`RegisterBus::start`].
    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), BusError> {
        self.inner_mut().start(list, words)
    }

    /// As [`RegisterBus::finish`].
    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        self.inner_mut().finish(list, words)
    }

    /// As [`RegisterBus::write_all`].
    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.inner_mut().write_all(accesses, words)
    }

    /// As [`RegisterBus::set_cycle`].
    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        self.inner_mut().set_cycle(period, deadline);
    }

    /// As [`RegisterBus::board`].
    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, BusError> {
        self.inner_mut().board(effort)
    }

    /// As [`RegisterBus::statistics`].
    fn statistics(&self) -> BusStatistics {
        self.inner().statistics()
    }

    /// As [`Clock::now`].
    fn now(&mut self) -> Instant {
        self.inner_mut().now()
    }

    /// As [`Clock::wait`].
    fn wait(&mut self, duration: Duration) {
        self.inner_mut().wait(duration);
    }

    /// As [`Clock::sleep`].
    fn sleep(&mut self, duration: Duration) {
        self.inner_mut().sleep(duration);
    }
}

/// A reference is a layer that changes nothing.
impl<B: ClockedBus + ?Sized> BusLayer for &mut B {
    type Inner = B;

    fn inner(&self) -> &B {
        self
    }

    fn inner_mut(&mut self) -> &mut B {
        self
    }
}

impl<L: BusLayer> RegisterBus for L {
    fn can_hold(&self) -> bool {
        BusLayer::can_hold(self)
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        BusLayer::exchange(self, accesses, words)
    }

    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<AccessList, BusError> {
        BusLayer::prepare(self, accesses, hold)
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), BusError> {
        BusLayer::start(self, list, words)
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        BusLayer::finish(self, list, words)
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        BusLayer::write_all(self, accesses, words)
    }

    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        BusLayer::set_cycle(self, period, deadline);
    }

    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, BusError> {
        BusLayer::board(self, effort)
    }

    fn statistics(&self) -> BusStatistics {
        BusLayer::statistics(self)
    }
}

impl<L: BusLayer> Clock for L {
    fn now(&mut self) -> Instant {
        BusLayer::now(self)
    }

    fn wait(&mut self, duration: Duration) {
        BusLayer::wait(self, duration);
    }

    fn sleep(&mut self, duration: Duration) {
        BusLayer::sleep(self, duration);
    }
}
