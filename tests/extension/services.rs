//! The services of the driver to a module outside of the crate: all instances, a part of the pins,
//! latching by the DPLL, writes and reads on demand, lost periods, and events.

use std::time::Duration;

use crate::common::ethernet;
use mesa_hal::bus::{Clock, Phase, ReadSlot, Setting, Stage};
use mesa_hal::driver::{Board, Driver, EventKind, Pace, Settings};
use mesa_hal::hal::{Input, Output};
use mesa_hal::hostmot2::{Gtag, ModuleDescriptor, PinDescriptor};
use mesa_hal::modules::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use mesa_hal_sim::{
    Configuration, Fabric, SimFirmware, SimFpga, SimModule, SimModuleDescriptor, SimPinDescriptor,
    machines,
};

const GAUGE: Gtag = Gtag(0x9A);
/// The first of four I/O pins: two of each instance.
const PIN: usize = 20;
/// The register that selects the timer by which the counts are latched.
const LATCH: u8 = 3;

/// The handles of one gauge.
#[derive(Clone, Copy, Debug)]
struct GaugePins {
    level: Input<u32>,
    /// Asks for the serial number, and clears the level.
    clear: Output<bool>,
    serial: Input<u32>,
    missed: Input<u32>,
}

#[derive(Debug)]
struct Gauge {
    number: u8,
    pins: GaugePins,
    level: ReadSlot,
    clear: Setting,
    serial: ReadSlot,
    is_asked: bool,
    missed: u32,
}

/// Registers all gauges; returns their pins, and true if they are latched by the DPLL.
fn register(r: &mut Registrar<'_>) -> Result<(Vec<GaugePins>, bool), RegisterError> {
    let is_latched = r.has_dpll();
    let gauges = r.each_instance(GAUGE, |r, module, instance, number| {
        gauge(r, module, instance, number)
    })?;
    if let Some(module) = r.module(GAUGE).filter(|_| is_latched) {
        let latch = module.register(LATCH, 0)?;
        r.image.setting(Stage::Configure, latch, 2);
    }
    let pins = gauges.iter().map(|gauge| gauge.pins).collect();
    for gauge in gauges {
        r.add(gauge);
    }
    Ok((pins, is_latched))
}

fn gauge(
    r: &mut Registrar<'_>,
    module: ModuleDescriptor,
    instance: u8,
    number: u8,
) -> Result<Gauge, RegisterError> {
    // The other pin of an instance stays plain I/O.
    let is_first = |pin: PinDescriptor| pin.secondary_pin == 0x81;
    r.use_io_if(GAUGE, number, is_first)?;
    let mut make = r.maker(&format!("gauge.{number:02}."));
    let pins = GaugePins {
        level: make.input("level")?,
        clear: make.output("clear", false)?,
        serial: make.input("serial")?,
        missed: make.input("missed")?,
    };
    Ok(Gauge {
        number,
        pins,
        level: r.image.read(Phase::Data, module.register(0, instance)?),
        clear: r.image.on_demand(module.register(1, instance)?),
        serial: r
            .image
            .read_extra(Phase::Data, module.register(2, instance)?),
        is_asked: false,
        missed: 0,
    })
}

impl Module for Gauge {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let level = cycle.words.word(self.level);
        if level > 1_000 {
            cycle.report(GAUGE, 7, u32::from(self.number));
        }
        self.missed += cycle.missed_periods() as u32;
        cycle.pins.publish(self.pins.level, level);
        cycle.pins.publish(self.pins.missed, self.missed);
        if std::mem::take(&mut self.is_asked) {
            let serial = cycle.words.word(self.serial);
            cycle.pins.publish(self.pins.serial, serial);
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if cycle.changed && cycle.pins.fetch(self.pins.clear) {
            cycle.words.set(self.clear, 1);
            cycle.words.repeat(self.clear);
            cycle.request_extra();
            self.is_asked = true;
        }
    }
}

/// Two gauges.
#[derive(Debug, Default)]
struct Gateware {
    levels: [u32; 2],
    cleared: [u32; 2],
    serial_reads: u32,
    latch: u32,
}

impl SimModule for Gateware {
    fn read(&mut self, _fabric: &Fabric, register: u8, instance: u8) -> u32 {
        let instance = usize::from(instance);
        match register {
            0 => self.levels[instance],
            2 => {
                self.serial_reads += 1;
                500 + instance as u32
            }
            _ => 0,
        }
    }

    fn write(&mut self, _fabric: &mut Fabric, register: u8, instance: u8, value: u32) {
        match register {
            1 => self.cleared[usize::from(instance)] += value,
            LATCH => self.latch = value,
            _ => {}
        }
    }

    fn reload(&mut self, _: &Configuration<'_>) {
        *self = Self::default();
    }
}

