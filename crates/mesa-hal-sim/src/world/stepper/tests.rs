use super::*;

/// A drive at its inputs, without a generator.
struct Bench {
    motor: Stepper,
    moved: Vec<(Nanos, f64)>,
}

const HIGH: Nanos = 2_000;

fn bench(config: StepperConfig) -> Bench {
    let mut motor = Stepper::new(config).expect("a valid motor");
    motor.wire(0, false, false);
    Bench {
        motor,
        moved: Vec::new(),
    }
}

impl Bench {
    fn set(&mut self, at: Nanos, step: bool, dir: bool) {
        let moved = &mut self.moved;
        let mut note = |segment: &Segment, positions: [f64; 2]| {
            moved.push((segment.end, positions[1]));
        };
        self.motor.set_inputs(at, step, dir, &mut note);
    }

    fn settle(&mut self, at: Nanos) {
        let moved = &mut self.moved;
        let mut note = |segment: &Segment, positions: [f64; 2]| {
            moved.push((segment.end, positions[1]));
        };
        self.motor.advance(at, &mut note);
    }

    /// Pulses at times, in one direction.
    fn pulses(&mut self, times: impl IntoIterator<Item = Nanos>, dir: bool) {
        for at in times {
            self.set(at, true, dir);
            self.set(at + HIGH, false, dir);
        }
    }

    fn counts(&self) -> (i64, i64, u64) {
        (
            self.motor.commanded(),
            self.motor.steps(),
            self.motor.lost(),
        )
    }
}

/// Times of the steps of a ramp from rest, in steps/s², up to a number of steps.
fn ramp(from: Nanos, acceleration: f64, steps: u32) -> Vec<Nanos> {
    let time = |step: u32| libm::sqrt(2.0 * f64::from(step) / acceleration);
    let times = (1..=steps).map(|step| from + (time(step) * 1e9) as Nanos);
    times.collect()
}

#[test]
fn position_is_the_number_of_steps_up_minus_down() {
    let mut bench = bench(StepperConfig::default());
    bench.pulses((1..=10).map(|n| n * 2_000_000), false);
    bench.set(30_000_000, false, true);
    bench.pulses((16..=30).map(|n| n * 2_000_000), true);
    bench.settle(70_000_000);
    assert_eq!(bench.counts(), (-5, -5, 0));
    assert_eq!(bench.motor.position(), -0.005);
    assert_eq!(bench.motor.counts(), -5.0);
    assert_eq!(bench.moved.len(), 25);
    assert_eq!(bench.moved[9], (20_000_000 + 1_000, 0.010));
}

#[test]
fn pulses_that_are_too_short_or_too_close_are_lost() {
    for (high, low, followed) in [(1_000, 1_000, 3), (999, 1_001, 0), (1_001, 999, 1)] {
        let mut bench = bench(StepperConfig {
            max_acceleration: f64::INFINITY,
            start_speed: f64::INFINITY,
            max_speed: f64::INFINITY,
            ..StepperConfig::default()
        });
        for n in 0..3 {
            let at = 1_000_000 + n * (high + low);
            bench.set(at, true, false);
            bench.set(at + high, false, false);
        }
        bench.settle(2_000_000);
        let lost = 3 - followed;
        assert_eq!(bench.counts(), (3, followed, lost as u64), "{high} {low}");
    }
}

#[test]
fn direction_that_changes_too_close_to_a_step_loses_it() {
    // From the rising edge to the change, and from the change to the rising edge.
    for (hold, setup, steps, lost) in [(200, 200, 0, 0), (199, 200, -1, 1), (200, 199, 1, 1)] {
        let mut bench = bench(StepperConfig {
            max_acceleration: f64::INFINITY,
            start_speed: f64::INFINITY,
            min_pulse: 0,
            ..StepperConfig::default()
        });
        bench.set(1_000_000, true, false);
        bench.set(1_000_000 + hold, true, true);
        bench.set(3_000_000, false, true);
        bench.set(4_000_000, false, false);
        bench.set(5_000_000, false, true);
        bench.set(5_000_000 + setup, true, true);
        bench.set(6_000_000, false, true);
        bench.settle(9_000_000);
        assert_eq!(bench.counts(), (0, steps, lost), "{hold} {setup}");
    }
}

