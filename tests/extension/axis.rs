//! What the step generators needed of the extension point, for any module outside of the crate: a
//! part of its own for parameters, a safe value that follows the machine, a register that takes
//! several words, the time of the timer that latches it, and a probe that latches where it is.

use mesa_hal::bus::{BusErrorKind, Clock, Instant, Phase, ReadSlot, RegisterBus, Setting, Stage};
use mesa_hal::bus::{Words, WriteSlot};
use mesa_hal::driver::{Board, Driver, Settings};
use mesa_hal::hal::{GroupId, InOut, Input, Output, Param, PinMaker, PinStore};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::modules::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::{
    Configuration, Fabric, SimFpga, SimModule, SimModuleDescriptor, SimPinDescriptor, machines,
};
use std::time::Duration;

const MOVER: Gtag = Gtag(0x9B);
const PERIOD: Duration = Duration::from_millis(1);
/// The I/O pin of the probe, and the number of this input in the module.
const PROBE: usize = 20;
const PROBE_INPUT: u8 = 1;
/// The bit of the probe register that arms the latch, and shows that it is armed. The bits above it
/// are the place that was latched.
const ARMED: u32 = 1;

#[derive(Clone, Copy, Debug)]
struct MoverPins {
    command: Output<f64>,
    place: Input<f64>,
    latch_us: Input<f64>,
    scale: Param<f64>,
    curve: Param<u32>,
    prepared: Input<u32>,
    /// Set to true: at the next edge of the probe the place is latched, and the pin false.
    probe_enable: InOut<bool>,
    probe_place: Input<f64>,
}

/// Progress of a request to latch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Progress {
    #[default]
    Idle,
    /// Not seen in the register yet.
    Asked,
    /// Seen in the register.
    Armed,
}

/// The latch of the probe. Writes can be lost, late or repeated: clear bits alone are no edge after
/// an exchange in doubt, because a late word of before clears them as well; another place is one.
#[derive(Debug)]
struct Probe {
    control: Setting,
    shown: ReadSlot,
    progress: Progress,
    /// The place that the register showed before the request.
    before: u32,
}

impl Probe {
    /// Takes the register; returns the place of the edge once there was one.
    fn read(&mut self, word: u32, certain: bool) -> Option<u32> {
        let (is_armed, place) = (word & ARMED != 0, word >> 1);
        if self.progress == Progress::Idle {
            self.before = place;
            return None;
        }
        let has_cleared = self.progress == Progress::Armed && !is_armed && certain;
        if place != self.before || has_cleared {
            self.progress = Progress::Idle;
            return Some(place);
        }
        self.progress = if is_armed {
            Progress::Armed
        } else {
            Progress::Asked
        };
        None
    }

    /// Makes the request, or takes it back.
    fn write(&mut self, is_wanted: bool, words: &mut Words) {
        if !is_wanted {
            self.progress = Progress::Idle;
        } else if self.progress == Progress::Idle {
            self.progress = Progress::Asked;
        }
        words.set(self.control, if is_wanted { ARMED } else { 0 });
        if self.progress == Progress::Asked {
            words.repeat(self.control);
        }
    }
}

/// Goes to a place, with a curve of three words.
#[derive(Debug)]
struct Mover {
    pins: MoverPins,
    parameters: GroupId,
    version: Option<u64>,
    timer_us: Output<f64>,
    scale: f64,
    prepared: u32,
    command: WriteSlot,
    place: ReadSlot,
    curve: [Setting; 3],
    probe: Probe,
}

