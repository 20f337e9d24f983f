//! A bus wrapper that measures the host time spent below the driver.

use std::ops::{Deref, DerefMut};
use std::time::{Duration, Instant};

use mesa_hal::bus::{Access, AccessList, BusError, BusLayer, ClockedBus, Reply};

#[derive(Debug)]
pub struct Timed<B> {
    bus: B,
    spent: Duration,
}

impl<B> Timed<B> {
    pub fn new(bus: B) -> Self {
        Self {
            bus,
            spent: Duration::ZERO,
        }
    }

    /// Host time spent in the bus so far, including the simulation.
    pub fn spent(&self) -> Duration {
        self.spent
    }

    fn measured<T>(&mut self, work: impl FnOnce(&mut B) -> T) -> T {
        let start = Instant::now();
        let result = work(&mut self.bus);
        self.spent += start.elapsed();
        result
    }
}

impl<B> Deref for Timed<B> {
    type Target = B;

    fn deref(&self) -> &B {
        &self.bus
    }
}

impl<B> DerefMut for Timed<B> {
    fn deref_mut(&mut self) -> &mut B {
        &mut self.bus
    }
}

impl<B: ClockedBus> BusLayer for Timed<B> {
    type Inner = B;

    fn inner(&self) -> &B {
        &self.bus
    }

    fn inner_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.measured(|bus| bus.exchange(accesses, words))
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), BusError> {
        self.measured(|bus| bus.start(list, words))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        self.measured(|bus| bus.finish(list, words))
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.measured(|bus| bus.write_all(accesses, words))
    }

    fn wait(&mut self, duration: Duration) {
        self.measured(|bus| bus.wait(duration));
    }

    fn sleep(&mut self, duration: Duration) {
        self.measured(|bus| bus.sleep(duration));
    }
}
