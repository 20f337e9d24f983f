//! The control law: from a commanded position to the speed of the next period.
//!
//! The law knows no bus, no pin and no step. It counts in moves: distances of one period in the
//! units of the position, so that a speed of `v` is the move `v*T`, and the acceleration `a`
//! changes a move by the *ramp* `a*T^2` from one period to the next.
//!
//! # The rule
//! A generator that moves by `m` and then brakes with the whole acceleration moves by `m + (m -
//! ramp) + (m - 2*ramp) + ...`, down to 0, until it stands still. For a move of `q` ramps, and `n`
//! the number of periods with a move (`q` rounded up), this distance is `D(q) = n*q - n*(n-1)/2`
//! ramps. In each period:
//!
//! 1. The *feed* is the move of the command since the last period. It follows the command by one
//!    ramp a period at most: a jump of the command is a distance and no speed.
//! 2. The *stop* is the place where the command would come to rest if it began to brake now.
//! 3. The next move is the largest from which the generator can still come to rest at the stop,
//!    `D^-1` of the distance to it, in the direction of the stop.
//! 4. The move is limited to the highest speed, and then to one ramp more or less than the move
//!    before.
//!
//! # Why its promises hold
//! - **Limits.** Step 4 is the last one. A highest speed that is lowered below the present speed is
//!   reached by braking with the acceleration.
//! - **A smooth command is followed exactly, one period late.** If the generator is where the
//!   command was a period ago, the distance to the stop is `D` of the feed, and the move is the
//!   feed. As long as the command keeps the acceleration, the feed is its move.
//! - **No overshoot.** Without a delay between read and write, a move `m` from step 3 leaves a
//!   distance of `D(m) - m = D(m - ramp)`, so that the next move is at least `m - ramp`, and step 4
//!   never keeps the generator faster than step 3 allows. A command that brakes with at most the
//!   acceleration comes to rest at the stop or beyond it. So the generator stops no later than the
//!   command, also after it was behind because the command was too fast. With a delay of the part
//!   `d` of the period, command and generator are compared at the time of the write, and the
//!   command has to be predicted until then. Of a command that has become slower it is assumed that
//!   it brakes with the whole acceleration, since the latest time that explains the loss. The moves
//!   are a staircase that is half a period ahead of the ramp of the command: for `d` up to 0.5 that
//!   is enough to brake in time. What remains are 0.06 ramps, from the last period of a motion. It
//!   is not enough if the moves of the command themselves are a staircase of whole ramps, or if it
//!   brakes within a period after it has accelerated, each with the whole acceleration: a generator
//!   without acceleration to spare then overruns by up to `v*d*T`. None could do better that is not
//!   `d` later all the time. The figures are in the tests.
//! - **Arrival.** Within one ramp of a stop that rests, `D^-1` is the distance itself: the last
//!   move ends at the stop.
//! - **Both signs alike.** Every operation is odd in positions and speeds: the mirrored command
//!   gives the mirrored moves, to the last bit.
//!
//! A deviation from a command that moves at the speed `v` decays with the time constant `v/a`, the
//! time that the command needs to brake. Jitter of the feedback is therefore averaged while the
//! generator is fast, and at rest a deviation is corrected within one period.

/// A smaller change of the acceleration of the command, in ramps, is rounding.
const LEAST_LOSS: f64 = 1e-6;

/// From 2^52 on, all numbers are whole, and the sum with a smaller one is rounded.
const ROUNDER: f64 = 4_503_599_627_370_496.0;

/// Limits of a generator, prepared for the cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ControlLimits {
    /// Greatest move of a period: the highest speed.
    max_move: f64,
    /// Greatest change of the move between two periods: the acceleration. Infinite without a limit.
    max_change: f64,
    /// `1 / max_change`; 0 without a limit.
    per_max_change: f64,
    /// Greatest change of a move that is faster than `max_move`: at least `max_change`.
    brake: f64,
    /// A distance to a command at rest that is smaller is none: what the position cannot resolve.
    resolution: f64,
}

