//! Replays the recorded transcripts of the real gateware's modules against the simulated ones.
//!
//! `MODULE_TRANSCRIPTS` selects another directory than `tests/transcripts/modules`, whose
//! `index.txt` describes format and rules of comparison. One line for each file contains the number
//! of comparisons; any difference, and any file that cannot be read completely, is a failure.
//!
//! # Files and families
//! The letters at the beginning of a file's name choose its family in [`FAMILIES`], and each family
//! is one file of `module_conformance/`:
//!
//! | file | families |
//! |---|---|
//! | `pins.rs` | `io`, `wd`, `led`, `ssr` |
//! | `pwm.rs` | `pwm` |
//! | `encoder.rs` | `enc`, `qc` |
//! | `dpll.rs` | `dpll` |
//! | `inputs.rs` | `im`, `in` |
//! | `stepgen.rs` | `sg` |
//!
//! Its `REPLAY` builds a [`bench::Bench`] with the firmware that the file was recorded on, and lets
//! [`runner`] apply the stimuli and compare. A file of no family fails.
//!
//! [`runner::replay`] compares every read and every pin at its nanosecond.
//! [`runner::replay_within`] replays several times with all stimuli delayed by a part of a
//! free-running divider's period, and takes a value as right if one of the replays shows it.
//! Comparisons of a family's own (`skip` in [`runner::Rules`]) are added with [`Outcome::compare`].

mod bench;
#[path = "../common/mod.rs"]
mod common;
mod damage;
mod dpll;
mod encoder;
mod inputs;
mod pins;
mod pwm;
mod register;
mod runner;
mod stepgen;
mod transcript;

use common::recording::{Outcome, replay_all};
use transcript::Transcript;

/// The transcripts that belong to the project.
const DIRECTORY: &str = "transcripts/modules";

/// Replays a file and compares.
pub type Replay = fn(&Transcript) -> Outcome;

/// Letters that begin a file's name, and the function that replays it.
type Family = (&'static str, Replay);

/// All families.
const FAMILIES: [Family; 11] = [
    ("io", pins::REPLAY),
    ("wd", pins::REPLAY),
    ("led", pins::REPLAY),
    ("ssr", pins::REPLAY),
    ("pwm", pwm::REPLAY),
    ("enc", encoder::REPLAY),
    ("qc", encoder::REPLAY),
    ("dpll", dpll::REPLAY),
    ("im", inputs::REPLAY),
    ("in", inputs::REPLAY),
    ("sg", stepgen::REPLAY),
];

/// The family of a file: its name begins with the family's letters, followed by no other letter.
fn family(name: &str) -> Option<&'static Family> {
    let letters = name
        .find(|c: char| !c.is_ascii_lowercase())
        .map_or(name, |end| &name[..end]);
    FAMILIES.iter().find(|(family, _)| *family == letters)
}

#[test]
fn simulated_modules_do_what_was_recorded() {
    replay_all(
        "MODULE_TRANSCRIPTS",
        DIRECTORY,
        |transcript: &Transcript| {
            let (_, replay) =
                family(&transcript.name).ok_or("no family of modules has this name")?;
            Ok(vec![("", replay(transcript))])
        },
    );
}
