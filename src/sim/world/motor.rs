//! A motor with its velocity drive and its encoder.

use crate::sim::wire::Nanos;

/// The longest piece of a movement that is handed on in one go.
const LONGEST_SEGMENT: Nanos = 100_000;

/// Slower than this (units per second), a motor without a command stands still.
const STANDSTILL: f64 = 1e-9;

/// What a motor, its drive and its encoder are like. Positions are in machine units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorConfig {
    /// Speed at full-scale voltage, in units per second.
    pub max_speed: f64,
    /// Full-scale voltage of the drive's input.
    pub full_scale: f64,
    /// Time constant of the velocity loop in seconds; 0 follows at once.
    pub time_constant: f64,
    /// Voltage that friction eats up; below it the motor does not move.
    pub friction: f64,
    /// Encoder counts (quadrature edges) for each unit; negative if the encoder is reversed.
    pub counts_per_unit: f64,
    /// Counts from index pulse to index pulse; 0 if there is no index.
    pub counts_per_revolution: u32,
}

impl Default for MotorConfig {
    /// 100 units/s at 10 V, 5 ms, no friction, 1000 counts a unit, an index every 4000 counts.
    fn default() -> Self {
        Self {
            max_speed: 100.0,
            full_scale: 10.0,
            time_constant: 0.005,
            friction: 0.0,
            counts_per_unit: 1000.0,
            counts_per_revolution: 4000,
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

/// A motor whose speed follows a voltage with a first-order lag.
///
/// It is stepped with the exact solution, so that its path does not depend on how often somebody
/// looks.
#[derive(Clone, Debug)]
pub struct Motor {
    config: MotorConfig,
    now: Nanos,
    position: f64,
    velocity: f64,
    command: f64,
    turned_by_hand: Option<f64>,
}

impl Motor {
    /// A motor at rest at position 0.
    pub fn new(config: MotorConfig) -> Self {
        Self {
            config,
            now: 0,
            position: 0.0,
            velocity: 0.0,
            command: 0.0,
            turned_by_hand: None,
        }
    }

    /// What it is like.
    pub fn config(&self) -> &MotorConfig {
        &self.config
    }

    /// Its true position in units.
    pub fn position(&self) -> f64 {
        self.position
    }

    /// Its true velocity in units per second.
    pub fn velocity(&self) -> f64 {
        self.turned_by_hand.unwrap_or(self.velocity)
    }

    /// What its encoder stands at, in counts.
    pub fn counts(&self) -> f64 {
        self.position * self.config.counts_per_unit
    }

    /// Turns the shaft at a given speed, whatever the drive does; `None` lets it go.
    pub fn turn_by_hand(&mut self, velocity: Option<f64>) {
        match velocity {
            Some(velocity) => self.turned_by_hand = Some(finite(velocity)),
            None => {
                if let Some(velocity) = self.turned_by_hand.take() {
                    self.velocity = velocity;
                }
            }
        }
    }

    /// Sets the drive's input from now on. A disabled drive brakes.
    pub(crate) fn command(&mut self, volts: f64, enabled: bool) {
        let volts = if enabled { finite(volts) } else { 0.0 };
        let limit = self.config.full_scale;
        let effective = (volts.abs() - self.config.friction).max(0.0);
        self.command =
            effective.copysign(volts).clamp(-limit, limit) / limit * self.config.max_speed;
    }

    /// Lets time pass up to `to` and hands on the movement in pieces of one direction each.
    pub(crate) fn advance(&mut self, to: Nanos, mut moved: impl FnMut(&Segment)) {
        while self.now < to {
            if self.is_at_rest() {
                self.velocity = 0.0;
                self.now = to;
                return;
            }
            let end = to.min(self.now + LONGEST_SEGMENT);
            match self.reversal(end) {
                Some(middle) => {
                    self.step(middle, &mut moved);
                    self.step(end, &mut moved);
                }
                None => self.step(end, &mut moved),
            }
        }
    }

    fn is_at_rest(&self) -> bool {
        match self.turned_by_hand {
            Some(velocity) => velocity == 0.0,
            None => self.command == 0.0 && self.velocity.abs() < STANDSTILL,
        }
    }

    /// When the velocity goes through zero before `end`.
    fn reversal(&self, end: Nanos) -> Option<Nanos> {
        let tau = self.config.time_constant;
        let opposed = self.velocity * self.command < 0.0;
        if self.turned_by_hand.is_some() || !opposed || tau <= 0.0 {
            return None;
        }
        let seconds = tau * libm::log1p(-self.velocity / self.command);
        let middle = self.now + (seconds * 1e9) as Nanos;
        (self.now < middle && middle < end).then_some(middle)
    }

    fn step(&mut self, end: Nanos, moved: &mut impl FnMut(&Segment)) {
        let seconds = (end - self.now) as f64 * 1e-9;
        let from = self.counts();
        if let Some(velocity) = self.turned_by_hand {
            self.position += velocity * seconds;
        } else if self.config.time_constant > 0.0 {
            let tau = self.config.time_constant;
            let excess = self.velocity - self.command;
            let lost = -libm::expm1(-seconds / tau);
            self.position += self.command * seconds + excess * tau * lost;
            self.velocity = self.command + excess * (1.0 - lost);
        } else {
            self.velocity = self.command;
            self.position += self.command * seconds;
        }
        let segment = Segment {
            start: self.now,
            end,
            from,
            to: self.counts(),
            counts_per_revolution: self.config.counts_per_revolution,
        };
        self.now = end;
        if (segment.to - segment.from).abs() > 0.0 {
            moved(&segment);
        }
    }
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(motor: &mut Motor, to: Nanos, step: Nanos) {
        let mut now = motor.now;
        while now < to {
            now = to.min(now + step);
            motor.advance(now, |_| {});
        }
    }

    #[test]
    fn speed_follows_the_voltage_with_the_time_constant() {
        let mut motor = Motor::new(MotorConfig::default());
        motor.command(5.0, true);
        motor.advance(5_000_000, |_| {});
        let expected = 50.0 * (1.0 - (-1.0f64).exp());
        assert!((motor.velocity() - expected).abs() < 1e-9);
        motor.advance(100_000_000, |_| {});
        assert!((motor.velocity() - 50.0).abs() < 1e-6);
        let expected = 50.0 * (0.1 - 0.005 * (1.0 - (-20.0f64).exp()));
        assert!((motor.position() - expected).abs() < 1e-9);
    }

    #[test]
    fn the_path_does_not_depend_on_how_often_somebody_looks() {
        let mut coarse = Motor::new(MotorConfig::default());
        let mut fine = coarse.clone();
        for motor in [&mut coarse, &mut fine] {
            motor.command(7.0, true);
        }
        run(&mut coarse, 20_000_000, 1_000_000);
        run(&mut fine, 20_000_000, 777);
        for motor in [&mut coarse, &mut fine] {
            motor.command(-3.0, true);
        }
        run(&mut coarse, 40_000_000, 1_000_000);
        run(&mut fine, 40_000_000, 777);
        assert!((coarse.position() - fine.position()).abs() < 1e-9);
        assert!((coarse.velocity() - fine.velocity()).abs() < 1e-9);
    }

    #[test]
    fn every_segment_goes_one_way_and_joins_the_one_before() {
        let mut motor = Motor::new(MotorConfig::default());
        motor.command(10.0, true);
        motor.advance(10_000_000, |_| {});
        motor.command(-10.0, true);
        let mut last = motor.counts();
        let mut turns = 0;
        let mut rising = true;
        motor.advance(30_000_000, |segment| {
            assert_eq!(segment.from, last);
            last = segment.to;
            if (segment.to > segment.from) != rising {
                rising = !rising;
                turns += 1;
            }
        });
        assert_eq!(turns, 1);
    }

    #[test]
    fn friction_holds_and_a_disabled_drive_brakes() {
        let config = MotorConfig {
            friction: 0.5,
            ..MotorConfig::default()
        };
        let mut motor = Motor::new(config);
        motor.command(0.4, true);
        motor.advance(100_000_000, |_| {});
        assert_eq!(motor.position(), 0.0);
        motor.command(1.5, true);
        motor.advance(200_000_000, |_| {});
        assert!((motor.velocity() - 10.0).abs() < 1e-6);
        motor.command(1.5, false);
        motor.advance(400_000_000, |_| {});
        assert_eq!(motor.velocity(), 0.0);
        motor.command(f64::NAN, true);
        motor.advance(500_000_000, |_| {});
        assert_eq!(motor.velocity(), 0.0);
    }
}
