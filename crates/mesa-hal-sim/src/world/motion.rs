//! Motion of a shaft under constant forces: the exact solution, piece by piece.

/// Forces on a shaft, as accelerations: force divided by inertia.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Forces {
    /// Speed commanded to the drive; `None` without power.
    pub(super) target: Option<f64>,
    /// Time constant of the velocity loop in seconds.
    pub(super) time_constant: f64,
    /// Maximum acceleration by the drive, in either direction.
    pub(super) strength: f64,
    /// Deceleration by friction.
    pub(super) drag: f64,
}

/// Position and velocity of a shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct State {
    pub(super) position: f64,
    pub(super) velocity: f64,
}

/// Motion of a shaft in one direction, until the forces change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Piece {
    course: Course,
    /// Duration in seconds, and the velocity at the end.
    ends: Option<(f64, f64)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Course {
    Uniform { velocity: f64, acceleration: f64 },
    Lag { toward: f64, time_constant: f64 },
}

/// Tolerance for rounding: a loop this much beyond the drive's strength is still within it.
const ROUNDING: f64 = 1e-9;

impl Forces {
    /// Acceleration of a shaft by the drive alone.
    fn pull(&self, velocity: f64) -> f64 {
        let Some(target) = self.target else {
            return 0.0;
        };
        let gap = target - velocity;
        if gap == 0.0 {
            0.0
        } else if self.time_constant > 0.0 {
            (gap / self.time_constant).clamp(-self.strength, self.strength)
        } else {
            self.strength.copysign(gap)
        }
    }

    /// Direction in which a shaft at rest begins to move, if it does.
    pub(super) fn departs(&self) -> Option<f64> {
        let pull = self.pull(0.0);
        (pull.abs() > self.drag).then_some(pull)
    }

    /// The next piece of a shaft's motion; `None` if it stays at rest.
    pub(super) fn piece(&self, velocity: f64) -> Option<Piece> {
        let way = if velocity == 0.0 {
            self.departs()?
        } else {
            velocity
        };
        let friction = -self.drag.copysign(way);
        let Some(target) = self.target else {
            return Some(uniform(velocity, friction, None));
        };
        let gap = target - velocity;
        if self.time_constant <= 0.0 && self.strength.is_infinite() {
            return Some(uniform(target, 0.0, None));
        }
        if self.time_constant <= 0.0 || self.drag >= self.strength {
            if gap == 0.0 {
                let slows = (self.drag - self.strength).max(0.0);
                let acceleration = if slows > 0.0 {
                    -slows.copysign(way)
                } else {
                    0.0
                };
                return Some(uniform(velocity, acceleration, None));
            }
            let pull = self.strength.copysign(gap);
            return Some(uniform(velocity, pull + friction, Some(target)));
        }
        let most = self.strength * self.time_constant;
        if gap.abs() > most * (1.0 + ROUNDING) {
            let edge = target - most.copysign(gap);
            let pull = self.strength.copysign(gap);
            return Some(uniform(velocity, pull + friction, Some(edge)));
        }
        let toward = target + friction * self.time_constant;
        let ends = (velocity * toward < 0.0)
            .then(|| (self.time_constant * libm::log1p(-velocity / toward), 0.0));
        Some(Piece {
            course: Course::Lag {
                toward,
                time_constant: self.time_constant,
            },
            ends,
        })
    }
}

/// A constant acceleration, until the shaft stops or reaches a velocity.
fn uniform(velocity: f64, acceleration: f64, until: Option<f64>) -> Piece {
    let after = |end: f64| {
        let seconds = (end - velocity) / acceleration;
        (seconds > 0.0 && seconds.is_finite()).then_some((seconds, end))
    };
    let ends = [until.and_then(after), after(0.0)];
    Piece {
        course: Course::Uniform {
            velocity,
            acceleration,
        },
        ends: ends
            .into_iter()
            .flatten()
            .min_by(|a, b| f64::total_cmp(&a.0, &b.0)),
    }
}

impl Piece {
    /// A constant speed without end.
    pub(super) fn steady(velocity: f64) -> Self {
        uniform(velocity, 0.0, None)
    }

    /// Runs the piece for at most `seconds`; returns the duration and the state afterwards.
    pub(super) fn run(&self, from: State, seconds: f64) -> (f64, State) {
        match self.ends {
            Some((end, velocity)) if end <= seconds => {
                let State { position, .. } = self.after(from, end);
                (end, State { position, velocity })
            }
            _ => (seconds, self.after(from, seconds)),
        }
    }

    /// Time in seconds at which the shaft reaches `stop`, which it does within `seconds`.
    pub(super) fn reaches(&self, from: State, seconds: f64, stop: f64) -> f64 {
        let beyond =
            |at: f64| (self.after(from, at).position - stop) * (from.position - stop) < 0.0;
        let (mut before, mut after) = (0.0, seconds);
        // Bisection of a ten-thousandth of a second down to less than the resolution of a double.
        for _ in 0..60 {
            let middle = f64::midpoint(before, after);
            if from.position != stop && !beyond(middle) {
                before = middle;
            } else {
                after = middle;
            }
        }
        before
    }

    fn after(&self, from: State, seconds: f64) -> State {
        let State { position, velocity } = from;
        match self.course {
            Course::Uniform {
                velocity,
                acceleration,
            } => State {
                position: position + velocity * seconds + acceleration * seconds * seconds / 2.0,
                velocity: velocity + acceleration * seconds,
            },
            Course::Lag {
                toward,
                time_constant,
            } => {
                let excess = velocity - toward;
                let lost = -libm::expm1(-seconds / time_constant);
                State {
                    position: position + toward * seconds + excess * time_constant * lost,
                    velocity: toward + excess * (1.0 - lost),
                }
            }
        }
    }
}
