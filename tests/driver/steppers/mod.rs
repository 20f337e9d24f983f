//! Step generators, compared with a stepper motor on their pins: the motor loses steps where pulses
//! are too fast, too short, or change their direction too early.

use std::time::Duration;

use crate::common::machine::World;
use mesa_hal::bus::{BusErrorKind, Clock};
use mesa_hal::driver::{BoardState, Driver, EventKind, Settings};
use mesa_hal::hal::Pins;
use mesa_hal::modules::stepgen::{StepgenPins, Stepgens};
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::{SimFpga, Stepper, StepperConfig, StepperWiring, machines};

const PERIOD: Duration = Duration::from_millis(1);
const SCALE: f64 = 1_000.0;

mod alike;
mod at_rest;
mod host_5i25;
mod late_writes;
mod set_up_order;
mod shared_timer;

struct Machine<B: World = Faulty<SimFpga>> {
    driver: Driver<B>,
    pins: StepgenPins,
    axis: usize,
}

/// A motor that follows an acceleration of 120, loses pulses shorter than 2 us, and needs a hold of
/// 1 us after the pulse.
fn motor() -> Stepper {
    let config = StepperConfig {
        max_acceleration: 120.0,
        start_speed: 0.5,
        min_pulse: 2_000,
        min_space: 2_000,
        dir_setup: 5_000,
        dir_hold: 3_500,
        ..StepperConfig::default()
    };
    Stepper::new(config).expect("a motor")
}

/// A 7I92 with a 7I76 and a motor on generator 0.
fn board() -> (SimFpga, usize) {
    let mut fpga = machines::i7i92_7i76();
    let axis = fpga.wire_stepper(StepperWiring {
        generator: 0,
        encoder: None,
        motor: motor(),
    });
    (fpga, axis)
}

/// Scale, limits and times that such a motor follows.
fn set_up(pins: &mut Pins, one: &StepgenPins) {
    for (param, value) in [
        (one.position_scale, SCALE),
        (one.maxvel, 20.0),
        (one.maxaccel, 100.0),
    ] {
        pins.set_param(param, value).expect("a value");
    }
    for (param, ns) in [
        (one.steplen, 2_500),
        (one.stepspace, 2_500),
        (one.dirsetup, 5_000),
        (one.dirhold, 1_000),
    ] {
        pins.set_param(param, ns).expect("a time");
    }
}

fn machine() -> Machine {
    let (fpga, axis) = board();
    machine_on(Faulty::new(fpga, 5), axis)
}

/// The machine on a bus, enabled at 0.
fn machine_on<B: World>(bus: B, axis: usize) -> Machine<B> {
    let mut driver = Driver::start(bus, Settings::default()).expect("it starts");
    let module = driver.modules::<Stepgens>().next();
    let pins = module.and_then(|module| module.pins().next());
    let pins = pins.expect("a generator");
    set_up(driver.pins_mut(), &pins);
    let mut machine = Machine { driver, pins, axis };
    for _ in 0..3 {
        machine.cycle(0.0);
    }
    machine.driver.pins_mut().set(pins.enable, true);
    machine
}

impl<B: World> Machine<B> {
    fn cycle(&mut self, command: f64) -> BoardState {
        let report = self.driver.read();
        self.driver.pins_mut().set(self.pins.position_cmd, command);
        let _ = self.driver.write();
        self.driver.bus_mut().wait(PERIOD);
        report.map_or(BoardState::BusDown, |report| report.board)
    }

    fn motor(&mut self) -> Stepper {
        let axis = self.axis;
        *self.driver.bus_mut().fpga().stepper(axis).expect("a motor")
    }

    fn position(&self) -> f64 {
        self.driver.pins().read(self.pins.position_fb).value
    }

    /// Checks that the motor has followed all steps, and is where the driver says.
    #[track_caller]
    fn assert_true(&mut self, command: f64) {
        let motor = self.motor();
        assert_eq!((motor.lost(), motor.overshot()), (0, 0));
        let shown = self.position();
        assert!((shown - command).abs() < 1e-4, "{shown}, {command}");
        assert!((motor.position() - shown).abs() <= 1.0 / SCALE, "{shown}");
    }
}

