//! The bus of a board whose outputs must not stay driven.

use alloc::vec::Vec;

use crate::bus::{Access, BusError, BusLayer, Clock, RegisterBus};
use crate::hostmot2::IoPorts;
use crate::modules::watchdog::WatchdogRegisters;

/// A layer that changes nothing until it is dropped, which [releases](Self::release) the board.
#[derive(Debug)]
pub(super) struct SafeBus<B: RegisterBus> {
    /// `None` only after it was taken out.
    bus: Option<B>,
    /// The accesses that make the board drive nothing.
    release: Vec<Access>,
    /// Their words; empty after they were written.
    words: Vec<u32>,
}

impl<B: RegisterBus> SafeBus<B> {
    pub fn new(bus: B, ports: &IoPorts, watchdog: &WatchdogRegisters) -> Self {
        let ports = ports.ports.iter().map(|port| port.address);
        let directions = ports.clone().map(|at| (at.direction, 0));
        let open_drains = ports.map(|at| (at.open_drain, 0));
        let bite = (watchdog.time, WatchdogRegisters::AT_ONCE);
        let (release, words) = Access::writes(directions.chain(open_drains).chain([bite]));
        Self {
            bus: Some(bus),
            release,
            words,
        }
    }

    /// Makes the board drive nothing: all pins are inputs, and the watchdog bites. Acknowledged, so
    /// that a lost packet is repeated. Only once.
    pub fn release(&mut self) -> Result<(), BusError> {
        let mut words = core::mem::take(&mut self.words);
        match &mut self.bus {
            Some(bus) if !words.is_empty() => bus.exchange(&self.release, &mut words),
            _ => Ok(()),
        }
    }

    /// Prevents the release: the board is another one.
    pub fn keep_off(&mut self) {
        self.words.clear();
    }

    /// Takes the bus out, once, before this is dropped.
    pub fn take(&mut self) -> B {
        self.bus.take().unwrap_or_else(|| gone())
    }
}

/// Unreachable: only an owned driver can be shut down, and no part of it is used afterwards.
#[expect(clippy::unreachable, reason = "ownership excludes it")]
fn gone() -> ! {
    unreachable!("the bus is taken out last")
}

impl<B: RegisterBus + Clock> BusLayer for SafeBus<B> {
    type Inner = B;

    #[inline]
    fn inner(&self) -> &B {
        self.bus.as_ref().unwrap_or_else(|| gone())
    }

    #[inline]
    fn inner_mut(&mut self) -> &mut B {
        self.bus.as_mut().unwrap_or_else(|| gone())
    }
}

impl<B: RegisterBus> Drop for SafeBus<B> {
    fn drop(&mut self) {
        // An error cannot be returned here; the watchdog makes the board safe.
        let _ = self.release();
    }
}
