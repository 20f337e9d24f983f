//! Arbitrary calls and disturbances while the board paces.

use std::time::Duration;

use mesa_hal::boards::{I7i77Analog, I7i77Field};
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::BoardState;
use mesa_hal::hal::Input;
use mesa_hal::modules::dpll::Dpll;
use mesa_hal_sim::devices::{find_cable, find_mut};

use super::{Machine, PERIOD, Pace, SimLink, WIRE, machine};
use crate::common::chance::Chance;
use crate::common::ethernet::{good, volts};

#[test]
fn shutdown_switches_remotes_off_at_any_point_of_the_cycle() {
    for (late, written) in [(100, false), (100, true), (950, false), (950, true)] {
        let mut driver = machine(Pace::Board);
        let analog: I7i77Analog = driver.attach((0, 1)).expect("analog");
        let _ = driver.rearm();
        for _ in 0..30 {
            let _ = driver.read().expect("the board is there");
            let pins = driver.pins_mut();
            pins.set(analog.analog_out[0].volts, 5.0);
            pins.set(analog.analogena.pin, true);
            driver.write().expect("the board is there");
            let _ = driver.rearm();
        }
        assert!((volts(driver.bus_mut()) - 5.0).abs() < 0.01);
        let _ = driver.read().expect("the board is there");
        driver.bus_mut().wait(Duration::from_micros(late));
        if written {
            driver.write().expect("the board is there");
        }
        let before = driver.bus_mut().now();
        let (mut bus, stopped) = driver.shutdown();
        stopped.expect("the board is there");
        let took = bus.now().since(before);
        assert!(took < Duration::from_millis(10), "{took:?}");
        assert_eq!(volts(&mut bus), 0.0, "{late} us late, {written}");
    }
}

#[test]
fn clock_of_other_frequency_is_in_every_report_without_runaway() {
    let mut driver = machine(Pace::Board);
    let dpll = driver
        .modules::<Dpll>()
        .next()
        .expect("a 7I97 has one")
        .pins;
    let run = |driver: &mut Machine, cycles: u32| {
        let mut said = 0;
        let before = driver.bus_mut().now();
        for _ in 0..cycles {
            let report = driver.read().expect("the board is there");
            said += u32::from(report.unpaced && !report.is_good());
            driver.write().expect("the board is there");
        }
        let took = driver.bus_mut().now().since(before);
        (said, took / cycles)
    };
    assert_eq!(run(&mut driver, 100).0, 0);
    for khz in [0.4, 2.0, 5.0] {
        driver.pins_mut().set(dpll.base_freq_khz, khz);
        run(&mut driver, 5);
        let (said, each) = run(&mut driver, 100);
        assert!(said > 40, "{khz} kHz: {said}");
        assert!(each >= PERIOD * 49 / 100, "{khz} kHz: {each:?}");
    }
    driver.pins_mut().set(dpll.base_freq_khz, 1.0);
    run(&mut driver, 5);
    let (said, each) = run(&mut driver, 100);
    assert_eq!(said, 0);
    assert!(each.abs_diff(PERIOD) < PERIOD / 100, "{each:?}");
    assert!(driver.statistics().unpaced_cycles > 120);
}

/// Sets the field inputs to the time in milliseconds.
fn set_inputs(driver: &mut Machine) -> u32 {
    let now = driver.bus_mut().now().as_nanos() / 1_000_000;
    let fpga = driver.bus_mut().link().board.gateware_mut();
    let device = find_mut(fpga.remote_mut(0, 0).expect("plugged")).expect("a device");
    for n in 0..32 {
        device.set_input(n, now >> n & 1 != 0).expect("an input");
    }
    now as u32
}

/// The number on the inputs, if they are valid, and its reported age.
fn shown(driver: &Machine, inputs: &[Input<bool>; 32]) -> Option<(u32, Duration)> {
    let age = driver.pins().read(inputs[0]).age;
    let bits = inputs.iter().enumerate().try_fold(0, |bits, (n, input)| {
        let reading = driver.pins().read(*input);
        reading
            .valid
            .then_some(bits | u32::from(reading.value) << n)
    });
    bits.map(|bits| (bits, age.time))
}

