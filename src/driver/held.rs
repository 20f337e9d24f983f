//! The bus of a board that must not be left driving anything.

use alloc::vec::Vec;
use core::ops::{Deref, DerefMut};

use crate::bus::{Access, RegisterBus};
use crate::hostmot2::IoPorts;
use crate::modules::watchdog::WatchdogRegisters;

/// A bus. When it is dropped, the board is [released](Self::release).
#[derive(Debug)]
pub(super) struct Held<B: RegisterBus> {
    /// `None` only when it was taken out.
    bus: Option<B>,
    /// What leaves the board driving nothing, ...
    release: Vec<Access>,
    /// ... until it was written.
    words: Vec<u32>,
}

impl<B: RegisterBus> Held<B> {
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

    /// Leaves the board driving nothing: all pins are inputs, and the watchdog bites. Acknowledged,
    /// so that a lost packet is repeated. Once.
    pub fn release(&mut self) -> Result<(), B::Error> {
        let mut words = core::mem::take(&mut self.words);
        match &mut self.bus {
            Some(bus) if !words.is_empty() => bus.exchange(&self.release, &mut words),
            _ => Ok(()),
        }
    }

    /// Nothing is written any more: the board is another one.
    pub fn keep_off(&mut self) {
        self.words.clear();
    }

    /// The bus itself, taken out once, before this is dropped.
    pub fn take(&mut self) -> B {
        self.bus.take().unwrap_or_else(|| gone())
    }
}

/// Only an owned driver can be shut down, and nothing of it is used afterwards.
fn gone() -> ! {
    unreachable!("the bus is taken out last")
}

impl<B: RegisterBus> Deref for Held<B> {
    type Target = B;

    #[inline]
    fn deref(&self) -> &B {
        self.bus.as_ref().unwrap_or_else(|| gone())
    }
}

impl<B: RegisterBus> DerefMut for Held<B> {
    #[inline]
    fn deref_mut(&mut self) -> &mut B {
        self.bus.as_mut().unwrap_or_else(|| gone())
    }
}

impl<B: RegisterBus> Drop for Held<B> {
    fn drop(&mut self) {
        // Nobody is left to tell; the watchdog does the rest.
        let _ = self.release();
    }
}
