//! Mesa's public firmwares, by their identity memories: each is identified, named, started and
//! driven behind the simulated bus.
//!
//! The images are in `tests/transcripts/firmwares`, one file each, with their provenance. The
//! environment variable `FIRMWARES` selects another directory of such files. The expected values
//! are read from the words by [`truth`], which shares nothing with the crate.

mod driven;
mod identified;
mod listened;
mod names;
mod truth;

use std::fs;
use std::path::PathBuf;

use truth::Truth;

/// A firmware: the name of its file, its text and its contents.
struct Image {
    name: String,
    text: String,
    truth: Truth,
}

/// All images of the directory, by name.
fn images() -> Vec<Image> {
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/transcripts/firmwares");
    let directory = std::env::var_os("FIRMWARES").map_or_else(|| own.into(), PathBuf::from);
    let entries = fs::read_dir(&directory);
    let entries = entries.unwrap_or_else(|error| panic!("{}: {error}", directory.display()));
    let paths = entries.map(|entry| entry.expect("a file").path());
    // Other files in the directory describe the images.
    let is_image = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        path.extension().is_some_and(|kind| kind == "txt") && name != "README" && name != "index"
    };
    let mut paths: Vec<PathBuf> = paths.filter(is_image).collect();
    paths.sort();
    assert!(!paths.is_empty(), "{}: no images", directory.display());
    let image = |path: PathBuf| {
        let name = path.file_stem().unwrap_or_default();
        let text = fs::read_to_string(&path).expect("a text");
        Image {
            name: name.to_string_lossy().into_owned(),
            truth: Truth::read(&text),
            text,
        }
    };
    paths.into_iter().map(image).collect()
}

/// Runs a check of each image; reports all failures.
fn each(check: impl Fn(&Image) -> Result<(), String>) {
    let images = images();
    let failures = images.iter().filter_map(|image| {
        let failure = check(image).err()?;
        Some(format!("{}: {failure}", image.name))
    });
    let failures: Vec<String> = failures.collect();
    assert!(
        failures.is_empty(),
        "{} of {}:\n{}",
        failures.len(),
        images.len(),
        failures.join("\n")
    );
}

/// Fails with the difference.
fn same<T: PartialEq + std::fmt::Debug>(what: &str, found: &T, expected: &T) -> Result<(), String> {
    if found == expected {
        return Ok(());
    }
    Err(format!("{what}: {found:?}, expected {expected:?}"))
}
