//! A bus whose type is chosen at run time.

use super::{
    Access, AccessList, BoardIdentity, BusError, BusStatistics, Clock, Effort, Hold, Instant,
    RegisterBus, Reply,
};
use alloc::boxed::Box;
use core::fmt;
use core::time::Duration;

/// A bus of any type, chosen at run time: for programs that take a board or a simulated one.
///
/// ```
/// use mesa_wire::bus::DynBus;
/// # use mesa_wire::bus::{Access, BusError, Clock, Instant, RegisterBus};
/// # use core::time::Duration;
/// # struct Board;
/// # struct Simulator;
/// # macro_rules! bus { ($($name:ident)*) => { $(
/// # impl RegisterBus for $name {
/// #     fn exchange(&mut self, _: &[Access], _: &mut [u32]) -> Result<(), BusError> { Ok(()) }
/// # }
/// # impl Clock for $name {
/// #     fn now(&mut self) -> Instant { Instant::default() }
/// #     fn wait(&mut self, _: Duration) {}
/// # } )* } }
/// # bus!(Board Simulator);
///
/// fn open(is_simulated: bool) -> DynBus {
///     if is_simulated {
///         DynBus::new(Simulator)
///     } else {
///         DynBus::new(Board)
///     }
/// }
/// # open(true).read(0x100).unwrap();
/// # open(false).read(0x100).unwrap();
/// ```
///
/// # Real time
/// As the bus inside, with one indirect call for each call.
pub struct DynBus(Box<dyn ErasedBus>);

impl DynBus {
    /// Hides the type of a bus.
    pub fn new<B: RegisterBus + Clock + Send + 'static>(bus: B) -> Self {
        Self(Box::new(bus))
    }
}

impl fmt::Debug for DynBus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DynBus").finish_non_exhaustive()
    }
}

trait ErasedBus: RegisterBus + Clock + Send {}

impl<B: RegisterBus + Clock + Send> ErasedBus for B {}

impl RegisterBus for DynBus {
    fn can_hold(&self) -> bool {
        self.0.can_hold()
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.0.exchange(accesses, words)
    }

    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<AccessList, BusError> {
        self.0.prepare(accesses, hold)
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), BusError> {
        self.0.start(list, words)
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        self.0.finish(list, words)
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.0.write_all(accesses, words)
    }

    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        self.0.set_cycle(period, deadline);
    }

    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, BusError> {
        self.0.board(effort)
    }

    fn statistics(&self) -> BusStatistics {
        self.0.statistics()
    }
}

impl Clock for DynBus {
    fn now(&mut self) -> Instant {
        self.0.now()
    }

    fn wait(&mut self, duration: Duration) {
        self.0.wait(duration);
    }

    fn sleep(&mut self, duration: Duration) {
        self.0.sleep(duration);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAILURE: BusError = BusError::NotStarted;

    struct Bus(Result<(), BusError>);

    impl RegisterBus for Bus {
        fn exchange(&mut self, _: &[Access], words: &mut [u32]) -> Result<(), BusError> {
            self.0?;
            words.fill(7);
            Ok(())
        }

        fn can_hold(&self) -> bool {
            true
        }
    }

    impl Clock for Bus {
        fn now(&mut self) -> Instant {
            Instant::from_nanos(5)
        }

        fn wait(&mut self, _: Duration) {}
    }

    #[test]
    fn a_bus_works_as_before_when_its_type_is_hidden() {
        let mut bus = DynBus::new(Bus(Ok(())));
        assert_eq!(bus.read(0x100), Ok(7));
        let list = bus
            .prepare(&[Access::read(0x100, 0, 1)], None)
            .expect("a list");
        let mut words = [0];
        assert_eq!(bus.run(&list, &mut words), Ok(Reply::CERTAIN));
        assert_eq!(
            (words, bus.now().as_nanos(), bus.can_hold()),
            ([7], 5, true)
        );
        assert_eq!(DynBus::new(Bus(Err(FAILURE))).read(0x100), Err(FAILURE));
    }
}
