//! A bus whose type is chosen at run time.

use super::{BusLayer, ClockedBus};
use alloc::boxed::Box;
use core::fmt;

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
pub struct DynBus(Box<dyn ClockedBus + Send>);

impl DynBus {
    /// Hides the type of a bus.
    pub fn new<B: ClockedBus + Send + 'static>(bus: B) -> Self {
        Self(Box::new(bus))
    }
}

impl fmt::Debug for DynBus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DynBus").finish_non_exhaustive()
    }
}

impl BusLayer for DynBus {
    type Inner = dyn ClockedBus + Send;

    fn inner(&self) -> &Self::Inner {
        &*self.0
    }

    fn inner_mut(&mut self) -> &mut Self::Inner {
        &mut *self.0
    }
}

#[cfg(test)]
mod tests {
    use super::DynBus;
    use crate::bus::{Access, BusError, Clock, RegisterBus, Reply};
    use crate::time::Instant;
    use core::time::Duration;

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
    fn bus_works_as_before_when_its_type_is_hidden() {
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