impl ControlLimits {
    /// Limits from the highest speed and the acceleration, in units per second and per second
    /// squared; both positive. An acceleration of 0 is no limit, and so is one that a period cannot
    /// resolve.
    pub fn new(speed: f64, acceleration: f64, period: f64) -> Self {
        let ramp = acceleration * period * period;
        let is_limit = (1e-200..=1e200).contains(&ramp);
        let per_max_change = if is_limit { 1.0 / ramp } else { 0.0 };
        let ramp = if is_limit { ramp } else { f64::INFINITY };
        Self {
            max_move: speed * period,
            max_change: ramp,
            per_max_change,
            brake: ramp,
            resolution: 0.0,
        }
    }

    /// With a greater change of the move down to the highest speed: after a change of the units,
    /// the acceleration of before in the new ones.
    pub fn with_brake(self, ramp: f64) -> Self {
        Self {
            brake: ramp.max(self.max_change),
            ..self
        }
    }

    /// With a position that has this resolution: a command between two values of it does not make
    /// the generator go to and fro.
    pub const fn with_resolution(self, resolution: f64) -> Self {
        Self { resolution, ..self }
    }

    /// Greatest move of a period.
    pub const fn max_move(&self) -> f64 {
        self.max_move
    }

    /// Greatest change of the move between two periods.
    pub const fn max_change(&self) -> f64 {
        self.max_change
    }

    /// Ramps in a move of one unit; 0 without a limit of the acceleration.
    pub const fn per_max_change(&self) -> f64 {
        self.per_max_change
    }

    /// A move within the highest speed.
    fn capped(&self, step: f64) -> f64 {
        step.min(self.max_move).max(-self.max_move)
    }

    /// The nearest move that the acceleration reaches from another one.
    fn reached(&self, from: f64, to: f64) -> f64 {
        let change = to - from;
        let ramp = if from.abs() > self.max_move {
            self.brake
        } else {
            self.max_change
        };
        if change.abs() <= ramp {
            to
        } else {
            from + ramp.copysign(change)
        }
    }
}

/// The state of the law, from period to period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ControlLaw {
    /// The commanded position of the last period.
    command: f64,
    /// The move of the command.
    feed: f64,
    /// Its change in the last period.
    change: f64,
    /// The present move of the generator.
    step: f64,
    /// The move before that, until the present one was written.
    before: f64,
}

impl ControlLaw {
    /// The present move.
    pub const fn step(&self) -> f64 {
        self.step
    }

    /// The move of the command.
    pub const fn feed(&self) -> f64 {
        self.feed
    }

    /// The commanded position of the last period.
    pub const fn command(&self) -> f64 {
        self.command
    }

    /// Takes the outcome of the write of the present move. If it did not arrive, the generator goes
    /// on with the one before.
    pub const fn written(&mut self, arrived: bool) {
        if !arrived {
            self.step = self.before;
        }
        self.before = self.step;
    }

    /// Positions have another origin: all are greater by `distance`.
    pub fn shift(&mut self, distance: f64) {
        self.command += distance;
    }

    /// Positions have another unit, in which all numbers are greater by `factor`. The speed in
    /// steps stays.
    pub fn rescale(&mut self, factor: f64) {
        let Self {
            command,
            feed,
            change,
            step,
            before,
        } = self;
        for number in [command, feed, change, step, before] {
            *number *= factor;
        }
    }

    /// Stops at once, and takes the commanded position as the last one.
    pub fn halt(&mut self, command: f64) {
        self.observe(command);
        (self.feed, self.change) = (0.0, 0.0);
        self.advance(0.0);
    }

