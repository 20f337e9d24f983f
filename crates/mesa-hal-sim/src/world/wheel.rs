//! A handwheel: a manual pulse generator.

use super::switch::{Change, SimTerminal};
use crate::wire::Nanos;

/// Maximum number of clicks that can be pending.
const MAX_CLICKS: i64 = 1_000_000;

/// A handwheel and the two inputs that its quadrature is wired to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelConfig {
    /// Its signal A.
    pub a: SimTerminal,
    /// Its signal B. A leads B when turning up.
    pub b: SimTerminal,
    /// Speed of turning in clicks per second. A click is a whole cycle of A and B: four edges.
    pub speed: f64,
}

/// A handwheel, turned from click to click.
#[derive(Clone, Debug)]
pub struct Wheel {
    config: WheelConfig,
    /// Remaining edges; the sign is the direction.
    left: i64,
    next: Nanos,
    /// Edges turned so far.
    edges: i64,
}

const EDGES: i64 = 4;

impl Wheel {
    pub(crate) fn new(config: WheelConfig) -> Self {
        Self {
            config,
            left: 0,
            next: 0,
            edges: 0,
        }
    }

    /// The configuration of the wheel.
    pub fn config(&self) -> &WheelConfig {
        &self.config
    }

    /// Whole clicks turned so far, up minus down.
    pub fn clicks(&self) -> i64 {
        self.edges.div_euclid(EDGES)
    }

    /// True while clicks are pending.
    pub fn is_turning(&self) -> bool {
        self.left != 0
    }

    /// The levels of its signals: A, then B.
    pub(crate) fn signals(&self) -> [(SimTerminal, bool); 2] {
        let phase = self.edges.rem_euclid(EDGES);
        let WheelConfig { a, b, .. } = self.config;
        [(a, matches!(phase, 1 | 2)), (b, matches!(phase, 2 | 3))]
    }

    /// Adds clicks after those that are still pending. `false` if there would be too many.
    pub(crate) fn turn(&mut self, now: Nanos, clicks: i64) -> bool {
        let edges = clicks.saturating_mul(EDGES).saturating_add(self.left);
        if edges.unsigned_abs() > (MAX_CLICKS * EDGES).unsigned_abs() {
            return false;
        }
        if !self.is_turning() {
            self.next = now + self.spacing();
        }
        self.left = edges;
        true
    }

    /// Turns the wheel up to `to`.
    pub(crate) fn advance(&mut self, to: Nanos, mut changed: impl FnMut(Change)) {
        while self.left != 0 && self.next <= to {
            let way = self.left.signum();
            let WheelConfig { a, b, .. } = self.config;
            // Up: A rises, B rises, A falls, B falls. Down: in reverse.
            let edge = (self.edges - i64::from(way < 0)).rem_euclid(EDGES);
            let terminal = if edge % 2 == 0 { a } else { b };
            let rises = (edge < 2) == (way > 0);
            changed(Change {
                at: self.next,
                terminal,
                on: rises,
            });
            self.edges += way;
            self.left -= way;
            debug_assert!(self.signals().contains(&(terminal, rises)));
            self.next += self.spacing();
        }
    }

    fn spacing(&self) -> Nanos {
        let edges = self.config.speed.max(1e-3) * EDGES as f64;
        ((1e9 / edges) as Nanos).max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: SimTerminal = SimTerminal::Board { input: 0 };
    const B: SimTerminal = SimTerminal::Board { input: 1 };

    fn turned(wheel: &mut Wheel, now: Nanos, clicks: i64) -> Vec<(Nanos, char, bool)> {
        assert!(wheel.turn(now, clicks));
        let mut edges = Vec::new();
        wheel.advance(now + 1_000_000_000, |change| {
            let name = if change.terminal == A { 'A' } else { 'B' };
            edges.push((change.at, name, change.on));
        });
        edges
    }

    #[test]
    fn click_is_a_whole_cycle_of_quadrature_at_its_speed() {
        let mut wheel = Wheel::new(WheelConfig {
            a: A,
            b: B,
            speed: 250.0,
        });
        let up = [
            (1_000_000, 'A', true),
            (2_000_000, 'B', true),
            (3_000_000, 'A', false),
            (4_000_000, 'B', false),
        ];
        assert_eq!(turned(&mut wheel, 0, 1), up);
        let down = [
            (2_001_000_000, 'B', true),
            (2_002_000_000, 'A', true),
            (2_003_000_000, 'B', false),
            (2_004_000_000, 'A', false),
        ];
        assert_eq!(turned(&mut wheel, 2_000_000_000, -1), down);
        assert_eq!(wheel.clicks(), 0);
        assert_eq!(turned(&mut wheel, 5_000_000_000, 7).len(), 28);
        assert_eq!((wheel.clicks(), wheel.is_turning()), (7, false));
    }

    #[test]
    fn wheel_clicks_left_to_turn_are_bounded() {
        let mut wheel = Wheel::new(WheelConfig {
            a: A,
            b: B,
            speed: 100.0,
        });
        assert!(!wheel.turn(0, i64::MAX));
        assert!(!wheel.turn(0, i64::MIN));
        assert!(wheel.turn(0, MAX_CLICKS));
        assert!(!wheel.turn(0, 1));
    }
}
