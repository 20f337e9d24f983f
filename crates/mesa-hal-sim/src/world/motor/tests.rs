//! Motion in virtual time.

use super::*;

use proptest::prelude::*;

fn run(motor: &mut Motor, to: Nanos, step: Nanos) {
    let mut now = motor.now;
    while now < to {
        now = to.min(now + step);
        motor.advance(now, |_, _| {});
    }
}

#[test]
fn speed_follows_the_voltage_with_the_time_constant() {
    let mut motor = Motor::default();
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
fn motor_path_is_independent_of_the_sampling_interval() {
    let mut coarse = Motor::default();
    let mut fine = coarse;
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
    let mut motor = Motor::default();
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
    let mut motor = Motor::new(config).unwrap();
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

/// Starts by hand at 40 units/s, then only friction acts: 20 of force on an inertia of 0.5.
fn coasting() -> Motor {
    let mut motor = Motor::new(MotorConfig {
        inertia: 0.5,
        drag: 20.0,
        ..MotorConfig::default()
    })
    .unwrap();
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
fn drive_gives_its_force_and_no_more() {
    let mut motor = Motor::new(MotorConfig {
        inertia: 0.5,
        max_force: 120.0,
        drag: 20.0,
        ..MotorConfig::default()
    })
    .unwrap();
    motor.command(10.0, true);
    let mut last = 0.0;
    for step in 1..=300 {
        motor.advance(step * 1_000_000, |_, _| {});
        let acceleration = (motor.velocity() - last) * 1e3;
        assert!(acceleration <= 200.0 + 1e-6, "{acceleration}");
        last = motor.velocity();
    }
    // (120 - 20) times the distance is the energy, as long as the drive is at its maximum force.
    assert!((motor.velocity() - 60.0).abs() < 1e-9);
    assert!((motor.energy() - 100.0 * motor.position()).abs() < 1e-6);
    // At the end the loop compensates the friction: 20 / 0.5 * 5 ms below the commanded speed.
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
fn force_below_friction_moves_nothing() {
    let mut motor = Motor::new(MotorConfig {
        max_force: 10.0,
        drag: 10.0,
        ..MotorConfig::default()
    })
    .unwrap();
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
        })
        .unwrap();
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
fn jammed_axis_stands_until_it_is_freed() {
    let mut motor = Motor::default();
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
fn path_with_force_and_friction_is_independent_of_sampling() {
    let config = MotorConfig {
        max_force: 2000.0,
        drag: 300.0,
        stops: [-0.5, 0.5],
        ..MotorConfig::default()
    };
    let mut coarse = Motor::new(config).unwrap();
    let mut fine = coarse;
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

#[test]
fn invalid_motor_settings_are_refused_with_the_allowed_range() {
    let usual = MotorConfig::default();
    for (field, value, config) in [
        (
            "max_speed",
            0.0,
            MotorConfig {
                max_speed: 0.0,
                ..usual
            },
        ),
        (
            "full_scale",
            -10.0,
            MotorConfig {
                full_scale: -10.0,
                ..usual
            },
        ),
        (
            "time_constant",
            -1e-9,
            MotorConfig {
                time_constant: -1e-9,
                ..usual
            },
        ),
        (
            "friction",
            -0.1,
            MotorConfig {
                friction: -0.1,
                ..usual
            },
        ),
        (
            "counts_per_unit",
            0.0,
            MotorConfig {
                counts_per_unit: 0.0,
                ..usual
            },
        ),
        (
            "inertia",
            1e-10,
            MotorConfig {
                inertia: 1e-10,
                ..usual
            },
        ),
        (
            "max_force",
            0.0,
            MotorConfig {
                max_force: 0.0,
                ..usual
            },
        ),
        (
            "drag",
            -1.0,
            MotorConfig {
                drag: -1.0,
                ..usual
            },
        ),
        (
            "position",
            1e10,
            MotorConfig {
                position: 1e10,
                ..usual
            },
        ),
    ] {
        let error = Motor::new(config).unwrap_err();
        assert!(
            matches!(error, MotorError::OutOfRange { field: f, value: v, .. } if (f, v) == (field, value)),
            "{error:?}"
        );
        let text = error.to_string();
        assert!(
            text.starts_with(&format!("{field} of a motor is {value}: allowed is ")),
            "{text}"
        );
    }
    let error = Motor::new(MotorConfig {
        full_scale: f64::NAN,
        ..usual
    })
    .unwrap_err();
    assert_eq!(
        error.to_string(),
        "full_scale of a motor is NaN: allowed is more than 0, up to 100 (V)"
    );
    for stops in [[1.0, 1.0], [2.0, -2.0], [f64::NAN, 1.0], [0.0, f64::NAN]] {
        let error = Motor::new(MotorConfig { stops, ..usual }).unwrap_err();
        assert!(error.to_string().contains("the lower one first"), "{error}");
    }
    assert_eq!(Motor::new(usual), Ok(Motor::default()));
}

/// Numbers from any source: usual, tiny, huge and infinite ones, and zero.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -20.0..20.0_f64,
        any::<f64>(),
        Just(0.0),
        Just(f64::INFINITY),
        (-300..300_i32).prop_map(|exponent| 10_f64.powi(exponent)),
    ]
}

proptest! {
    #[test]
    fn motor_settings_are_refused_or_give_a_finite_path(
        numbers in prop::collection::vec(prop::option::weighted(0.3, any_number()), 11),
        volts in prop::collection::vec(any_number(), 1..6),
    ) {
        let usual = MotorConfig::default();
        let number = |n: usize, usual: f64| numbers[n].unwrap_or(usual);
        let made = Motor::new(MotorConfig {
            max_speed: number(0, usual.max_speed),
            full_scale: number(1, usual.full_scale),
            time_constant: number(2, usual.time_constant),
            friction: number(3, usual.friction),
            counts_per_unit: number(4, usual.counts_per_unit),
            counts_per_revolution: 4000,
            inertia: number(5, usual.inertia),
            max_force: number(6, usual.max_force),
            drag: number(7, usual.drag),
            stops: [number(8, usual.stops[0]), number(9, usual.stops[1])],
            position: number(10, usual.position),
        });
        let Ok(mut motor) = made else {
            return Ok(());
        };
        for (volts, enabled) in volts.into_iter().zip([true, true, false, true, true]) {
            motor.command(volts, enabled);
            let end = motor.now + 3_000_000;
            motor.advance(end, |segment, _| {
                assert!(segment.from.is_finite() && segment.to.is_finite());
            });
            prop_assert!(motor.position().is_finite() && motor.velocity().is_finite());
        }
    }
}