fn register(r: &mut Registrar<'_>) -> Result<MoverPins, RegisterError> {
    let module = r.module(MOVER).expect("the firmware has it");
    // The pin of the probe is the module's.
    r.use_io(MOVER, 0)?;
    let mut make = r.maker("mover.");
    let (command, place) = (make.output("command", 0.0)?, make.input("place")?);
    let (latch_us, prepared) = (make.input("latch-us")?, make.input("prepared")?);
    let (probe_enable, probe_place) = (make.inout("probe-enable")?, make.input("probe-place")?);
    // Only their changes are looked at, while the command changes in each cycle.
    let parameters = r.pins.add_part(r.group)?;
    let stem = format!("{}.mover.", r.name);
    let mut make = PinMaker::new(r.pins, parameters, stem);
    let pins = MoverPins {
        command,
        place,
        latch_us,
        prepared,
        probe_enable,
        probe_place,
        scale: make.scale("scale", 1.0)?,
        curve: make.setting("curve", 1)?,
    };
    let timer_us = r.pins.output(&format!("{}.dpll.02.timer-us", r.name))?;
    let mover = Mover {
        pins,
        parameters,
        version: None,
        timer_us,
        scale: 1.0,
        prepared: 0,
        command: r.image.output(module.register(0, 0)?, 0),
        place: r.image.read(Phase::Data, module.register(0, 0)?),
        curve: r
            .image
            .sequence(Stage::Configure, module.register(1, 0)?, [1, 2, 3]),
        probe: Probe {
            control: r.image.setting(Stage::Configure, module.register(2, 0)?, 0),
            shown: r.image.read(Phase::Data, module.register(2, 0)?),
            progress: Progress::Idle,
            before: 0,
        },
    };
    r.add(mover);
    Ok(pins)
}

impl Module for Mover {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let place = f64::from(cycle.words.word(self.place)) / self.scale;
        cycle.pins.publish(self.pins.place, place);
        cycle.pins.set_safe(self.pins.command, place);
        cycle.pins.set_safe(self.pins.command, f64::NAN);
        let word = cycle.words.word(self.probe.shown);
        if let Some(place) = self.probe.read(word, cycle.certain) {
            let place = f64::from(place) / self.scale;
            cycle.pins.publish(self.pins.probe_place, place);
            cycle.pins.publish(self.pins.probe_enable, false);
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        // The request is written again until the register shows it, so that a probe misses no edge.
        let is_wanted = cycle.pins.fetch(self.pins.probe_enable.as_output());
        self.probe.write(is_wanted, cycle.words);
        if !cycle.changed {
            return;
        }
        let version = cycle.pins.output_version(self.parameters);
        if version != self.version {
            self.version = version;
            self.prepared += 1;
            self.scale = cycle.pins.param(self.pins.scale);
            let first = cycle.pins.param(self.pins.curve);
            for (setting, word) in self.curve.iter().zip(first..) {
                cycle.words.set(*setting, word);
                cycle.words.repeat(*setting);
            }
        }
        let command = cycle.pins.fetch(self.pins.command) * self.scale;
        cycle.words.put(self.command, command as u32);
        cycle.pins.publish(self.pins.prepared, self.prepared);
        let timer_us = cycle.pins.commanded(self.timer_us);
        cycle.pins.publish(self.pins.latch_us, timer_us);
    }

    /// After a reset the register shows neither the request nor a place.
    fn restored(&mut self, _: &mut PinStore, _: Instant) {
        self.probe.progress = Progress::Idle;
    }
}

#[derive(Debug, Default)]
struct Gateware {
    place: u32,
    curve: Vec<u32>,
    is_armed: bool,
    latched: u32,
}

impl SimModule for Gateware {
    fn read(&mut self, _fabric: &Fabric, register: u8, _instance: u8) -> u32 {
        match register {
            0 => self.place,
            _ => self.latched << 1 | u32::from(self.is_armed),
        }
    }

    fn write(&mut self, _fabric: &mut Fabric, register: u8, _instance: u8, value: u32) {
        match register {
            0 if value > 0 => self.place = value,
            0 => {}
            1 => self.curve.push(value),
            _ => self.is_armed = value & ARMED != 0,
        }
    }

    fn set_input(&mut self, _: u64, pin: SimPinDescriptor, level: bool) {
        if pin.pin == PROBE_INPUT && level && std::mem::take(&mut self.is_armed) {
            self.latched = self.place;
        }
    }

    fn reload(&mut self, _: &Configuration<'_>) {
        self.curve.clear();
        (self.is_armed, self.latched) = (false, 0);
    }
}

