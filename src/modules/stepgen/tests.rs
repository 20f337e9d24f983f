//! Generators in a driver, with the registers of FACTS 14 and a motor that counts the steps that go
//! out while its pins are driven.

use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use core::time::Duration;
use std::collections::BTreeSet;

use super::*;
use crate::bus::{Access, BusError, BusErrorKind, Clock, Direction, RegisterBus};
use crate::driver::{BoardState, Driver, EventKind, Events, Remark, RemarkKind, Settings};
use crate::hal::{Param, PinError};
use crate::transport::{Fault, Faulty};
use mesa_hal_sim::{SimFpga, SimModuleDescriptor, SimPinDescriptor, machines};

mod faults;
mod limits;
mod meaning;
mod motion;
mod set_up;

const GTAG: u8 = 0x05;
const MS: u64 = 1_000_000;
/// Pins of the second connector: step, direction and two outputs of a table for each of two
/// generators, then index and probe.
const FIRST_PIN: usize = 17;

/// Two generators with ideal pulses.
#[derive(Debug, Default)]
struct Model {
    now: u64,
    master: u32,
    timer: u32,
    /// The accumulators read as 0.
    is_frozen: bool,
    generators: [ModelGenerator; 2],
    /// What must not happen.
    wrongs: Vec<String>,
}

#[derive(Debug, Default)]
struct ModelGenerator {
    rate: i32,
    mode: u32,
    dir_setup: u32,
    dir_hold: u32,
    step_len: u32,
    step_space: u32,
    table: Vec<u32>,
    table_max: u32,
    /// Without wrap-around; a step is 2^32.
    accumulator: i64,
    latched: u32,
}

impl ModelGenerator {
    fn steps(&self) -> i64 {
        self.accumulator >> 32
    }

    fn wrong(&self, master: u32) -> Option<&'static str> {
        if master == 0 {
            return None;
        }
        if self.step_len == 0 {
            return Some("STEPLEN is 0");
        }
        (self.rate != 0 && self.dir_hold < self.step_len)
            .then_some("the hold does not include the pulse")
    }

    /// An edge of the index or the probe.
    fn edge(&mut self, enable: u32) {
        if self.mode & enable != 0 {
            self.mode &= !enable;
            self.latched = (self.accumulator >> 24) as u32 & 0xFF_FFFF;
        }
    }
}

impl Model {
    /// Ticks of 10 ns until `now`.
    fn advance(&mut self, now: u64) {
        let ticks = (now / 10).saturating_sub(self.now / 10) as i64;
        self.now = now;
        for generator in &mut self.generators {
            if self.master != 0 {
                generator.accumulator += i64::from(generator.rate) * ticks;
            }
        }
    }
}

impl Model {
    fn read(&mut self, now: u64, register: u8, instance: u8) -> u32 {
        self.advance(now);
        let Some(generator) = self.generators.get(usize::from(instance)) else {
            return 0;
        };
        match register {
            1 if self.is_frozen => 0,
            1 => (generator.accumulator >> 16) as u32,
            2 => generator.mode & 0xFF | generator.latched << 8,
            9 => self.master,
            10 => self.timer,
            _ => 0xDEAD_BEEF,
        }
    }

