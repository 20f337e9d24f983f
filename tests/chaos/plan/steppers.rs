//! Step generators with motors, again from a random stream of their own.

use super::{Plan, scrambled};
use crate::common::chance::Chance;

/// The step generators of a machine.
#[derive(Clone, Copy, Debug)]
pub struct Steppers {
    pub count: u8,
    /// The version of the module.
    pub version: u8,
    /// Units per second squared; 0 for no limit.
    pub acceleration: f64,
}

impl Steppers {
    pub const NONE: Self = Self {
        count: 0,
        version: 2,
        acceleration: 0.0,
    };
}

impl Plan {
    /// Adds step generators to some of the machines with few remotes.
    pub(super) fn with_steppers(mut self) -> Self {
        let mut chance = Chance(scrambled(self.seed ^ 0x57E9));
        let steppers = Steppers {
            count: chance.of(&[0, 0, 0, 1, 3]),
            version: chance.of(&[2, 0x42, 0xC2]),
            acceleration: chance.of(&[0.0, 200.0]),
        };
        let is_simple = matches!(&self.ports[..], [only] if only.len() <= 3);
        if is_simple && !self.is_minute && !self.is_homing {
            self.steppers = steppers;
        }
        self
    }
}
