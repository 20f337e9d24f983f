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
pub(crate) use bus::check;
pub use director::{ChangeCause, Director};
pub use firmware::{OUTPUT_PIN, SimFirmware, SimModuleDescriptor, SimPinDescriptor, gtag};
pub use image::{FirmwareImage, FirmwareImageError};
pub use plant::{AxisWiring, DriveSignal, DriveSource, Readout, StepperWiring};
pub(crate) use world_side::device;

use crate::modules::{
    ForeignModules, Inputs, SimDpll, SimIoPorts, SimLeds, SimOutputs, SimPwm, SimWatchdog,
    SmartSerial,
};
use crate::wire::Nanos;
use decode::{AddressMap, Target};
use plant::{Plant, PortWatcher};

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
    firmware: SimFirmware,
    map: AddressMap,
    rom: Vec<u32>,
    now: Nanos,
    access_cost: Nanos,
    exchanges: u64,
    counters: AccessCounters,
    io: SimIoPorts,
    watchdog: SimWatchdog,
    pwm: Option<SimPwm>,
    in_mux: Option<Inputs>,
    in_m: Option<Inputs>,
    ssr: Option<SimOutputs>,
    out_m: Option<SimOutputs>,
    dpll: Option<SimDpll>,
    leds: SimLeds,
    serial: Vec<SmartSerial>,
    foreign: ForeignModules,
    plant: Plant,
    /// Time up to which the edges of the DPLL's timers have latched their modules.
    latched_to: Nanos,
    /// End of the reset: until then the FPGA ignores writes and every read returns all ones.
    reset_until: Nanos,
    director: Option<Box<dyn Director>>,
}

impl SimFpga {
    /// An FPGA at power-up, with nothing plugged in.
    pub fn new(firmware: SimFirmware) -> Self {
        Self::configured_at(firmware, 0)
    }

    /// An FPGA that is configured at a time, from which its dividers run.
    fn configured_at(firmware: SimFirmware, now: Nanos) -> Self {
        let mut rom = SimFirmware::identification().to_vec();
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
            module.map(|module| SimOutputs::new(&firmware, module, now))
        };
        let pwm = firmware.module(gtag::PWM);
        let io = SimIoPorts::new(firmware.ports, firmware.port_width);
        let mut plant = Plant::new(&firmware, now);
        plant.pins_changed(&io);
        Self {
            map,
            rom,
            now,
            access_cost: DEFAULT_ACCESS_COST,
            exchanges: 0,
            counters: AccessCounters::default(),
            io,
            watchdog: SimWatchdog::new(clock(gtag::WATCHDOG), firmware.starts_bitten),
            pwm: pwm.map(|module| SimPwm::new(&firmware, module, now)),
            in_mux: inputs(gtag::IN_MUX),
            in_m: inputs(gtag::IN_M),
            ssr: outputs(gtag::SSR),
            out_m: outputs(gtag::OUT_M),
            dpll: firmware
                .module(gtag::DPLL)
                .map(|module| SimDpll::new(firmware.clock(module.clock))),
            leds: SimLeds::default(),
            plant,
            latched_to: now,
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
        while let Some(event) = self.next_event().filter(|&event| event <= to) {
            self.run_to(event);
            self.take_pwm_values();
            if self.watchdog.event(event) {
                self.settle();
                self.io.make_inputs();
                self.pins_changed();
                self.show(ChangeCause::Bite);
            }
        }
        self.run_to(to);
    }

    /// Time of the next spontaneous change of the driven outputs.
    fn next_event(&self) -> Option<Nanos> {
        let pwm = self.pwm.as_ref().and_then(SimPwm::next_event);
        [self.watchdog.next_event(), pwm]
            .into_iter()
            .flatten()
            .min()
    }

