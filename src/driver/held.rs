//! The bus of a board that must not be left driving anything.

use alloc::vec::Vec;
use core::ops::{Deref, DerefMut};

use crate::bus::{Access, RegisterBus};
use crate::hostmot2::IoPorts;
use crate::modules::watchdog::WatchdogRegisters;

/// A bus. When it is dropped, the board is [released](Self::release).
#[derive(Debug)]
pub(super) struct Held<B: RegisterBus> {
    /// `None` only while it is taken out.
    bus: Option<B>,
    /// What leaves the board driving nothing.
    release: Vec<(u16, u32)>,
    is_released: bool,
}

impl<B: RegisterBus> Held<B> {
    pub fn new(bus: B, ports: &IoPorts, watchdog: &WatchdogRegisters) -> Self {
        let ports = || ports.ports.iter().map(|port| port.address);
        let (directions, open_drains) = (
            ports().map(|at| at.direction),
            ports().map(|at| at.open_drain),
        );
        let inputs = directions.chain(open_drains);
        let mut release: Vec<_> = inputs.map(|address| (address, 0)).collect();
        release.push((watchdog.time, WatchdogRegisters::AT_ONCE));
        Self {
            bus: Some(bus),
            release,
            is_released: false,
        }
    }

    /// Leaves the board driving nothing: all pins are inputs, and the watchdog bites. Acknowledged,
    /// so that a lost packet is repeated.
    pub fn release(&mut self) -> Result<(), B::Error> {
        self.is_released = true;
        let accesses: Vec<_> = (0u16..)
            .zip(&self.release)
            .map(|(n, &(address, _))| Access::write(address, n, 1))
            .collect();
        let mut words: Vec<_> = self.release.iter().map(|&(_, word)| word).collect();
        match &mut self.bus {
            Some(bus) => bus.exchange(&accesses, &mut words),
            None => Ok(()),
        }
    }

    /// The bus itself, taken out once, before this is dropped.
    pub fn take(&mut self) -> B {
        self.is_released = true;
        match self.bus.take() {
            Some(bus) => bus,
            None => unreachable!("a driver that is being dropped is not shut down again"),
        }
    }
}

impl<B: RegisterBus> Deref for Held<B> {
    type Target = B;

    #[inline]
    fn deref(&self) -> &B {
        match &self.bus {
            Some(bus) => bus,
            None => unreachable!("it is only taken where nobody has it any more"),
        }
    }
}

impl<B: RegisterBus> DerefMut for Held<B> {
    #[inline]
    fn deref_mut(&mut self) -> &mut B {
        match &mut self.bus {
            Some(bus) => bus,
            None => unreachable!("it is only taken where nobody has it any more"),
        }
    }
}

impl<B: RegisterBus> Drop for Held<B> {
    fn drop(&mut self) {
        if !self.is_released {
            // Nobody is left to tell; the watchdog does the rest.
            let _ = self.release();
        }
    }
}
