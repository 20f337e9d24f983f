//! Moves of a servo machine in all of LinuxCNC with either driver: LinuxCNC's sample configuration,
//! and what `mesa hal` writes. One word of the files changes.

use crate::halcmd::{alone, skipped};
use crate::tools::skip;
use crate::whole::{
    Files, LinuxCnc, Machine, merged, sample_text, with_address, with_one_word_changed, written,
};

const MACHINE: Machine = Machine {
    toml: "servo/machine.toml",
    prefix: "hm2_7i97.0",
};
const JOINT: usize = 1;
const COUNTS_PER_UNIT: f64 = 81_920.0;
/// Position of the joint at the index next to the switch: `HOME_OFFSET` of both configurations.
const INDEX_POSITION: f64 = -2.9;
/// Counts of the motor there.
const INDEX_COUNTS: f64 = 8192.0;
/// Attempts to home with hm2_eth: on a busy computer it has homed one index further.
const HOMINGS: usize = 3;
/// All of it is acceleration, in which an axis falls behind by what the cycle is late.
const JOG: f64 = 0.25;
/// Permitted ratio of the following errors. One cycle more between an encoder and its drive, which
/// is as fast as a cycle, makes 1.5 of them.
const NO_LARGER: f64 = 1.15;

/// What a driver made of the machine.
#[derive(Debug)]
struct Moves {
    /// Counts of the motor at the joint's zero.
    zero: f64,
    /// Following error in units.
    following: f64,
}

#[test]
fn sample_configuration_homes_and_follows_with_one_word_changed() {
    if skipped() {
        return;
    }
    let Some(files) = sample() else {
        skip("the sample hm2-servo is not installed with LinuxCNC");
        return;
    };
    // The sample is in inches.
    compare(
        "sample",
        &files,
        ["DRIVER=hm2_eth", "DRIVER=mesa_eth"],
        25.4,
    );
}

#[test]
fn mesa_hal_files_home_and_follow_with_one_word_changed() {
    if skipped() {
        return;
    }
    let files = written(MACHINE, include_str!("servo/written.ini"));
    compare("written", &files, ["hm2_eth", "mesa_eth"], 1.0);
}

/// Runs a configuration with both drivers. `unit` is in mm.
fn compare(name: &str, files: &Files, words: [&str; 2], unit: f64) {
    let _alone = alone();
    let changed = with_one_word_changed(files, words);
    let from_index = |moves: &Moves| {
        let counts = moves.zero - (INDEX_COUNTS + INDEX_POSITION * COUNTS_PER_UNIT);
        counts / COUNTS_PER_UNIT * unit
    };
    let mut homings = (0..HOMINGS).map(|_| drive(&format!("{name}-hm2_eth"), files, |_| false));
    let theirs = homings.find(|moves| {
        let error = from_index(moves);
        println!("{name}: hm2_eth homed {error:.5} mm from the index");
        error.abs() < 0.01
    });
    let theirs = theirs.expect("hm2_eth homes on the index next to the switch");
    let ours = drive(&format!("{name}-mesa_eth"), &changed, |following| {
        following > NO_LARGER * theirs.following
    });
    let error = from_index(&ours);
    let apart = error - from_index(&theirs);
    let ratio = ours.following / theirs.following;
    println!("{name}: {theirs:?}, {ours:?}: homed {apart:.5} mm apart, following {ratio:.2}");
    assert!(error.abs() < 0.01, "homed {error} mm from the index");
    assert!(apart.abs() < 0.01, "homed {apart} mm apart");
    assert!(ratio <= NO_LARGER, "following error: {ratio}");
}

/// LinuxCNC's sample for the simulated board; `None` if it is not installed.
fn sample() -> Option<Files> {
    let ini = sample_text("hm2-servo/5i20.ini")?;
    let files = [
        (
            "machine.ini",
            merged(&ini, include_str!("servo/sample.ini")),
        ),
        (
            "hm2-servo.hal",
            with_address(&sample_text("hm2-servo/hm2-servo.hal")?),
        ),
        ("tool.tbl", sample_text("hm2-servo/tool.tbl")?),
    ];
    Some(files.map(|(name, text)| (name.to_owned(), text)).into())
}

/// Homes and jogs with a configuration; a jog that is `too_large` is repeated.
fn drive(name: &str, files: &Files, too_large: impl Fn(f64) -> bool) -> Moves {
    let mut linuxcnc = LinuxCnc::load(name, files, MACHINE);
    linuxcnc.hal("on");
    linuxcnc.hal(&format!("home {JOINT}"));
    let following = linuxcnc.following(JOINT, JOG, too_large);
    linuxcnc.hal("off");
    // The motor is off. The encoder counts against the joint.
    let zero = linuxcnc.settled(|linuxcnc| {
        linuxcnc.motor(JOINT, "counts") + linuxcnc.position(JOINT) * COUNTS_PER_UNIT
    });
    linuxcnc.halcmd.end();
    Moves { zero, following }
}
