//! Limits, and the events about them.

use super::*;

#[test]
fn limit_is_reported_once_with_its_values() {
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
fn highest_rate_is_that_of_the_gateware_and_near_it_is_shown() {
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
fn limit_is_not_reported_again_on_rearm() {
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
fn limit_that_goes_with_the_old_pulses_is_not_reported() {
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
fn hold_for_which_the_pulse_leaves_no_room_is_reported_once() {
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
