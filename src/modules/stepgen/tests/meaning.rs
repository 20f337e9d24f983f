//! Positions that change their meaning: nothing moves without a command of the new meaning, and no
//! speed changes by more than the acceleration.

use super::*;

/// What changes the meaning of positions.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    Nothing,
    Reset,
    Index,
    Scale(f64),
}

const CHANGES: [Change; 6] = [
    Change::Nothing,
    Change::Reset,
    Change::Index,
    Change::Scale(2_000.0),
    Change::Scale(-1_000.0),
    Change::Scale(10.0),
];

impl Machine {
    /// A cycle without a new command.
    fn idle(&mut self) {
        let _ = self.driver.read();
        let _ = self.driver.write();
        self.wait(MS);
    }

    fn idle_for(&mut self, cycles: u32) {
        for _ in 0..cycles {
            self.idle();
        }
    }

    fn command(&self) -> f64 {
        self.driver.pins().commanded(self.pins.position_cmd)
    }

    fn set(&mut self, pin: crate::hal::Output<bool>, on: bool) {
        self.driver.pins_mut().set(pin, on);
    }

    /// Makes a change while the generator does not move, or in the cycle of whatever was set
    /// before.
    fn change(&mut self, change: Change) {
        match change {
            Change::Nothing => self.idle(),
            Change::Reset => {
                self.set(self.pins.position_reset, true);
                self.idle();
                self.set(self.pins.position_reset, false);
                self.idle();
            }
            Change::Index => {
                self.set(self.pins.index_enable.unwrap().as_output(), true);
                self.idle_for(5);
                let now = self.fpga().now().as_nanos();
                self.model().advance(now);
                self.generator().edge(1 << 4);
                self.idle_for(2);
            }
            Change::Scale(scale) => {
                self.set_param(self.pins.position_scale, scale);
                self.idle();
            }
        }
    }

    fn bite(&mut self) {
        self.wait(20 * MS);
        self.idle_for(3);
        let rearmed = self.driver.rearm().expect("it is there");
        assert_eq!(rearmed.waiting, rearmed.rearm_pending, "{rearmed:?}");
        self.idle_for(3);
    }

    /// Steps of each of some cycles without a new command.
    fn steps_of(&mut self, cycles: u32) -> Vec<i64> {
        let step = |machine: &mut Self| {
            let before = machine.motor;
            machine.idle();
            machine.motor - before
        };
        (0..cycles).map(|_| step(self)).collect()
    }
}

fn largest_change(steps: &[i64]) -> i64 {
    let changes = steps.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    changes.max().unwrap_or(0)
}

#[test]
fn motor_does_not_move_after_a_bite_without_a_new_command() {
    for change in CHANGES {
        for is_before in [false, true] {
            let mut machine = Machine::enabled(WITH_LATCH);
            machine.go(10.0);
            machine.wait(20 * MS);
            machine.idle_for(3);
            if is_before {
                machine.change(change);
            }
            let _ = machine.driver.rearm().expect("it is there");
            machine.idle_for(3);
            if !is_before {
                machine.change(change);
            }
            let before = machine.motor;
            machine.enable(true);
            machine.idle_for(500);
            let moved = machine.motor - before;
            assert!(moved.abs() <= 1, "{change:?} {is_before}: {moved} steps");
            let shown = machine.read(machine.pins.position_fb);
            let scale = machine.driver.pins().param(machine.pins.position_scale);
            let away = (machine.command() - shown) * scale;
            assert!(away.abs() <= 1.0, "{change:?} {is_before}: {away} steps");
            machine.assert_right();
        }
    }
}

#[test]
fn motor_does_not_move_on_simultaneous_scale_rearm_and_enable() {
    for scale in [2_000.0, -1_000.0, 10.0] {
        let mut machine = Machine::enabled(2);
        machine.go(10.0);
        machine.bite();
        let before = machine.motor;
        machine.set_param(machine.pins.position_scale, scale);
        machine.enable(true);
        machine.idle_for(300);
        assert!((machine.motor - before).abs() <= 1, "{scale}");

        machine.wait(20 * MS);
        machine.idle_for(3);
        let before = machine.motor;
        let _ = machine.driver.read();
        machine.set_param(machine.pins.position_scale, 500.0);
        let _ = machine.driver.rearm().expect("it is there");
        machine.enable(true);
        let _ = machine.driver.write();
        machine.wait(MS);
        machine.idle_for(300);
        assert!((machine.motor - before).abs() <= 1, "{scale}");
    }
}

