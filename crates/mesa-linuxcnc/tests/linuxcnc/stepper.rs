//! Moves of a stepper machine in all of LinuxCNC with either driver: LinuxCNC's sample
//! configuration, and what `mesa hal` writes. One word of the files changes. The truth is the
//! simulated stepper motor, which loses steps where pulses are too fast, too short, or accelerate
//! too much.

use crate::halcmd::{alone, skipped};
use crate::tools::skip;
use crate::whole::{
    Files, LinuxCnc, Machine, merged, sample_text, with_address, with_one_word_changed, written,
};

const ON_7I92: Machine = Machine {
    toml: "stepper/7i92.toml",
    prefix: "hm2_7i92.0",
};
const ON_7I97: Machine = Machine {
    toml: "stepper/7i97.toml",
    prefix: "hm2_7i97.0",
};
/// The joint with a home switch.
const JOINT: usize = 1;
const STEPS_PER_UNIT: f64 = 1000.0;
const JOG: f64 = 0.25;
/// Permitted ratio of the following errors.
const NO_LARGER: f64 = 1.15;
/// Following errors up to a tenth of a step count as this: no motor resolves them, and they are the
/// jitter of the read on a computer that is not a realtime one, which this driver averages over
/// more cycles than hm2_eth. One cycle of lag more is a whole step at the speed of the jogs.
const RESOLVED: f64 = 0.1 / STEPS_PER_UNIT;
/// Number of runs of which one has to do without a lost step.
const RUNS: usize = 3;
/// A move of three axes in machine coordinates, and where it ends.
const MOVE: &str = "mdi G53 G0 X1 Y0.5 Z-1";
const END: [f64; 3] = [1.0, 0.5, -1.0];

/// What a driver made of the machine.
#[derive(Debug)]
struct Moves {
    /// Step of the motor at the zero of the joint with the switch.
    zero: f64,
    /// Following error in units.
    following: f64,
}

#[test]
fn sample_config_moves_7i92_steppers_with_one_word_changed() {
    the_sample_moves(ON_7I92, "7i92", "gpio.020.in");
}

#[test]
fn sample_config_moves_7i97_steppers_with_one_word_changed() {
    the_sample_moves(ON_7I97, "7i97", "inmux.00.input-04");
}

#[test]
fn mesa_hal_files_move_steppers_with_one_word_changed() {
    if skipped() {
        return;
    }
    let files = written(ON_7I92, include_str!("stepper/written.ini"));
    compare("stepper-written", ON_7I92, &files, ["hm2_eth", "mesa_eth"]);
}

fn the_sample_moves(machine: Machine, board: &str, switch: &str) {
    if skipped() {
        return;
    }
    let Some(files) = sample(board, switch) else {
        skip("the sample hm2-stepper is not installed with LinuxCNC");
        return;
    };
    let words = ["DRIVER=hm2_eth", "DRIVER=mesa_eth"];
    compare(&format!("stepper-{board}"), machine, &files, words);
}

/// LinuxCNC's sample for a simulated board; `None` if it is not installed.
fn sample(board: &str, switch: &str) -> Option<Files> {
    let values = include_str!("stepper/sample.ini");
    let values = values.replace("BOARD=", &format!("BOARD={board}"));
    let values = values.replace("hm2_BOARD.0.SWITCH", &format!("hm2_{board}.0.{switch}"));
    let values = values.replace("hm2_BOARD", &format!("hm2_{board}"));
    let ini = sample_text("hm2-stepper/5i20.ini")?;
    let files = [
        ("machine.ini", merged(&ini, &values)),
        (
            "hm2-stepper.hal",
            with_address(&sample_text("hm2-stepper/hm2-stepper.hal")?),
        ),
        ("tool.tbl", sample_text("hm2-stepper/tool.tbl")?),
    ];
    Some(files.map(|(name, text)| (name.to_owned(), text)).into())
}

/// Runs a configuration with both drivers.
fn compare(name: &str, machine: Machine, files: &Files, words: [&str; 2]) {
    let _alone = alone();
    let changed = with_one_word_changed(files, words);
    let theirs = format!("{name}-hm2_eth");
    let theirs = without_lost_steps(|| drive(&theirs, machine, files, |_| false));
    let limit = NO_LARGER * theirs.following.max(RESOLVED);
    let ours = format!("{name}-mesa_eth");
    let too_large = |following| following > limit;
    let ours = without_lost_steps(|| drive(&ours, machine, &changed, too_large));
    let apart = ours.zero - theirs.zero;
    println!("{name}: {theirs:?}, {ours:?}: homed {apart:.2} steps apart");
    assert!(apart.abs() <= 2.0, "homed {apart} steps apart");
    assert!(ours.following <= limit, "following error above {limit}");
}

/// Repeats a run in which a motor has lost steps: a thread that a busy computer holds back leaves a
/// rate in force for longer, and hm2_eth then corrects more than a motor follows.
fn without_lost_steps(mut drive: impl FnMut() -> Result<Moves, String>) -> Moves {
    let mut said = Vec::new();
    for _ in 0..RUNS {
        match drive() {
            Ok(moves) => return moves,
            Err(lost) => {
                println!("{lost}");
                said.push(lost);
            }
        }
    }
    panic!("steps are lost in each of {RUNS} runs: {said:#?}");
}

/// Homes all joints, jogs one and moves three with a configuration; a jog that is `too_large` is
/// repeated. Fails with the motor that has lost steps.
fn drive(
    name: &str,
    machine: Machine,
    files: &Files,
    too_large: impl Fn(f64) -> bool,
) -> Result<Moves, String> {
    let mut linuxcnc = LinuxCnc::load(name, files, machine);
    linuxcnc.hal("on");
    let joints = linuxcnc.joints();
    for joint in 0..joints {
        linuxcnc.hal(&format!("home {joint}"));
    }
    // With all joints at home LinuxCNC leaves the mode for joints.
    linuxcnc.hal("on");
    let following = linuxcnc.following(JOINT, JOG, too_large);
    linuxcnc.hal(MOVE);
    linuxcnc.hal("off");
    let (mut zero, mut all_lost) = (0.0, Vec::new());
    for (joint, end) in END.into_iter().enumerate() {
        let counter = format!("stepgen.{joint:02}.counts");
        let mut counts = 0.0;
        let steps = linuxcnc.settled(|linuxcnc| {
            counts = linuxcnc.halcmd.number(&counter);
            linuxcnc.motor(joint, "steps")
        });
        let lost = ["lost-steps", "overshot-steps"].map(|what| linuxcnc.motor(joint, what));
        println!("{name}: joint {joint}: {steps} steps, {counts} counted, lost {lost:?}");
        if lost != [0.0; 2] {
            all_lost.push(format!("{name}: joint {joint} has lost {lost:?}"));
            continue;
        }
        // Its sub-count is off by one after a wrap around of the accumulator, which is a
        // step where a motor rests right at a boundary.
        let tolerance = if name.ends_with("hm2_eth") { 1.0 } else { 0.0 };
        assert!((steps - counts).abs() <= tolerance, "joint {joint}");
        // Without a switch a joint is at home where it was switched on.
        let of_joint = steps - end * STEPS_PER_UNIT;
        if joint == JOINT {
            zero = of_joint;
        } else {
            assert!(of_joint.abs() <= 1.0, "joint {joint} ends at {steps}");
        }
    }
    linuxcnc.halcmd.end();
    if all_lost.is_empty() {
        Ok(Moves { zero, following })
    } else {
        Err(all_lost.join(", "))
    }
}
