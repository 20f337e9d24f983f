//! A motor with its velocity drive, its encoder, and what it moves between hard stops.

use thiserror::Error;

use super::motion::{Forces, Piece, State};
use crate::wire::Nanos;

/// The longest piece of a movement that is handed on in one go.
const LONGEST_SEGMENT: Nanos = 100_000;

/// Slower than this (units per second), a motor that nothing drives stands still.
const STANDSTILL: f64 = 1e-9;

/// The most changes of what acts on a shaft in one segment; further ones are taken later.
const MOST_PIECES: usize = 16;

/// What a motor, its drive, its encoder and its axis are like. Positions are in machine units, forces
/// in any unit, the same for all: with millimetres and newtons an inertia of 1 is 1000 kg.
///
/// [`Motor::new`] takes what is in the ranges that are given here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorConfig {
    /// Speed at full-scale voltage, in units per second. More than 0, up to 1e9.
    pub max_speed: f64,
    /// Full-scale voltage of the drive's input. More than 0, up to 100.
    pub full_scale: f64,
    /// Time constant of the velocity loop in seconds, as long as the drive's force suffices; 0
    /// follows at once. Up to 10.
    pub time_constant: f64,
    /// Dead band of the drive's input in volts: what is told is less by so much, either way.
    /// 0 to 10.
    pub friction: f64,
    /// Encoder counts (quadrature edges) for each unit; negative if the encoder is reversed.
    /// -1e7 to 1e7, and not 0.
    pub counts_per_unit: f64,
    /// Counts from index pulse to index pulse; 0 if there is no index.
    pub counts_per_revolution: u32,
    /// The force that an acceleration of one unit/s² takes. 1e-9 to 1e9.
    pub inertia: f64,
    /// The most force that the drive has; infinite for no limit. More than 0.
    pub max_force: f64,
    /// The force of dry friction: slows what coasts, and below it nothing moves. 0 to 1e9.
    pub drag: f64,
    /// Positions of the hard stops, the lower one first; infinite for none. Nothing gets past them,
    /// and nothing bounces.
    pub stops: [f64; 2],
    /// Where it stands at power-up, brought between the stops. -1e9 to 1e9. The index is at multiples
    /// of the counts of a revolution from 0.
    pub position: f64,
}

impl Default for MotorConfig {
    /// 100 units/s at 10 V, 5 ms, no friction, 1000 counts a unit, an index every 4000 counts. The
    /// drive is as strong as it has to be, there are no stops, and it stands at 0.
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

/// A motor that can not be.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MotorError {
    /// A number that is not in its range.
    #[error("{field} of a motor is {value}: allowed is {allowed}")]
    OutOfRange {
        /// The field of [`MotorConfig`].
        field: &'static str,
        /// What it has.
        value: f64,
        /// What is allowed, for people.
        allowed: &'static str,
    },
    /// Stops that leave no way between them.
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

impl MotorConfig {
    /// Whether there can be such a motor.
    fn check(&self) -> Result<(), MotorError> {
        let positive = |value: f64| value > 0.0 && value <= 1e9;
        let not_negative = |value: f64| (0.0..=1e9).contains(&value);
        let up_to_ten = |value: f64| (0.0..=10.0).contains(&value);
        for (field, value, is_allowed, allowed) in [
            (
                "max_speed",
                self.max_speed,
                positive(self.max_speed),
                "more than 0, up to 1e9",
            ),
            (
                "full_scale",
                self.full_scale,
                self.full_scale > 0.0 && self.full_scale <= 100.0,
                "more than 0, up to 100 (V)",
            ),
            (
                "time_constant",
                self.time_constant,
                up_to_ten(self.time_constant),
                "0 to 10 (s)",
            ),
            (
                "friction",
                self.friction,
                up_to_ten(self.friction),
                "0 to 10 (V)",
            ),
            (
                "counts_per_unit",
                self.counts_per_unit,
                self.counts_per_unit.abs() <= 1e7 && self.counts_per_unit != 0.0,
                "-1e7 to 1e7, and not 0",
            ),
            (
                "inertia",
                self.inertia,
                (1e-9..=1e9).contains(&self.inertia),
                "1e-9 to 1e9",
            ),
            (
                "max_force",
                self.max_force,
                self.max_force > 0.0,
                "more than 0, up to inf",
            ),
            ("drag", self.drag, not_negative(self.drag), "0 to 1e9"),
            (
                "position",
                self.position,
                self.position.abs() <= 1e9,
                "-1e9 to 1e9",
            ),
        ] {
            if !is_allowed {
                return Err(MotorError::OutOfRange {
                    field,
                    value,
                    allowed,
                });
            }
        }
        let [low, high] = self.stops;
        if low < high {
            Ok(())
        } else {
            Err(MotorError::Stops { low, high })
        }
    }
}

/// A piece of a movement in one direction, as the encoder sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// When it begins.
    pub start: Nanos,
    /// When it ends; later than `start`.
    pub end: Nanos,
    /// Encoder position at the beginning, in counts.
    pub from: f64,
    /// Encoder position at the end, in counts.
    pub to: f64,
    /// Counts from index pulse to index pulse; 0 if there is no index.
    pub counts_per_revolution: u32,
}

