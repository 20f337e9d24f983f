//! The simulated FPGA: a HostMot2 firmware as a register file on a virtual clock.

mod bus;
mod decode;
mod director;
mod dispatch;
mod fabric;
pub(crate) mod firmware;
mod image;
mod installation;
mod plant;
mod reload;
mod slots;
mod world_side;

pub use director::{ChangeCause, Director};
pub use fabric::Fabric;
pub use firmware::{OUTPUT_PIN, SimFirmware, SimModuleDescriptor, SimPinDescriptor, gtag};
pub use image::{FirmwareImage, FirmwareImageError};
pub use plant::{AxisWiring, DriveSignal, DriveSource, Readout, StepperWiring};
pub(crate) use world_side::device;

use crate::modules::Effect;
use crate::wire::Nanos;
use decode::{AddressSpace, Target};

/// Value that a write-only register reads as: no module drives the bus, and a host must not rely on
/// the value. FACTS 12.11.
pub const UNDRIVEN: u32 = u32::MAX;

/// Default time of one register access: about that of a PCI read.
pub const DEFAULT_ACCESS_COST: Nanos = 600;

/// Access statistics, with the accesses that have no effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AccessCounters {
    /// Registers read.
    pub reads: u64,
    /// Registers written.
    pub writes: u64,
    /// Reads of addresses without a register; they read 0.
    pub unknown_reads: u64,
    /// Writes to addresses without a register; no effect. LinuxCNC writes 0x0000 at start.
    pub unknown_writes: u64,
    /// Writes to identification or IDROM; no effect.
    pub rom_writes: u64,
}

/// A simulated FPGA, with everything plugged into it and wired to it.
///
/// Time is virtual: it advances with [`advance_to`](Self::advance_to), and with each access through
/// [`RegisterBus`](mesa_wire::bus::RegisterBus). The simulation does not sleep, does not allocate
/// after construction, and two runs with the same accesses give the same results.
#[derive(Debug)]
pub struct SimFpga {
    fabric: Fabric,
    space: AddressSpace,
    access_cost: Nanos,
    exchanges: u64,
    counters: AccessCounters,
    director: Option<Box<dyn Director>>,
}

impl SimFpga {
    /// An FPGA at power-up, with nothing plugged in.
    pub fn new(firmware: SimFirmware) -> Self {
        let mut fpga = Self {
            space: AddressSpace::new(&firmware),
            fabric: Fabric::new(firmware),
            access_cost: DEFAULT_ACCESS_COST,
            exchanges: 0,
            counters: AccessCounters::default(),
            director: None,
        };
        for slot in 0..fpga.fabric.modules.len() {
            fpga.map_module(slot);
        }
        fpga
    }

    /// Maps the registers of the module in a slot.
    fn map_module(&mut self, slot: usize) {
        let Fabric {
            firmware,
            io,
            modules,
            ..
        } = &self.fabric;
        self.space.map(slot, &modules.addresses(slot, firmware, io));
    }

    /// Virtual time since power-up.
    pub fn now(&self) -> Nanos {
        self.fabric.now()
    }

    /// Advances to `to`; no effect if that is in the past.
    ///
    /// The cost is proportional to the time, and to the motion and communication in it.
    pub fn advance_to(&mut self, to: Nanos) {
        while let Some(at) = self.scene(to) {
            self.pass(at);
            self.play();
        }
        self.pass(to);
    }

    /// Advances to `to`, before which the director does not act.
    fn pass(&mut self, to: Nanos) {
        while let Some(at) = self.fabric.next_event(to) {
            self.fabric.run_to(at);
            for slot in 0..self.fabric.modules.len() {
                let cause = match self.fabric.event(slot) {
                    Effect::Nothing => continue,
                    Effect::Outputs => ChangeCause::Write,
                    Effect::Bite => ChangeCause::Bite,
                };
                self.show(cause);
            }
        }
        self.fabric.run_to(to);
    }

    /// Reads the register at a byte address, now and in no time.
    pub fn read_register(&mut self, address: u16) -> u32 {
        self.counters.reads += 1;
        if self.fabric.is_in_reset() {
            return u32::MAX;
        }
        match self.space.at(address) {
            Target::Nothing => {
                self.counters.unknown_reads += 1;
                0
            }
            Target::Rom(index) => self.space.rom(index),
            Target::Module {
                slot,
                register,
                instance,
            } => self.fabric.read(slot.into(), register, instance),
        }
    }

    /// Writes the register at a byte address, now and in no time.
    pub fn write_register(&mut self, address: u16, value: u32) {
        self.counters.writes += 1;
        if self.fabric.is_in_reset() {
            return;
        }
        match self.space.at(address) {
            Target::Nothing => self.counters.unknown_writes += 1,
            Target::Rom(_) => self.counters.rom_writes += 1,
            Target::Module {
                slot,
                register,
                instance,
            } => {
                if self.fabric.write(slot.into(), register, instance, value) {
                    self.show(ChangeCause::Write);
                }
            }
        }
    }
}