    fn write(&mut self, now: u64, register: u8, instance: u8, value: u32) {
        self.advance(now);
        let generator = &mut self.generators[usize::from(instance)];
        let moves = self.master != 0 && generator.rate != 0;
        let mut pulses = |old: &mut u32, mask: u32| {
            if moves && (*old ^ value) & mask != 0 {
                let what = format!("register {register} is {value:#X} while it moves");
                self.wrongs.push(what);
            }
            *old = value & mask;
        };
        match register {
            0 => generator.rate = value as i32,
            1 => self.wrongs.push("ACCUM is written".to_string()),
            2 => {
                pulses(&mut (generator.mode & 0xF), 0xF);
                generator.mode = value & 0xFF;
            }
            3 => pulses(&mut generator.dir_setup, 0x3FFF),
            4 => pulses(&mut generator.dir_hold, 0x3FFF),
            5 => pulses(&mut generator.step_len, 0x3FFF),
            6 => pulses(&mut generator.step_space, 0x3FFF),
            7 | 8 if moves => self
                .wrongs
                .push("the table is written while it moves".to_string()),
            7 => {
                generator.table.insert(0, value);
                generator.table.truncate(16);
            }
            8 => generator.table_max = value,
            9 => self.master = value,
            _ => self.timer = value,
        }
        let master = self.master;
        let wrong = self.generators.iter().find_map(|one| one.wrong(master));
        self.wrongs.extend(wrong.map(ToString::to_string));
    }

    fn reload(&mut self, now: u64) {
        let accumulators = [0, 1].map(|n: usize| self.generators[n].accumulator);
        *self = Self {
            now,
            wrongs: core::mem::take(&mut self.wrongs),
            ..Self::default()
        };
        // The count of the steps goes on, though the register is 0.
        for (generator, accumulator) in self.generators.iter_mut().zip(accumulators) {
            generator.accumulator = accumulator & !0xFFFF_FFFF_FFFF;
        }
    }
}

/// A simulated board whose step generators are the model.
struct ModelBoard {
    fpga: SimFpga,
    model: Model,
}

impl RegisterBus for ModelBoard {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        for access in accesses {
            for (at, word) in (access.address..)
                .step_by(4)
                .zip(&mut words[access.words()])
            {
                let is_read = access.direction == Direction::Read;
                let now = self.fpga.now();
                let (register, instance) = ((at >> 8) as u8 & 0xF, at as u8 / 4);
                match (at, is_read) {
                    (0x2000..0x2B00, true) => *word = self.model.read(now, register, instance),
                    (0x2000..0x2B00, false) => self.model.write(now, register, instance, *word),
                    (_, true) => *word = self.fpga.read(at)?,
                    (_, false) => self.fpga.write(at, *word)?,
                }
            }
        }
        Ok(())
    }
}

impl Clock for ModelBoard {
    fn now(&mut self) -> Instant {
        Clock::now(&mut self.fpga)
    }

    fn wait(&mut self, duration: Duration) {
        self.fpga.wait(duration);
    }
}

struct Machine {
    driver: Driver<Faulty<ModelBoard>>,
    pins: StepgenPins,
    events: Events,
    /// Steps of generator 0 that went out, and all that it has made.
    motor: i64,
    made: i64,
}