    /// Applies a written PWM value at the end of its period.
    fn take_pwm_values(&mut self) {
        let due = self.pwm.as_ref().and_then(SimPwm::next_event);
        if due.is_some_and(|due| due <= self.now) {
            self.settle();
            if let Some(pwm) = &mut self.pwm {
                pwm.event(self.now);
                self.plant.pwm_changed(pwm, &self.io);
            }
            self.show(ChangeCause::Write);
        }
    }

    /// Reads the register at a byte address, now and in no time.
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

    /// Writes the register at a byte address, now and in no time.
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
                    self.show(ChangeCause::Write);
                }
            }
        }
    }

    /// Advances to `to`, before which the watchdog does not bite.
    fn run_to(&mut self, to: Nanos) {
        self.visit_remotes(SmartSerial::is_touched);
        while self.now < to {
            let ports = self.serial.iter();
            let remotes = ports.filter_map(SmartSerial::remotes_due).min();
            let latch = self.next_latch();
            let module = self.next_foreign_change();
            let due = [remotes, latch, module].into_iter().flatten().min();
            let due = due.unwrap_or(Nanos::MAX).min(self.plant.due());
            let step = to.min(due.max(self.now + 1));
            self.run_ports(step);
            self.now = step;
            if step >= due {
                self.advance_plant();
                // Remotes have events of their own (their watchdogs bite), without any transmission
                // to them.
                self.visit_remotes(|port| port.remotes_due().is_some_and(|due| due <= step));
            }
        }
    }

    /// Advances the remotes of the selected ports, and applies their outputs.
    fn visit_remotes(&mut self, which: impl Fn(&SmartSerial) -> bool) {
        for (number, port) in self.serial.iter_mut().enumerate() {
            if which(port) {
                self.plant.advance(self.now);
                let mut watcher = PortWatcher::new(&mut self.plant, number);
                port.visit_remotes(self.now, &self.io, &mut watcher);
            }
        }
    }

    /// Runs the ports that have an event up to `to`.
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

    /// Brings the motors up to date, and applies changes of remotes to them.
    fn settle(&mut self) {
        self.advance_plant();
        self.visit_remotes(SmartSerial::is_touched);
    }

    /// Brings motors, encoders and step generators up to date, and latches them at the edges of
    /// their timers.
    fn advance_plant(&mut self) {
        while let Some(edge) = self.next_latch().filter(|&edge| edge <= self.now) {
            self.plant.advance(edge);
            self.latch(edge);
        }
        self.latched_to = self.now;
        self.plant.advance(self.now);
        self.plant.modules_changed(&self.foreign, &self.io);
        self.take_signals();
    }

    /// Time of the next spontaneous change of a foreign module's signal to a drive.
    fn next_foreign_change(&self) -> Option<Nanos> {
        let drives = self.plant.is_driven_by_modules();
        let change = || self.foreign.next_change(self.now);
        drives.then(change).flatten()
    }

    /// The next time at which a timer latches a module. It counts from the last edge that has
    /// latched, not from the time of the plant, which other events advance as well.
    fn next_latch(&self) -> Option<Nanos> {
        let dpll = self.dpll.as_ref()?;
        let timers = self.plant.latching_timers();
        let edges = timers.filter_map(|timer| dpll.next_edge(self.latched_to, timer));
        edges.min()
    }

    /// Latches all modules whose timer rises at `edge`, the next edge of any.
    fn latch(&mut self, edge: Nanos) {
        if let Some(dpll) = &self.dpll {
            let rises = |timer| dpll.next_edge(self.latched_to, timer) == Some(edge);
            self.plant.latch(edge, rises);
        }
        self.latched_to = edge;
    }

    /// Informs all modules that depend on the set-up of the pins.
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
fn serial_ports(firmware: &SimFirmware) -> Vec<SmartSerial> {
    let modules = firmware.modules.iter();
    modules
        .filter(|module| matches!(module.gtag, gtag::SSERIAL | gtag::SSERIAL_B))
        .flat_map(|module| {
            let instances = 0..module.instances.min(decode::MAX_PORTS);
            instances.map(move |instance| SmartSerial::new(firmware, module, instance))
        })
        .collect()
}
