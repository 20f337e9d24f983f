//! The simulated FPGA: a HostMot2 firmware as a register file on a virtual clock.

mod bus;
mod decode;
pub(crate) mod firmware;
mod plant;

pub use bus::SimError;
pub use firmware::{Firmware, ModuleDescriptor, OUTPUT_PIN, PinDescriptor, gtag};
pub use plant::{DriveSignal, Readout};

use crate::sim::modules::{IoPorts, SmartSerial, Watchdog};
use crate::sim::wire::{Nanos, RemoteEnd};
use decode::{AddressMap, Target};
use plant::{Plant, PortWatcher};

/// What one register access costs by default: about what a PCI read takes.
pub const DEFAULT_ACCESS_COST: Nanos = 600;

/// What was accessed so far, and what of it went nowhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AccessCounters {
    /// Registers read.
    pub reads: u64,
    /// Registers written.
    pub writes: u64,
    /// Reads of addresses without a register; they read 0.
    pub unknown_reads: u64,
    /// Writes to addresses without a register; nothing happens. LinuxCNC writes 0x0000 at start.
    pub unknown_writes: u64,
    /// Writes to identification or IDROM; nothing happens.
    pub rom_writes: u64,
}

/// A simulated FPGA, with what is plugged into it and wired to it.
///
/// Time is virtual: it passes with [`advance_to`](Self::advance_to), and with each access through
/// [`RegisterBus`](crate::bus::RegisterBus). Nothing sleeps, nothing allocates after construction,
/// and two runs with the same accesses are the same.
#[derive(Debug)]
pub struct SimFpga {
    firmware: Firmware,
    map: AddressMap,
    rom: Vec<u32>,
    now: Nanos,
    access_cost: Nanos,
    exchanges: u64,
    counters: AccessCounters,
    io: IoPorts,
    watchdog: Watchdog,
    serial: Vec<SmartSerial>,
    plant: Plant,
}

impl SimFpga {
    /// An FPGA at power-up, with nothing plugged in.
    pub fn new(firmware: Firmware) -> Self {
        let mut rom = Firmware::identification().to_vec();
        let idrom = firmware.idrom();
        let map = AddressMap::new(&firmware, idrom.len());
        rom.extend(idrom);
        let serial = serial_ports(&firmware);
        let clock = |tag| {
            let module = firmware.module(tag);
            firmware.clock(module.map_or(1, |module| module.clock))
        };
        Self {
            map,
            rom,
            now: 0,
            access_cost: DEFAULT_ACCESS_COST,
            exchanges: 0,
            counters: AccessCounters::default(),
            io: IoPorts::new(firmware.ports, firmware.port_width),
            watchdog: Watchdog::new(clock(gtag::WATCHDOG)),
            plant: Plant::new(&firmware),
            serial,
            firmware,
        }
    }

    /// Virtual time since power-up.
    pub fn now(&self) -> Nanos {
        self.now
    }

    /// Lets time pass up to `to`; does nothing if that is in the past.
    ///
    /// Cost: proportional to the time, and to what moves and talks in it.
    pub fn advance_to(&mut self, to: Nanos) {
        while let Some(bite) = self.watchdog.deadline().filter(|&bite| bite <= to) {
            self.run_to(bite);
            self.watchdog.bite();
            self.io.hold_clear(true);
            self.plant.pins_changed(&self.io);
        }
        self.run_to(to);
    }

    /// Reads the register at a byte address, now. Takes no time.
    pub fn read_register(&mut self, address: u16) -> u32 {
        self.counters.reads += 1;
        match self.map.at(address) {
            Target::Nothing => {
                self.counters.unknown_reads += 1;
                0
            }
            Target::Rom(index) => self.rom.get(usize::from(index)).copied().unwrap_or(0),
            Target::Module {
                gtag,
                register,
                instance,
                port,
            } => self.read_module(gtag, register, instance, port),
        }
    }

    /// Writes the register at a byte address, now. Takes no time.
    pub fn write_register(&mut self, address: u16, value: u32) {
        self.counters.writes += 1;
        match self.map.at(address) {
            Target::Nothing => self.counters.unknown_writes += 1,
            Target::Rom(_) => self.counters.rom_writes += 1,
            Target::Module {
                gtag,
                register,
                instance,
                port,
            } => self.write_module(gtag, register, instance, port, value),
        }
    }

    /// The firmware it was built from.
    pub fn firmware(&self) -> &Firmware {
        &self.firmware
    }

    /// What was accessed so far.
    pub fn counters(&self) -> AccessCounters {
        self.counters
    }

    /// What each access through the bus costs in virtual time.
    pub fn set_access_cost(&mut self, cost: Nanos) {
        self.access_cost = cost;
    }

    /// Puts a word into identification or IDROM: a firmware that is wrong in one place.
    /// Other addresses are left alone.
    pub fn override_rom(&mut self, address: u16, value: u32) {
        if let Target::Rom(index) = self.map.at(address)
            && let Some(word) = self.rom.get_mut(usize::from(index))
        {
            *word = value;
        }
    }

    /// The I/O ports.
    pub fn io(&self) -> &IoPorts {
        &self.io
    }

    /// The level of an I/O pin.
    pub fn pin_level(&self, pin: usize) -> bool {
        let levels = |pin| self.module_level(pin);
        self.io.level(pin, &levels)
    }

