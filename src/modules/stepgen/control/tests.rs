//! The figures of FACTS 14.16, with a generator that moves exactly as it is told.

use super::*;
use alloc::vec::Vec;
use proptest::prelude::*;

const PERIOD: f64 = 0.001;
/// The limits of FACTS 14.16.
const SPEED: f64 = 10.0;
const ACCELERATION: f64 = 100.0;
const RAMP: f64 = ACCELERATION * PERIOD * PERIOD;

fn limits(speed: f64, acceleration: f64) -> ControlLimits {
    ControlLimits::new(speed, acceleration, PERIOD)
}

/// A generator that adds each move to its position.
#[derive(Clone, Default)]
struct Ideal {
    law: ControlLaw,
    position: f64,
    /// The distance in which the present move is still made after the read, as a part of the
    /// period.
    delay: f64,
}

impl Ideal {
    /// One period. Checks the limits of the move.
    fn step(&mut self, limits: &ControlLimits, command: f64) -> f64 {
        let before = self.law.step();
        self.law.follow(limits, command, self.position, self.delay);
        let step = self.law.step();
        assert!(step.is_finite());
        let least = limits.max_move.max(before.abs() - limits.max_change);
        assert!(step.abs() <= least * (1.0 + 1e-12), "{step} of {limits:?}");
        let change = (step - before).abs();
        assert!(
            change <= limits.max_change * (1.0 + 1e-9) + 1e-12 * before.abs(),
            "{change} of {limits:?}"
        );
        self.position += before * self.delay + step * (1.0 - self.delay);
        step
    }

    /// Periods of a constant command until the position is within `tolerance` of it for good, and
    /// the greatest overshoot.
    fn arrive(&mut self, limits: &ControlLimits, command: f64, tolerance: f64) -> (usize, f64) {
        let way = (command - self.position).signum();
        let (mut last, mut overshoot) = (0, 0.0_f64);
        for period in 1..40_000 {
            self.step(limits, command);
            let error = self.position - command;
            overshoot = overshoot.max(error * way);
            if error.abs() > tolerance {
                last = period;
            }
            if period > last + 200 && self.law.step() == 0.0 {
                break;
            }
        }
        (last + 1, overshoot)
    }
}

/// The positions of a trapezoid from 0: its acceleration, its speed and the time at speed.
fn trapezoid(acceleration: f64, speed: f64, cruise: f64) -> Vec<f64> {
    let rise = speed / acceleration;
    let end = 2.0 * rise + cruise;
    let ramped = |t: f64| acceleration * t * t / 2.0;
    let at = |t: f64| {
        if t < rise {
            ramped(t)
        } else if t < rise + cruise {
            ramped(rise) + speed * (t - rise)
        } else if t < end {
            2.0 * ramped(rise) + speed * cruise - ramped(end - t)
        } else {
            2.0 * ramped(rise) + speed * cruise
        }
    };
    let periods = (end / PERIOD) as usize + 400;
    (0..periods).map(|n| at(n as f64 * PERIOD)).collect()
}

/// The greatest distance from the command of the period before, and the overshoot at the end.
fn follow(path: &[f64], limits: &ControlLimits, delay: f64) -> (f64, f64) {
    let mut ideal = Ideal {
        delay,
        ..Ideal::default()
    };
    let (mut worst, mut previous) = (0.0_f64, 0.0);
    let end = path.last().copied().unwrap();
    let mut overshoot = 0.0_f64;
    for &command in path {
        worst = worst.max((ideal.position - previous).abs());
        ideal.step(limits, command);
        overshoot = overshoot.max((ideal.position - end) * end.signum());
        previous = command;
    }
    assert!(
        (ideal.position - end).abs() < 1e-6,
        "{}",
        ideal.position - end
    );
    (worst, overshoot)
}

#[test]
fn one_unit_step_takes_at_most_1_percent_over_the_shortest_time() {
    for (size, shortest) in [(1.0, 0.2), (-1.0, 0.2), (100.0, 10.1), (0.25, 0.1)] {
        let mut ideal = Ideal::default();
        let limits = limits(SPEED, ACCELERATION);
        let (periods, overshoot) = ideal.arrive(&limits, size, 1e-4);
        let taken = periods as f64 * PERIOD;
        assert!(taken <= shortest * 1.01 + 2.0 * PERIOD, "{size}: {taken} s");
        assert!(overshoot < 1e-12, "{size}: {overshoot}");
    }
}

