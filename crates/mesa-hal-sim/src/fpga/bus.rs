//! The simulated FPGA as a register bus.

use core::time::Duration;

use super::SimFpga;
use mesa_wire::bus::{
    Access, BusError, BusErrorKind, BusStatistics, Clock, Direction, Instant, RegisterBus,
};

/// An access list that the simulated FPGA rejects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// An access names words outside the buffer.
    #[error(
        "access of {count} registers at {address:#06x}: words {first}.. lie outside of the buffer of {len}; give exchange() the buffer the list was made for"
    )]
    OutsideBuffer {
        /// Address of the access.
        address: u16,
        /// Its first word.
        first: u16,
        /// Its number of words.
        count: u16,
        /// Length of the buffer.
        len: usize,
    },
    /// An address is not a multiple of 4.
    #[error("address {address:#06x} is not a multiple of 4; registers are 32 bits wide")]
    Misaligned {
        /// The address.
        address: u16,
    },
    /// An access goes past the end of the address space.
    #[error("access of {count} registers at {address:#06x} goes past address 0xffff; split it")]
    PastEnd {
        /// Address of the access.
        address: u16,
        /// Its number of words.
        count: u16,
    },
}

impl BusError for SimError {
    fn kind(&self) -> BusErrorKind {
        BusErrorKind::Invalid
    }
}

impl RegisterBus for SimFpga {
    type Error = SimError;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), SimError> {
        for access in accesses {
            check(*access, words.len())?;
        }
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

pub(crate) fn check(access: Access, len: usize) -> Result<(), SimError> {
    let Access {
        address,
        first,
        count,
        ..
    } = access;
    if address % 4 != 0 {
        return Err(SimError::Misaligned { address });
    }
    if u32::from(address) + 4 * u32::from(count) > 0x1_0000 {
        return Err(SimError::PastEnd { address, count });
    }
    if access.words().end > len {
        return Err(SimError::OutsideBuffer {
            address,
            first,
            count,
            len,
        });
    }
    Ok(())
}
