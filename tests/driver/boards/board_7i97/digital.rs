//! The isolated inputs and outputs, the MPGs, the LEDs and the expansion connector's pins.

use super::*;
use crate::common::machine::start;

#[test]
fn inputs_arrive_filtered_and_raw() {
    for mut machine in both_firmwares().map(started) {
        let inputs = inputs(&machine);
        machine.driver.pins_mut().set(inputs.slow[3], true);
        machine.cycles(3);
        for n in 0..16 {
            machine.fpga().set_input(n, n % 3 == 0);
        }
        machine.cycles(4);
        for (n, (raw, input)) in inputs.raw.iter().zip(inputs.filtered).enumerate() {
            let (level, pins) = (n % 3 == 0, machine.driver.pins());
            let filtered = level && n != 3;
            assert_eq!(pins.read(raw.pin).value, level, "input {n}");
            assert_eq!(pins.read(raw.not).value, !level, "input {n}");
            assert_eq!(pins.read(input.pin).value, filtered, "input {n}");
            assert_eq!(pins.read(input.not).value, !filtered, "input {n}");
            let terminal = &pins.info(input.pin).expect("a pin").place.signal;
            assert_eq!(*terminal, format!("IN{n}"));
        }
        // 500 scans at 20 kHz: 25 ms.
        machine.cycles(30);
        assert!(machine.driver.pins().read(inputs.filtered[3].pin).value);
    }
}

/// For a number of cycles no input is valid and wrong, and no MPG has moved; then all of them are
/// valid.
fn inputs_become_valid_only_as_they_become_true<B: World>(
    machine: &mut Machine<B>,
    terminals: [bool; 16],
    mpgs: [i32; 4],
) {
    let card = inputs(machine);
    for n in 0..60 {
        let _ = machine.driver.read().expect("the bus does not fail");
        let pins = machine.driver.pins();
        for (k, truth) in terminals.into_iter().enumerate() {
            for (pair, what) in [(card.raw[k], "raw"), (card.filtered[k], "filtered")] {
                let (pin, not) = (pins.read(pair.pin), pins.read(pair.not));
                assert_eq!(pin.valid, not.valid);
                assert!(pin.valid || n < 40, "cycle {n}: {what} input {k}");
                let is_true = pin.value == truth && not.value != truth;
                assert!(!pin.valid || is_true, "cycle {n}: {what} input {k}");
            }
        }
        for (&count, expected) in card.mpg_counts.iter().zip(mpgs) {
            let count = pins.read(count);
            assert!(count.valid || n < 40, "cycle {n}");
            assert!(
                !count.valid || count.value == expected,
                "cycle {n}: {count:?}"
            );
        }
        machine.finish();
    }
}

#[test]
fn inputs_are_not_valid_until_scanned_and_filtered_again() {
    let terminals = core::array::from_fn(|n| n % 3 == 0);
    for mut fpga in both_firmwares() {
        for (n, on) in terminals.into_iter().enumerate() {
            fpga.set_input(n, on);
        }
        let mut machine = started(fpga);
        let inputs = inputs(&machine);
        for n in [0, 3, 4] {
            machine.driver.pins_mut().set(inputs.slow[n], true);
        }
        inputs_become_valid_only_as_they_become_true(&mut machine, terminals, [0; 4]);
        // MPG 2 on inputs 4 (slow) and 5, MPG 3 on inputs 6 and 7.
        machine.fpga().set_input(7, true);
        machine.cycles(3);
        machine.fpga().set_input(6, false);
        machine.cycles(3);
        machine.fpga().set_input(7, false);
        machine.cycles(3);
        machine.fpga().set_input(6, true);
        let mpgs = [0, 0, 0, -1];
        machine.cycles(3);
        inputs_become_valid_only_as_they_become_true(&mut machine, terminals, mpgs);
        for reset in [false, true] {
            if reset {
                machine.fpga().reload();
                machine.cycles(2);
            } else {
                machine.driver.bus_mut().wait(Duration::from_millis(20));
                let _ = machine.cycle();
            }
            assert_ne!(machine.driver.board_state(), BoardState::Running);
            for _ in 0..20 {
                let _ = machine.driver.rearm().expect("the bus does not fail");
                if machine.driver.board_state() == BoardState::Running {
                    break;
                }
                let _ = machine.cycle();
            }
            for n in [0, 3, 4] {
                machine.driver.pins_mut().set(inputs.slow[n], true);
            }
            inputs_become_valid_only_as_they_become_true(&mut machine, terminals, mpgs);
        }
    }
}

/// Turns the MPG on inputs 2k (A) and 2k+1 (B) by whole cycles, B ahead of A or behind it.
fn turn_mpg(machine: &mut Machine<SimFpga>, k: usize, cycles: i32) {
    let mut steps = [(false, true), (true, true), (true, false), (false, false)];
    if cycles < 0 {
        steps[..3].reverse();
    }
    for _ in 0..cycles.abs() {
        for (a, b) in steps {
            machine.fpga().set_input(2 * k, a);
            machine.fpga().set_input(2 * k + 1, b);
            machine.cycles(1);
        }
    }
}

