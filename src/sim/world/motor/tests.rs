//! Motion in virtual time.

use super::*;

fn run(motor: &mut Motor, to: Nanos, step: Nanos) {
    let mut now = motor.now;
    while now < to {
        now = to.min(now + step);
        motor.advance(now, |_, _| {});
    }
}

#[test]
fn speed_follows_the_voltage_with_the_time_constant() {
    let mut motor = Motor::new(MotorConfig::default());
    motor.command(5.0, true);
    motor.advance(5_000_000, |_, _| {});
    let expected = 50.0 * (1.0 - (-1.0f64).exp());
    assert!((motor.velocity() - expected).abs() < 1e-9);
    motor.advance(100_000_000, |_, _| {});
    assert!((motor.velocity() - 50.0).abs() < 1e-6);
    let expected = 50.0 * (0.1 - 0.005 * (1.0 - (-20.0f64).exp()));
    assert!((motor.position() - expected).abs() < 1e-9);
}

#[test]
fn the_path_does_not_depend_on_how_often_somebody_looks() {
    let mut coarse = Motor::new(MotorConfig::default());
    let mut fine = coarse.clone();
    for motor in [&mut coarse, &mut fine] {
        motor.command(7.0, true);
    }
    run(&mut coarse, 20_000_000, 1_000_000);
    run(&mut fine, 20_000_000, 777);
    for motor in [&mut coarse, &mut fine] {
        motor.command(-3.0, true);
    }
    run(&mut coarse, 40_000_000, 1_000_000);
    run(&mut fine, 40_000_000, 777);
    assert!((coarse.position() - fine.position()).abs() < 1e-9);
    assert!((coarse.velocity() - fine.velocity()).abs() < 1e-9);
}

#[test]
fn every_segment_goes_one_way_and_joins_the_one_before() {
    let mut motor = Motor::new(MotorConfig::default());
    motor.command(10.0, true);
    motor.advance(10_000_000, |_, _| {});
    motor.command(-10.0, true);
    let mut last = motor.counts();
    let mut turns = 0;
    let mut rising = true;
    motor.advance(30_000_000, |segment, _| {
        assert_eq!(segment.from, last);
        last = segment.to;
        if (segment.to > segment.from) != rising {
            rising = !rising;
            turns += 1;
        }
    });
    assert_eq!(turns, 1);
}

#[test]
fn friction_holds_and_a_disabled_drive_brakes() {
    let config = MotorConfig {
        friction: 0.5,
        ..MotorConfig::default()
    };
    let mut motor = Motor::new(config);
    motor.command(0.4, true);
    motor.advance(100_000_000, |_, _| {});
    assert_eq!(motor.position(), 0.0);
    motor.command(1.5, true);
    motor.advance(200_000_000, |_, _| {});
    assert!((motor.velocity() - 10.0).abs() < 1e-6);
    motor.command(1.5, false);
    motor.advance(400_000_000, |_, _| {});
    assert_eq!(motor.velocity(), 0.0);
    motor.command(f64::NAN, true);
    motor.advance(500_000_000, |_, _| {});
    assert_eq!(motor.velocity(), 0.0);
}

/// 40 units/s by hand, then nothing but friction: 20 of force on an inertia of 0.5.
fn coasting() -> Motor {
    let mut motor = Motor::new(MotorConfig {
        inertia: 0.5,
        drag: 20.0,
        ..MotorConfig::default()
    });
    motor.set_power(false);
    motor.turn_by_hand(Some(40.0));
    motor.advance(1_000_000, |_, _| {});
    motor.turn_by_hand(None);
    motor
}

#[test]
fn friction_takes_the_energy_of_what_coasts() {
    let mut motor = coasting();
    let from = motor.position();
    let energy = motor.energy();
    assert_eq!(energy, 400.0);
    for _ in 0..150 {
        let now = motor.now;
        motor.advance(now + 7_000_000, |_, _| {});
        let taken = 20.0 * (motor.position() - from);
        assert!((motor.energy() + taken - energy).abs() < 1e-9);
    }
    assert_eq!(motor.velocity(), 0.0, "it stands after a second");
    assert!((motor.position() - from - 20.0).abs() < 1e-9);
}

