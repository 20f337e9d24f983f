//! Commands, positions and latched positions.

use super::*;

#[test]
fn position_arrives_and_the_motor_has_made_its_steps() {
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
fn speed_is_kept_and_the_position_counts() {
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
fn command_that_is_no_number_is_the_one_before_and_counted() {
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
fn position_goes_on_beyond_the_accumulator() {
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

/// From 2.7 ms on, the slowest rate makes more than four sub-counts in a period.
#[test]
fn generator_steps_with_periods_of_50_us_to_50_ms() {
    for micros in [50, 1_000, 2_600, 2_700, 3_000, 12_000, 50_000] {
        let settings = Settings {
            period: Duration::from_micros(micros),
            ..Settings::default()
        };
        let mut machine = start(firmware(2), settings);
        let pins = machine.pins;
        for (param, value) in [(pins.position_scale, 1_000.0), (pins.maxaccel, 100.0)] {
            machine.set_param(param, value);
        }
        for param in [pins.steplen, pins.stepspace, pins.dirsetup, pins.dirhold] {
            machine.driver.pins_mut().set_param(param, 5_000).unwrap();
        }
        machine.set_param(pins.maxvel, 50.0);
        let mut last = 0;
        for n in 0..3_000_000 / micros {
            let _ = machine.driver.read();
            let pins_mut = machine.driver.pins_mut();
            pins_mut.set(pins.enable, n * micros > 1_500_000);
            pins_mut.set(pins.position_cmd, 1.0);
            let _ = machine.driver.write();
            machine.wait(micros * 1_000);
            let unsure = machine.unsure();
            assert!(!unsure, "{micros} us, cycle {n}");
            last = machine.motor;
        }
        assert!((last - 1_000).abs() <= 1, "{micros} us: {last}");
        assert_eq!(machine.said(), [""; 0]);
        machine.assert_right();
    }
}

/// With 50 ms the accumulator of a faster one could wrap around between two reads.
#[test]
fn rate_is_limited_to_what_the_period_can_count() {
    let settings = Settings {
        period: Duration::from_millis(50),
        ..Settings::default()
    };
    let mut machine = start(firmware(2), settings);
    let pins = machine.pins;
    machine.set_param(pins.maxaccel, 0.0);
    for param in [pins.steplen, pins.stepspace, pins.dirsetup, pins.dirhold] {
        machine.driver.pins_mut().set_param(param, 100).unwrap();
    }
    for n in 0..100 {
        let _ = machine.driver.read();
        let pins_mut = machine.driver.pins_mut();
        pins_mut.set(pins.control_type, true);
        pins_mut.set(pins.enable, n > 20);
        pins_mut.set(pins.velocity_cmd, 2e6);
        let _ = machine.driver.write();
        machine.wait(50 * MS);
        assert!(!machine.unsure(), "{n}");
    }
    let shown = machine.read(pins.position_fb);
    let motor = machine.motor as f64;
    assert!((shown - motor).abs() <= 16_400.0, "{shown}, {motor}");
    assert!(motor > 1e6, "{motor}");
    assert_eq!(machine.said().len(), 1, "the limit is reported");
}

/// A command between two values of the accumulator, in a cycle in which one of them is a rate.
#[test]
fn generator_that_has_arrived_stands_still() {
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
fn sample_to_write_time_includes_the_timer_lead() {
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

/// A probe has no second edge.
#[test]
fn edge_in_the_period_of_a_lost_write_is_latched() {
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
        .fail_at(next + 1, Fault::AckedButLost);
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
fn index_sets_position_to_0_at_its_place_and_probe_only_latches() {
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