/// FACTS 12.9: B leading A counts up, so that 1X counts rising edges of A up and falling ones down.
#[test]
fn mpgs_count_beyond_8_bits_at_1x_and_4x_and_can_be_reset() {
    for mut machine in both_firmwares().map(started) {
        let inputs = inputs(&machine);
        let count = |machine: &Machine<SimFpga>, k: usize| {
            machine.driver.pins().read(inputs.mpg_counts[k]).value
        };
        machine.cycles(3);
        turn_mpg(&mut machine, 1, 300);
        machine.cycles(2);
        assert_eq!((count(&machine, 0), count(&machine, 1)), (0, 300));
        turn_mpg(&mut machine, 1, -500);
        machine.cycles(2);
        assert_eq!((count(&machine, 0), count(&machine, 1)), (0, -200));
        machine.set_param(inputs.mpg_4x[3], true);
        machine.cycles(1);
        turn_mpg(&mut machine, 3, 100);
        machine.cycles(2);
        assert_eq!((count(&machine, 1), count(&machine, 3)), (-200, 400));
        turn_mpg(&mut machine, 3, -1);
        machine.cycles(2);
        assert_eq!(count(&machine, 3), 396);
        machine.driver.pins_mut().set(inputs.mpg_resets[1], true);
        machine.cycles(1);
        assert_eq!(count(&machine, 1), 0);
        machine.driver.pins_mut().set(inputs.mpg_resets[1], false);
        // A change of mode keeps the counts.
        machine.set_param(inputs.mpg_4x[3], false);
        turn_mpg(&mut machine, 1, 2);
        turn_mpg(&mut machine, 3, 2);
        machine.cycles(2);
        assert_eq!((count(&machine, 1), count(&machine, 3)), (2, 398));
    }
}

#[test]
fn isolated_outputs_and_leds_follow_and_can_be_inverted() {
    for mut machine in both_firmwares().map(started) {
        let card = machine.cards;
        let on = |machine: &mut Machine<SimFpga>| {
            let fpga = machine.fpga();
            [0, 1, 2, 3, 4, 5].map(|n| fpga.isolated_output(n))
        };
        let lit = |machine: &mut Machine<SimFpga>| {
            let leds = machine.fpga().leds();
            [0, 1, 2, 3].map(|n| leds.is_lit(n))
        };
        machine.cycles(2);
        assert_eq!(
            (on(&mut machine), lit(&mut machine)),
            ([false; 6], [false; 4])
        );
        for n in 0..6 {
            for (k, output) in card.outputs.iter().enumerate() {
                machine.driver.pins_mut().set(output.pin, k == n);
            }
            for (k, led) in card.leds.iter().enumerate() {
                machine.driver.pins_mut().set(*led, k == n);
            }
            machine.cycles(1);
            assert_eq!(on(&mut machine), [0, 1, 2, 3, 4, 5].map(|k| k == n));
            assert_eq!(lit(&mut machine), [0, 1, 2, 3].map(|k| k == n));
        }
        card.outputs[2]
            .set_inverted(machine.driver.pins_mut(), true)
            .expect("a pin inverts it");
        machine.cycles(1);
        assert_eq!(on(&mut machine), [false, false, true, false, false, true]);
        let Ok(rate) = machine
            .driver
            .pins()
            .output::<u32>("hm2_7i97.0.ssr.00.rate")
        else {
            assert!(machine.fpga().ssr().is_none(), "only SSR has a drive");
            continue;
        };
        machine.driver.pins_mut().set(rate, 0);
        machine.cycles(1);
        assert_eq!(on(&mut machine), [false; 6], "without drive");
    }
}

#[test]
fn expansion_pins_are_inputs_or_outputs_as_configured() {
    let config = GpioConfig {
        output: true,
        ..GpioConfig::default()
    };
    let inverted = GpioConfig {
        invert: true,
        ..config
    };
    let fpga = machines::i7i97(1);
    let mut machine = build(fpga, |s| s.gpio = vec![(34, config), (50, inverted)]);
    let all: [Output<bool>; 17] =
        core::array::from_fn(|n| machine.output(&format!("gpio.{:03}.out", 34 + n)));
    let out = |n: usize| all[n];
    let level: Input<bool> = machine.input("gpio.039.in");
    let not: Input<bool> = machine.input("gpio.039.in_not");
    let output = machine.param::<bool>("gpio.039.is_output");
    let drain = machine.param::<bool>("gpio.039.is_opendrain");
    machine.cycles(2);
    assert!(!machine.fpga().pin_level(34) && machine.fpga().pin_level(50));
    machine.driver.pins_mut().set(out(0), true);
    machine.driver.pins_mut().set(out(16), true);
    machine.driver.pins_mut().set(out(5), true);
    machine.fpga().drive_pin(39, Some(false));
    machine.cycles(2);
    assert!(machine.fpga().pin_level(34) && !machine.fpga().pin_level(50));
    assert!(
        !machine.driver.pins().read(level).value,
        "driven from outside"
    );
    assert!(machine.driver.pins().read(not).value);
    machine.fpga().drive_pin(39, None);
    machine.set_param(output, true);
    machine.driver.pins_mut().set(out(5), false);
    machine.cycles(2);
    assert!(!machine.fpga().pin_level(39));
    machine.set_param(drain, true);
    machine.driver.pins_mut().set(out(5), true);
    machine.fpga().drive_pin(39, Some(false));
    machine.cycles(2);
    assert!(
        !machine.driver.pins().read(level).value,
        "it does not drive high"
    );
}

#[test]
fn pin_that_a_module_uses_is_no_plain_io() {
    let error = start(machines::i7i97(1), |s| {
        s.gpio = vec![(19, GpioConfig::default())];
    })
    .expect_err("an isolated output");
    assert!(error.to_string().contains("I/O pin 19"), "{error}");
}
