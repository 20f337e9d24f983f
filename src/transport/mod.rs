//! Buses: LBP16 over UDP, recording and fault-injecting wrappers.

mod faulty;
mod recording;
#[cfg(test)]
mod test_bus;
pub mod udp;

pub use faulty::{Fault, Faulty, FaultyError};
pub use recording::{Entry, Event, Recording};

use crate::bus::Access;

/// A list of a bus around a bus.
#[derive(Clone, Debug)]
pub struct WrappedList<L> {
    accesses: Box<[Access]>,
    inner: L,
}

impl<L> WrappedList<L> {
    fn new(accesses: &[Access], inner: L) -> Self {
        Self {
            accesses: accesses.into(),
            inner,
        }
    }
}
