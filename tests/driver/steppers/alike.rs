//! An application that is written for an axis runs on an analog drive with its encoder and on a
//! step generator alike.

use std::time::Duration;

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::hal::Axis;
use mesa_hal::{Driver, I7i77, I7i97, Settings};
use mesa_hal_sim::{Motor, MotorConfig, SimFpga, machines};

use super::machine;

const PERIOD: Duration = Duration::from_millis(1);

/// Moves an axis to a position: the application, which knows nothing of what moves it. Returns the
/// number of periods that it takes.
fn go<B: RegisterBus + Clock>(driver: &mut Driver<B>, axis: Axis, target: f64) -> u32 {
    for period in 0..3_000 {
        let _ = driver.read().expect("the bus is well");
        let pins = driver.pins_mut();
        let place = axis.position(pins).within(25);
        let error = place.map_or(0.0, |place| target - place);
        axis.enable(pins, place.is_some());
        axis.set_speed(pins, (20.0 * error).clamp(-15.0, 15.0));
        driver.write().expect("the bus is well");
        driver.bus_mut().wait(PERIOD);
        if error.abs() < 0.01 && period > 10 {
            return period;
        }
    }
    panic!(
        "{target} is not reached: {:?}",
        axis.position(driver.pins())
    );
}

/// The zero where the axis is.
fn set_zero<B: RegisterBus + Clock>(driver: &mut Driver<B>, axis: Axis) {
    for on in [true, false] {
        axis.reset(driver.pins_mut(), on);
        axis.set_speed(driver.pins_mut(), 0.0);
        for _ in 0..3 {
            let _ = driver.read().expect("the bus is well");
            driver.write().expect("the bus is well");
            driver.bus_mut().wait(PERIOD);
        }
    }
}

/// Moves to and fro, and sets a new zero; `motor` is the true position.
fn drive<B: RegisterBus + Clock>(
    driver: &mut Driver<B>,
    axis: Axis,
    motor: impl Fn(&mut Driver<B>) -> f64,
) {
    for target in [2.0, -1.5, 3.0] {
        let periods = go(driver, axis, target);
        assert!(periods > 50, "{periods}");
        assert!((motor(driver) - target).abs() < 0.05, "{}", motor(driver));
        assert!(!axis.is_unsure(driver.pins()));
    }
    let before = motor(driver);
    set_zero(driver, axis);
    assert!(axis.position(driver.pins()).value.abs() < 0.05);
    go(driver, axis, -1.0);
    assert!((motor(driver) - before + 1.0).abs() < 0.1);
    // Disabled, it stands.
    for _ in 0..200 {
        let _ = driver.read().expect("the bus is well");
        axis.enable(driver.pins_mut(), false);
        axis.set_speed(driver.pins_mut(), 5.0);
        driver.write().expect("the bus is well");
        driver.bus_mut().wait(PERIOD);
    }
    assert!((motor(driver) - before + 1.0).abs() < 0.2);
}

#[test]
fn same_function_moves_a_servo_drive_and_a_step_generator() {
    let motor = Motor::new(MotorConfig::default()).expect("a motor");
    let board = machines::six_axes_7i97(motor);
    let mut driver = Driver::start(board, Settings::default()).expect("it starts");
    let card: I7i97 = driver.attach_board().expect("a 7I97");
    let (analog, encoder) = (card.analog_out[0], card.encoders[0]);
    let config = MotorConfig::default();
    let pins = driver.pins_mut();
    pins.set_param(encoder.scale, config.counts_per_unit)
        .expect("a scale");
    // Units per second at 10 V.
    analog.set_full_scale(pins, FULL_SPEED).expect("a scale");
    let axis = Axis::servo(analog, encoder);
    assert!(axis.request_index(driver.pins_mut()));
    assert!(axis.awaits_index(driver.pins()));
    driver.pins_mut().set(encoder.index_enable, false);
    drive(&mut driver, axis, |driver: &mut Driver<SimFpga>| {
        let motor = driver.bus_mut().motor(0);
        motor.expect("a motor").position()
    });

    let mut machine = machine();
    let (axis, number) = (machine.pins.axis(), machine.axis);
    assert!(!axis.request_index(machine.driver.pins_mut()), "no index");
    assert!(!axis.awaits_index(machine.driver.pins()));
    drive(&mut machine.driver, axis, |driver| {
        let motor = driver.bus_mut().inner.stepper(number);
        motor.expect("a motor").position()
    });
}

/// The limits of a 7I77's output are in its unit, and are ±10 at first: a 7I97's has none.
#[test]
fn axis_of_a_7i77_reaches_its_full_speed() {
    let motor = Motor::new(MotorConfig::default()).expect("a motor");
    let board = machines::six_axes_7i92(motor);
    let mut driver = Driver::start(board, Settings::default()).expect("it starts");
    let card: I7i77 = driver.attach_card((0, 0)).expect("a 7I77");
    let (analog, encoder) = (card.analog.analog_out[0], card.encoders[0]);
    let pins = driver.pins_mut();
    analog.set_full_scale(pins, FULL_SPEED).expect("a scale");
    let axis = Axis::servo(analog, encoder);
    for speed in [0.8 * FULL_SPEED, -0.8 * FULL_SPEED] {
        for _ in 0..500 {
            let _ = driver.read().expect("the bus is well");
            axis.enable(driver.pins_mut(), true);
            axis.set_speed(driver.pins_mut(), speed);
            driver.write().expect("the bus is well");
            driver.bus_mut().wait(PERIOD);
        }
        let velocity = driver.bus_mut().motor(0).expect("a motor").velocity();
        assert!((velocity - speed).abs() < 1.0, "{velocity}, not {speed}");
    }
    let pins = driver.pins_mut();
    assert!(analog.set_full_scale(pins, 0.0).is_err());
    // A limit beyond the range would become infinite, which is refused before anything changes.
    let limit = analog.max_limit.expect("a limit");
    let usual = [pins.param(analog.full_scale), pins.param(limit)];
    pins.set_param(limit, f64::MAX / 2.0).expect("finite");
    let scale = usual[0];
    assert!(analog.set_full_scale(pins, scale * 4.0).is_err());
    assert_eq!(
        [pins.param(analog.full_scale), pins.param(limit)],
        [scale, f64::MAX / 2.0]
    );
    pins.set_param(limit, usual[1]).expect("as before");
    let limits = [analog.max_limit, analog.min_limit].map(|limit| limit.map(|it| pins.param(it)));
    assert_eq!(limits, [Some(FULL_SPEED), Some(-FULL_SPEED)]);
    assert_eq!(pins.param(analog.full_scale), FULL_SPEED);
}

/// The speed of the simulated motor at the end of the range.
const FULL_SPEED: f64 = 100.0;
