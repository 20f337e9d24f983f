//! A stepper motor with its step/direction drive and an encoder.

use super::motor::{COUNTS, MotorError, POSITION, Range, Segment, check_ranges};
use crate::wire::Nanos;

/// Properties of a stepper motor, its drive, its axis and its encoder. A step is a pulse: a
/// microstep of the drive. Positions are in machine units.
///
/// [`Stepper::new`] accepts values in the ranges given here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepperConfig {
    /// Steps per unit; negative for a reversed motor. -1e7 to 1e7, except 0.
    pub steps_per_unit: f64,
    /// Encoder counts (quadrature edges) per unit; negative for a reversed encoder. Not more than
    /// the steps, or else a step is several counts at once. -1e7 to 1e7, except 0.
    pub counts_per_unit: f64,
    /// Counts from index pulse to index pulse; 0 if there is no index.
    pub counts_per_revolution: u32,
    /// Maximum acceleration of the rotor in units/s²; infinite for no limit. More than 0.
    pub max_acceleration: f64,
    /// Difference in units/s between the speed of the pulses and that of the rotor up to which the
    /// motor follows: also the speed to which it can start. More than 0.
    pub start_speed: f64,
    /// Speed in units/s above which the motor has no torque left; infinite for no limit. More than
    /// 0.
    pub max_speed: f64,
    /// Shortest pulse that the drive detects.
    pub min_pulse: Nanos,
    /// Shortest time between the end of a pulse and the next one.
    pub min_space: Nanos,
    /// Shortest time from a change of direction to the rising edge of a step.
    pub dir_setup: Nanos,
    /// Shortest time from the rising edge of a step to a change of direction.
    pub dir_hold: Nanos,
    /// Position at power-up. -1e9 to 1e9.
    pub position: f64,
}

const POSITIVE: Range = (|value| value > 0.0, "more than 0, up to inf");

impl StepperConfig {
    /// Checks the ranges.
    fn check(&self) -> Result<(), MotorError> {
        check_ranges(&[
            ("steps_per_unit", self.steps_per_unit, COUNTS),
            ("counts_per_unit", self.counts_per_unit, COUNTS),
            ("max_acceleration", self.max_acceleration, POSITIVE),
            ("start_speed", self.start_speed, POSITIVE),
            ("max_speed", self.max_speed, POSITIVE),
            ("position", self.position, POSITION),
        ])
    }
}

impl Default for StepperConfig {
    /// 1000 steps and 1000 counts per unit, an index every 4000 counts, at most 1000 units/s² and
    /// 100 units/s, starts to 1 unit/s; pulses and spaces of 1 us, set-up and hold of 200 ns; at 0.
    fn default() -> Self {
        Self {
            steps_per_unit: 1000.0,
            counts_per_unit: 1000.0,
            counts_per_revolution: 4000,
            max_acceleration: 1000.0,
            start_speed: 1.0,
            max_speed: 100.0,
            min_pulse: 1_000,
            min_space: 1_000,
            dir_setup: 200,
            dir_hold: 200,
            position: 0.0,
        }
    }
}

/// A step that the drive has detected, until its pulse and its hold time are long enough.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    at: Nanos,
    way: i64,
}

/// A stepper motor.
///
/// The drive detects a step at each rising edge of STEP, upwards while DIR is low. It ignores a
/// step whose pulse, space, set-up or hold is too short. The rotor follows the pulses with limited
/// acceleration: while its speed differs too much from theirs, steps are lost and the rotor slows
/// down, until the pulses are slow enough again. A step against the one before cancels it: the
/// speed of the pulses between the two is 0, however close they are, as the inertia of a rotor lets
/// it take no part in both. If the pulses stop at a speed from which the rotor cannot stop, it
/// overshoots by the steps it needs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepper {
    config: StepperConfig,
    now: Nanos,
    powered: bool,
    step: bool,
    dir: bool,
    /// Time of the last change of DIR, and of the last falling edge of STEP.
    dir_since: Option<Nanos>,
    fallen: Option<Nanos>,
    pending: Option<Step>,
    /// Speed of the rotor in steps/s, and the last step.
    speed: f64,
    last: Option<Step>,
    commanded: i64,
    steps: i64,
    lost: u64,
    overshot: u64,
}

