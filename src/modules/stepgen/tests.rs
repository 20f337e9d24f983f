//! Generators in a driver, with the registers of FACTS 14 and a motor that counts the steps that go
//! out while its pins are driven.

use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use core::time::Duration;
use std::collections::BTreeSet;

use super::*;
use crate::bus::{Access, BusErrorKind, Clock, Direction, RegisterBus};
use crate::driver::{BoardState, Driver, EventKind, Events, Remark, RemarkKind, Settings};
use crate::hal::{Param, PinError};
use crate::transport::{Fault, Faulty};
use mesa_hal_sim::{SimError, SimFpga, SimModuleDescriptor, SimPinDescriptor, machines};

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
    type Error = SimError;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), SimError> {
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
    let descriptor = SimModuleDescriptor::new(GTAG, version, 1, 2, 0x2000, 10, 0x00, 0x1FF);
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
                    | EventKind::StepgenStands { .. }
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

#[test]
fn names_types_and_fresh_values_are_those_of_linuxcnc() {
    let machine = start(firmware(WITH_LATCH), Settings::default());
    let pins = machine.driver.pins();
    let prefix = "hm2_7i92.0.stepgen.";
    let found: BTreeSet<_> = pins
        .infos()
        .iter()
        .zip(pins.values())
        .filter_map(|(info, value)| {
            let name = info.name.strip_prefix(prefix)?;
            let name = name
                .strip_prefix("00.")
                .or(Some(name).filter(|n| !n.starts_with("01.")))?;
            Some(format!(
                "{name} {} {} {value}",
                info.hal_type.as_str(),
                info.role.hal_direction()
            ))
        })
        .collect();
    let expected = "\
        control-type bit IN false|counts s32 OUT 0|dbg_err_at_match float OUT 0|dbg_ff_vel float OUT 0|\
        dbg_pos_minus_prev_cmd float OUT 0|dbg_s_to_match float OUT 0|dbg_step_rate s32 OUT 0|\
        dbg_vel_error float OUT 0|dirhold u32 RW 163830|dirsetup u32 RW 163830|disable-ramp bit RW false|\
        enable bit IN false|index-enable bit I/O false|index-invert bit IN false|maxaccel float RW 1|\
        maxvel float RW 0|near-max-rate bit OUT false|position-cmd float IN 0|position-fb float OUT 0|\
        position-lag float OUT 0|position-latch float OUT 0|position-reset bit IN false|\
        position-scale float RW 1|position-unsure bit OUT false|probe-enable bit I/O false|\
        probe-invert bit IN false|step_type u32 RW 0|steplen u32 RW 163830|stepspace u32 RW 163830|\
        swap_step_dir bit RW false|table-data-0 u32 RW 0|table-data-1 u32 RW 0|table-data-2 u32 RW 0|\
        table-data-3 u32 RW 0|timer-number s32 IN -1|velocity-cmd float IN 0|velocity-fb float OUT 0";
    let expected: BTreeSet<_> = expected.split('|').map(ToString::to_string).collect();
    assert_eq!(found, expected);
}

#[test]
fn the_set_up_ends_with_the_master_rate_and_the_directions() {
    let mut machine = machine(2);
    machine.assert_right();
    assert_eq!(machine.model().master, u32::MAX);
    let generator = machine.generator();
    assert_eq!((generator.step_len, generator.dir_hold), (0x3FFF, 0x3FFF));
    let driven: Vec<_> = (0..10)
        .filter(|n| machine.fpga().is_driven(FIRST_PIN + n))
        .collect();
    assert_eq!(driven, [0, 1, 4, 5], "the others are plain I/O");
    machine.cycle(0.0);
    machine.cycle(0.0);
    let generator = machine.generator();
    assert_eq!((generator.step_len, generator.step_space), (250, 250));
    assert_eq!((generator.dir_setup, generator.dir_hold), (500, 250 + 501));
    machine.assert_right();
}

#[test]
fn a_position_arrives_and_the_motor_has_made_its_steps() {
    for (version, end) in [(2, 1.0), (2, -1.0), (0, 0.001), (0x42, 20.0)] {
        let mut machine = Machine::enabled(version);
        machine.go(end);
        machine.assert_motor_at(end * 1_000.0);
        assert_eq!(machine.read(machine.pins.velocity_fb), 0.0);
        assert!(!machine.unsure());
        assert_eq!(machine.said(), [""; 0]);
        machine.assert_right();
    }
}

#[test]
fn nothing_moves_before_a_read_has_confirmed_the_times() {
    let mut machine = machine(2);
    machine.enable(true);
    let _ = machine.driver.read();
    machine
        .driver
        .pins_mut()
        .set(machine.pins.position_cmd, 1.0);
    // The write with the times is lost.
    let next = machine.driver.bus_mut().exchanges();
    machine.driver.bus_mut().fail_at(next, Fault::SilentWrite);
    machine.driver.write().unwrap();
    machine.wait(MS);
    assert_eq!(machine.generator().step_len, 0x3FFF);
    machine.cycle(1.0);
    assert_eq!(
        (machine.generator().rate, machine.generator().step_len),
        (0, 250)
    );
    machine.cycle(1.0);
    assert!(machine.generator().rate > 0);
    machine.go(1.0);
    machine.assert_motor_at(1_000.0);
    machine.assert_right();
}

#[test]
fn disabled_is_a_rate_of_0_at_once_or_along_the_acceleration() {
    for has_ramp in [false, true] {
        let mut machine = Machine::enabled(2);
        let ramp = machine.pins.disable_ramp;
        machine.driver.pins_mut().set_param(ramp, has_ramp).unwrap();
        for _ in 0..51 {
            machine.cycle(-100.0);
        }
        let before = machine.generator().rate;
        assert!(before < -200_000, "{before}");
        machine.enable(false);
        machine.cycle(-100.0);
        let change = f64::from(machine.generator().rate - before);
        if has_ramp {
            // 0.1 units per second and period.
            assert!((change / 42.949_672_96 - 100.0).abs() < 0.1, "{change}");
            for _ in 0..60 {
                machine.cycle(-100.0);
            }
        }
        assert_eq!(machine.generator().rate, 0);
        let (at, motor) = (machine.read(machine.pins.position_fb), machine.motor);
        machine.cycle(5.0);
        machine.cycle(5.0);
        assert_eq!(machine.motor, motor, "still");
        assert!(
            (machine.read(machine.pins.position_fb) * 1_000.0 - motor as f64).abs() < 1.0,
            "{at}"
        );
        machine.assert_right();
    }
}

#[test]
fn a_speed_is_kept_and_the_position_counts() {
    let mut machine = Machine::enabled(2);
    let pins = machine.pins;
    machine.driver.pins_mut().set(pins.control_type, true);
    machine.driver.pins_mut().set(pins.velocity_cmd, -5.0);
    for _ in 0..1_000 {
        machine.cycle(0.0);
    }
    assert_eq!(machine.read(pins.velocity_fb), -5.0);
    // 50 ms of acceleration.
    assert!((machine.motor + 4_940).abs() <= 70, "{}", machine.motor);
    machine.driver.pins_mut().set(pins.velocity_cmd, f64::NAN);
    for _ in 0..60 {
        machine.cycle(0.0);
    }
    assert_eq!(
        machine.read(pins.velocity_fb),
        0.0,
        "no number is a speed of 0"
    );
    machine.assert_right();
}

#[test]
fn a_command_that_is_no_number_is_the_one_before_and_counted() {
    let mut machine = Machine::enabled(2);
    machine.go(2.0);
    let before = machine.driver.pins().total_rejections().not_finite;
    for _ in 0..10 {
        machine.cycle(f64::NAN);
    }
    machine.assert_motor_at(2_000.0);
    assert!(machine.driver.pins().total_rejections().not_finite >= before + 10);
}

#[test]
fn the_position_goes_on_beyond_the_accumulator() {
    let mut machine = Machine::enabled(2);
    let pins = machine.pins;
    machine.set_param(pins.position_scale, 10.0);
    machine.set_param(pins.maxvel, 0.0);
    machine.set_param(pins.maxaccel, 0.0);
    machine.go(-20_000.0);
    machine.assert_motor_at(-200_000.0);
    let counts = machine.driver.pins().read(pins.counts).value;
    assert!((-200_001..=-200_000).contains(&counts));
    machine.driver.pins_mut().set(pins.position_reset, true);
    machine.cycle(0.0);
    machine.cycle(0.0);
    machine.cycle(0.0);
    assert_eq!(machine.read(pins.position_fb), 0.0);
}

#[test]
fn mode_swap_and_times_change_at_rest_only() {
    let mut machine = Machine::enabled(0x42);
    for _ in 0..20 {
        machine.cycle(1.0);
    }
    let pins = machine.pins;
    machine
        .driver
        .pins_mut()
        .set_param(pins.step_type, 2)
        .unwrap();
    machine
        .driver
        .pins_mut()
        .set_param(pins.steplen, 5_000)
        .unwrap();
    let swap = pins.swap_step_dir.unwrap();
    machine.driver.pins_mut().set_param(swap, true).unwrap();
    machine.cycle(1.0);
    assert_eq!(
        (machine.generator().mode, machine.generator().step_len),
        (0, 250)
    );
    machine.go(1.0);
    assert_eq!(
        (machine.generator().mode, machine.generator().step_len),
        (6, 500)
    );
    machine.go(0.0);
    machine.assert_right();
}

#[test]
fn a_table_is_written_whole_and_its_length_exchanges_no_outputs() {
    let settings = Settings {
        stepgen_width: 4,
        ..Settings::default()
    };
    let mut machine = start(firmware(0x42), settings);
    let pins = machine.pins;
    let table = pins.table_data.expect("pins for a table");
    for (param, data) in table
        .into_iter()
        .zip([0x0403_0201, 0x0807_0605, 0, 0x1000_0000])
    {
        machine.driver.pins_mut().set_param(param, data).unwrap();
    }
    machine
        .driver
        .pins_mut()
        .set_param(pins.step_type, 6)
        .unwrap();
    let _ = machine.driver.read();
    let next = machine.driver.bus_mut().exchanges();
    machine.driver.bus_mut().fail_at(next, Fault::SilentWrite);
    machine.driver.write().unwrap();
    machine.wait(MS);
    machine.cycle(0.0);
    machine.cycle(0.0);
    let generator = machine.generator();
    assert_eq!(generator.mode, 3);
    assert_eq!(generator.table_max, 5);
    let mut expected: Vec<u32> = (1..=8).collect();
    expected.resize(16, 0);
    expected[15] = 0x10;
    assert_eq!(generator.table, expected);
    assert!(machine.fpga().is_driven(FIRST_PIN + 3));
    machine.set_param(pins.position_scale, 1_000.0);
    machine.set_param(pins.maxaccel, 100.0);
    // It does not move before it is certain that nothing of the table is written again.
    machine.enable(true);
    for period in 0..400 {
        if period % 7 == 0 && period > 110 {
            let next = machine.driver.bus_mut().exchanges();
            machine
                .driver
                .bus_mut()
                .fail_at(next + 1, Fault::SilentWrite);
        }
        machine.cycle(1.0);
        assert!(machine.motor == 0 || period > 95, "{period}");
    }
    assert!(machine.motor > 100, "{}", machine.motor);
    machine.assert_right();
}

#[test]
fn a_table_is_refused_where_there_are_no_pins_for_one() {
    let settings = Settings {
        instances: [(Gtag::STEPGEN, 2)].into(),
        ..Settings::default()
    };
    let fpga = SimFpga::new(machines::firmware_7i92_7i76());
    let mut machine = start(fpga, settings);
    let (pins, to) = (machine.pins, machine.driver.pins_mut());
    assert!(pins.table_data.is_none());
    for step_type in [3, 4, 16, u32::MAX] {
        let refused = to.set_param(pins.step_type, step_type);
        assert!(refused.is_err(), "{step_type}");
    }
    to.set_param(pins.step_type, 2).expect("quadrature");
}

#[test]
fn a_bite_stops_the_rate_before_the_directions_and_leaves_the_position_unsure() {
    let mut machine = Machine::enabled(2);
    for _ in 0..60 {
        machine.cycle(100.0);
    }
    let moving = machine.generator().rate;
    assert!(moving > 0);
    // The host is late: the generator goes on, and nothing reaches the motor.
    machine.wait(10 * MS);
    let motor = machine.motor;
    machine.wait(20 * MS);
    assert_eq!(machine.generator().rate, moving, "a bite does not stop it");
    assert_eq!(machine.motor, motor);
    assert_eq!(machine.cycle(100.0), BoardState::WatchdogBitten);
    assert_eq!(machine.generator().rate, 0);
    assert!(!machine.fpga().is_driven(FIRST_PIN));
    for _ in 0..5 {
        machine.cycle(100.0);
    }
    let shown = machine.read(machine.pins.position_fb);
    let _ = machine.driver.rearm().expect("it is there");
    for _ in 0..10 {
        machine.driver.read().map(drop).unwrap();
        machine.driver.write().unwrap();
        machine.wait(MS);
    }
    assert!(machine.fpga().is_driven(FIRST_PIN));
    assert_eq!(
        (machine.generator().rate, machine.motor),
        (0, motor),
        "nothing moves"
    );
    assert!(machine.unsure());
    assert_eq!(
        machine.read(machine.pins.position_fb),
        shown,
        "it goes on where it was read last"
    );
    // The command of before is forgotten: it is where the generator is.
    let command = machine.driver.pins().commanded(machine.pins.position_cmd);
    assert_eq!(command, shown);
    machine.driver.pins_mut().set(machine.pins.enable, true);
    for _ in 0..10 {
        machine.driver.read().map(drop).unwrap();
        machine.driver.write().unwrap();
        machine.wait(MS);
    }
    assert_eq!(machine.motor, motor);
    let reset = machine.pins.position_reset;
    machine.driver.pins_mut().set(reset, true);
    machine.cycle(0.0);
    machine.driver.pins_mut().set(reset, false);
    machine.cycle(0.0);
    assert!(!machine.unsure());
    machine.assert_right();
}

#[test]
fn a_reset_of_the_board_sets_the_times_up_again_before_anything_moves() {
    let mut machine = Machine::enabled(2);
    for _ in 0..60 {
        machine.cycle(100.0);
    }
    machine.fpga().reload();
    let now = machine.fpga().now().as_nanos();
    machine.model().reload(now);
    machine.cycle(100.0);
    machine.cycle(100.0);
    assert_eq!(machine.generator().rate, 0);
    let _ = machine.driver.rearm().expect("it is there");
    machine.cycle(0.0);
    machine.cycle(0.0);
    assert_eq!(
        (machine.generator().step_len, machine.model().master),
        (250, u32::MAX)
    );
    assert!(machine.unsure());
    machine.assert_right();
}

#[test]
fn lost_writes_and_reads_make_no_more_steps_than_their_age_and_the_position_stays_true() {
    let mut machine = Machine::enabled(2);
    machine
        .driver
        .bus_mut()
        .fail_randomly(Fault::SilentWrite, 0.02);
    machine
        .driver
        .bus_mut()
        .fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 0.01);
    for round in 0..6 {
        let end = if round % 2 == 0 { 3.0 } else { 0.0 };
        for _ in 0..900 {
            if machine.cycle(end) == BoardState::Running {
                let shown = machine.read(machine.pins.position_fb) * 1_000.0;
                assert!(
                    (shown - machine.motor as f64).abs() <= 13.0,
                    "{shown}, {}",
                    machine.motor
                );
            } else {
                machine.driver.pins_mut().set(machine.pins.enable, true);
            }
        }
    }
    machine.driver.bus_mut().heal();
    let _ = machine.driver.rearm();
    machine.enable(true);
    machine.assert_right();
}

