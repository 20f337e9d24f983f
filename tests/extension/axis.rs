//! What the step generators needed of the extension point, for any module outside of the crate: a part
//! of its own for parameters, a safe value that follows the machine, a register that takes several
//! words, and the time of the timer that latches it.

use mesa_hal::bus::{Clock, Phase, ReadSlot, Setting, Stage, WriteSlot};
use mesa_hal::driver::{Board, Driver, Settings};
use mesa_hal::hal::{GroupId, Input, Output, Param, PinMaker};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::modules::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use mesa_hal_sim::{ForeignModule, SimFpga, SimModuleDescriptor, machines};
use std::time::Duration;

const MOVER: Gtag = Gtag(0x9B);
const PERIOD: Duration = Duration::from_millis(1);

#[derive(Clone, Copy, Debug)]
struct MoverPins {
    command: Output<f64>,
    place: Input<f64>,
    latch_us: Input<f64>,
    scale: Param<f64>,
    curve: Param<u32>,
    prepared: Input<u32>,
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
}

fn register(r: &mut Registrar<'_>) -> Result<MoverPins, RegisterError> {
    let module = r.module(MOVER).expect("the firmware has it");
    let mut make = r.maker("mover.");
    let (command, place) = (make.output("command", 0.0)?, make.input("place")?);
    let (latch_us, prepared) = (make.input("latch-us")?, make.input("prepared")?);
    // Only their changes are looked at, while the command changes in each cycle.
    let parameters = r.pins.add_part(r.group)?;
    let stem = format!("{}.mover.", r.name);
    let mut make = PinMaker::new(r.pins, parameters, stem);
    let pins = MoverPins {
        command,
        place,
        latch_us,
        prepared,
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
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
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
}

#[derive(Debug, Default)]
struct Gateware {
    place: u32,
    curve: Vec<u32>,
}

impl ForeignModule for Gateware {
    fn read(&mut self, _now: u64, _register: u8, _instance: u8) -> u32 {
        self.place
    }

    fn write(&mut self, _now: u64, register: u8, _instance: u8, value: u32) {
        match register {
            0 if value > 0 => self.place = value,
            0 => {}
            _ => self.curve.push(value),
        }
    }

    fn level(&self, _now: u64, _instance: u8, _pin: u8) -> bool {
        false
    }

    fn reload(&mut self, _now: u64) {
        self.curve.clear();
    }
}

fn started() -> (Driver<SimFpga>, MoverPins) {
    let mut firmware = machines::firmware_7i92_7i77();
    let descriptor = SimModuleDescriptor::new(MOVER.0, 0, 1, 1, 0xA000, 2, 0x00, 0);
    firmware.modules.push(descriptor);
    let mut fpga = SimFpga::new(firmware);
    fpga.add_module(MOVER.0, Box::new(Gateware::default()));
    let mut board = Board::identify(fpga, Settings::default()).expect("a board");
    let pins = board.add(register).expect("the module");
    (board.start().expect("it starts"), pins)
}

fn cycles(driver: &mut Driver<SimFpga>, count: u32) {
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
fn a_register_of_several_words_gets_them_in_their_order_at_the_set_up_and_after_a_change() {
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
fn parameters_are_prepared_when_one_of_them_changes_and_not_with_each_command() {
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
fn after_a_fault_an_output_has_the_safe_value_that_its_module_gave_it() {
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
fn a_module_knows_the_time_at_which_a_timer_of_the_loop_latches_it() {
    let (mut driver, pins) = started();
    let timer = driver.pins().output("hm2_7i92.0.dpll.02.timer-us");
    driver.pins_mut().set(timer.expect("a timer"), -250.0);
    driver.pins_mut().set(pins.command, 1.0);
    cycles(&mut driver, 2);
    assert_eq!(driver.pins().read(pins.latch_us).ok(), Some(-250.0));
}
