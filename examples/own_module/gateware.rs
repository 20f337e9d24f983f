//! The gateware of the pulse generator, for the simulated FPGA.

use mesa_hal_sim::wire::Nanos;
use mesa_hal_sim::{
    Configuration, Fabric, SimFirmware, SimFpga, SimModule, SimModuleDescriptor, SimPinDescriptor,
    UNDRIVEN, machines,
};

use crate::pulser::GTAG;

/// The I/O pin that carries the pulses: the second connector of a 7I92.
pub const PIN: usize = 20;

/// A 7I92 with a 7I77, whose gateware has a pulse generator.
pub fn board() -> SimFpga {
    with_pulser(machines::firmware_7i92_7i77())
}

/// The FPGA of a firmware, with a pulse generator added.
pub fn with_pulser(mut firmware: SimFirmware) -> SimFpga {
    let descriptor = SimModuleDescriptor {
        gtag: GTAG.0,
        base: 0xA000,
        registers: 3,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.push(descriptor);
    firmware.pins[PIN] = SimPinDescriptor::new(GTAG.0, 0, 0x81);
    let clock_hz = u64::from(firmware.clock_low);
    let mut fpga = SimFpga::new(firmware);
    fpga.add_module(GTAG.0, Box::new(Gateware::new(clock_hz)));
    fpga
}

/// Registers, and the phase of the pulses.
#[derive(Debug)]
pub struct Gateware {
    clock_hz: u64,
    /// The frequency in 2^-32 of the clock.
    pub rate: u32,
    /// The width of a pulse in clocks.
    pub width: u32,
    /// Pulses in units of 2^-32, counted up to the time `since`.
    phase: u128,
    since: Nanos,
}

impl Gateware {
    fn new(clock_hz: u64) -> Self {
        Self {
            clock_hz,
            rate: 0,
            width: 0,
            phase: 0,
            since: 0,
        }
    }

    /// Number of pulses so far.
    pub fn pulses(&self, now: Nanos) -> u32 {
        (self.phase(now) >> 32) as u32
    }

    fn phase(&self, now: Nanos) -> u128 {
        let clocks = u128::from(now - self.since) * u128::from(self.clock_hz) / 1_000_000_000;
        self.phase + clocks * u128::from(self.rate)
    }
}

impl SimModule for Gateware {
    fn read(&mut self, fabric: &Fabric, register: u8, _: u8) -> u32 {
        match register {
            2 => self.pulses(fabric.now()),
            _ => UNDRIVEN,
        }
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, _: u8, value: u32) {
        let now = fabric.now();
        (self.phase, self.since) = (self.phase(now), now);
        match register {
            0 => self.rate = value,
            1 => self.width = value,
            _ => {}
        }
    }

    fn level(&self, now: Nanos, _: SimPinDescriptor) -> bool {
        let fraction = self.phase(now) & 0xFFFF_FFFF;
        self.rate > 0 && fraction < u128::from(self.width) * u128::from(self.rate)
    }

    fn reload(&mut self, configuration: &Configuration<'_>) {
        *self = Self {
            since: configuration.now,
            ..Self::new(self.clock_hz)
        };
    }
}
