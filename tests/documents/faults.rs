//! The fault contract has a row for each fault that can be simulated.

use mesa_hal_sim::FaultKind;

const PAGE: &str = include_str!("../../docs/faults.md");

/// The names in the first column of the contract's table.
fn rows() -> Vec<&'static str> {
    let names = PAGE.lines().filter_map(|line| line.strip_prefix("| `"));
    names.filter_map(|rest| rest.split('`').next()).collect()
}

#[test]
fn the_fault_contract_has_exactly_one_row_for_each_fault_of_the_simulator() {
    let rows = rows();
    for kind in FaultKind::ALL {
        let found = rows.iter().filter(|row| **row == kind.name()).count();
        assert_eq!(found, 1, "{kind} in docs/faults.md");
    }
    for row in &rows {
        let is_known = FaultKind::ALL.iter().any(|kind| kind.name() == *row);
        assert!(is_known, "docs/faults.md has {row}, the simulator not");
    }
}

#[test]
fn every_row_of_the_fault_contract_says_everything() {
    for line in PAGE.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<_> = line.trim_matches('|').split('|').collect();
        assert_eq!(cells.len(), 7, "{line}");
        assert!(cells.iter().all(|cell| !cell.trim().is_empty()), "{line}");
    }
}
