//! The end of a motion: a rate of 0 counts as upwards, so that the direction changes after a motion
//! downwards. That must not cut a pulse, nor make another step.

use std::time::Duration;

use mesa_hal::bus::Clock;

use super::{Machine, machine};

/// The pins of generator 0 of a 7I76: direction, or steps downwards, and step, or steps upwards.
const DIR: usize = 0;
const STEP: usize = 1;
const LENGTH: u32 = 100_000;
/// A pulse in samples, less the time of the exchanges, in which none is taken.
const SHORTEST: u32 = 80;
const DIR_HOLD_REGISTER: u16 = 0x2400;
/// Samples in a period, of 1 us each.
const SAMPLES: u32 = 1_000;

/// What was seen on the pins.
#[derive(Debug, Default)]
struct Seen {
    levels: [bool; 2],
    /// Pulses on each pin, and the length of the present one in samples.
    pulses: [i32; 2],
    length: u32,
    /// Pulses that were too short, and changes of the direction inside a pulse.
    short: u32,
    turns_in_pulse: u32,
    turns: u32,
}

impl Seen {
    fn sample(&mut self, levels: [bool; 2], is_up_down: bool) {
        let before = std::mem::replace(&mut self.levels, levels);
        if !is_up_down && before[DIR] != levels[DIR] {
            self.turns += 1;
            self.turns_in_pulse += u32::from(before[STEP] && levels[STEP]);
        }
        for pin in [DIR, STEP] {
            if pin == DIR && !is_up_down {
                continue;
            }
            match (before[pin], levels[pin]) {
                (false, true) => (self.pulses[pin], self.length) = (self.pulses[pin] + 1, 1),
                (true, true) => self.length += 1,
                (true, false) => self.short += u32::from(self.length < SHORTEST),
                (false, false) => {}
            }
        }
    }
}

/// A generator with long pulses.
fn slow(step_type: u32) -> Machine {
    let mut machine = machine();
    let pins = machine.pins;
    let to = machine.driver.pins_mut();
    to.set_param(pins.step_type, step_type).expect("a type");
    to.set_param(pins.maxaccel, 0.0).expect("no limit");
    for (param, ns) in [
        (pins.steplen, LENGTH),
        (pins.stepspace, 50_000),
        (pins.dirsetup, 20_000),
        (pins.dirhold, 20_000),
    ] {
        to.set_param(param, ns).expect("a time");
    }
    to.set(pins.control_type, true);
    for _ in 0..10 {
        machine.cycle(0.0);
    }
    machine
}

/// Moves downwards at a speed, and stops. Returns true if a pulse was on its way when the rate
/// became 0.
fn move_and_stop(machine: &mut Machine, speed: f64, seen: &mut Seen, is_up_down: bool) -> bool {
    let pins = machine.pins;
    let mut was_in_pulse = false;
    for period in 0..30 {
        let _ = machine.driver.read();
        let is_moving = period < 20;
        if period == 20 {
            was_in_pulse = seen.levels.into_iter().any(|level| level);
        }
        machine.driver.pins_mut().set(pins.enable, is_moving);
        machine.driver.pins_mut().set(pins.velocity_cmd, -speed);
        machine.driver.write().expect("the bus is well");
        for _ in 0..SAMPLES {
            machine.driver.bus_mut().wait(Duration::from_micros(1));
            let fpga = &machine.driver.bus_mut().inner;
            seen.sample([DIR, STEP].map(|pin| fpga.pin_level(pin)), is_up_down);
        }
    }
    was_in_pulse
}

/// The pins while a generator moves and stops at several phases of its steps.
fn stops(machine: &mut Machine, is_up_down: bool) -> Seen {
    let mut seen = Seen::default();
    let mut in_pulse = 0;
    for number in 0..12 {
        let speed = 1.03 + 0.291 * f64::from(number);
        in_pulse += u32::from(move_and_stop(machine, speed, &mut seen, is_up_down));
    }
    assert!(in_pulse > 0, "none of them was in a pulse");
    seen
}

#[test]
fn motion_downwards_ends_without_a_false_step_in_up_down() {
    let mut machine = slow(1);
    let seen = stops(&mut machine, true);
    let counts = machine.driver.pins().read(machine.pins.counts).value;
    assert_eq!((seen.pulses[STEP], seen.short), (0, 0), "{seen:?}");
    assert!(seen.pulses[DIR] > 100, "{seen:?}");
    assert_eq!(-counts, seen.pulses[DIR]);
}

#[test]
fn direction_changes_after_the_pulse_when_a_downward_move_ends() {
    let mut machine = slow(0);
    let seen = stops(&mut machine, false);
    let counts = machine.driver.pins().read(machine.pins.counts).value;
    assert_eq!((seen.turns_in_pulse, seen.short), (0, 0), "{seen:?}");
    assert!(seen.turns > 12, "a rate of 0 is upwards: {seen:?}");
    assert_eq!(-counts, seen.pulses[STEP]);
}

/// The register of the driver makes the difference: with a hold that is shorter than the pulse, the
/// rest of the pulse appears on the other pin.
#[test]
fn hold_that_excludes_the_pulse_causes_a_false_gateware_step() {
    let mut machine = slow(1);
    let fpga = &mut machine.driver.bus_mut().inner;
    fpga.write_register(DIR_HOLD_REGISTER, 1);
    let seen = stops(&mut machine, true);
    assert!(seen.pulses[STEP] > 0 && seen.short > 0, "{seen:?}");
}