#[test]
fn standing_command_keeps_its_place_without_a_fault() {
    for change in CHANGES {
        for is_on in [false, true] {
            let mut machine = Machine::enabled(WITH_LATCH);
            machine.go(10.0);
            machine.enable(is_on);
            machine.idle_for(3);
            let before = machine.motor;
            machine.change(change);
            machine.enable(true);
            machine.idle_for(500);
            let moved = machine.motor - before;
            assert!(moved.abs() <= 1, "{change:?}, {is_on}: {moved} steps");
        }
    }
}

#[test]
fn command_set_together_with_the_change_is_a_new_one() {
    for (change, command) in [
        (Change::Reset, 2.0),
        (Change::Scale(2_000.0), 6.0),
        (Change::Scale(-1_000.0), -12.0),
    ] {
        let mut machine = Machine::enabled(2);
        machine.go(10.0);
        machine
            .driver
            .pins_mut()
            .set(machine.pins.position_cmd, command);
        machine.change(change);
        machine.idle_for(3_000);
        machine.assert_motor_at(12_000.0);
    }
}

#[test]
fn position_reset_that_is_held_ends_the_motion() {
    let mut machine = Machine::enabled(2);
    for _ in 0..300 {
        machine.cycle(100.0);
    }
    machine.set(machine.pins.position_reset, true);
    let steps: Vec<_> = (0..1_000)
        .map(|_| {
            let before = machine.motor;
            machine.cycle(100.0);
            machine.motor - before
        })
        .collect();
    assert!(steps[0] >= 9, "it moved");
    assert!(largest_change(&steps) <= 2, "{:?}", &steps[..200]);
    assert_eq!(steps[150..].iter().sum::<i64>(), 0, "it stands");
    machine.assert_right();
}

/// 100 units/s^2 are 0.1 steps in a period and per period, with a scale of 1000.
#[test]
fn scale_changed_at_speed_changes_no_speed_at_once() {
    for by_speed in [true, false] {
        for scale in [2_000.0, 10_000.0, -1_000.0, 10.0] {
            let mut machine = Machine::enabled(2);
            let pins = machine.pins;
            machine.set_param(pins.maxvel, 20.0);
            for time in [pins.steplen, pins.stepspace] {
                machine.driver.pins_mut().set_param(time, 500).unwrap();
            }
            machine.set(pins.control_type, by_speed);
            machine.driver.pins_mut().set(pins.velocity_cmd, 10.0);
            let mut last = 0.0;
            for n in 0..300 {
                last = 0.01 * f64::from(n);
                machine.cycle(last);
            }
            machine.set_param(pins.position_scale, scale);
            let steps = machine.steps_of(3_000);
            let (first, allowed) = (steps[0], (scale.abs() / 10_000.0).ceil() as i64 + 1);
            assert!((9..=12).contains(&first), "{scale}: {first}");
            let change = largest_change(&steps);
            assert!(change <= allowed, "{by_speed}, {scale}: {change}");
            let shown = machine.read(pins.position_fb) * scale;
            let motor = machine.motor as f64;
            let since = 1.0 + steps[steps.len() - 1].abs() as f64;
            assert!((shown - motor).abs() <= since, "{shown}, {motor}");
            if !by_speed {
                let place = last * 1_000.0;
                assert!((motor - place).abs() <= 2.0, "{scale}: {motor}, {place}");
            }
            machine.assert_right();
        }
    }
}

/// The acceleration of before brakes: 100 times less would take 10 s and 50000 steps.
#[test]
fn smaller_scale_at_speed_brakes_as_before() {
    let mut machine = Machine::enabled(2);
    let pins = machine.pins;
    machine.set(pins.control_type, true);
    machine.driver.pins_mut().set(pins.velocity_cmd, 10.0);
    for _ in 0..300 {
        machine.cycle(0.0);
    }
    machine.set_param(pins.position_scale, 10.0);
    let steps = machine.steps_of(300);
    let until = steps.iter().position(|steps| *steps <= 1);
    assert!(until.is_some_and(|at| at < 120), "{until:?}");
    assert!(largest_change(&steps) <= 2, "{steps:?}");
}