#[test]
fn a_limit_is_reported_once_with_its_values() {
    let mut machine = Machine::enabled(2);
    let pins = machine.pins;
    // 250 + 250 + 4 ticks.
    machine.set_param(pins.maxvel, 500.0);
    machine.cycle(0.0);
    machine.cycle(0.0);
    machine.cycle(0.0);
    let said = machine.said();
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(
        said[0].contains("generator 0") && said[0].contains("500000"),
        "{said:?}"
    );
    assert!(said[0].contains("198412"), "{said:?}");
    // A command that is faster than maxvel.
    machine.set_param(pins.maxvel, 2.0);
    let mut lag = 0.0_f64;
    for period in 0..300 {
        machine.cycle(f64::from(period) * 0.003);
        lag = lag.max(machine.read(pins.position_lag));
    }
    let said = machine.said();
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].contains("2000 steps/s"), "{said:?}");
    assert!(lag > 0.25, "{lag}");
    machine
        .driver
        .pins_mut()
        .set_param(pins.dirhold, 200_000)
        .unwrap();
    machine.cycle(0.9);
    machine.cycle(0.9);
    let said = machine.said();
    assert!(
        said.iter()
            .any(|text| text.contains("200000") && text.contains("163830")),
        "{said:?}"
    );
    assert_eq!(machine.driver.pins().param(pins.dirhold), 163_830);
}

