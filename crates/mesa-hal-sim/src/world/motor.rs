//! A motor with its velocity drive, its encoder, and an axis between hard stops.

use thiserror::Error;

use super::motion::{Forces, Piece, State};
use crate::wire::Nanos;

/// Longest segment of a movement that is reported at once.
const LONGEST_SEGMENT: Nanos = 100_000;

/// Speed (units per second) below which a motor without any drive force is at rest.
const STANDSTILL: f64 = 1e-9;

/// Maximum number of changes of the forces in one segment; further ones follow later.
const MAX_PIECES: usize = 16;

/// Properties of a motor, its drive, its encoder and its axis. Positions are in machine units,
/// forces in any unit, the same for all: with millimetres and newtons an inertia of 1 is 1000 kg.
///
/// [`Motor::new`] accepts values in the ranges given here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorConfig {
    /// Speed at full-scale voltage, in units per second. More than 0, up to 1e9.
    pub max_speed: f64,
    /// Full-scale voltage of the drive's input. More than 0, up to 100.
    pub full_scale: f64,
    /// Time constant of the velocity loop in seconds, as long as the drive's force suffices; 0
    /// follows immediately. Up to 10.
    pub time_constant: f64,
    /// Dead band of the drive's input in volts: subtracted from the command in either direction. 0
    /// to 10.
    pub friction: f64,
    /// Encoder counts (quadrature edges) per unit; negative for a reversed encoder. -1e7 to 1e7,
    /// except 0.
    pub counts_per_unit: f64,
    /// Counts from index pulse to index pulse; 0 if there is no index.
    pub counts_per_revolution: u32,
    /// Force for an acceleration of one unit/s². 1e-9 to 1e9.
    pub inertia: f64,
    /// Maximum force of the drive; infinite for no limit. More than 0.
    pub max_force: f64,
    /// Force of dry friction: slows a coasting motor, and a smaller force does not move a motor at
    /// rest. 0 to 1e9.
    pub drag: f64,
    /// Positions of the hard stops, the lower one first; infinite for none. The axis stops there
    /// without bouncing.
    pub stops: [f64; 2],
    /// Position at power-up, clamped to the stops. -1e9 to 1e9. The index is at multiples of the
    /// counts of a revolution from 0.
    pub position: f64,
}

impl Default for MotorConfig {
    /// 100 units/s at 10 V, 5 ms, no friction, 1000 counts per unit, an index every 4000 counts,
    /// unlimited force, no stops, position 0.
    fn default() -> Self {
        Self {
            max_speed: 100.0,
            full_scale: 10.0,
            time_constant: 0.005,
            friction: 0.0,
            counts_per_unit: 1000.0,
            counts_per_revolution: 4000,
            inertia: 1.0,
            max_force: f64::INFINITY,
            drag: 0.0,
            stops: [f64::NEG_INFINITY, f64::INFINITY],
            position: 0.0,
        }
    }
}

/// An invalid motor.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MotorError {
    /// A number outside its range.
    #[error("{field} of a motor is {value}: allowed is {allowed}")]
    OutOfRange {
        /// The field of [`MotorConfig`] or of [`StepperConfig`](super::StepperConfig).
        field: &'static str,
        /// Its value.
        value: f64,
        /// The permitted range, as text.
        allowed: &'static str,
    },
    /// Stops without any travel between them.
    #[error(
        "the stops of a motor are {low} and {high}: allowed are two positions, the lower one first; -inf and inf for none"
    )]
    Stops {
        /// The first one.
        low: f64,
        /// The second one.
        high: f64,
    },
}

