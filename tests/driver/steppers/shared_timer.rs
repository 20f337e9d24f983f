//! Step generators and encoders that one timer of the DPLL latches, as many public configurations
//! have them.

use mesa_hal::Driver;
use mesa_hal::hal::Value;
use mesa_hal_sim::{SimFpga, Stepper, StepperConfig, StepperWiring, machines};

use super::{Machine, SCALE, machine_on, motor};
use crate::common::machine::World;

/// Encoder counts per unit, fewer than steps.
const COUNTS: f64 = 400.0;

/// A motor on generator 0, with encoder `encoder` on its shaft.
fn wired(mut fpga: SimFpga, encoder: usize) -> (SimFpga, usize) {
    let config = StepperConfig {
        counts_per_unit: COUNTS,
        ..*motor().config()
    };
    let axis = fpga.wire_stepper(StepperWiring {
        generator: 0,
        encoder: Some(encoder),
        motor: Stepper::new(config).expect("a motor"),
    });
    (fpga, axis)
}

/// Sets a signal of the board that every cycle writes.
fn set<T: Value>(driver: &mut Driver<SimFpga>, name: &str, value: T) {
    let name = format!("{}.{name}", driver.name());
    let pin = driver.pins().output::<T>(&name).expect("a pin");
    driver.pins_mut().set(pin, value);
}

#[test]
fn axis_moves_while_one_timer_latches_steps_and_encoder() {
    let boards: [(fn() -> SimFpga, usize); 2] =
        [(machines::i7i92_7i76, 0), (machines::i7i97_7i76, 6)];
    for (board, encoder) in boards {
        for (steps, counts) in [(1, 1), (2, 2), (1, 2), (0, 1), (1, 0), (0, 0)] {
            let (fpga, axis) = wired(board(), encoder);
            let mut machine = machine_on(fpga, axis);
            let driver = &mut machine.driver;
            let case = format!("{}, timers {steps} and {counts}", driver.name());
            for timer in ["dpll.01.timer-us", "dpll.02.timer-us"] {
                set(driver, timer, -50.0);
            }
            set(driver, "stepgen.timer-number", steps);
            set(driver, "encoder.timer-number", counts);
            go(&mut machine, encoder, &case);
        }
    }
}

/// Moves to and fro, and compares what generator and encoder say with the motor.
fn go<B: World>(machine: &mut Machine<B>, encoder: usize, case: &str) {
    let name = format!("{}.encoder.{encoder:02}.rawcounts", machine.driver.name());
    let rawcounts = machine.driver.pins().input::<i32>(&name).expect("a pin");
    for target in [3.0, -2.0] {
        for _ in 0..1_500 {
            machine.cycle(target);
        }
        let motor = machine.motor();
        assert_eq!((motor.lost(), motor.overshot()), (0, 0), "{case}");
        let shown = machine.position();
        assert!((shown - target).abs() < 2.0 / SCALE, "{case}: {shown}");
        let truth = motor.position();
        assert!((truth - target).abs() < 2.0 / SCALE, "{case}: {truth}");
        let counted = f64::from(machine.driver.pins().read(rawcounts).value) / COUNTS;
        assert!((counted - truth).abs() < 2.0 / COUNTS, "{case}: {counted}");
    }
}