#[test]
fn step_of_a_thousandth_takes_six_periods() {
    let mut ideal = Ideal::default();
    let (periods, overshoot) = ideal.arrive(&limits(SPEED, ACCELERATION), 0.001, 1e-9);
    assert_eq!(periods, 6);
    assert!(overshoot < 1e-15, "{overshoot}");
}

#[test]
fn trapezoid_within_the_limits_is_followed_one_period_late() {
    for acceleration in [1.0, 50.0, 80.0, 99.0, 100.0] {
        for speed in [0.05, 3.0, 9.9] {
            let path = trapezoid(acceleration, speed, 0.3);
            let (worst, overshoot) = follow(&path, &limits(SPEED, ACCELERATION), 0.0);
            let allowed = acceleration * PERIOD * PERIOD;
            assert!(worst < 1e-3 * allowed, "{acceleration}, {speed}: {worst}");
            assert!(overshoot < 1e-11, "{acceleration}, {speed}: {overshoot}");
        }
    }
}

/// LinuxCNC's rule overshoots by 0.019 and 0.041 there.
#[test]
fn command_that_is_too_fast_is_caught_up_with_and_not_overrun() {
    let limits = limits(SPEED, ACCELERATION);
    let (_, fast) = follow(&trapezoid(80.0, 10.2, 0.5), &limits, 0.0);
    assert!(fast < 1e-9, "{fast}");
    // It cannot brake as the command does: 5^2/200 - 5^2/240.
    let (_, steep) = follow(&trapezoid(120.0, 5.0, 0.5), &limits, 0.0);
    assert!(steep < 0.0212, "{steep}");
}

#[test]
fn delay_of_up_to_half_a_period_causes_no_overshoot() {
    for delay in [0.05, 0.1, 0.3, 0.5] {
        for acceleration in [50.0, 80.0, 99.0, 100.0] {
            let path = trapezoid(acceleration, 5.0, 0.3);
            let (worst, overshoot) = follow(&path, &limits(SPEED, ACCELERATION), delay);
            assert!(worst <= delay * RAMP, "{delay}, {acceleration}: {worst}");
            assert!(overshoot < 1e-12, "{delay}, {acceleration}: {overshoot}");
        }
    }
}

#[test]
fn longer_read_to_write_delay_adds_no_more_lag_than_itself() {
    for delay in [0.1, 0.3, 0.8] {
        let path = trapezoid(80.0, 5.0, 0.3);
        let (worst, overshoot) = follow(&path, &limits(SPEED, ACCELERATION), delay);
        assert!(worst <= 2.0 * delay * RAMP, "{delay}: {worst}");
        assert!(overshoot < 1e-12, "{delay}: {overshoot}");
        let mut ideal = Ideal {
            delay,
            ..Ideal::default()
        };
        let (_, overshoot) = ideal.arrive(&limits(SPEED, ACCELERATION), 1.0, 1e-6);
        assert!(overshoot < delay * RAMP, "{delay}: {overshoot}");
    }
    // With no acceleration to spare, and more than half a period late.
    let path = trapezoid(ACCELERATION, 5.0, 0.3);
    let (worst, overshoot) = follow(&path, &limits(SPEED, ACCELERATION), 0.8);
    assert!(worst <= 5.0 * 0.3 * PERIOD + RAMP, "{worst}");
    assert!(overshoot <= 5.0 * 0.3 * PERIOD + RAMP, "{overshoot}");
}

/// A profile of continuous time: moves from speed to speed with an acceleration, a time at each of
/// them, and rest, sampled from a part of the first period on. Returns its samples.
fn sampled(speeds: &[(f64, f64)], acceleration: f64, phase: f64) -> Vec<f64> {
    let (mut parts, mut speed) = (alloc::vec![(0.0, 5.0 * PERIOD)], 0.0_f64);
    for &(to, hold) in speeds.iter().chain(&[(0.0, 0.4)]) {
        let change = to - speed;
        parts.push((acceleration.copysign(change), change.abs() / acceleration));
        parts.push((0.0, hold));
        speed = to;
    }
    let (mut samples, mut begin, mut position) = (Vec::new(), 0.0, 0.0);
    speed = 0.0;
    for (acceleration, time) in parts {
        let at = |t: f64| position + speed * t + acceleration * t * t / 2.0;
        let next = |samples: &Vec<f64>| (samples.len() as f64 + phase) * PERIOD - begin;
        while next(&samples) < time {
            let sample = at(next(&samples));
            samples.push(sample);
        }
        position = at(time);
        speed += acceleration * time;
        begin += time;
    }
    samples
}

