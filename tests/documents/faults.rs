//! The fault contract has a row for each fault that can be simulated, and each row names tests
//! that exist.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use mesa_hal_sim::FaultKind;

const PAGE: &str = include_str!("../../docs/faults.md");

/// The cells of each row of the contract.
fn rows() -> impl Iterator<Item = Vec<&'static str>> {
    let lines = PAGE.lines().filter(|line| line.starts_with("| `"));
    lines.map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
}

/// The texts between backticks.
fn quoted(cell: &str) -> impl Iterator<Item = &str> {
    cell.split('`').skip(1).step_by(2)
}

#[test]
fn fault_contract_has_one_row_for_each_simulator_fault() {
    let names: Vec<_> = rows().filter_map(|row| quoted(row[0]).next()).collect();
    for kind in FaultKind::ALL {
        let found = names.iter().filter(|name| **name == kind.name()).count();
        assert_eq!(found, 1, "{kind} in docs/faults.md");
    }
    for name in &names {
        let is_known = FaultKind::ALL.iter().any(|kind| kind.name() == *name);
        assert!(is_known, "docs/faults.md has {name}, the simulator not");
    }
}

#[test]
fn every_row_of_the_fault_contract_has_a_text_in_each_cell() {
    for row in rows() {
        assert_eq!(row.len(), 8, "{row:?}");
        assert!(row.iter().all(|cell| !cell.is_empty()), "{row:?}");
    }
}

#[test]
fn every_row_of_the_fault_contract_names_tests_that_exist() {
    let mut tests = BTreeSet::new();
    collect(Path::new(env!("CARGO_MANIFEST_DIR")), &mut tests);
    for row in rows() {
        let named: Vec<_> = quoted(row[7]).collect();
        assert!(!named.is_empty(), "{} names no test", row[0]);
        for name in named {
            let exists = tests.contains(name);
            assert!(exists, "{}: `{name}` is no test in `tests`", row[0]);
        }
    }
}

/// Adds the names of the test functions in the sources below `path`.
fn collect(path: &Path, tests: &mut BTreeSet<String>) {
    if path.is_dir() {
        for entry in fs::read_dir(path).expect("a folder") {
            collect(&entry.expect("an entry").path(), tests);
        }
    } else if path.extension().is_some_and(|end| end == "rs") {
        let source = fs::read_to_string(path).expect("a source");
        let after = source.split("#[test]\nfn ").skip(1);
        tests.extend(after.filter_map(|rest| Some(rest.split_once('(')?.0.to_owned())));
    }
}