#[test]
fn ramp_within_acceleration_loses_no_step_a_steeper_one_does() {
    let config = StepperConfig {
        max_acceleration: 100.0,
        start_speed: 0.5,
        ..StepperConfig::default()
    };
    for (part, loses) in [(0.9, false), (1.5, true)] {
        let mut bench = bench(config);
        bench.pulses(ramp(1_000_000, part * 100_000.0, 2_000), false);
        let (commanded, steps, lost) = bench.counts();
        assert_eq!(lost > 0, loses, "{part}: {lost}");
        assert_eq!(commanded, 2_000);
        // The last one still waits for its hold time.
        assert!(steps + lost as i64 >= 1_999, "{steps} {lost}");
    }
}

/// A turn on the boundary of a step: 7 us from the step up to the step down.
#[test]
fn two_opposite_steps_close_together_lose_nothing() {
    let mut bench = bench(StepperConfig::default());
    for turn in 0..10 {
        let at = 10_000_000 * (turn + 1);
        bench.pulses([at], false);
        bench.set(at + 3_000, false, true);
        bench.pulses([at + 7_000], true);
        bench.set(at + 10_000, false, false);
    }
    bench.settle(200_000_000);
    assert_eq!(bench.counts(), (0, 0, 0));
    assert_eq!(bench.moved.len(), 20);
    assert_eq!(bench.motor.velocity(), 0.0);
}

#[test]
fn steps_are_lost_by_turning_at_speed_or_too_fast_after_a_turn() {
    // 20 steps/ms, and 1 step/ms to which the motor starts.
    for (after, loses) in [(50_000, true), (1_100_000, false)] {
        let mut bench = bench(StepperConfig::default());
        bench.pulses([10_000_000], false);
        bench.set(10_005_000, false, true);
        bench.pulses((0..5).map(|n| 10_007_000 + n * after), true);
        bench.settle(30_000_000);
        let (commanded, _, lost) = bench.counts();
        assert_eq!((commanded, lost > 0), (-4, loses), "{after}: {lost}");
    }
    let mut bench = bench(StepperConfig::default());
    let times = ramp(1_000_000, 900_000.0, 500);
    let last = times[499];
    bench.pulses(times, false);
    bench.set(last + 5_000, false, true);
    bench.pulses([last + 7_000], true);
    bench.settle(last + 20_000);
    assert!(bench.motor.lost() > 0);
}

#[test]
fn motor_that_has_lost_steps_follows_again_after_a_stop() {
    let mut bench = bench(StepperConfig::default());
    bench.pulses((1..=100).map(|n| n * 20_000), false);
    bench.settle(1_000_000_000);
    let (_, before, lost) = bench.counts();
    assert!(lost > 90, "50 kHz at once: {lost} lost");
    bench.pulses((1..=100).map(|n| 2_000_000_000 + n * 2_000_000), false);
    bench.settle(3_000_000_000);
    assert_eq!(bench.counts(), (200, before + 100, lost));
}

#[test]
fn pulses_that_end_at_speed_let_the_rotor_run_on() {
    let mut bench = bench(StepperConfig {
        start_speed: 2.0,
        ..StepperConfig::default()
    });
    let times = ramp(1_000_000, 900_000.0, 500);
    let last = times[499];
    bench.pulses(times, false);
    bench.settle(last + 1_000_000_000);
    // 30 steps/ms: (30000 - 2000)^2 / (2 * 1e6).
    let overshot = bench.motor.overshot();
    assert!((360..=400).contains(&overshot), "{overshot}");
    assert_eq!(bench.motor.lost(), 0);
    assert_eq!(bench.motor.steps(), 500 + overshot as i64);
    assert_eq!(bench.motor.velocity(), 0.0);
}

#[test]
fn all_steps_are_lost_without_power() {
    let mut bench = bench(StepperConfig::default());
    bench.motor.set_power(false);
    bench.pulses((1..=10).map(|n| n * 2_000_000), true);
    bench.settle(30_000_000);
    assert_eq!(bench.counts(), (-10, 0, 10));
}

#[test]
fn values_outside_of_their_range_are_refused() {
    let refused = |config| Stepper::new(config).expect_err("refused").to_string();
    let text = refused(StepperConfig {
        steps_per_unit: 0.0,
        ..StepperConfig::default()
    });
    assert!(
        text.starts_with("steps_per_unit of a motor is 0: "),
        "{text}"
    );
    for config in [
        StepperConfig {
            max_acceleration: 0.0,
            ..StepperConfig::default()
        },
        StepperConfig {
            start_speed: f64::NAN,
            ..StepperConfig::default()
        },
    ] {
        refused(config);
    }
}