/// The generator averages what is read: in LinuxCNC this jitter takes the whole acceleration.
#[test]
fn read_jitter_at_speed_uses_little_of_the_acceleration() {
    let limits = limits(SPEED, ACCELERATION);
    let (mut ideal, mut command) = (Ideal::default(), 0.0);
    let mut worst = 0.0_f64;
    for period in 0..2_000_u32 {
        let speed = (f64::from(period) * PERIOD * 80.0).min(5.0);
        command += speed * PERIOD;
        let late = if period % 2 == 0 { 20e-6 } else { -20e-6 };
        let before = ideal.law.step();
        let seen = ideal.position + speed * late;
        ideal.law.follow(&limits, command, seen, 0.0);
        let step = ideal.law.step();
        if period > 200 {
            worst = worst.max((step - before).abs());
        }
        ideal.position += step;
    }
    assert!(worst < 0.05 * RAMP, "{} of a ramp", worst / RAMP);
}

#[test]
fn command_is_reached_at_full_speed_without_acceleration_limit() {
    let free = limits(SPEED, 0.0);
    for size in [1.0, -1.0, 0.001, 1e-7] {
        let mut ideal = Ideal::default();
        let (periods, overshoot) = ideal.arrive(&free, size, 1e-4);
        assert!(periods <= 106, "{size}: {periods}");
        assert!(overshoot < 1e-12, "{size}: {overshoot}");
    }
    let (worst, overshoot) = follow(&trapezoid(1e4, 9.0, 0.3), &free, 0.0);
    assert!(worst < 1e-9 && overshoot < 1e-9, "{worst}, {overshoot}");
}

#[test]
fn command_that_is_not_a_number_is_the_one_before() {
    let limits = limits(SPEED, ACCELERATION);
    for strange in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut ideal = Ideal::default();
        for n in 0..60 {
            ideal.step(&limits, f64::from(n) * 0.002);
        }
        let last = ideal.law.command();
        for _ in 0..1_000 {
            ideal.step(&limits, strange);
        }
        assert!((ideal.position - last).abs() < 1e-9, "{strange}");
    }
    let mut law = ControlLaw::default();
    law.follow(&limits, 0.0, f64::NAN, 0.0);
    assert_eq!(law.step(), 0.0);
    law.track(&limits, f64::NAN, 0.0);
    assert_eq!(law.step(), 0.0);
}

#[test]
fn speed_is_reached_along_the_acceleration_and_not_passed() {
    let limits = limits(SPEED, ACCELERATION);
    let mut law = ControlLaw::default();
    for (speed, periods) in [(5.0, 50), (-50.0, 150), (0.0, 100)] {
        for period in 1..=periods {
            law.track(&limits, speed * PERIOD, 0.0);
            let wanted = speed.clamp(-SPEED, SPEED) * PERIOD;
            let is_there = (law.step() - wanted).abs() < 1e-12;
            assert_eq!(is_there, period == periods, "{speed}: {period}");
        }
    }
}

#[test]
fn write_that_failed_leaves_the_move_of_before() {
    let limits = limits(SPEED, ACCELERATION);
    let mut law = ControlLaw::default();
    for _ in 0..10 {
        law.track(&limits, 1.0, 0.0);
    }
    let before = law.step();
    law.track(&limits, 1.0, 0.0);
    law.written(false);
    assert_eq!(law.step(), before);
    law.written(false);
    assert_eq!(law.step(), before, "no move was made since");
    law.track(&limits, 1.0, 0.0);
    let now = law.step();
    law.written(true);
    law.written(false);
    assert_eq!(law.step(), now);
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -20.0..20.0,
        1 => prop::num::f64::ANY,
        1 => Just(0.0),
    ]
}

/// Sizes of steps: from a ten-thousandth of a ramp to half a minute of motion.
fn size() -> impl Strategy<Value = f64> {
    (-8.0..1.5, prop::bool::ANY).prop_map(|(exponent, is_negative): (f64, bool)| {
        let size = libm::pow(10.0, exponent);
        if is_negative { -size } else { size }
    })
}