#[test]
fn the_highest_rate_is_that_of_the_gateware_and_near_it_is_shown() {
    let mut machine = Machine::enabled(2);
    let pins = machine.pins;
    machine.set_param(pins.maxvel, 0.0);
    machine.set_param(pins.maxaccel, 0.0);
    machine.driver.pins_mut().set(pins.control_type, true);
    for (speed, is_near) in [(100.0, false), (180.0, true), (1e6, true), (-1e6, true)] {
        machine.driver.pins_mut().set(pins.velocity_cmd, speed);
        for _ in 0..3 {
            machine.cycle(0.0);
        }
        assert_eq!(
            machine.driver.pins().read(pins.near_max_rate).value,
            is_near,
            "{speed}"
        );
    }
    let rate = f64::from(machine.generator().rate) / 42.949_672_96;
    assert!((rate + 1e8 / 504.0).abs() < 1.0, "{rate}");
}

/// The limit of the speed is one of the parameters: nothing else makes it news.
#[test]
fn a_limit_is_not_reported_again_when_something_is_armed() {
    let mut machine = Machine::enabled(2);
    machine.set_param(machine.pins.maxvel, 500.0);
    for _ in 0..5 {
        machine.cycle(0.0);
    }
    assert_eq!(machine.said().len(), 1);
    machine.wait(20 * MS);
    machine.cycle(0.0);
    let _ = machine.driver.rearm().expect("it is there");
    for _ in 0..5 {
        machine.cycle(0.0);
    }
    assert_eq!(machine.said(), [""; 0]);
    machine.set_param(machine.pins.maxvel, 600.0);
    for _ in 0..5 {
        machine.cycle(0.0);
    }
    assert_eq!(machine.said().len(), 1, "another one");
}

