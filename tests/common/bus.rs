//! Fake buses: registers provided by a test, or a test between the host and a simulated FPGA.

use std::ops::{Deref, DerefMut};
use std::time::Duration;

use mesa_hal::bus::{Access, BusError, BusStatistics, Clock, Direction, Instant, RegisterBus};
use mesa_hal_sim::SimFpga;

/// Time for a word, in nanoseconds.
const ACCESS: u64 = 100;

/// The registers behind a [`FakeBus`].
pub trait Registers {
    fn read(&mut self, address: u16, now: u64) -> u32;
    fn write(&mut self, address: u16, word: u32, now: u64);
}

/// A bus of made-up registers on a virtual clock.
#[derive(Clone, Debug, Default)]
pub struct FakeBus<R> {
    pub registers: R,
    pub now: u64,
    /// The clock always returns 0.
    pub is_stopped: bool,
    pub exchanges: usize,
    /// Number of words read or written.
    pub accesses: usize,
}

impl<R> FakeBus<R> {
    pub fn over(registers: R) -> Self {
        Self {
            registers,
            now: 0,
            is_stopped: false,
            exchanges: 0,
            accesses: 0,
        }
    }
}

impl<R> Deref for FakeBus<R> {
    type Target = R;

    fn deref(&self) -> &R {
        &self.registers
    }
}

impl<R> DerefMut for FakeBus<R> {
    fn deref_mut(&mut self) -> &mut R {
        &mut self.registers
    }
}

impl<R: Registers> RegisterBus for FakeBus<R> {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.exchanges += 1;
        for access in accesses {
            for (address, index) in (access.address..).step_by(4).zip(access.words()) {
                assert!(address.is_multiple_of(4), "{address:#06X}");
                self.accesses += 1;
                self.now += ACCESS;
                match access.direction {
                    Direction::Read => words[index] = self.registers.read(address, self.now),
                    Direction::Write => self.registers.write(address, words[index], self.now),
                }
            }
        }
        Ok(())
    }
}

impl<R> Clock for FakeBus<R> {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(if self.is_stopped { 0 } else { self.now })
    }

    fn wait(&mut self, duration: Duration) {
        self.now += duration.as_nanos() as u64;
    }
}

/// Modifies exchanges on their way to a simulated FPGA.
pub trait Between {
    fn exchange(
        &mut self,
        fpga: &mut SimFpga,
        accesses: &[Access],
        words: &mut [u32],
    ) -> Result<(), BusError>;
}

/// A simulated FPGA behind a [`Between`].
#[derive(Debug)]
pub struct Around<T> {
    pub fpga: SimFpga,
    pub between: T,
}

impl<T: Between> RegisterBus for Around<T> {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.between.exchange(&mut self.fpga, accesses, words)
    }

    fn statistics(&self) -> BusStatistics {
        self.fpga.statistics()
    }
}

impl<T> Clock for Around<T> {
    fn now(&mut self) -> Instant {
        Clock::now(&mut self.fpga)
    }

    fn wait(&mut self, duration: Duration) {
        self.fpga.wait(duration);
    }
}
