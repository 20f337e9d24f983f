//! The code in the README drives the axis.

use mesa_hal::Clock;

const README: &str = include_str!("../../README.md");
const TEN_LINES: &str = include_str!("ten_lines.in");

#[test]
fn lines_in_the_readme_are_those_that_are_run_here() {
    let (_, block) = README.split_once("```rust\n").expect("a block of code");
    let (block, _) = block.split_once("# Ok::").expect("its end");
    let run = TEN_LINES.strip_prefix("{\n").expect("an expression");
    let run = run
        .strip_suffix("(ended.driver.into_bus(), ended.statistics)\n}\n")
        .expect("that gives what is left");
    assert_eq!(block, run);
}

#[test]
fn lines_in_the_readme_move_the_axis() -> Result<(), Box<dyn std::error::Error>> {
    let (mut bus, statistics) = include!("ten_lines.in");
    // The motor needs a moment to stop.
    bus.wait(std::time::Duration::from_millis(50));
    // 1.5 V are 15 units a second, for a second.
    let mut motor = |axis| {
        let motor = bus.motor(axis).expect("a motor");
        (motor.position(), motor.velocity())
    };
    let (moved, speed) = motor(0);
    assert!((14.0..16.0).contains(&moved), "{moved} units");
    assert!(speed.abs() < 0.1, "it still moves: {speed}");
    for axis in 1..6 {
        assert!(motor(axis).0.abs() < 1e-9, "axis {axis}");
    }
    assert_eq!((statistics.cycles, statistics.failed_reads), (1000, 0));
    Ok(())
}