impl Default for Stepper {
    /// The motor of [`StepperConfig::default`].
    fn default() -> Self {
        Self::at_rest(StepperConfig::default())
    }
}

impl Stepper {
    /// A motor at rest, with power.
    ///
    /// # Errors
    /// A value is outside the range in [`StepperConfig`], or is not a number.
    pub fn new(config: StepperConfig) -> Result<Self, MotorError> {
        config.check()?;
        Ok(Self::at_rest(config))
    }

    fn at_rest(config: StepperConfig) -> Self {
        Self {
            config,
            now: 0,
            powered: true,
            step: true,
            dir: true,
            dir_since: None,
            fallen: None,
            pending: None,
            speed: 0.0,
            last: None,
            commanded: 0,
            steps: 0,
            lost: 0,
            overshot: 0,
        }
    }

    /// The configuration of the motor.
    pub fn config(&self) -> &StepperConfig {
        &self.config
    }

    /// Steps that arrived at the drive's inputs since power-up, up minus down, whether they were
    /// followed or not.
    pub fn commanded(&self) -> i64 {
        self.commanded
    }

    /// True position in steps since power-up.
    pub fn steps(&self) -> i64 {
        self.steps
    }

    /// Number of steps that arrived and that the motor did not follow.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Number of steps by which the rotor ran on after pulses that stopped too suddenly.
    pub fn overshot(&self) -> u64 {
        self.overshot
    }

    /// Its true position in units.
    pub fn position(&self) -> f64 {
        self.config.position + self.steps as f64 / self.config.steps_per_unit
    }

    /// The speed of the rotor in units per second.
    pub fn velocity(&self) -> f64 {
        self.speed / self.config.steps_per_unit
    }

    /// Position of its encoder in counts.
    pub fn counts(&self) -> f64 {
        let StepperConfig {
            steps_per_unit,
            counts_per_unit,
            position,
            ..
        } = self.config;
        // In this order a whole number of counts is exact.
        position * counts_per_unit + self.steps as f64 * counts_per_unit / steps_per_unit
    }

    /// Switches the drive's power: without it, the motor loses all steps.
    pub fn set_power(&mut self, powered: bool) {
        self.powered = powered;
    }

    /// True if the drive has power.
    pub fn is_powered(&self) -> bool {
        self.powered
    }

    /// Wires the drive's inputs to signals with these levels.
    pub(crate) fn wire(&mut self, now: Nanos, step: bool, dir: bool) {
        (self.now, self.step, self.dir) = (now, step, dir);
    }

    /// Sets the levels of the drive's inputs at `at`, and reports the movement as
    /// [`Motor::advance`](super::Motor) does.
    pub(crate) fn set_inputs(
        &mut self,
        at: Nanos,
        step: bool,
        dir: bool,
        moved: &mut impl FnMut(&Segment, [f64; 2]),
    ) {
        self.advance(at, moved);
        if dir != self.dir {
            let is_early = |pending: Step| at.saturating_sub(pending.at) < self.config.dir_hold;
            if self.pending.is_some_and(is_early) {
                self.lose_pending();
            }
            self.dir = dir;
            self.dir_since = Some(at);
        }
        if step == self.step {
            return;
        }
        self.step = step;
        if step {
            self.rise(at, moved);
        } else {
            self.fallen = Some(at);
            let is_short = |pending: Step| at.saturating_sub(pending.at) < self.config.min_pulse;
            if self.pending.is_some_and(is_short) {
                self.lose_pending();
            }
        }
    }

    fn rise(&mut self, at: Nanos, moved: &mut impl FnMut(&Segment, [f64; 2])) {
        if let Some(step) = self.pending.take() {
            self.follow(step, at, moved);
        }
        let way = if self.dir { -1 } else { 1 };
        self.commanded += way;
        let passed =
            |since: Option<Nanos>| since.map_or(Nanos::MAX, |since| at.saturating_sub(since));
        let is_detected = passed(self.dir_since) >= self.config.dir_setup
            && passed(self.fallen) >= self.config.min_space;
        if is_detected {
            self.pending = Some(Step { at, way });
        } else {
            self.lost += 1;
        }
    }

