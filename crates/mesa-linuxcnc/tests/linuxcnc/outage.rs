//! A network that is away for a while, in all of LinuxCNC: positions afterwards, against the motor.

use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::halcmd::{alone, skipped};
use crate::session::SETTLE;
use crate::whole::{LinuxCnc, Machine, merged, with_one_word_changed, written};

const SERVO: Machine = Machine {
    toml: "servo/machine.toml",
    prefix: "hm2_7i97.0",
};
const STEPPER: Machine = Machine {
    toml: "stepper/7i92.toml",
    prefix: "hm2_7i92.0",
};
const JOINT: usize = 1;
const COUNTS_PER_UNIT: f64 = 81_920.0;
const STEPS_PER_UNIT: f64 = 1000.0;
/// LinuxCNC's usual limits, with which ten lost packets in a row set `io_error`.
const USUAL: &str = "[HOSTMOT2]\nPACKET_ERROR_LIMIT = 100\n";
const SHORT_WATCHDOG: &str = "[HOSTMOT2]\nPACKET_ERROR_LIMIT = 100\nWATCHDOG_NS = 100000000\n";

/// What an outage of the network in the middle of a move left.
struct After {
    /// What the motor moved that LinuxCNC's position has not, in counts or steps of the motor.
    error: f64,
    /// The pin that says that the position is unsure.
    is_unsure: bool,
    /// What was printed on the operator's screen.
    screen: Vec<String>,
}

/// Homes a joint, takes the network away while it moves, and continues as the page on LinuxCNC
/// says. `truth` is where the motor is, in counts or steps, less what LinuxCNC's position means.
fn outage(
    name: &str,
    (machine, ini, limits): (Machine, &str, &str),
    (millis, unsure): (u32, &str),
    truth: impl Fn(&mut LinuxCnc) -> f64,
) -> After {
    let _alone = alone();
    let mut files = written(machine, ini);
    let with_limits = merged(&files["machine.ini"], limits);
    files.insert("machine.ini".into(), with_limits);
    let files = with_one_word_changed(&files, ["hm2_eth", "mesa_eth"]);
    let mut linuxcnc = LinuxCnc::load(name, &files, machine);
    linuxcnc.hal("on");
    for joint in 0..linuxcnc.joints() {
        linuxcnc.hal(&format!("home {joint}"));
    }
    linuxcnc.hal("on");
    let before = linuxcnc.settled(&truth);
    // Slowly enough that its counter cannot wrap around until somebody clears `io_error`, and at
    // its speed: an axis that accelerates could go further.
    linuxcnc.hal(&format!("move {JOINT} 2.5 0.1"));
    sleep(Duration::from_millis(300));
    linuxcnc.board("loss 1");
    linuxcnc.board(&format!("at +{millis}ms loss 0"));
    let begin = Instant::now();
    while linuxcnc.halcmd.get("io_error") != "TRUE" {
        assert!(begin.elapsed() < SETTLE, "no io_error");
    }
    sleep(Duration::from_millis(u64::from(millis) + 50));
    let mut screen = linuxcnc.hal(&format!("setp {}.io_error FALSE", machine.prefix));
    sleep(Duration::from_millis(500));
    screen.extend(linuxcnc.hal("on"));
    let error = linuxcnc.settled(truth) - before;
    let is_unsure = linuxcnc.halcmd.get(unsure) == "TRUE";
    println!("{name}, {millis} ms: {error} off, unsure: {is_unsure}, {screen:#?}");
    linuxcnc.halcmd.end();
    After {
        error,
        is_unsure,
        screen,
    }
}

fn counts(linuxcnc: &mut LinuxCnc) -> f64 {
    linuxcnc.motor(JOINT, "counts") + linuxcnc.position(JOINT) * COUNTS_PER_UNIT
}

fn steps(linuxcnc: &mut LinuxCnc) -> f64 {
    linuxcnc.motor(JOINT, "steps") - linuxcnc.position(JOINT) * STEPS_PER_UNIT
}

const ENCODER: &str = "encoder.01.count-unsure";
const GENERATOR: &str = "stepgen.01.position-unsure";

#[test]
fn servo_axis_keeps_its_position_after_an_outage() {
    if skipped() {
        return;
    }
    let machine = (SERVO, include_str!("servo/written.ini"), USUAL);
    let after = outage("outage-servo", machine, (300, ENCODER), counts);
    assert!(after.error.abs() <= 2.0, "{} counts off", after.error);
    assert!(!after.is_unsure, "{:?}", after.screen);
}

#[test]
fn step_generator_keeps_its_position_after_an_outage() {
    if skipped() {
        return;
    }
    let machine = (STEPPER, include_str!("stepper/written.ini"), USUAL);
    let after = outage("outage-stepper", machine, (300, GENERATOR), steps);
    assert!(after.error.abs() <= 2.0, "{} steps off", after.error);
    assert!(!after.is_unsure, "{:?}", after.screen);
}

/// The watchdog releases the step pins: where the motor stood still is an estimate, which is on the
/// operator's screen.
#[test]
fn bitten_step_generator_reports_an_estimated_position() {
    if skipped() {
        return;
    }
    let machine = (STEPPER, include_str!("stepper/written.ini"), SHORT_WATCHDOG);
    let after = outage("outage-bitten", machine, (400, GENERATOR), steps);
    // Steps of 1 ms at 0.1 units/s, and what LinuxCNC's own period varies by on a busy computer.
    assert!(after.error.abs() <= 5.0, "{} steps off", after.error);
    assert!(after.is_unsure, "{:?}", after.screen);
    let mut screen = after.screen.iter();
    let said = screen.any(|line| line.contains("position unsure of step generators"));
    assert!(said, "{:?}", after.screen);
}
