//! Replays the recorded transcripts of the real gateware's modules against the simulated ones.
//!
//! `MODULE_TRANSCRIPTS` names another directory than `tests/transcripts/modules`, whose `index.txt`
//! describes format and rules of comparison. One line for each file says how much was compared;
//! any difference, and any file that can not be read whole, fails.
//!
//! # Who replays what
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
//!
//! Its `REPLAY` builds a [`bench::Bench`] with the firmware that the file was recorded on, and lets
//! [`runner`] apply the stimuli and compare. A file of no family fails.
//!
//! [`runner::replay`] compares every read and every pin at its nanosecond. [`runner::replay_within`]
//! replays several times with all stimuli delayed by a part of a free-running divider's period, and
//! takes a value as right if one of the replays shows it. What a family compares in a way of its
//! own (`skip` in [`runner::Rules`]) it adds with [`outcome::Outcome::compare`].

mod bench;
mod damage;
mod dpll;
mod encoder;
mod inputs;
mod outcome;
mod pins;
mod pwm;
mod register;
mod runner;
mod transcript;

use std::path::{Path, PathBuf};

use outcome::Outcome;
use transcript::Transcript;

/// Differences that are shown for each file.
const SHOWN: usize = 12;

/// Replays a file and compares.
pub type Replay = fn(&Transcript) -> Outcome;

/// Letters that begin a file's name, and what replays it.
type Family = (&'static str, Replay);

/// All families.
const FAMILIES: [Family; 10] = [
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
];

fn directory() -> PathBuf {
    std::env::var_os("MODULE_TRANSCRIPTS").map_or_else(own_directory, PathBuf::from)
}

/// The transcripts that belong to the project.
fn own_directory() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/transcripts/modules")
}

/// All transcripts of a directory, in the order of their names; `index.txt` is none.
fn files(directory: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(directory)
        .unwrap_or_else(|error| panic!("{}: {error}", directory.display()))
        .map(|entry| entry.expect("a readable directory").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "txt"))
        .filter(|path| path.file_name().is_some_and(|name| name != "index.txt"))
        .collect();
    files.sort();
    files
}

/// The family of a file: its name begins with the family's letters, and then comes no other.
fn family(name: &str) -> Option<&'static Family> {
    let letters = name
        .find(|c: char| !c.is_ascii_lowercase())
        .map_or(name, |end| &name[..end]);
    FAMILIES.iter().find(|(family, _)| *family == letters)
}

/// Compares one file; prints what was found. `Err` if something differs or could not be compared.
fn check(path: &Path) -> Result<usize, ()> {
    let transcript = Transcript::load(path).map_err(|unreadable| println!("{unreadable}"))?;
    let name = &transcript.name;
    let Some((_, replay)) = family(name) else {
        println!("{name}: no family of modules has this name");
        return Err(());
    };
    let outcome = replay(&transcript);
    println!(
        "{name}: compared {}, differing {}",
        outcome.compared,
        outcome.differences.len()
    );
    for difference in outcome.differences.iter().take(SHOWN) {
        println!(
            "    line {}: recorded: {}; simulated: {}",
            difference.line, difference.expected, difference.actual
        );
    }
    if outcome.compared == 0 {
        println!("    nothing was compared");
        return Err(());
    }
    outcome
        .differences
        .is_empty()
        .then_some(outcome.compared)
        .ok_or(())
}

#[test]
fn simulated_modules_do_what_was_recorded() {
    let directory = directory();
    let files = files(&directory);
    assert!(
        !files.is_empty(),
        "no transcripts in {}",
        directory.display()
    );
    let results: Vec<_> = files.iter().map(|path| check(path)).collect();
    let compared: usize = results.iter().flatten().sum();
    let failed = results.iter().filter(|result| result.is_err()).count();
    println!(
        "{} files, {compared} items compared, {failed} files differ",
        files.len()
    );
    assert_eq!(failed, 0, "files that differ from their recording");
}