/// Only the old times have a limit that is too low for both.
#[test]
fn a_limit_that_goes_with_the_old_pulses_is_not_reported() {
    let mut machine = Machine::enabled(2);
    for _ in 0..30 {
        machine.cycle(1.0);
    }
    machine.set_param(machine.pins.maxvel, 300.0);
    let (steplen, space) = (machine.pins.steplen, machine.pins.stepspace);
    for time in [steplen, space] {
        machine.driver.pins_mut().set_param(time, 1_000).unwrap();
    }
    machine.go(1.0);
    assert_eq!(machine.said(), [""; 0]);
    assert_eq!(machine.generator().step_len, 100);
}

#[test]
fn a_hold_for_which_the_pulse_leaves_no_room_is_reported_once() {
    let mut machine = Machine::enabled(2);
    let pins = machine.pins;
    machine.set_param(pins.maxvel, 1.0);
    let times = [(pins.steplen, 150_000), (pins.dirhold, 20_000)];
    for (param, ns) in times {
        machine.driver.pins_mut().set_param(param, ns).unwrap();
    }
    for _ in 0..10 {
        machine.cycle(0.0);
    }
    let said = machine.said();
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(
        said[0].contains("20000 ns") && said[0].contains("13830 ns"),
        "{said:?}"
    );
    // Fresh parameters are no news before the generator is used.
    let mut fresh = start(firmware(2), Settings::default());
    fresh.cycle(0.0);
    fresh.cycle(0.0);
    assert_eq!(fresh.said(), [""; 0]);
    fresh.enable(true);
    fresh.cycle(0.0);
    fresh.cycle(0.0);
    assert_eq!(fresh.said().len(), 1);
}