    fn lose_pending(&mut self) {
        self.lost += u64::from(self.pending.take().is_some());
    }

    /// Advances to `to`: follows a step that has waited for long enough.
    pub(crate) fn advance(&mut self, to: Nanos, moved: &mut impl FnMut(&Segment, [f64; 2])) {
        let wait = self.config.min_pulse.max(self.config.dir_hold);
        if let Some(step) = self.pending
            && step.at.saturating_add(wait) <= to
        {
            self.pending = None;
            self.follow(step, step.at + wait, moved);
        }
        if self.pending.is_none() {
            self.overshoot(to, moved);
        }
        self.now = self.now.max(to);
    }

    /// Follows a step, if the rotor can.
    fn follow(&mut self, step: Step, at: Nanos, moved: &mut impl FnMut(&Segment, [f64; 2])) {
        self.overshoot(step.at, moved);
        let seconds = self.seconds_since_step(step.at);
        let turns = self.last.is_some_and(|last| last.way != step.way);
        self.last = Some(step);
        // At a turn, the two steps are at the same place.
        let pulses = if turns {
            0.0
        } else {
            step.way as f64 / seconds
        };
        let change = self.acceleration() * seconds;
        let speed = self.speed + (pulses - self.speed).clamp(-change, change);
        let follows = (pulses - speed).abs() <= self.per_second(self.config.start_speed)
            && pulses.abs() <= self.per_second(self.config.max_speed)
            && self.powered;
        if follows {
            self.speed = speed;
            self.turn(step.way, [step.at, at], moved);
        } else {
            self.lost += 1;
            self.speed -= self.speed.clamp(-change, change);
        }
    }

    /// Lets the rotor run on, if no step has come for so long that it cannot have slowed down as
    /// the steps did. The longest time without a step that a speed allows is shorter than that in
    /// which the rotor slows down if the speed exceeds twice the root of the acceleration.
    fn overshoot(&mut self, to: Nanos, moved: &mut impl FnMut(&Segment, [f64; 2])) {
        let acceleration = self.acceleration();
        let root = libm::sqrt(acceleration);
        let excess = self.speed.abs() - self.per_second(self.config.start_speed);
        if excess <= 2.0 * root || self.seconds_since_step(to) < 1.0 / root {
            return;
        }
        let steps = libm::floor(excess * excess / acceleration / 2.0) as i64;
        let way = if self.speed < 0.0 { -steps } else { steps };
        self.overshot += steps.unsigned_abs();
        self.speed = 0.0;
        self.turn(way, [self.now, to], moved);
    }

    /// Turns the rotor by steps within a time, of which only the part from `now` on is left.
    fn turn(&mut self, steps: i64, times: [Nanos; 2], moved: &mut impl FnMut(&Segment, [f64; 2])) {
        let (from, counts) = (self.position(), self.counts());
        self.steps += steps;
        let [start, end] = times.map(|time| time.max(self.now));
        let segment = Segment {
            start,
            end,
            from: counts,
            to: self.counts(),
            counts_per_revolution: self.config.counts_per_revolution,
        };
        self.now = end;
        if steps != 0 {
            moved(&segment, [from, self.position()]);
        }
    }

    /// Time since the last step; a step after none is a start.
    fn seconds_since_step(&self, at: Nanos) -> f64 {
        let since = |last: Step| at.saturating_sub(last.at) as f64 * 1e-9;
        self.last.map_or(f64::INFINITY, since)
    }

    /// Maximum acceleration in steps/s².
    fn acceleration(&self) -> f64 {
        self.per_second(self.config.max_acceleration)
    }

    /// Steps for units, regardless of the direction.
    fn per_second(&self, units: f64) -> f64 {
        units * self.config.steps_per_unit.abs()
    }
}

#[cfg(test)]
mod tests;
