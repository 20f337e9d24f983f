//! Files, types and functions that `ARCHITECTURE.md` names exist.

use std::fs;
use std::path::PathBuf;

const PAGE: &str = include_str!("../../ARCHITECTURE.md");

/// Texts between backticks on the page.
fn quoted() -> impl Iterator<Item = &'static str> {
    PAGE.split('`').skip(1).step_by(2)
}

fn sources(folder: PathBuf, texts: &mut Vec<String>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(path, texts);
        } else if path.extension().is_some_and(|end| end == "rs") {
            texts.push(fs::read_to_string(path).expect("a source"));
        }
    }
}

#[test]
fn each_path_is_there() {
    let is_path = |word: &&str| {
        ["src/", "tests/", "crates/"]
            .iter()
            .any(|at| word.starts_with(at))
    };
    let mut paths = quoted().filter(is_path).peekable();
    assert!(paths.peek().is_some());
    for path in paths {
        assert!(crate::root().join(path).exists(), "{path}");
    }
}

/// A name with a path exists if both its type and its function, variant or field are defined.
#[test]
fn each_name_is_defined() {
    let mut texts = Vec::new();
    for folder in [
        "src",
        "crates/mesa-hal-sim/src",
        "crates/mesa-tools/src",
        "crates/mesa-wire/src",
    ] {
        sources(crate::root().join(folder), &mut texts);
    }
    let is_defined = |ways: &[String]| {
        let mut texts = texts.iter();
        texts.any(|text| ways.iter().any(|way| text.contains(way)))
    };
    let names = quoted().filter_map(|word| word.split_once("::"));
    let names: Vec<_> = names.collect();
    assert!(names.len() > 30, "{names:?}");
    for (owner, name) in names {
        let kinds = ["struct", "enum", "trait"];
        let owners = kinds.map(|kind| format!("{kind} {owner}"));
        assert!(is_defined(&owners), "{owner}");
        let is_variant = name.starts_with(char::is_uppercase);
        let ways = if is_variant {
            [" {", "(", ","]
                .map(|end| format!("    {name}{end}"))
                .to_vec()
        } else {
            let functions = ["(", "<"].map(|end| format!("fn {name}{end}"));
            let field = format!("pub {name}: ");
            [functions.to_vec(), vec![field]].concat()
        };
        assert!(is_defined(&ways), "{owner}::{name}");
    }
}