#[test]
fn an_accumulator_that_does_not_follow_its_rate_stops_the_generator() {
    let mut machine = Machine::enabled(2);
    machine.model().is_frozen = true;
    for _ in 0..100 {
        machine.cycle(50.0);
    }
    assert_eq!(machine.generator().rate, 0);
    assert!(machine.unsure());
    let said = machine.said();
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].contains("generator 0"), "{said:?}");
    machine.model().is_frozen = false;
    for _ in 0..20 {
        machine.cycle(50.0);
    }
    assert_eq!(machine.generator().rate, 0, "until it is disabled");
    machine.enable(false);
    machine.cycle(50.0);
    machine.enable(true);
    machine.cycle(50.0);
    assert!(machine.generator().rate > 0);
}

/// A command between two values of the accumulator, in a cycle in which one of them is a rate.
#[test]
fn a_generator_that_has_arrived_stands_still() {
    const PERIOD: u64 = 250_000;
    let settings = Settings {
        period: Duration::from_nanos(PERIOD),
        ..Settings::default()
    };
    let mut machine = start(firmware(2), settings);
    machine.set_param(machine.pins.position_scale, 999.7);
    machine.set_param(machine.pins.maxaccel, 100.0);
    machine.enable(true);
    let mut changes = 0;
    for step in 1..20 {
        let mut rate = 0;
        for period in 0..800 {
            let _ = machine.driver.read();
            let command = f64::from(step) * 0.001_234_567;
            machine
                .driver
                .pins_mut()
                .set(machine.pins.position_cmd, command);
            machine.driver.write().unwrap();
            machine.wait(PERIOD);
            let before = core::mem::replace(&mut rate, machine.generator().rate);
            changes += u32::from(period > 400 && rate != before);
        }
    }
    assert_eq!(changes, 0);
}