    /// Brakes with the acceleration; the commanded position is taken as the last one.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn brake(&mut self, limits: &ControlLimits, command: f64) {
        self.track(limits, 0.0, command);
        (self.feed, self.change) = (0.0, 0.0);
    }

    /// Approaches a move; the commanded position is taken as the last one.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn track(&mut self, limits: &ControlLimits, step: f64, command: f64) {
        self.observe_limited(limits, command);
        let wanted = if step.is_nan() {
            0.0
        } else {
            limits.capped(step)
        };
        self.advance(limits.reached(self.step, wanted));
    }

    /// Follows a commanded position, from the position that was read. `delay` is the time from the
    /// sample of this position to the write of the new move, as a part of the period: until then
    /// the generator goes on with the present move. A command that is not finite is the one before.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn follow(&mut self, limits: &ControlLimits, command: f64, position: f64, delay: f64) {
        let last = self.change;
        self.observe_limited(limits, command);
        // The command and the generator at the time of the write.
        let change = self.expected_change(limits, last, delay);
        let feed = self.feed + change * delay;
        let ahead = (self.feed + change - self.step) * delay;
        let wanted = wanted(limits, feed, self.command - position + ahead);
        let wanted = if wanted.is_nan() {
            0.0
        } else {
            limits.capped(wanted)
        };
        self.advance(limits.reached(self.step, wanted));
    }

    /// The change that the move of the command makes in the next period, as far as the time of the
    /// write needs it. `last` is the change of the period before.
    fn expected_change(&self, limits: &ControlLimits, last: f64, delay: f64) -> f64 {
        let (feed, change) = (self.feed, self.change);
        let slows = feed * change < 0.0;
        if !slows || limits.per_max_change == 0.0 {
            return if (feed + change) * feed > 0.0 {
                change
            } else {
                0.0
            };
        }
        // In ramps, positive in the direction of the motion.
        let unit = limits.per_max_change.copysign(feed);
        let (speed, before, mut expected) = (feed * unit, last * unit, change * unit);
        let lost = before - expected;
        if lost > LEAST_LOSS && delay > 0.0 {
            // The part of the period since which it has braked with the whole acceleration.
            let span = before + 1.0;
            let since = libm::sqrt((2.0 * lost / span).min(1.0));
            let rest = 1.0 - since;
            let part = 1.0 - rest * rest / (2.0 * delay).min(1.0);
            expected = (before - span * part).min(expected).max(-1.0);
        }
        if speed + 1.5 * expected < 0.0 {
            // It comes to rest in the next period, from the speed at the end of this one.
            let end = (speed + 0.5 * expected).max(0.0);
            expected = -end * end / (2.0 * expected) - speed;
        }
        expected * limits.max_change.copysign(feed)
    }

    fn observe_limited(&mut self, limits: &ControlLimits, command: f64) {
        let moved = self.observe(command);
        let before = self.feed;
        self.feed = limits.reached(before, moved);
        self.change = self.feed - before;
    }

    /// Takes the commanded position of this period; returns its move.
    fn observe(&mut self, command: f64) -> f64 {
        if !command.is_finite() {
            return 0.0;
        }
        let last = core::mem::replace(&mut self.command, command);
        let moved = command - last;
        if moved.is_finite() { moved } else { 0.0 }
    }

    const fn advance(&mut self, step: f64) {
        self.before = core::mem::replace(&mut self.step, step);
    }
}

/// The largest move from which the generator still comes to rest at the stop, which is as far
/// beyond the command as its move `feed` needs to brake. `distance` is that to the command.
fn wanted(limits: &ControlLimits, feed: f64, distance: f64) -> f64 {
    let ramp = limits.max_change;
    let deviation = distance - feed;
    if feed == 0.0 && distance.abs() < limits.resolution {
        return 0.0;
    }
    if limits.per_max_change == 0.0 {
        return feed + 0.5 * deviation;
    }
    let ramps = feed.abs() * limits.per_max_change;
    let periods = whole_above(ramps);
    // D^-1 is linear between whole numbers of ramps, which saves the root near the command.
    // Below one ramp the stop is the command itself.
    if periods <= 1.0 {
        if distance.abs() <= ramp {
            return distance;
        }
    } else {
        let correction = deviation / periods;
        let moved = (feed + correction) * limits.per_max_change;
        if (periods - 1.0..=periods).contains(&moved.copysign(moved * feed)) {
            return feed + correction;
        }
    }
    let beyond = (periods - 1.0) * (ramps - 0.5 * periods) * ramp;
    let to_stop = distance + beyond.copysign(feed);
    let ramps = to_stop.abs() * limits.per_max_change;
    let periods = whole_above(0.5 * (libm::sqrt(1.0 + 8.0 * ramps) - 1.0));
    let step = to_stop.abs() / periods + 0.5 * (periods - 1.0) * ramp;
    step.copysign(to_stop)
}

/// The smallest whole number that is not less than a number, and at least 1.
fn whole_above(number: f64) -> f64 {
    // Rounds to the nearest whole number, up or down.
    let whole = number + ROUNDER - ROUNDER;
    let above = if whole < number { whole + 1.0 } else { whole };
    above.max(1.0)
}

#[cfg(test)]
mod tests;
