//! Replays the recorded transcripts of the real gateware against the simulator, and compares.
//!
//! `GATEWARE_TRANSCRIPTS` names another directory than `tests/transcripts`. One line for each file
//! says how much was compared; any difference, and any file that can not be read whole, fails.

mod damage;
mod doit_time;
mod fpga_side;
mod outcome;
mod phase;
mod remote_side;
mod shifted;
mod transcript;
mod wire_log;

use std::path::{Path, PathBuf};

use transcript::Transcript;

/// Differences that are shown for each file.
const SHOWN: usize = 12;

fn directory() -> PathBuf {
    std::env::var_os("GATEWARE_TRANSCRIPTS").map_or_else(own_directory, PathBuf::from)
}

/// The transcripts that belong to the project.
fn own_directory() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/transcripts")
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

/// Compares one file from both ends of the wire; prints what was found, and says whether all is as
/// recorded.
fn check(transcript: &Transcript) -> (usize, bool) {
    let sides = [
        ("FPGA", fpga_side::replay(transcript)),
        ("remote", remote_side::replay(transcript)),
    ];
    let compared: usize = sides.iter().map(|(_, outcome)| outcome.compared).sum();
    let differing: usize = sides
        .iter()
        .map(|(_, outcome)| outcome.differences.len())
        .sum();
    println!(
        "{}: compared {compared}, differing {differing}",
        transcript.name
    );
    for (side, outcome) in &sides {
        for difference in outcome.differences.iter().take(SHOWN) {
            println!(
                "    {side} side, line {}: recorded: {}; simulated: {}",
                difference.line, difference.expected, difference.actual
            );
        }
    }
    (compared, differing == 0)
}

#[test]
fn simulated_fpga_and_remotes_do_what_was_recorded() {
    let directory = directory();
    let files = files(&directory);
    assert!(
        !files.is_empty(),
        "no transcripts in {}",
        directory.display()
    );
    let (mut compared, mut failed) = (0, 0);
    for path in &files {
        match Transcript::load(path) {
            Ok(transcript) => {
                let (items, same) = check(&transcript);
                compared += items;
                failed += usize::from(!same);
            }
            Err(unreadable) => {
                println!("{unreadable}");
                failed += 1;
            }
        }
    }
    println!(
        "{} files, {compared} items compared, {failed} files differ",
        files.len()
    );
    assert_eq!(failed, 0, "files that differ from their recording");
}