#[test]
fn the_time_from_the_sample_to_the_write_includes_the_lead_of_a_timer() {
    let mut machine = Machine::enabled(2);
    let pins = machine.driver.pins();
    let number = pins.output::<i32>("hm2_7i92.0.stepgen.timer-number");
    let number = number.expect("a DPLL");
    let times = [1, 2].map(|timer| {
        let name = format!("hm2_7i92.0.dpll.{timer:02}.timer-us");
        pins.output::<f64>(&name).expect("a timer")
    });
    let of_read = machine.delay();
    machine.driver.pins_mut().set(times[0], -300.0);
    machine.driver.pins_mut().set(times[1], 200.0);
    for (timer, word, lead) in [
        (1, 0x9000, 0.3),
        (2, 0xA000, 0.8),
        (0, 0x8000, 0.0),
        (-1, 0, 0.0),
    ] {
        machine.driver.pins_mut().set(number, timer);
        for _ in 0..3 {
            machine.cycle(0.0);
        }
        assert_eq!(machine.model().timer, word);
        let delay = machine.delay();
        assert!((delay - of_read - lead).abs() < 1e-3, "{timer}: {delay}");
    }
}

#[test]
fn without_the_phase_locked_loop_nothing_latches_the_positions() {
    let settings = Settings {
        instances: [(Gtag::HM2DPLL, 0)].into(),
        ..Settings::default()
    };
    let machine = start(firmware(2), settings);
    let number = machine
        .driver
        .pins()
        .output::<i32>("hm2_7i92.0.stepgen.timer-number");
    assert!(number.is_err());
}