    /// Drives an I/O pin from outside, or lets it go.
    pub fn drive_pin(&mut self, pin: usize, level: Option<bool>) {
        self.io.drive(pin, level);
    }

    /// The watchdog.
    pub fn watchdog(&self) -> &Watchdog {
        &self.watchdog
    }

    /// Number of smart serial ports.
    pub fn serial_ports(&self) -> usize {
        self.serial.len()
    }

    /// A smart serial port.
    pub fn serial_port(&self, port: usize) -> Option<&SmartSerial> {
        self.serial.get(port)
    }

    /// Plugs a remote into a channel (`None` unplugs) and hands back what was there.
    pub fn plug(
        &mut self,
        port: usize,
        channel: usize,
        remote: Option<Box<dyn RemoteEnd>>,
    ) -> Option<Box<dyn RemoteEnd>> {
        let previous = self.serial.get_mut(port)?.plug(channel, remote);
        self.plant.refresh_remotes(&self.serial);
        previous
    }

    /// What is plugged into a channel.
    pub fn remote(&self, port: usize, channel: usize) -> Option<&dyn RemoteEnd> {
        self.serial.get(port)?.remote(channel)
    }

    /// What is plugged into a channel, to change it.
    pub fn remote_mut(&mut self, port: usize, channel: usize) -> Option<&mut dyn RemoteEnd> {
        self.serial.get_mut(port)?.remote_mut(channel)
    }

    /// The device of type `T` on a channel, whatever stands in front of it.
    pub fn device<T: RemoteEnd>(&self, port: usize, channel: usize) -> Option<&T> {
        device(self.remote(port, channel)?)
    }

    /// The device of type `T` on a channel, whatever stands in front of it, to change it.
    pub fn device_mut<T: RemoteEnd>(&mut self, port: usize, channel: usize) -> Option<&mut T> {
        device_mut(self.remote_mut(port, channel)?)
    }

    /// Lets time pass up to `to`, before which the watchdog does not bite.
    fn run_to(&mut self, to: Nanos) {
        if to <= self.now {
            return;
        }
        for (number, port) in self.serial.iter_mut().enumerate() {
            if port.next_event().is_some_and(|event| event <= to) {
                let mut watcher = PortWatcher::new(&mut self.plant, number);
                port.advance(to, &self.io, &mut watcher);
            }
        }
        self.now = to;
        if self.plant.is_due(to) {
            self.settle();
        }
    }

    /// Brings everything that is only looked at now and then up to the present.
    fn settle(&mut self) {
        self.plant.advance(self.now);
        self.plant.age_remotes(&mut self.serial, self.now);
    }

    fn read_module(&mut self, gtag: u8, register: u8, instance: u8, port: u8) -> u32 {
        match gtag {
            gtag::WATCHDOG => self.watchdog.read(register),
            gtag::IO_PORT => {
                let levels = |pin| self.module_level(pin);
                self.io.read(register, instance, &levels)
            }
            gtag::SSERIAL | gtag::SSERIAL_B => {
                let now = self.now;
                let serial = self.serial.get_mut(usize::from(port));
                serial.map_or(0, |serial| serial.read(now, register, instance))
            }
            _ => 0,
        }
    }

    fn write_module(&mut self, gtag: u8, register: u8, instance: u8, port: u8, value: u32) {
        match gtag {
            gtag::WATCHDOG => {
                self.watchdog.write(self.now, register, value);
                self.io.hold_clear(self.watchdog.has_bitten());
            }
            gtag::IO_PORT => {
                self.settle();
                self.io.write(register, instance, value);
                self.plant.pins_changed(&self.io);
            }
            gtag::SSERIAL | gtag::SSERIAL_B => {
                let now = self.now;
                if let Some(serial) = self.serial.get_mut(usize::from(port)) {
                    serial.write(now, register, instance, value);
                }
            }
            _ => {}
        }
    }

    /// What a module puts out on a pin at the moment, when the pin lets it.
    #[expect(clippy::unused_self, reason = "the modules that drive pins come next")]
    fn module_level(&self, _pin: usize) -> bool {
        true
    }
}

/// The smart serial ports of a firmware: all instances of SSerial, then those of SSerialB.
fn serial_ports(firmware: &Firmware) -> Vec<SmartSerial> {
    let modules = firmware.modules.iter();
    modules
        .filter(|module| matches!(module.gtag, gtag::SSERIAL | gtag::SSERIAL_B))
        .flat_map(|module| {
            let instances = 0..module.instances.min(4);
            instances.map(move |instance| SmartSerial::new(firmware, module, instance))
        })
        .collect()
}

/// Looks for a device behind everything that stands in front of it.
pub(crate) fn device<T: RemoteEnd>(mut end: &dyn RemoteEnd) -> Option<&T> {
    loop {
        let any: &dyn core::any::Any = end;
        if let Some(found) = any.downcast_ref() {
            return Some(found);
        }
        end = end.inner()?;
    }
}

fn device_mut<T: RemoteEnd>(end: &mut dyn RemoteEnd) -> Option<&mut T> {
    if (end as &dyn core::any::Any).is::<T>() {
        return (end as &mut dyn core::any::Any).downcast_mut();
    }
    device_mut(end.inner_mut()?)
}