#[test]
fn a_drive_gives_its_force_and_no_more() {
    let mut motor = Motor::new(MotorConfig {
        inertia: 0.5,
        max_force: 120.0,
        drag: 20.0,
        ..MotorConfig::default()
    });
    motor.command(10.0, true);
    let mut last = 0.0;
    for step in 1..=300 {
        motor.advance(step * 1_000_000, |_, _| {});
        let acceleration = (motor.velocity() - last) * 1e3;
        assert!(acceleration <= 200.0 + 1e-6, "{acceleration}");
        last = motor.velocity();
    }
    // (120 - 20) times the way is the energy, as long as the force is all it has.
    assert!((motor.velocity() - 60.0).abs() < 1e-9);
    assert!((motor.energy() - 100.0 * motor.position()).abs() < 1e-6);
    // At the end the loop gives what friction takes: 20 / 0.5 * 5 ms below what it is told.
    motor.advance(2_000_000_000, |_, _| {});
    assert!(
        (motor.velocity() - 99.8).abs() < 1e-6,
        "{}",
        motor.velocity()
    );
    motor.command(10.0, false);
    motor.advance(4_000_000_000, |_, _| {});
    assert_eq!(motor.velocity(), 0.0, "a disabled drive brakes");
}

#[test]
fn a_force_below_friction_moves_nothing() {
    let mut motor = Motor::new(MotorConfig {
        max_force: 10.0,
        drag: 10.0,
        ..MotorConfig::default()
    });
    motor.command(10.0, true);
    motor.advance(1_000_000_000, |_, _| {});
    assert_eq!(motor.position(), 0.0);
    motor.turn_by_hand(Some(30.0));
    motor.advance(1_100_000_000, |_, _| {});
    motor.turn_by_hand(None);
    motor.command(-10.0, true);
    motor.advance(4_000_000_000, |_, _| {});
    assert_eq!(motor.velocity(), 0.0, "both of them slow it");
    assert!(motor.position() > 3.0);
}

#[test]
fn stops_hold_whatever_pushes() {
    for time_constant in [0.0, 0.005] {
        let mut motor = Motor::new(MotorConfig {
            time_constant,
            stops: [-2.0, 3.0],
            position: 1.0,
            ..MotorConfig::default()
        });
        motor.command(10.0, true);
        let mut now = 0;
        let mut highest = 0.0_f64;
        for _ in 0..1000 {
            now += 777_777;
            motor.advance(now, |segment, [from, to]| {
                assert!(to > from && segment.end > segment.start);
                highest = highest.max(to);
            });
        }
        assert_eq!((motor.position(), highest), (3.0, 3.0));
        assert_eq!(motor.velocity(), 0.0);
        assert!(motor.is_at_stop());
        motor.turn_by_hand(Some(50.0));
        motor.advance(now + 100_000_000, |_, _| panic!("a hand neither"));
        assert_eq!(motor.velocity(), 0.0);
        motor.turn_by_hand(None);
        motor.command(-1.0, true);
        motor.advance(now + 200_000_000, |_, _| {});
        assert!(motor.velocity() < -9.0, "the other way it is free");
        motor.advance(now + 2_000_000_000, |_, _| {});
        assert_eq!(motor.position(), -2.0);
    }
}

#[test]
fn a_jammed_axis_stands_until_it_is_freed() {
    let mut motor = Motor::new(MotorConfig::default());
    motor.command(10.0, true);
    motor.advance(100_000_000, |_, _| {});
    let position = motor.position();
    motor.block(true);
    motor.advance(200_000_000, |_, _| panic!("it is jammed"));
    assert_eq!((motor.position(), motor.velocity()), (position, 0.0));
    motor.block(false);
    motor.advance(300_000_000, |_, _| {});
    assert!(motor.velocity() > 99.0);
}

#[test]
fn with_force_and_friction_the_path_does_not_depend_on_looking_either() {
    let config = MotorConfig {
        max_force: 2000.0,
        drag: 300.0,
        stops: [-0.5, 0.5],
        ..MotorConfig::default()
    };
    let mut coarse = Motor::new(config);
    let mut fine = coarse.clone();
    let mut now = 0;
    for volts in [7.0, -3.0, 0.5, -10.0, 0.0, 10.0] {
        now += 20_000_000;
        for motor in [&mut coarse, &mut fine] {
            motor.command(volts, true);
        }
        run(&mut coarse, now, 20_000_000);
        run(&mut fine, now, 777);
        assert!(
            (coarse.position() - fine.position()).abs() < 1e-7,
            "{volts}"
        );
        assert!(
            (coarse.velocity() - fine.velocity()).abs() < 1e-4,
            "{volts}"
        );
    }
}