/// Executed again, the set-up would cut a pulse off.
#[test]
fn a_doubt_in_motion_soon_after_a_set_up_makes_the_position_unsure_and_later_it_does_not() {
    for (after, is_unsure) in [(30, true), (200, false)] {
        let mut machine = Machine::enabled(2);
        for _ in 0..after {
            machine.cycle(100.0);
        }
        let next = machine.driver.bus_mut().exchanges();
        machine
            .driver
            .bus_mut()
            .fail_at(next + 1, Fault::SilentWrite);
        for _ in 0..3 {
            machine.cycle(100.0);
        }
        assert_eq!(machine.unsure(), is_unsure, "{after}");
    }
}

#[test]
fn a_long_gap_at_a_high_rate_makes_the_position_unsure() {
    for (speed, is_unsure) in [(-190.0, true), (100.0, false)] {
        let settings = Settings {
            watchdog: Some(Duration::from_secs(1)),
            ..Settings::default()
        };
        let mut machine = start(firmware(2), settings);
        let pins = machine.pins;
        for time in [pins.steplen, pins.stepspace, pins.dirsetup, pins.dirhold] {
            machine.driver.pins_mut().set_param(time, 2_500).unwrap();
        }
        machine.set_param(pins.position_scale, 1_000.0);
        machine.set_param(pins.maxaccel, 0.0);
        machine.driver.pins_mut().set(pins.control_type, true);
        machine.driver.pins_mut().set(pins.velocity_cmd, speed);
        machine.enable(true);
        for _ in 0..120 {
            machine.cycle(0.0);
        }
        // 190,000 or 100,000 steps/s: 32,767 steps in 172 ms or 328 ms.
        machine.wait(200 * MS);
        machine.cycle(0.0);
        assert_eq!(machine.unsure(), is_unsure, "{speed}");
    }
}

#[test]
fn each_generator_has_its_own_registers() {
    let mut machine = Machine::enabled(2);
    let module = machine.driver.modules::<Stepgens>().next();
    let second = module.and_then(|module| module.pins().nth(1)).unwrap();
    machine.set_param(second.position_scale, -500.0);
    machine.set_param(second.maxaccel, 50.0);
    machine.driver.pins_mut().set(second.enable, true);
    for _ in 0..2_000 {
        machine.driver.pins_mut().set(second.position_cmd, 2.0);
        machine.cycle(-1.0);
    }
    let steps = [0, 1].map(|n: usize| machine.model().generators[n].steps());
    assert!((steps[0] + 1_000).abs() <= 1 && (steps[1] + 1_000).abs() <= 1);
    assert!((machine.read(second.position_fb) - 2.0).abs() < 1e-4);
}

/// A probe has no second edge.
#[test]
fn an_edge_in_the_period_of_a_lost_write_is_latched() {
    let mut machine = Machine::enabled(WITH_LATCH);
    let pins = machine.pins;
    let probe = pins.probe_enable.unwrap();
    machine.driver.pins_mut().set(pins.control_type, true);
    machine.driver.pins_mut().set(pins.velocity_cmd, 2.0);
    for _ in 0..120 {
        machine.cycle(0.0);
    }
    machine.driver.pins_mut().set(probe, true);
    for _ in 0..5 {
        machine.cycle(0.0);
    }
    let next = machine.driver.bus_mut().exchanges();
    machine
        .driver
        .bus_mut()
        .fail_at(next + 1, Fault::SilentWrite);
    machine.cycle(0.0);
    let now = machine.fpga().now().as_nanos();
    machine.model().advance(now);
    machine.generator().edge(1 << 6);
    let motor = machine.motor;
    for _ in 0..3 {
        machine.cycle(0.0);
    }
    assert!(!machine.driver.pins().read(probe).value);
    let latched = machine.read(pins.position_latch.unwrap()) * 1_000.0;
    assert!((latched - motor as f64).abs() <= 1.0, "{latched}, {motor}");
}

