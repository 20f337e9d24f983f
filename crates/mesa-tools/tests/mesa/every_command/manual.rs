//! Documentation by `mesa` itself: help, completions, manual pages.

use std::fs;
use std::path::PathBuf;

use crate::run::{done, run};

/// Names of all commands in the help.
pub fn commands() -> Vec<String> {
    let help = done(&["--help"]);
    let (_, rest) = help.split_once("Commands:\n").expect("a list");
    let (list, _) = rest.split_once("\n\n").expect("its end");
    // Continuation lines have a deeper indent.
    let is_name = |line: &&str| line.starts_with("  ") && !line.starts_with("   ");
    let lines = list.lines().filter(is_name);
    let names = lines.filter_map(|line| line.split_whitespace().next());
    let names = names.filter(|name| *name != "help");
    names.map(str::to_owned).collect()
}

#[test]
fn shells_and_manuals_know_every_command() {
    let script = done(&["completions", "bash"]);
    let directory = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("man");
    fs::create_dir_all(&directory).expect("a directory");
    done(&["man", directory.to_str().expect("UTF-8")]);
    for command in commands() {
        assert!(script.contains(&command), "{command}");
        let page = directory.join(format!("mesa-{command}.1"));
        let page = fs::read_to_string(page).expect("a page");
        assert!(page.contains("SYNOPSIS"), "{command}: {page}");
    }
}

#[test]
fn a_directory_that_is_not_there_is_said() {
    let run = run(&["man", "/nowhere/at/all"]);
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(run.err.contains("make it first"), "{run:?}");
}

#[test]
fn bad_usage_ends_with_2_and_nothing_on_standard_output() {
    for arguments in [&["nonsense"][..], &[], &["led", "--nonsense"]] {
        let run = run(arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {run:?}");
        assert_eq!(run.out, "", "{arguments:?}");
        assert!(run.err.contains("Usage"), "{arguments:?}: {run:?}");
    }
}

/// Of two entries with one name a parser keeps only the last.
#[test]
fn the_schema_names_each_thing_once() {
    let schema = include_str!("../../../../../docs/mesa.schema.json");
    let entries = schema.lines().filter_map(|line| {
        let entry = line.strip_prefix("    \"")?;
        entry.split_once("\":").map(|(name, _)| name)
    });
    let mut names: Vec<&str> = entries.collect();
    let count = names.len();
    assert!(count > 30, "{names:?}");
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), count, "{names:?}");
}