fn firmware(version: u8) -> SimFpga {
    let mut firmware = machines::firmware_7i92_7i77();
    let descriptor = SimModuleDescriptor {
        gtag: GTAG,
        version,
        instances: 2,
        base: 0x2000,
        registers: 10,
        multiple: 0x1FF,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.push(descriptor);
    for unit in 0..2 {
        for output in 0..4 {
            let pin = FIRST_PIN + usize::from(4 * unit + output);
            firmware.pins[pin] = SimPinDescriptor::new(GTAG, unit, 0x81 + output);
        }
    }
    if version == WITH_LATCH {
        firmware.pins[FIRST_PIN + 8] = SimPinDescriptor::new(GTAG, 0, 0x09);
        firmware.pins[FIRST_PIN + 9] = SimPinDescriptor::new(GTAG, 0x80, 0x0A);
    }
    SimFpga::new(firmware)
}

/// A machine with usual times, a scale of 1000, a speed of 10 and an acceleration of 100.
fn machine(version: u8) -> Machine {
    let mut machine = start(firmware(version), Settings::default());
    let pins = machine.pins;
    for (param, value) in [
        (pins.position_scale, 1_000.0),
        (pins.maxvel, 10.0),
        (pins.maxaccel, 100.0),
    ] {
        machine.set_param(param, value);
    }
    for (param, ns) in [
        (pins.steplen, 2_500),
        (pins.stepspace, 2_500),
        (pins.dirsetup, 5_000),
        (pins.dirhold, 5_000),
    ] {
        machine.driver.pins_mut().set_param(param, ns).unwrap();
    }
    machine
}

fn start(fpga: SimFpga, settings: Settings) -> Machine {
    let model = Model::default();
    let board = ModelBoard { fpga, model };
    let driver = Driver::start(Faulty::new(board, 1), settings).expect("it starts");
    let pins = driver.modules::<Stepgens>().next().map(Stepgens::pins);
    let pins = pins.and_then(|mut pins| pins.next()).expect("a generator");
    Machine {
        events: driver.events(),
        driver,
        pins,
        motor: 0,
        made: 0,
    }
}

impl Machine {
    fn set_param(&mut self, param: Param<f64>, value: f64) {
        self.driver.pins_mut().set_param(param, value).unwrap();
    }

    fn fpga(&mut self) -> &mut SimFpga {
        &mut self.driver.bus_mut().inner.fpga
    }

    fn model(&mut self) -> &mut Model {
        &mut self.driver.bus_mut().inner.model
    }

    fn generator(&mut self) -> &mut ModelGenerator {
        &mut self.model().generators[0]
    }

    fn read(&self, pin: crate::hal::Input<f64>) -> f64 {
        self.driver.pins().read(pin).value
    }

    fn delay(&self) -> f64 {
        let module = self.driver.modules::<Stepgens>().next();
        module.expect("step generators").delay
    }

    fn unsure(&self) -> bool {
        self.driver.pins().read(self.pins.position_unsure).value
    }

    /// Lets time pass; the motor moves while its pin is driven.
    fn wait(&mut self, nanos: u64) {
        let is_driven = self.fpga().is_driven(FIRST_PIN);
        self.driver.bus_mut().wait(Duration::from_nanos(nanos));
        let now = self.fpga().now().as_nanos();
        self.model().advance(now);
        let made = self.generator().steps();
        if is_driven && self.fpga().is_driven(FIRST_PIN) {
            self.motor += made - self.made;
        }
        self.made = made;
    }

    /// One period: read, command, write.
    fn cycle(&mut self, command: f64) -> BoardState {
        let report = self.driver.read();
        self.driver.pins_mut().set(self.pins.position_cmd, command);
        let _ = self.driver.write();
        self.wait(MS);
        report.map_or(BoardState::BusDown, |report| report.board)
    }

    fn enable(&mut self, on: bool) {
        self.driver.pins_mut().set(self.pins.enable, on);
    }

    /// Enabled, and at rest at 0.
    fn enabled(version: u8) -> Self {
        let mut machine = machine(version);
        for _ in 0..3 {
            machine.cycle(0.0);
        }
        machine.enable(true);
        machine
    }

    /// Runs until the position is `end`.
    fn go(&mut self, end: f64) {
        for _ in 0..3_000 {
            self.cycle(end);
        }
        assert!((self.read(self.pins.position_fb) - end).abs() < 1e-4);
    }

    /// Events of step generators.
    fn said(&mut self) -> Vec<String> {
        let of_steps = |kind: &EventKind| {
            matches!(
                kind,
                EventKind::StepRateLimited { .. }
                    | EventKind::StepTimeClipped { .. }
                    | EventKind::StepHoldShort { .. }
                    | EventKind::StepgenStalled { .. }
            )
        };
        let events = self.events.by_ref().map(|event| event.kind);
        events
            .filter(of_steps)
            .map(|kind| kind.to_string())
            .collect()
    }

    /// Within a step: the command is on the boundary between two.
    #[track_caller]
    fn assert_motor_at(&self, steps: f64) {
        let motor = self.motor as f64;
        assert!((motor - steps).abs() <= 1.0, "{motor}, expected {steps}");
    }

    #[track_caller]
    fn assert_right(&mut self) {
        assert_eq!(self.model().wrongs, [""; 0]);
    }
}