#[test]
fn an_index_makes_the_position_0_where_it_was_and_a_probe_only_latches() {
    let mut machine = Machine::enabled(WITH_LATCH);
    let pins = machine.pins;
    let (index, probe) = (pins.index_enable.unwrap(), pins.probe_enable.unwrap());
    let latch = pins.position_latch.unwrap();
    machine.driver.pins_mut().set(pins.control_type, true);
    machine.driver.pins_mut().set(pins.velocity_cmd, 2.0);
    for _ in 0..100 {
        machine.cycle(0.0);
    }
    for (pin, bit) in [(probe, 1 << 6), (index, 1 << 4)] {
        machine.driver.pins_mut().set(pin, true);
        for _ in 0..5 {
            machine.cycle(0.0);
        }
        assert!(machine.driver.pins().read(pin).value, "it waits");
        let now = machine.fpga().now().as_nanos();
        machine.model().advance(now);
        machine.generator().edge(bit);
        let motor = machine.motor;
        machine.cycle(0.0);
        machine.cycle(0.0);
        assert!(!machine.driver.pins().read(pin).value);
        let shown = machine.read(pins.position_fb) * 1_000.0;
        if pin == probe {
            assert!((machine.read(latch) * 1_000.0 - motor as f64).abs() <= 1.0);
            assert!((shown - machine.motor as f64).abs() <= 3.0);
        } else {
            assert!(
                (shown - (machine.motor - motor) as f64).abs() <= 3.0,
                "{shown}"
            );
        }
    }
    machine.assert_right();
}

#[test]
fn unknown_versions_are_named_and_old_ones_are_remarked() {
    let module = |version| ModuleDescriptor {
        gtag: Gtag::STEPGEN,
        version,
        clock_hz: 100_000_000,
        instances: 5,
        base: 0x2000,
        registers: 10,
        register_stride: 0x100,
        instance_stride: 4,
        multiple_registers: 0x1FF,
    };
    let known: Vec<u8> = (0..=255)
        .filter(|version| check(&module(*version)).is_ok())
        .collect();
    assert_eq!(known, [0, 1, 2, 0x42, 0xC2]);
    let error = check(&module(3)).unwrap_err().to_string();
    assert!(
        error.contains("version 03") && error.contains("00, 01, 02, 42 or C2"),
        "{error}"
    );
    for (version, is_old) in [(0, true), (1, true), (2, false)] {
        let machine = start(firmware(version), Settings::default());
        let mut remarks = machine.driver.remarks().iter();
        let found =
            remarks.any(|Remark { kind, .. }| matches!(kind, RemarkKind::OldStepgen { .. }));
        assert_eq!(found, is_old, "{version}");
    }
}

#[test]
fn the_source_of_the_latch_is_off_or_a_timer() {
    let words = [-1, 0, 1, 4, 5, -2].map(latch_timer);
    assert_eq!(words, [0, 0x8000, 0x9000, 0xC000, 0x8000, 0x8000]);
}

#[test]
fn fewer_generators_than_there_are_leave_their_pins_to_the_application() {
    let settings = Settings {
        instances: [(Gtag::STEPGEN, 1)].into(),
        ..Settings::default()
    };
    let machine = start(firmware(2), settings);
    let pins = machine.driver.pins();
    assert!(pins.output::<bool>("hm2_7i92.0.stepgen.00.enable").is_ok());
    let second = pins.output::<bool>("hm2_7i92.0.stepgen.01.enable");
    assert!(matches!(second, Err(PinError::NotFound { .. })));
    let free = format!("hm2_7i92.0.gpio.{:03}.out", FIRST_PIN + 4);
    assert!(pins.output::<bool>(&free).is_ok());
}
