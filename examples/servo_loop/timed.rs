//! A bus around a bus that measures the host time spent below the driver.

use std::ops::{Deref, DerefMut};
use std::time::{Duration, Instant};

use mesa_hal::bus::{Access, BusStatistics, Prepared, RegisterBus};

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

    /// Host time spent in the bus, and with it in the simulation, so far.
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

impl<B: RegisterBus> RegisterBus for Timed<B> {
    type Error = B::Error;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), B::Error> {
        self.measured(|bus| bus.exchange(accesses, words))
    }

    fn now(&mut self) -> mesa_hal::bus::Instant {
        self.bus.now()
    }

    fn wait(&mut self, duration: Duration) {
        self.measured(|bus| bus.wait(duration));
    }

    fn prepare(&mut self, accesses: &[Access]) -> Result<Prepared, B::Error> {
        self.bus.prepare(accesses)
    }

    fn exchange_prepared(
        &mut self,
        prepared: &Prepared,
        words: &mut [u32],
    ) -> Result<(), B::Error> {
        self.measured(|bus| bus.exchange_prepared(prepared, words))
    }

    fn write_some(
        &mut self,
        accesses: &[Access],
        wanted: &[bool],
        words: &mut [u32],
    ) -> Result<(), B::Error> {
        self.measured(|bus| bus.write_some(accesses, wanted, words))
    }

    fn prepare_paced(
        &mut self,
        accesses: &[Access],
        limit: Duration,
    ) -> Result<Option<Prepared>, B::Error> {
        self.bus.prepare_paced(accesses, limit)
    }

    fn post(&mut self, prepared: &Prepared) -> Result<(), B::Error> {
        self.measured(|bus| bus.post(prepared))
    }

    fn collect(&mut self, prepared: &Prepared, words: &mut [u32]) -> Result<(), B::Error> {
        self.measured(|bus| bus.collect(prepared, words))
    }

    fn slack(&self) -> Option<Duration> {
        self.bus.slack()
    }

    fn set_cycle_deadline(&mut self, deadline: Duration) {
        self.bus.set_cycle_deadline(deadline);
    }

    fn follow_period(&mut self, period: Duration) {
        self.bus.follow_period(period);
    }

    fn statistics(&self) -> BusStatistics {
        self.bus.statistics()
    }
}
