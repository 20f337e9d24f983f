//! The simulated FPGA as a register bus.

use core::time::Duration;

use super::SimFpga;
use mesa_wire::bus::{Access, BusError, BusStatistics, Clock, Direction, Instant, RegisterBus};

impl RegisterBus for SimFpga {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        accesses
            .iter()
            .try_for_each(|access| access.check(words.len()))?;
        self.exchanges += 1;
        for access in accesses {
            let words = words.get_mut(access.words()).unwrap_or_default();
            for (index, word) in words.iter_mut().enumerate() {
                self.advance_to(self.fabric.now.saturating_add(self.access_cost));
                let address = access.address.wrapping_add(4 * index as u16);
                match access.direction {
                    Direction::Read => *word = self.read_register(address),
                    Direction::Write => self.write_register(address, *word),
                }
            }
        }
        Ok(())
    }

    fn statistics(&self) -> BusStatistics {
        BusStatistics::of_exchanges(self.exchanges)
    }
}

impl Clock for SimFpga {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.fabric.now)
    }

    fn wait(&mut self, duration: Duration) {
        let nanos = u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        self.advance_to(self.fabric.now.saturating_add(nanos));
    }
}