fn fpga() -> SimFpga {
    let mut firmware = machines::firmware_7i92_7i77();
    let descriptor = SimModuleDescriptor {
        gtag: MOVER.0,
        base: 0xA000,
        registers: 3,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.push(descriptor);
    firmware.pins[PROBE] = SimPinDescriptor::new(MOVER.0, 0, PROBE_INPUT);
    let mut fpga = SimFpga::new(firmware);
    fpga.add_module(MOVER.0, Box::new(Gateware::default()));
    fpga.drive_pin(PROBE, Some(false));
    fpga
}

fn started() -> (Driver<SimFpga>, MoverPins) {
    started_on(fpga())
}

fn started_on<B: RegisterBus + Clock>(bus: B) -> (Driver<B>, MoverPins) {
    let mut board = Board::identify(bus, Settings::default()).expect("a board");
    let pins = board.add(register).expect("the module");
    (board.start().expect("it starts"), pins)
}

fn cycles<B: RegisterBus + Clock>(driver: &mut Driver<B>, count: u32) {
    for _ in 0..count {
        let _ = driver.read().expect("the bus is well");
        driver.write().expect("the bus is well");
        driver.bus_mut().wait(PERIOD);
    }
}

fn curve(driver: &Driver<SimFpga>) -> &[u32] {
    let module: &Gateware = driver.bus().module(MOVER.0).expect("it was added");
    &module.curve
}

#[test]
fn multi_word_register_is_written_in_order_at_set_up_and_change() {
    let (mut driver, pins) = started();
    assert!(curve(&driver).ends_with(&[1, 2, 3]), "{:?}", curve(&driver));
    driver
        .pins_mut()
        .set_param(pins.curve, 7)
        .expect("a parameter");
    cycles(&mut driver, 1);
    assert!(curve(&driver).ends_with(&[7, 8, 9]), "{:?}", curve(&driver));
    driver.bus_mut().reload();
    cycles(&mut driver, 2);
    let _ = driver.rearm().expect("it is there");
    assert!(curve(&driver).ends_with(&[7, 8, 9]), "{:?}", curve(&driver));
}

#[test]
fn parameters_are_prepared_on_change_not_with_each_command() {
    let (mut driver, pins) = started();
    cycles(&mut driver, 1);
    let prepared = driver.pins().read(pins.prepared).value;
    for command in 1..50 {
        driver.pins_mut().set(pins.command, f64::from(command));
        cycles(&mut driver, 1);
    }
    assert_eq!(driver.pins().read(pins.prepared).value, prepared);
    driver
        .pins_mut()
        .set_param(pins.scale, 2.0)
        .expect("a parameter");
    cycles(&mut driver, 2);
    assert_eq!(driver.pins().read(pins.prepared).value, prepared + 1);
    assert_eq!(driver.pins().read(pins.place).ok(), Some(49.0));
}

/// The command of a position is safe where the axis stands.
#[test]
fn output_has_the_safe_value_of_its_module_after_a_fault() {
    let (mut driver, pins) = started();
    driver.pins_mut().set(pins.command, 40.0);
    cycles(&mut driver, 3);
    // The watchdog bites.
    driver.bus_mut().wait(PERIOD * 50);
    driver.pins_mut().set(pins.command, 900.0);
    cycles(&mut driver, 2);
    let _ = driver.rearm().expect("it is there");
    cycles(&mut driver, 3);
    assert_eq!(driver.pins().read(pins.place).ok(), Some(40.0));
    driver.pins_mut().set(pins.command, 50.0);
    cycles(&mut driver, 3);
    assert_eq!(driver.pins().read(pins.place).ok(), Some(50.0));
}

#[test]
fn module_knows_the_latch_time_of_its_dpll_timer() {
    let (mut driver, pins) = started();
    let timer = driver.pins().output("hm2_7i92.0.dpll.02.timer-us");
    driver.pins_mut().set(timer.expect("a timer"), -250.0);
    driver.pins_mut().set(pins.command, 1.0);
    cycles(&mut driver, 2);
    assert_eq!(driver.pins().read(pins.latch_us).ok(), Some(-250.0));
}

/// Moves on, with an edge of the probe on the way; returns the place of the edge.
fn probed<B: RegisterBus + Clock>(
    driver: &mut Driver<B>,
    pins: MoverPins,
    edge: impl Fn(&mut B, bool),
) -> f64 {
    let from = driver.pins().read(pins.place).value;
    for step in 1..=10 {
        driver.pins_mut().set(pins.command, from + f64::from(step));
        cycles(driver, 1);
        edge(driver.bus_mut(), step == 4);
    }
    from + 4.0
}

fn touch(fpga: &mut SimFpga, is_touched: bool) {
    fpga.drive_pin(PROBE, Some(is_touched));
}

#[test]
fn place_of_the_edge_of_a_probe_is_latched_and_ends_the_request() {
    let (mut driver, pins) = started();
    let asks = |driver: &Driver<SimFpga>| driver.pins().read(pins.probe_enable).value;
    let latched = |driver: &Driver<SimFpga>| driver.pins().read(pins.probe_place).ok();
    let _ = probed(&mut driver, pins, touch);
    assert_eq!(latched(&driver), Some(0.0), "nothing was asked for");
    // Twice, also at the same place.
    for is_back in [false, true] {
        if is_back {
            driver.pins_mut().set(pins.command, 10.0);
            cycles(&mut driver, 3);
        }
        driver.pins_mut().set(pins.probe_enable, true);
        cycles(&mut driver, 3);
        assert!(asks(&driver), "no edge yet");
        let at = probed(&mut driver, pins, touch);
        assert_eq!((latched(&driver), asks(&driver)), (Some(at), false));
        let _ = probed(&mut driver, pins, touch);
        assert_eq!(latched(&driver), Some(at), "once");
    }
    // Taken back.
    driver.pins_mut().set(pins.probe_enable, true);
    cycles(&mut driver, 3);
    driver.pins_mut().set(pins.probe_enable, false);
    cycles(&mut driver, 3);
    let before = latched(&driver);
    let _ = probed(&mut driver, pins, touch);
    assert_eq!((latched(&driver), asks(&driver)), (before, false));
}

/// Whichever write is lost: that of the request, or one in the period of the edge.
#[test]
fn lost_write_costs_no_edge_of_a_probe() {
    for lost in 0..16 {
        let (mut driver, pins) = started_on(Faulty::new(fpga(), 1));
        cycles(&mut driver, 120);
        driver.pins_mut().set(pins.probe_enable, true);
        let next = driver.bus_mut().exchanges();
        driver.bus_mut().fail_at(next + lost, Fault::AckedButLost);
        driver
            .bus_mut()
            .fail_at(next + lost + 1, Fault::NotExecuted(BusErrorKind::Lost));
        for _ in 0..4 {
            let _ = driver.read();
            let _ = driver.write();
            driver.bus_mut().wait(PERIOD);
        }
        let from = driver.pins().read(pins.place).value;
        for step in 1..=10 {
            driver.pins_mut().set(pins.command, from + f64::from(step));
            let _ = driver.read();
            let _ = driver.write();
            driver.bus_mut().wait(PERIOD);
            let fpga = &mut driver.bus_mut().inner;
            touch(fpga, step == 4);
        }
        let place = driver.pins().read(pins.probe_place).value;
        assert!((place - from - 4.0).abs() <= 2.0, "{lost}: {place}");
        assert!(!driver.pins().read(pins.probe_enable).value, "{lost}");
    }
}

#[test]
fn request_of_before_a_reset_is_made_again() {
    let (mut driver, pins) = started();
    driver.pins_mut().set(pins.probe_enable, true);
    cycles(&mut driver, 3);
    driver.bus_mut().reload();
    cycles(&mut driver, 2);
    let _ = driver.rearm().expect("it is there");
    driver.pins_mut().set(pins.probe_enable, true);
    cycles(&mut driver, 5);
    assert!(driver.pins().read(pins.probe_enable).value, "no edge yet");
    let at = probed(&mut driver, pins, touch);
    assert_eq!(driver.pins().read(pins.probe_place).ok(), Some(at));
}
