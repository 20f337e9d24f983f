//! Documentation by `mesa` itself: help, completions, manual pages.

use std::fs;

use crate::interop::Scratch;
use crate::run::{done, run};

/// Names of all commands in the help.
pub fn commands() -> Vec<String> {
    let help = done(&["--help"]);
    let (_, rest) = help.split_once("\nLook:\n").expect("the first group");
    let (list, _) = rest.split_once("\nOptions:\n").expect("their end");
    let lines = list.lines().filter(|line| line.starts_with("  "));
    let names = lines.filter_map(|line| line.split_whitespace().next());
    let names: Vec<String> = names.map(str::to_owned).collect();
    assert!(names.len() > 20, "{names:?}");
    names
}

#[test]
fn manual_has_a_page_of_every_command() {
    let above = Scratch::new("share");
    let directory = above.0.join("man").join("man1");
    done(&["man", directory.to_str().expect("UTF-8")]);
    for command in commands() {
        let page = directory.join(format!("mesa-{command}.1"));
        let page = fs::read_to_string(page).expect("a page");
        assert!(page.contains("SYNOPSIS"), "{command}: {page}");
    }
}

#[test]
fn directory_that_cannot_be_created_is_reported() {
    for directory in ["/proc/at/all", "/dev/null"] {
        let run = run(&["man", directory]);
        assert_eq!(run.code, Some(1), "{run:?}");
        assert!(run.err.contains(directory), "{run:?}");
        assert!(run.err.contains("name another directory"), "{run:?}");
    }
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
fn schema_names_each_thing_once() {
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
