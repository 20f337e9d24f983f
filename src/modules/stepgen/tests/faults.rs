//! Bites, resets, lost writes and long gaps.

use super::*;

#[test]
fn bite_stops_rate_before_directions_and_position_is_unsure() {
    let mut machine = Machine::enabled(2);
    for _ in 0..60 {
        machine.cycle(100.0);
    }
    let moving = machine.generator().rate;
    assert!(moving > 0);
    // The host is late: the generator goes on, and nothing reaches the motor.
    for _ in 0..200 {
        machine.wait(MS / 20);
    }
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
    // Its motor has made whole steps, and the write before the bite was some microseconds late.
    let shown = machine.read(machine.pins.position_fb);
    let missing = shown * 1_000.0 - machine.motor as f64;
    assert!((-0.5..1.5).contains(&missing), "{missing}");
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
fn step_times_are_restored_before_any_motion_after_board_reset() {
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
fn homed_ends_unsure_at_its_rising_edge_alone() {
    let mut machine = Machine::enabled(2);
    let homed = machine.pins.homed;
    let mut after_a_reset = |homes: &[bool]| {
        for _ in 0..60 {
            machine.cycle(100.0);
        }
        machine.fpga().reload();
        let now = machine.fpga().now().as_nanos();
        machine.model().reload(now);
        machine.cycle(100.0);
        machine.cycle(100.0);
        let _ = machine.driver.rearm().expect("it is there");
        machine.enable(true);
        machine.cycle(0.0);
        machine.cycle(0.0);
        assert!(machine.unsure());
        for &is_homed in homes {
            machine.driver.pins_mut().set(homed, is_homed);
            machine.cycle(100.0);
            machine.cycle(100.0);
        }
        machine.unsure()
    };
    assert!(!after_a_reset(&[true]));
    assert!(after_a_reset(&[true]), "held since before the fault");
    assert!(!after_a_reset(&[false, true]));
}

#[test]
fn lost_exchanges_add_bounded_steps_and_position_stays_true() {
    let mut machine = Machine::enabled(2);
    machine
        .driver
        .bus_mut()
        .fail_randomly(Fault::AckedButLost, 0.02);
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
fn generator_stops_if_its_accumulator_does_not_follow_the_rate() {
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

#[test]
fn positions_are_not_latched_without_a_dpll() {
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
fn doubt_in_motion_makes_position_unsure_only_soon_after_set_up() {
    for (after, is_unsure) in [(30, true), (200, false)] {
        let mut machine = Machine::enabled(2);
        for _ in 0..after {
            machine.cycle(100.0);
        }
        let next = machine.driver.bus_mut().exchanges();
        machine
            .driver
            .bus_mut()
            .fail_at(next + 1, Fault::AckedButLost);
        for _ in 0..3 {
            machine.cycle(100.0);
        }
        assert_eq!(machine.unsure(), is_unsure, "{after}");
    }
}

#[test]
fn long_gap_at_a_high_rate_makes_the_position_unsure() {
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