/// A motor whose speed follows a voltage with a first-order lag, as far as its force goes.
///
/// While its drive has power, that accelerates by `(told - speed) / time_constant`, at most by
/// `max_force / inertia`; a drive that is disabled is told 0. Dry friction acts against the motion.
/// Without power only friction slows it. It is stepped with the exact solution, so that its path
/// does not depend on how often somebody looks.
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
    /// There is no such motor: a number is not in the range that [`MotorConfig`] gives, or none.
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

    /// What it is like.
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

    /// What its encoder stands at, in counts.
    pub fn counts(&self) -> f64 {
        self.state.position * self.config.counts_per_unit
    }

    /// The energy of its motion: force times units.
    pub fn energy(&self) -> f64 {
        self.config.inertia * self.velocity() * self.velocity() / 2.0
    }

    /// Whether it stands at a hard stop.
    pub fn is_at_stop(&self) -> bool {
        self.config.stops.contains(&self.state.position)
    }

    /// Turns the shaft at a given speed, whatever the drive does; `None` lets it go.
    pub fn turn_by_hand(&mut self, velocity: Option<f64>) {
        let now = self.velocity();
        if velocity.is_none() && self.turned_by_hand.is_some() {
            self.state.velocity = now;
        }
        self.turned_by_hand = velocity.map(finite);
    }

    /// Jams the axis where it is, whatever drives it, or frees it.
    pub fn block(&mut self, blocked: bool) {
        self.blocked = blocked;
        if blocked {
            self.state.velocity = 0.0;
        }
    }

    /// Whether the axis is jammed.
    pub fn is_blocked(&self) -> bool {
        self.blocked
    }

    /// Gives the drive its power, or cuts it: without, it neither drives nor brakes.
    pub fn set_power(&mut self, powered: bool) {
        self.powered = powered;
    }

    /// Whether the drive has power.
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

    /// Lets time pass up to `to` and hands on the movement in pieces of one direction each, with the
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

    /// Whether a stop keeps it from moving that way.
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

    /// Moves it up to `end`, not far away, over whatever changes on the way.
    fn run(&mut self, end: Nanos, moved: &mut impl FnMut(&Segment, [f64; 2])) {
        let mut left = (end - self.now) as f64 * 1e-9;
        let mut start = self.now;
        let mut from = self.state.position;
        for turn in 1..=MOST_PIECES {
            let Some(piece) = self.piece() else {
                break;
            };
            left -= self.follow(&piece, left);
            let at = end - ((left.max(0.0) * 1e9) as Nanos).min(end);
            let at = if left <= 0.0 || turn == MOST_PIECES {
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
        // It came to rest within a nanosecond of the last piece.
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

    /// Follows a piece for at most `seconds`, up to its end or to a stop; how long that took.
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