/// A permitted range: its test and its text.
pub(super) type Range = (fn(f64) -> bool, &'static str);

const SPEED: Range = (
    |speed| speed > 0.0 && speed <= 1e9,
    "more than 0, up to 1e9",
);
const FULL_SCALE: Range = (
    |volts| volts > 0.0 && volts <= 100.0,
    "more than 0, up to 100 (V)",
);
const TIME: Range = (|time| (0.0..=10.0).contains(&time), "0 to 10 (s)");
const FRICTION: Range = (|volts| (0.0..=10.0).contains(&volts), "0 to 10 (V)");
pub(super) const COUNTS: Range = (
    |counts| counts.abs() <= 1e7 && counts != 0.0,
    "-1e7 to 1e7, and not 0",
);
const INERTIA: Range = (|inertia| (1e-9..=1e9).contains(&inertia), "1e-9 to 1e9");
const FORCE: Range = (|force| force > 0.0, "more than 0, up to inf");
const DRAG: Range = (|drag| (0.0..=1e9).contains(&drag), "0 to 1e9");
pub(super) const POSITION: Range = (|position| position.abs() <= 1e9, "-1e9 to 1e9");

impl MotorConfig {
    /// Checks the ranges.
    fn check(&self) -> Result<(), MotorError> {
        check_ranges(&[
            ("max_speed", self.max_speed, SPEED),
            ("full_scale", self.full_scale, FULL_SCALE),
            ("time_constant", self.time_constant, TIME),
            ("friction", self.friction, FRICTION),
            ("counts_per_unit", self.counts_per_unit, COUNTS),
            ("inertia", self.inertia, INERTIA),
            ("max_force", self.max_force, FORCE),
            ("drag", self.drag, DRAG),
            ("position", self.position, POSITION),
        ])?;
        let [low, high] = self.stops;
        if low < high {
            Ok(())
        } else {
            Err(MotorError::Stops { low, high })
        }
    }
}

/// Checks each field, by its name and its value.
pub(super) fn check_ranges(fields: &[(&'static str, f64, Range)]) -> Result<(), MotorError> {
    for &(field, value, (is_allowed, allowed)) in fields {
        if !is_allowed(value) {
            return Err(MotorError::OutOfRange {
                field,
                value,
                allowed,
            });
        }
    }
    Ok(())
}

/// A segment of a movement in one direction, as the encoder sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Time of the beginning.
    pub start: Nanos,
    /// Time of the end; not before `start`.
    pub end: Nanos,
    /// Encoder position at the beginning, in counts.
    pub from: f64,
    /// Encoder position at the end, in counts.
    pub to: f64,
    /// Counts from index pulse to index pulse; 0 if there is no index.
    pub counts_per_revolution: u32,
}

/// A motor whose speed follows a voltage with a first-order lag, within its force.
///
/// While its drive has power, the drive accelerates the motor by `(commanded - speed) /
/// time_constant`, at most by `max_force / inertia`; the command to a disabled drive is 0. Dry
/// friction acts against the motion. Without power only friction slows the motor. Each step uses
/// the exact solution, so that the path does not depend on the number of steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    config: MotorConfig,
    now: Nanos,
    state: State,
    command: f64,
    powered: bool,
    blocked: bool,
    turned_by_hand: Option<f64>,
}

impl Default for Motor {
    /// The motor of [`MotorConfig::default`].
    fn default() -> Self {
        Self::at_rest(MotorConfig::default())
    }
}

impl Motor {
    /// A motor at rest, with power.
    ///
    /// # Errors
    /// A value is outside the range in [`MotorConfig`], or is not a number.
    pub fn new(config: MotorConfig) -> Result<Self, MotorError> {
        config.check()?;
        Ok(Self::at_rest(config))
    }

    fn at_rest(config: MotorConfig) -> Self {
        let [low, high] = config.stops;
        Self {
            state: State {
                position: config.position.max(low).min(high),
                velocity: 0.0,
            },
            config,
            now: 0,
            command: 0.0,
            powered: true,
            blocked: false,
            turned_by_hand: None,
        }
    }

    /// The configuration of the motor.
    pub fn config(&self) -> &MotorConfig {
        &self.config
    }

    /// Its true position in units.
    pub fn position(&self) -> f64 {
        self.state.position
    }

    /// Its true velocity in units per second.
    pub fn velocity(&self) -> f64 {
        match self.turned_by_hand {
            Some(velocity) if !self.is_at_rest() => velocity,
            Some(_) => 0.0,
            None => self.state.velocity,
        }
    }

    /// Position of its encoder in counts.
    pub fn counts(&self) -> f64 {
        self.state.position * self.config.counts_per_unit
    }

    /// The kinetic energy: force times units.
    pub fn energy(&self) -> f64 {
        self.config.inertia * self.velocity() * self.velocity() / 2.0
    }

    /// True if the axis is at a hard stop.
    pub fn is_at_stop(&self) -> bool {
        self.config.stops.contains(&self.state.position)
    }

    /// Turns the shaft at a given speed, regardless of the drive; `None` releases it.
    pub fn turn_by_hand(&mut self, velocity: Option<f64>) {
        let now = self.velocity();
        if velocity.is_none() && self.turned_by_hand.is_some() {
            self.state.velocity = now;
        }
        self.turned_by_hand = velocity.map(finite);
    }

    /// Jams the axis at its position, regardless of the drive, or frees it.
    pub fn block(&mut self, blocked: bool) {
        self.blocked = blocked;
        if blocked {
            self.state.velocity = 0.0;
        }
    }

    /// True if the axis is jammed.
    pub fn is_blocked(&self) -> bool {
        self.blocked
    }

    /// Switches the drive's power: without it, the drive neither drives nor brakes.
    pub fn set_power(&mut self, powered: bool) {
        self.powered = powered;
    }

    /// True if the drive has power.
    pub fn is_powered(&self) -> bool {
        self.powered
    }

    /// Sets the drive's input from now on. A disabled drive brakes.
    pub(crate) fn command(&mut self, volts: f64, enabled: bool) {
        let volts = if enabled { finite(volts) } else { 0.0 };
        let limit = self.config.full_scale;
        let effective = (volts.abs() - self.config.friction).max(0.0);
        self.command =
            effective.copysign(volts).clamp(-limit, limit) / limit * self.config.max_speed;
    }

    /// Advances to `to`, and reports the movement in segments of one direction each, with the
    /// positions at the beginning and at the end.
    pub(crate) fn advance(&mut self, to: Nanos, mut moved: impl FnMut(&Segment, [f64; 2])) {
        while self.now < to {
            if self.is_at_rest() {
                self.state.velocity = 0.0;
                self.now = to;
                return;
            }
            let end = to.min(self.now + LONGEST_SEGMENT);
            self.run(end, &mut moved);
        }
    }

    fn is_at_rest(&self) -> bool {
        if self.blocked {
            return true;
        }
        if let Some(velocity) = self.turned_by_hand {
            return velocity == 0.0 || self.is_held(velocity);
        }
        let velocity = self.state.velocity;
        let forces = self.forces();
        if velocity == 0.0 {
            return forces.departs().is_none_or(|way| self.is_held(way));
        }
        let is_driven = forces.target.is_some_and(|target| target != 0.0);
        !is_driven && velocity.abs() < STANDSTILL
    }

    /// True if a stop prevents a movement in that direction.
    fn is_held(&self, way: f64) -> bool {
        let [low, high] = self.config.stops;
        let position = self.state.position;
        (way < 0.0 && position <= low) || (way > 0.0 && position >= high)
    }

    fn forces(&self) -> Forces {
        let config = &self.config;
        Forces {
            target: self.powered.then_some(self.command),
            time_constant: config.time_constant,
            strength: config.max_force / config.inertia,
            drag: config.drag / config.inertia,
        }
    }

    /// Moves up to `end`, within one segment, through all changes of the forces on the way.
    fn run(&mut self, end: Nanos, moved: &mut impl FnMut(&Segment, [f64; 2])) {
        let mut left = (end - self.now) as f64 * 1e-9;
        let mut start = self.now;
        let mut from = self.state.position;
        for turn in 1..=MAX_PIECES {
            let Some(piece) = self.piece() else {
                break;
            };
            left -= self.follow(&piece, left);
            let at = end - ((left.max(0.0) * 1e9) as Nanos).min(end);
            let at = if left <= 0.0 || turn == MAX_PIECES {
                end
            } else {
                at
            };
            if at > start {
                self.hand_on(start, at, from, moved);
                (start, from) = (at, self.state.position);
            }
            if left <= 0.0 {
                break;
            }
        }
        // The motor came to rest within a nanosecond of the last piece.
        if start < end {
            self.hand_on(start, end, from, moved);
        }
        self.now = end;
    }

    fn piece(&self) -> Option<Piece> {
        if self.is_at_rest() {
            return None;
        }
        match self.turned_by_hand {
            Some(velocity) => Some(Piece::steady(velocity)),
            None => self.forces().piece(self.state.velocity),
        }
    }

    /// Follows a piece for at most `seconds`, up to its end or to a stop; returns the time used.
    fn follow(&mut self, piece: &Piece, seconds: f64) -> f64 {
        let [low, high] = self.config.stops;
        let (took, state) = piece.run(self.state, seconds);
        let stop = if state.position <= low {
            low
        } else if state.position >= high {
            high
        } else {
            self.state = state;
            return took;
        };
        let took = piece.reaches(self.state, took, stop);
        self.state = State {
            position: stop,
            velocity: 0.0,
        };
        took
    }

    fn hand_on(
        &self,
        start: Nanos,
        end: Nanos,
        from: f64,
        moved: &mut impl FnMut(&Segment, [f64; 2]),
    ) {
        let to = self.state.position;
        let segment = Segment {
            start,
            end,
            from: from * self.config.counts_per_unit,
            to: to * self.config.counts_per_unit,
            counts_per_revolution: self.config.counts_per_revolution,
        };
        if from != to {
            moved(&segment, [from, to]);
        }
    }
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

#[cfg(test)]
mod tests;