fn fpga(mut firmware: SimFirmware) -> SimFpga {
    let descriptor = SimModuleDescriptor {
        gtag: GAUGE.0,
        instances: 2,
        base: 0xA000,
        registers: 4,
        multiple: 0b0111,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.push(descriptor);
    for (place, (instance, pin)) in [(0, 0x81), (0, 0x82), (1, 0x81), (1, 0x82)]
        .into_iter()
        .enumerate()
    {
        firmware.pins[PIN + place] = SimPinDescriptor::new(GAUGE.0, instance, pin);
    }
    let mut fpga = SimFpga::new(firmware);
    fpga.add_module(GAUGE.0, Box::new(Gateware::default()));
    fpga
}

fn started(firmware: SimFirmware) -> (Driver<SimFpga>, Vec<GaugePins>, bool) {
    let mut board = Board::identify(fpga(firmware), Settings::default()).expect("a board");
    let (pins, is_latched) = board.add(register).expect("the module");
    (board.start().expect("it starts"), pins, is_latched)
}

fn gateware(driver: &Driver<SimFpga>) -> &Gateware {
    driver.bus().module(GAUGE.0).expect("it was added")
}

fn cycles(driver: &mut Driver<SimFpga>, count: u32) {
    for _ in 0..count {
        let _ = driver.read().expect("the bus is well");
        driver.write().expect("the bus is well");
        driver.bus_mut().wait(Duration::from_millis(1));
    }
}

#[test]
fn every_instance_is_registered_and_unused_pins_are_plain_io() {
    let (mut driver, gauges, _) = started(machines::firmware_7i92_7i77());
    assert_eq!(gauges.len(), 2);
    let module: &mut Gateware = driver.bus_mut().module_mut(GAUGE.0).expect("it was added");
    module.levels = [11, 22];
    cycles(&mut driver, 3);
    let levels: Vec<_> = gauges
        .iter()
        .map(|gauge| driver.pins().read(gauge.level).ok())
        .collect();
    assert_eq!(levels, [Some(11), Some(22)]);
    let has = |pin: usize| {
        let name = format!("hm2_7i92.0.gpio.{pin:03}.is_output");
        driver.pins().parameter::<bool>(&name).is_ok()
    };
    // A pin that a module drives has no direction to set.
    assert_eq!(
        [0, 1, 2, 3].map(|pin| has(PIN + pin)),
        [false, true, false, true]
    );
}

#[test]
fn requested_accesses_happen_once_and_module_reports_its_event() {
    let (mut driver, gauges, _) = started(machines::firmware_7i92_7i77());
    let mut events = driver.events();
    cycles(&mut driver, 20);
    assert_eq!(gateware(&driver).cleared, [0, 0]);
    let before = gateware(&driver).serial_reads;
    cycles(&mut driver, 20);
    assert_eq!(gateware(&driver).serial_reads, before, "not in every cycle");
    driver.pins_mut().set(gauges[1].clear, true);
    cycles(&mut driver, 3);
    assert_eq!(gateware(&driver).cleared, [0, 1]);
    assert_eq!(driver.pins().read(gauges[1].serial).ok(), Some(501));
    let serial_reads = gateware(&driver).serial_reads;
    cycles(&mut driver, 20);
    assert_eq!(gateware(&driver).cleared, [0, 1], "once");
    assert_eq!(gateware(&driver).serial_reads, serial_reads);

    events.by_ref().for_each(drop);
    let module: &mut Gateware = driver.bus_mut().module_mut(GAUGE.0).expect("it was added");
    module.levels[1] = 1_001;
    cycles(&mut driver, 1);
    let told: Vec<_> = events.by_ref().map(|event| event.kind).collect();
    let kind = EventKind::OfModule {
        module: GAUGE.0.into(),
        code: 7,
        value: 1,
    };
    assert_eq!(told, [kind]);
    assert_eq!(kind.to_string(), "module 9A: event 7, value 1");
}

/// The board paces: a host that is late misses periods, which each module knows.
#[test]
fn module_knows_how_many_periods_were_missed() {
    let settings = Settings {
        pace: Pace::Board,
        ..Settings::default()
    };
    let bus = ethernet::bus(fpga(machines::firmware_7i97(1)));
    let mut board = Board::identify(bus, settings).expect("a board");
    let (gauges, _) = board.add(register).expect("the module");
    let mut driver = board.start().expect("it starts");
    let mut missed = 0;
    for number in 0..100 {
        let report = driver.read().expect("the board is there");
        missed += report.missed_periods as u32;
        let micros = if number % 20 == 10 { 2_300 } else { 100 };
        driver.bus_mut().wait(Duration::from_micros(micros));
        driver.write().expect("the board is there");
    }
    assert!(missed >= 10, "{missed}");
    assert_eq!(driver.pins().read(gauges[0].missed).ok(), Some(missed));
}

#[test]
fn module_is_latched_by_the_dpll_of_the_firmware_that_has_one() {
    for has_dpll in [false, true] {
        let mut firmware = machines::firmware_7i97(1);
        firmware
            .modules
            .retain(|module| has_dpll || module.gtag != Gtag::HM2DPLL.0);
        let (driver, _, is_latched) = started(firmware);
        assert_eq!(is_latched, has_dpll);
        assert_eq!(gateware(&driver).latch, if has_dpll { 2 } else { 0 });
    }
    let settings = Settings {
        instances: [(Gtag::HM2DPLL, 0)].into(),
        ..Settings::default()
    };
    let board = Board::identify(fpga(machines::firmware_7i97(1)), settings);
    let (_, is_latched) = board.expect("a board").add(register).expect("the module");
    assert!(!is_latched, "the loop is left alone");
}
