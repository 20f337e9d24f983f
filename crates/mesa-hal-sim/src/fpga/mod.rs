//! The simulated FPGA: a HostMot2 firmware as a register file on a virtual clock.

mod bus;
mod decode;
mod director;
mod dispatch;
pub(crate) mod firmware;
mod image;
mod installation;
mod plant;
mod reload;
mod world_side;

pub use bus::SimError;
pub use director::{Cause, Director};
pub use firmware::{Firmware, ModuleDescriptor, OUTPUT_PIN, PinDescriptor, gtag};
pub use image::{FirmwareImage, ImageError};
pub use plant::{AxisWiring, DriveSignal, DriveSource, Readout};
pub(crate) use world_side::device;

use crate::modules::{
    Dpll, ForeignModules, Inputs, IoPorts, Leds, Outputs, Pwm, SmartSerial, Watchdog,
};
use crate::wire::Nanos;
use decode::{AddressMap, Target};
use plant::{Plant, PortWatcher};

/// What a register reads that can only be written: no module drives the bus, and a host must not
/// rely on what it sees. FACTS 12.11.
pub const UNDRIVEN: u32 = u32::MAX;

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
/// [`RegisterBus`](mesa_wire::bus::RegisterBus). Nothing sleeps, nothing allocates after construction,
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
    pwm: Option<Pwm>,
    in_mux: Option<Inputs>,
    in_m: Option<Inputs>,
    ssr: Option<Outputs>,
    out_m: Option<Outputs>,
    dpll: Option<Dpll>,
    leds: Leds,
    serial: Vec<SmartSerial>,
    foreign: ForeignModules,
    plant: Plant,
    /// While it is reset, it neither answers nor takes anything.
    reset_until: Nanos,
    director: Option<Box<dyn Director>>,
}

impl SimFpga {
    /// An FPGA at power-up, with nothing plugged in.
    pub fn new(firmware: Firmware) -> Self {
        Self::configured_at(firmware, 0)
    }