/// Makes one of the possible calls, or causes one of the possible events.
fn disturb(driver: &mut Machine, chance: &mut Chance) {
    match chance.below(40) {
        0 => drop(driver.rearm()),
        1 => assert!(driver.restart((0, chance.below(3) as u8))),
        2 => driver.request_read(),
        3 => drop(driver.wait_transfers(PERIOD)),
        4 => driver
            .bus_mut()
            .wait(Duration::from_micros(chance.below(4000))),
        // The host is stopped, and the watchdog bites.
        5 if chance.below(4) == 0 => driver.bus_mut().wait(Duration::from_secs(3)),
        6 => {
            let is_cut = chance.below(4) == 0;
            let fpga = driver.bus_mut().link().board.gateware_mut();
            let channel = chance.below(3) as usize;
            let cable = find_cable(fpga.remote_mut(0, channel).expect("a channel"));
            let cable = cable.expect("remotes have cables");
            if is_cut {
                cable.unplug();
            } else {
                cable.replug();
            }
        }
        7 => {
            let is_cut = chance.below(3) == 0;
            let link: &mut SimLink = driver.bus_mut().link();
            link.to_board = Box::new(move |_, _| if is_cut { vec![] } else { vec![WIRE] });
        }
        8 => driver.bus_mut().link().is_unreachable = chance.below(3) == 0,
        9 if chance.below(4) == 0 => driver.bus_mut().link().board.gateware_mut().reload(),
        10 => drop(driver.read()),
        11 => drop(driver.write()),
        _ => {}
    }
}

#[test]
fn no_input_is_older_than_its_age_and_no_loop_spins_on_a_fault() {
    for seed in 1..=6 {
        let mut driver = machine(Pace::Board);
        let mut chance = Chance(seed);
        let field: I7i77Field = driver.attach((0, 0)).expect("field I/O");
        let inputs = field.inputs.map(|pair| pair.pin);
        let (mut valid, mut history) = (0, vec![0]);
        for n in 0..1500 {
            history.push(set_inputs(&mut driver));
            disturb(&mut driver, &mut chance);
            let counted = driver.bus().statistics();
            let failed = driver.read().is_err();
            let now = driver.bus_mut().now().as_nanos() / 1_000_000;
            if let Some((bits, age)) = shown(&driver, &inputs) {
                // Time until which the inputs had this value.
                let until = history.iter().copied().find(|set| *set > bits);
                let until = until.map_or(now, u64::from);
                assert!(history.contains(&bits), "seed {seed}, cycle {n}: {bits}");
                assert!(
                    until + age.as_millis() as u64 + 1 >= now,
                    "seed {seed}, cycle {n}: {bits} until {until} at {now}, {age:?}"
                );
                valid += u32::from(!failed);
            }
            history.push(set_inputs(&mut driver));
            disturb(&mut driver, &mut chance);
            let _ = driver.write();
            let after = driver.bus().statistics();
            assert!(
                after.exchanges - counted.exchanges < 400,
                "seed {seed}, cycle {n}"
            );
        }
        println!("seed {seed}: {valid} cycles with new inputs");
        assert!(valid > 20, "seed {seed}: {valid}");
        let link = driver.bus_mut().link();
        link.is_unreachable = false;
        link.to_board = good();
        let fpga = link.board.gateware_mut();
        for channel in 0..3 {
            let cable = fpga.remote_mut(0, channel).and_then(find_cable);
            cable.expect("remotes have cables").replug();
        }
        for _ in 0..1500 {
            let _ = driver.read();
            let _ = driver.write();
            let _ = driver.rearm();
        }
        let started = driver.bus_mut().now();
        for _ in 0..100 {
            let report = driver.read().expect("all is well again");
            assert_eq!(
                (report.board, report.missed_periods),
                (BoardState::Running, 0)
            );
            assert!(!report.unpaced, "seed {seed}");
            driver.write().expect("all is well again");
        }
        let each = driver.bus_mut().now().since(started) / 100;
        assert!(each.abs_diff(PERIOD) < PERIOD / 50, "seed {seed}: {each:?}");
    }
}

#[test]
fn loop_without_a_board_takes_its_time_whatever_is_called_in_it() {
    for seed in 1..=8 {
        let mut driver = machine(Pace::Board);
        let mut chance = Chance(seed);
        let _ = driver.read().expect("the board is there");
        driver.bus_mut().link().is_unreachable = true;
        let before = driver.bus_mut().now();
        for _ in 0..100 {
            for _ in 0..chance.below(3) {
                let _ = driver.write();
            }
            let _ = driver.rearm();
            let _ = driver.wait_transfers(PERIOD);
            assert!(driver.read().is_err());
        }
        let took = driver.bus_mut().now().since(before);
        assert!(took >= PERIOD * 95, "seed {seed}: {took:?}");
    }
}