#[test]
fn motor_follows_steps_smooth_moves_and_reversals_without_loss() {
    let mut machine = machine();
    for command in [3.0, -2.0, -1.999, 0.0] {
        for _ in 0..1_500 {
            machine.cycle(command);
        }
        machine.assert_true(command);
    }
    // Turns in the middle of a step, on the boundary between two, and just beyond it, where the
    // motor gets a step up and a step down close together.
    for offset in [0.000_5, 0.0, 0.000_01, -0.000_01] {
        let wave = |period: u32| offset + 2.0 * (1.0 - (f64::from(period) * 0.004).cos());
        for period in 0..4_000 {
            machine.cycle(wave(period));
        }
        let end = wave(3_999);
        for _ in 0..300 {
            machine.cycle(end);
        }
        machine.assert_true(end);
        for _ in 0..500 {
            machine.cycle(0.0);
        }
    }
}

#[test]
fn motor_stands_after_a_bite_and_the_position_is_unsure() {
    let mut machine = machine();
    let mut events = machine.driver.events();
    for _ in 0..20 {
        machine.cycle(100.0);
    }
    assert!(machine.motor().velocity() > 0.5);
    machine.driver.bus_mut().wait(Duration::from_millis(40));
    let bitten = machine.motor();
    assert_eq!(machine.cycle(100.0), BoardState::WatchdogBitten);
    for _ in 0..5 {
        machine.cycle(100.0);
    }
    let rearmed = machine.driver.rearm().expect("it answers");
    assert!(rearmed.armed + rearmed.rearm_pending > 0, "{rearmed:?}");
    let (pins, mut moved) = (machine.pins, 0);
    for _ in 0..50 {
        let _ = machine.driver.read();
        machine.driver.write().expect("the bus is well");
        machine.driver.bus_mut().wait(PERIOD);
        moved = machine.motor().steps() - bitten.steps();
    }
    // Pins that are released and driven again make an edge each.
    assert!(moved.abs() <= 2, "{moved}");
    assert!(machine.driver.pins().read(pins.position_unsure).value);
    // Enabled without a new command, it stays.
    machine.driver.pins_mut().set(pins.enable, true);
    for _ in 0..50 {
        let _ = machine.driver.read();
        machine.driver.write().expect("the bus is well");
        machine.driver.bus_mut().wait(PERIOD);
    }
    assert_eq!(machine.motor().steps() - bitten.steps(), moved);
    assert!(events.any(|event| event.kind == EventKind::WatchdogBitten));
}

#[test]
fn lost_packets_lose_no_step_of_the_motor() {
    let mut machine = machine();
    // Without sudden stops: a lost write is caught up with, within what the motor follows.
    let pins = machine.pins;
    machine
        .driver
        .pins_mut()
        .set_param(pins.maxaccel, 50.0)
        .expect("a value");
    let bus = machine.driver.bus_mut();
    bus.fail_randomly(Fault::AckedButLost, 0.01);
    bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 0.005);
    for command in [2.0, 0.0, 3.0, 0.5] {
        for _ in 0..1_200 {
            assert!(matches!(
                machine.cycle(command),
                BoardState::Running | BoardState::BusDown
            ));
        }
    }
    machine.driver.bus_mut().heal();
    for _ in 0..200 {
        machine.cycle(0.5);
    }
    assert!(!machine.driver.pins().read(pins.position_unsure).value);
    machine.assert_true(0.5);
}

/// Reported once, with the generator and both values.
#[test]
fn request_beyond_a_generators_limits_is_an_event() {
    let mut machine = machine();
    let (mut events, pins) = (machine.driver.events(), machine.pins);
    machine
        .driver
        .pins_mut()
        .set_param(pins.maxvel, 1e3)
        .expect("a value");
    machine
        .driver
        .pins_mut()
        .set_param(pins.stepspace, 200_000)
        .expect("a time");
    for _ in 0..10 {
        machine.cycle(0.0);
    }
    let kinds: Vec<_> = events.by_ref().map(|event| event.kind).collect();
    let clipped = EventKind::StepTimeClipped {
        generator: 0,
        asked: 200_000,
        longest: 163_830,
    };
    assert_eq!(
        kinds.iter().filter(|kind| **kind == clipped).count(),
        1,
        "{kinds:?}"
    );
    let is_limit = |kind: &&EventKind| matches!(kind, EventKind::StepRateLimited { generator: 0, asked: 1_000_000, limit } if *limit < 7_000);
    assert_eq!(kinds.iter().filter(is_limit).count(), 1, "{kinds:?}");
}