    /// An FPGA that is configured at a time, from which its dividers run.
    fn configured_at(firmware: Firmware, now: Nanos) -> Self {
        let mut rom = Firmware::identification().to_vec();
        let idrom = firmware.idrom();
        let map = AddressMap::new(&firmware, idrom.len());
        rom.extend(idrom);
        let serial = serial_ports(&firmware);
        let clock = |tag| {
            let module = firmware.module(tag);
            firmware.clock(module.map_or(1, |module| module.clock))
        };
        let inputs = |tag| {
            let module = firmware.module(tag);
            module.map(|module| Inputs::new(&firmware, module))
        };
        let outputs = |tag| {
            let module = firmware.module(tag);
            module.map(|module| Outputs::new(&firmware, module, now))
        };
        let pwm = firmware.module(gtag::PWM);
        let io = IoPorts::new(firmware.ports, firmware.port_width);
        let mut plant = Plant::new(&firmware);
        plant.pins_changed(&io);
        Self {
            map,
            rom,
            now,
            access_cost: DEFAULT_ACCESS_COST,
            exchanges: 0,
            counters: AccessCounters::default(),
            io,
            watchdog: Watchdog::new(clock(gtag::WATCHDOG), firmware.starts_bitten),
            pwm: pwm.map(|module| Pwm::new(&firmware, module, now)),
            in_mux: inputs(gtag::IN_MUX),
            in_m: inputs(gtag::IN_M),
            ssr: outputs(gtag::SSR),
            out_m: outputs(gtag::OUT_M),
            dpll: firmware
                .module(gtag::DPLL)
                .map(|module| Dpll::new(firmware.clock(module.clock))),
            leds: Leds::default(),
            plant,
            serial,
            foreign: ForeignModules::default(),
            firmware,
            reset_until: 0,
            director: None,
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
        while let Some(at) = self.scene(to) {
            self.pass(at);
            self.play();
        }
        self.pass(to);
    }

    /// Lets time pass up to `to`, up to when nobody acts.
    fn pass(&mut self, to: Nanos) {
        while let Some(event) = self.next_event().filter(|&event| event <= to) {
            self.run_to(event);
            self.take_pwm_values();
            if self.watchdog.event(event) {
                self.settle();
                self.io.make_inputs();
                self.pins_changed();
                self.show(Cause::Bite);
            }
        }
        self.run_to(to);
    }

    /// When something happens by itself to what the FPGA drives.
    fn next_event(&self) -> Option<Nanos> {
        let pwm = self.pwm.as_ref().and_then(Pwm::next_event);
        [self.watchdog.next_event(), pwm]
            .into_iter()
            .flatten()
            .min()
    }

    /// A PWM value that was written before comes into effect when its period has ended.
    fn take_pwm_values(&mut self) {
        let due = self.pwm.as_ref().and_then(Pwm::next_event);
        if due.is_some_and(|due| due <= self.now) {
            self.settle();
            if let Some(pwm) = &mut self.pwm {
                pwm.event(self.now);
                self.plant.pwm_changed(pwm, &self.io);
            }
            self.show(Cause::Write);
        }
    }

    /// Reads the register at a byte address, now. Takes no time.
    pub fn read_register(&mut self, address: u16) -> u32 {
        self.counters.reads += 1;
        if self.is_in_reset() {
            return u32::MAX;
        }
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
        if self.is_in_reset() {
            return;
        }
        match self.map.at(address) {
            Target::Nothing => self.counters.unknown_writes += 1,
            Target::Rom(_) => self.counters.rom_writes += 1,
            Target::Module {
                gtag,
                register,
                instance,
                port,
            } => {
                self.write_module(gtag, register, instance, port, value);
                if Self::is_driving(gtag) {
                    self.show(Cause::Write);
                }
            }
        }
    }

    /// Lets time pass up to `to`, before which the watchdog does not bite.
    fn run_to(&mut self, to: Nanos) {
        self.visit_remotes(SmartSerial::is_touched);
        while self.now < to {
            let ports = self.serial.iter();
            let remotes = ports.filter_map(SmartSerial::remotes_due).min();
            let latch = self.next_latch().map(|(_, edge)| edge);
            let module = self.next_foreign_change();
            let due = [remotes, latch, module].into_iter().flatten().min();
            let due = due.unwrap_or(Nanos::MAX).min(self.plant.due());
            let step = to.min(due.max(self.now + 1));
            self.run_ports(step);
            self.now = step;
            if step >= due {
                self.advance_plant();
                // Remotes do things by themselves (their watchdogs bite), whoever talks to them.
                self.visit_remotes(|port| port.remotes_due().is_some_and(|due| due <= step));
            }
        }
    }

    /// Lets the remotes of some ports notice the time, and takes over what they put out.
    fn visit_remotes(&mut self, which: impl Fn(&SmartSerial) -> bool) {
        for (number, port) in self.serial.iter_mut().enumerate() {
            if which(port) {
                self.plant.advance(self.now);
                let mut watcher = PortWatcher::new(&mut self.plant, number);
                port.visit_remotes(self.now, &self.io, &mut watcher);
            }
        }
    }

    /// Lets the ports go on where there is something to do.
    fn run_ports(&mut self, to: Nanos) {
        if self.is_in_reset() {
            return;
        }
        for (number, port) in self.serial.iter_mut().enumerate() {
            if port.next_event().is_some_and(|event| event <= to) {
                let mut watcher = PortWatcher::new(&mut self.plant, number);
                port.advance(to, &self.io, &mut watcher);
            }
        }
    }

    /// Brings the motors up to the present, and lets them notice what was done to remotes.
    fn settle(&mut self) {
        self.advance_plant();
        self.visit_remotes(SmartSerial::is_touched);
    }

    /// Brings motors and encoders up to the present, and latches on the way what a timer latches.
    fn advance_plant(&mut self) {
        while let Some((bank, edge)) = self.next_latch().filter(|&(_, edge)| edge <= self.now) {
            self.plant.advance(edge);
            if let Some(bank) = self.plant.banks.get_mut(bank) {
                bank.latch(edge);
            }
        }
        self.plant.advance(self.now);
        self.plant.modules_changed(&self.foreign, &self.io);
        self.take_signals();
    }

    /// When a module from outside next gives another signal to a drive by itself.
    fn next_foreign_change(&self) -> Option<Nanos> {
        let drives = self.plant.is_driven_by_modules();
        let change = || self.foreign.next_change(self.now);
        drives.then(change).flatten()
    }

    /// When a timer latches encoders next, from where the motors are now, and of which module.
    fn next_latch(&self) -> Option<(usize, Nanos)> {
        let dpll = self.dpll.as_ref()?;
        let banks = self.plant.banks.iter().enumerate();
        let edges = banks.filter_map(|(number, bank)| {
            let edge = dpll.next_edge(self.plant.now(), bank.latching_timer()?);
            edge.map(|edge| (number, edge))
        });
        edges.min_by_key(|&(_, edge)| edge)
    }

    /// Tells everybody that depends on the set-up of the pins.
    fn pins_changed(&mut self) {
        self.plant.pins_changed(&self.io);
        if let Some(pwm) = &self.pwm {
            self.plant.pwm_changed(pwm, &self.io);
        }
        self.plant.modules_changed(&self.foreign, &self.io);
        for inputs in [&mut self.in_mux, &mut self.in_m].into_iter().flatten() {
            inputs.pins_changed(self.now, &self.io);
        }
    }
}

/// The smart serial ports of a firmware: all instances of SSerial, then those of SSerialB.
fn serial_ports(firmware: &Firmware) -> Vec<SmartSerial> {
    let modules = firmware.modules.iter();
    modules
        .filter(|module| matches!(module.gtag, gtag::SSERIAL | gtag::SSERIAL_B))
        .flat_map(|module| {
            let instances = 0..module.instances.min(decode::MAX_PORTS);
            instances.map(move |instance| SmartSerial::new(firmware, module, instance))
        })
        .collect()
}