proptest! {
    #[test]
    fn steps_of_any_size_arrive_without_overshoot(
        size in size(), speed in 1.0f64..50.0, acceleration in 1.0f64..5_000.0
    ) {
        let limits = limits(speed, acceleration);
        let mut ideal = Ideal::default();
        let mut position = ideal.position;
        let ramp = acceleration * PERIOD * PERIOD;
        let time = size.abs() / speed + speed / acceleration + 2.0 * (size.abs() / acceleration).sqrt();
        for _ in 0..(time / PERIOD) as usize + 20 {
            ideal.step(&limits, size);
            // Apart from rounding: some thousand moves are added.
            let rounding = 1e-12 * (1.0 + size.abs());
            prop_assert!((ideal.position - position) * size.signum() >= -rounding, "it turns back");
            position = ideal.position;
            prop_assert!((position - size) * size.signum() <= 1e-9 * (ramp + size.abs()));
        }
        prop_assert!((position - size).abs() <= 1e-9 * (ramp + size.abs()), "{}", position - size);
    }

    /// Whatever the commands are and whenever the limits change, no move is larger and no change of
    /// it is greater than they allow: `Ideal::step` checks it.
    #[test]
    fn limits_are_kept_in_every_period_whatever_is_commanded(
        steps in prop::collection::vec(
            (number(), 1usize..40, 0.0f64..30.0, prop_oneof![1 => Just(0.0), 6 => 0.01f64..3_000.0]),
            1..20,
        ),
        delay in 0.0f64..0.9,
    ) {
        let mut ideal = Ideal { delay, ..Ideal::default() };
        for (command, periods, speed, acceleration) in steps {
            let limits = limits(speed, acceleration);
            for _ in 0..periods {
                ideal.step(&limits, command);
            }
        }
    }

    #[test]
    fn mirrored_command_gives_the_mirrored_moves(
        commands in prop::collection::vec(number(), 1..200), speed in 0.1f64..30.0,
        acceleration in prop_oneof![1 => Just(0.0), 6 => 0.1f64..3_000.0],
    ) {
        let limits = limits(speed, acceleration);
        let (mut one, mut other) = (Ideal::default(), Ideal::default());
        for command in commands {
            let (up, down) = (one.step(&limits, command), other.step(&limits, -command));
            prop_assert_eq!(up, -down);
        }
    }

    /// Whatever the phase of its periods is: a command that brakes from a speed which it has had
    /// for three periods is not overrun, but for the last period of the motion, and is followed
    /// within one ramp if there is acceleration to spare.
    #[test]
    fn continuous_command_is_not_overrun_at_half_a_period_of_delay(
        speeds in prop::collection::vec((0.2f64..9.0, 0.003f64..0.05), 1..4),
        acceleration in prop_oneof![1 => Just(100.0), 1 => 40.0f64..100.0],
        phase in 0.0f64..1.0, delay in 0.0f64..=0.5,
    ) {
        let path = sampled(&speeds, acceleration, phase);
        let limits = limits(SPEED, ACCELERATION);
        let end = path.last().copied().unwrap();
        let mut ideal = Ideal { delay, ..Ideal::default() };
        let (mut previous, mut before) = (0.0, 0.0);
        for command in path {
            let lag = previous - ideal.position;
            let spare = acceleration <= 90.0 && delay <= 0.4;
            prop_assert!(!spare || lag.abs() <= RAMP, "{} ramps behind", lag / RAMP);
            ideal.step(&limits, command);
            let (beyond, back) = (ideal.position - end, before - ideal.position);
            prop_assert!(beyond <= 0.1 * RAMP, "{} ramps beyond", beyond / RAMP);
            prop_assert!(back <= 0.1 * RAMP, "{} ramps back", back / RAMP);
            (previous, before) = (command, ideal.position);
        }
        prop_assert!((ideal.position - end).abs() < 1e-12);
    }

    /// A command with random accelerations up to that of the generator, which begins behind it: no
    /// stop of the command is overrun.
    #[test]
    fn command_that_keeps_the_acceleration_is_not_overrun(
        parts in prop::collection::vec((-1.0f64..=1.0, 1usize..300), 1..6),
        behind in 0.0f64..0.5,
    ) {
        let limits = limits(SPEED, ACCELERATION);
        let mut ideal = Ideal { position: -behind, ..Ideal::default() };
        let (mut command, mut speed) = (0.0, 0.0_f64);
        let rest = core::iter::repeat_n(-1.0, 110).chain(core::iter::repeat_n(0.0, 3_000));
        let parts = parts.into_iter().flat_map(|(part, n)| core::iter::repeat_n(part, n));
        for part in parts.chain(rest) {
            speed = (speed + part * RAMP).clamp(0.0, 0.9 * SPEED * PERIOD);
            command += speed;
            ideal.step(&limits, command);
            // Where the command can come to rest: n moves that fall by a ramp each.
            let ramps = speed / RAMP;
            let periods = ramps.ceil().max(1.0);
            let stop = command + (periods - 1.0) * (ramps - periods / 2.0) * RAMP;
            prop_assert!(ideal.position <= stop + 1e-9, "{} beyond {stop}", ideal.position);
        }
        prop_assert!((ideal.position - command).abs() < 1e-9);
    }
}
