//! Names that are not here, or that differ, as they should: with reasons.

use super::list::{Entry, List};

/// A list, a name, the listed value, and the reason. `*` stands for any characters.
type Reasons = &'static [(&'static str, &'static str, &'static str, &'static str)];

/// Names that are not here, or have another type or direction.
const NAMES: Reasons = &[];

const VALUES: Reasons = &[
    (
        "*",
        "*.nvunitnumber",
        "*",
        "each card has a number of its own",
    ),
    ("7i97t*", "*", "*", "listed while a machine used the board"),
    (
        "*",
        "encoder.sample-frequency",
        "0x00001FC8",
        "hostmot2 takes each clock of 33.3 MHz and shows 8136 Hz; here it is 16.7 MHz, and shown",
    ),
];

/// True if a name is missing, or has another type or direction, for a reason.
pub fn of_name(list: &List, name: &str, listed: &Entry) -> bool {
    is_known(NAMES, list, name, listed)
}

/// True if a value differs for a reason.
pub fn of_value(list: &List, name: &str, listed: &Entry) -> bool {
    is_known(VALUES, list, name, listed)
}

fn is_known(reasons: Reasons, list: &List, name: &str, listed: &Entry) -> bool {
    reasons.iter().any(|(lists, names, values, _)| {
        fits(lists, &list.name) && fits(names, name) && fits(values, &listed.value)
    })
}

fn fits(pattern: &str, text: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == text,
        Some((head, tail)) => text.strip_prefix(head).is_some_and(|rest| {
            let mut ends = (0..=rest.len()).filter(|&at| rest.is_char_boundary(at));
            ends.any(|at| fits(tail, &rest[at..]))
        }),
    }
}

#[test]
fn reason_is_for_its_own_names_alone() {
    for (pattern, text, expected) in [
        ("*", "anything", true),
        ("*.nvunitnumber", "7i76.0.2.nvunitnumber", true),
        ("*.nvunitnumber", "7i76.0.2.nvunitnumbers", false),
        ("7i97t*", "7i97t", true),
        ("7i97t*", "7i97", false),
    ] {
        assert_eq!(fits(pattern, text), expected, "{pattern} {text}");
    }
}
