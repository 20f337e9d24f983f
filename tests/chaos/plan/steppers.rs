//! Step generators with motors, again from a random stream of their own.

use super::{Card, Plan, scrambled};
use crate::common::chance::Chance;

/// The step generators of a machine.
#[derive(Clone, Copy, Debug)]
pub struct Steppers {
    pub count: u8,
    /// The version of the module.
    pub version: u8,
    /// Units per second squared; 0 for no limit.
    pub acceleration: f64,
    /// They are those of a 7I76, with Mesa's firmware for the board and this card.
    pub is_7i76: bool,
    /// The application changes scales, and does not command anything for some cycles after arming,
    /// in which it resets positions.
    pub is_odd: bool,
    /// The process asks for a period that is refused, before its first write.
    pub is_refused: bool,
    /// Their speed, in parts of the usual one.
    pub speed: u32,
}

impl Steppers {
    pub const NONE: Self = Self {
        count: 0,
        version: 2,
        acceleration: 0.0,
        is_7i76: false,
        is_odd: false,
        is_refused: false,
        speed: 1,
    };
}

/// Generators of a 7I76.
const OF_7I76: u8 = 5;

impl Plan {
    /// Adds step generators to some of the machines with few remotes.
    pub(super) fn with_steppers(mut self) -> Self {
        let mut chance = Chance(scrambled(self.seed ^ 0x57E9));
        let steppers = Steppers {
            count: chance.of(&[0, 0, 0, 1, 3]),
            version: chance.of(&[2, 0x42, 0xC2]),
            acceleration: chance.of(&[0.0, 200.0]),
            ..Steppers::NONE
        };
        let is_simple = matches!(&self.ports[..], [only] if only.len() <= 3);
        if is_simple && !self.is_minute && !self.is_homing {
            self.steppers = steppers;
            self.with_7i76().with_odd_steppers()
        } else {
            self
        }
    }

    /// Some of the applications have other habits, and faster motors: up to 40 kHz.
    fn with_odd_steppers(mut self) -> Self {
        let mut chance = Chance(scrambled(self.seed ^ 0x0DD5));
        self.steppers.is_odd = chance.one_in(2);
        self.steppers.speed = chance.of(&[1, 1, 8]);
        self.steppers.is_refused = self.steppers.is_odd && chance.one_in(6);
        self
    }

    /// Some of the machines without step generators become one with a 7I76 on its connector: its
    /// field I/O is the first remote, and it has channels for two.
    fn with_7i76(mut self) -> Self {
        let mut chance = Chance(scrambled(self.seed ^ 0x7_1760));
        let acceleration = chance.of(&[0.0, 200.0]);
        let is_chosen = chance.one_in(4) && self.steppers.count == 0;
        // A plain encoder starts with the long filter, which loses counts of the fastest motors.
        let is_chosen = is_chosen && !self.extras.is_fast;
        let channels = self.ports.first_mut().filter(|cards| cards.len() <= 2);
        let first = channels.and_then(|cards| cards.first_mut());
        if let Some(first @ Card::Field) = first
            && is_chosen
        {
            *first = Card::Field76;
            // Its modes are 0 to 2.
            self.field_mode = self.field_mode.min(2);
            self.steppers = Steppers {
                count: OF_7I76,
                acceleration,
                is_7i76: true,
                ..Steppers::NONE
            };
        }
        self
    }
}
