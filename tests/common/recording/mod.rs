//! Recordings of Mesa's gateware in `tests/transcripts`: files of lines with a time each, their
//! comparison with a replay, and the proof that the comparison can fail.

mod text;

pub mod sslbp;

use std::fmt;
use std::path::{Path, PathBuf};

use mesa_hal_sim::wire::Nanos;

pub use text::{decimal, hexadecimal, split};

/// Number of differences that are shown for each file.
const SHOWN: usize = 12;

/// A file, one line after the other. Nothing is skipped: a line that does not parse is an error
/// that contains file and line.
pub trait Recording: Clone {
    /// The content of a line.
    type Event: Clone;

    fn new(name: &str) -> Self;

    /// File name without directory and extension.
    fn name(&self) -> &str;

    /// Parses and adds one line; `line` counts from 1.
    fn take(&mut self, line: usize, text: &str) -> Result<(), String>;

    /// True if header and entries are present.
    fn is_complete(&self) -> bool;

    fn entries_mut(&mut self) -> &mut Vec<Entry<Self::Event>>;

    /// Adds an entry, whose time must not be before that of the previous one.
    fn push(&mut self, line: usize, time: Nanos, event: Self::Event) -> Result<(), String> {
        let entries = self.entries_mut();
        let previous = entries.last().map_or(0, |entry| entry.time);
        if time < previous {
            return Err(format!(
                "its time is before {previous}, that of the line before"
            ));
        }
        entries.push(Entry { line, time, event });
        Ok(())
    }

    fn parse(name: &str, text: &str) -> Result<Self, Unreadable> {
        let unreadable = |line, reason| Unreadable {
            file: name.to_owned(),
            line,
            reason,
        };
        let mut recording = Self::new(name);
        let mut lines = 0;
        for line in text.lines() {
            lines += 1;
            recording
                .take(lines, line)
                .map_err(|reason| unreadable(lines, reason))?;
        }
        if text.ends_with('\n') && recording.is_complete() {
            return Ok(recording);
        }
        let reason = "the file has no header, no entries, or ends in the middle of a line";
        Err(unreadable(lines, reason.to_owned()))
    }

    fn load(path: &Path) -> Result<Self, Unreadable> {
        let name = path
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let text = std::fs::read_to_string(path).map_err(|error| Unreadable {
            file: name.clone(),
            line: 0,
            reason: error.to_string(),
        })?;
        Self::parse(&name, &text)
    }

    /// A recording of the project.
    fn own(directory: &str, name: &str) -> Self {
        let path = own_directory(directory).join(format!("{name}.txt"));
        Self::load(&path).unwrap_or_else(|error| panic!("{error}"))
    }
}

/// A line of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry<E> {
    /// Line number in the file, from 1.
    pub line: usize,
    /// The time at the beginning of the line.
    pub time: Nanos,
    /// The content of the line.
    pub event: E,
}

/// A line that cannot be parsed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unreadable {
    /// File name.
    pub file: String,
    /// Line number, from 1.
    pub line: usize,
    /// The defect.
    pub reason: String,
}

impl fmt::Display for Unreadable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, line {}: {}", self.file, self.line, self.reason)
    }
}

/// An item that differs from the recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Line of the recording.
    pub line: usize,
    /// The recorded item.
    pub expected: String,
    /// The simulated item.
    pub actual: String,
}

/// Number of comparisons, and the differences.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Number of things compared.
    pub compared: usize,
    /// The differences.
    pub differences: Vec<Difference>,
}

impl Outcome {
    /// Counts one comparison; records the expected and the actual item if they differ.
    pub fn compare(
        &mut self,
        same: bool,
        line: usize,
        describe: impl FnOnce() -> (String, String),
    ) {
        self.compared += 1;
        if !same {
            let (expected, actual) = describe();
            self.differences.push(Difference {
                line,
                expected,
                actual,
            });
        }
    }

    /// Records an item that cannot be compared at all, which is a difference, too.
    pub fn fail(&mut self, line: usize, expected: String, reason: String) {
        self.compare(false, line, || (expected, reason));
    }

    /// Adds the result of another comparison of the same file.
    pub fn add(&mut self, other: Self) {
        self.compared += other.compared;
        self.differences.extend(other.differences);
        self.differences.sort_by_key(|difference| difference.line);
    }
}

/// The project's own recordings: a folder of `tests`.
pub fn own_directory(directory: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(directory)
}

/// All recordings of a directory, sorted by name, without `index.txt`.
pub fn files(directory: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(directory)
        .unwrap_or_else(|error| panic!("{}: {error}", directory.display()))
        .map(|entry| entry.expect("a readable directory").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "txt"))
        .filter(|path| path.file_name().is_some_and(|name| name != "index.txt"))
        .collect();
    files.sort();
    files
}

/// Replays every file of a directory, or of the one that an environment variable names. Prints one
/// line for each, and panics if anything differs, cannot be read, or was not compared.
///
/// `replay` returns an outcome for each side that it examines, or the reason why the file cannot be
/// replayed.
pub fn replay_all<R: Recording>(
    variable: &str,
    directory: &str,
    replay: impl Fn(&R) -> Result<Vec<(&'static str, Outcome)>, String>,
) {
    let directory =
        std::env::var_os(variable).map_or_else(|| own_directory(directory), PathBuf::from);
    let files = files(&directory);
    assert!(
        !files.is_empty(),
        "no recordings in {}",
        directory.display()
    );
    let (mut compared, mut failed) = (0, 0);
    for path in &files {
        let sides = R::load(path)
            .map_err(|unreadable| unreadable.to_string())
            .and_then(|recording| {
                replay(&recording).map_err(|why| format!("{}: {why}", recording.name()))
            });
        let items = sides.map(|sides| print(path, &sides));
        match items {
            Ok((items, true)) => compared += items,
            Ok((_, false)) => failed += 1,
            Err(why) => {
                println!("{why}");
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

/// Prints the result for a file; returns the number of comparisons, and true if all of them match.
fn print(path: &Path, sides: &[(&str, Outcome)]) -> (usize, bool) {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let compared: usize = sides.iter().map(|(_, outcome)| outcome.compared).sum();
    let differing: usize = sides
        .iter()
        .map(|(_, outcome)| outcome.differences.len())
        .sum();
    println!("{name}: compared {compared}, differing {differing}");
    for (side, outcome) in sides {
        for difference in outcome.differences.iter().take(SHOWN) {
            println!(
                "    {side}line {}: recorded: {}; simulated: {}",
                difference.line, difference.expected, difference.actual
            );
        }
    }
    if compared == 0 {
        println!("    nothing was compared");
    }
    (compared, differing == 0 && compared > 0)
}

/// Alters one entry after the other; returns the number of alterations, and the lines whose
/// alteration `differs` did not detect.
pub fn unnoticed<R: Recording>(
    original: &R,
    differs: impl Fn(&R) -> bool,
    alter: impl Fn(&mut Entry<R::Event>) -> bool,
) -> (usize, Vec<usize>) {
    let mut altered = 0;
    let mut missed = Vec::new();
    for index in 0..original.clone().entries_mut().len() {
        let mut copy = original.clone();
        let entry = &mut copy.entries_mut()[index];
        let line = entry.line;
        if alter(entry) {
            altered += 1;
            if !differs(&copy) {
                missed.push(line);
            }
        }
    }
    (altered, missed)
}
