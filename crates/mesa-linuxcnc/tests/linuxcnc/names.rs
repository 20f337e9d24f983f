//! Comparison with what hostmot2 makes for the same board.

use std::fs;
use std::path::Path;

use super::session::List;

/// Differences that are as they should be, with reasons. `*` stands for any characters.
type Reasons = &'static [(&'static str, &'static str)];

const ONLY_THEIRS: Reasons = &[];

const ONLY_OURS: Reasons = &[
    ("valid", "of the component: inputs of the board are valid"),
    (
        "7i*.valid",
        "of the component: inputs of the remote are valid",
    ),
    (
        "7i*.armed",
        "of the component: outputs of the remote follow",
    ),
    ("7i*.rearm", "of the component: arms a remote alone"),
    ("armed", "of the component: outputs of the board follow"),
    ("rearm", "of the component: arms the board and its cards"),
    ("lost-writes", "hostmot2 does not notice them"),
    ("*.*.homed", "a joint is homed without an index"),
    (
        "encoder.*.count-unsure",
        "hostmot2 does not notice a gap that hides a wrap-around",
    ),
    ("encoder.*max-count-rate", "hostmot2 does not report it"),
    (
        "encoder.*.position-interpolated",
        "of newer versions of LinuxCNC",
    ),
    (
        "encoder.*.no_clear_on_index",
        "of newer versions of LinuxCNC",
    ),
    (
        "encoder.*.probe-*",
        "latch on probe, made for every encoder",
    ),
    (
        "stepgen.*.position-unsure",
        "hostmot2 goes on after a bite as if nothing were lost",
    ),
    (
        "stepgen.*.near-max-rate",
        "beyond the highest rate no step is lost and the position lags: hostmot2 does not report it",
    ),
    ("stepgen.*.position-lag", "as near-max-rate"),
    (
        "stepgen.*.disable-ramp",
        "hostmot2 stops at once when a generator is disabled",
    ),
    ("7i*.fault-*", "each fault of a remote is a pin"),
    ("7i*.running", "remotes go offline alone"),
    ("7i*.failures", "failures are counted for each remote"),
    ("7i*.restarts", "remotes come back by themselves"),
    ("sserial.port-*.transfers", "statistics"),
    ("sserial.port-*.too-short", "statistics"),
];

const OTHER_VALUE: Reasons = &[
    (
        "*input-*-not",
        "as a tripped switch that is normally closed shows, until the input was valid",
    ),
    ("gpio.*.in*", "a level, read at another moment of the load"),
    ("dpll.ddsize", "hostmot2 reads it when the thread starts"),
    (
        "dpll.prescale",
        "hostmot2 computes it when the thread starts",
    ),
    (
        "dpll.phase-error-us",
        "the clock runs freely before the thread",
    ),
    (
        "sserial.port-*.port_state",
        "the load has started the remotes",
    ),
];

/// Keeps a list below `target/tmp`, for comparison with others.
pub fn keep(driver: &str, list: &List) {
    let lines = list
        .iter()
        .map(|(name, entry)| format!("{name} {}\n", entry.join(" ")));
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{driver}.list"));
    fs::write(path, lines.collect::<String>()).expect("it is written");
}

/// Fails for each difference without a reason, and if fewer than `at_least` are the same.
pub fn compare(theirs: &List, ours: &List, at_least: usize) {
    let mut wrong = Vec::new();
    let mut same = 0;
    for (name, [kind, direction, value]) in theirs {
        let Some([own_kind, own_direction, own_value]) = ours.get(name) else {
            if !is_known(ONLY_THEIRS, name) && !is_of_function(name) {
                wrong.push(format!(
                    "only hostmot2: {kind} {direction} {name} = {value}"
                ));
            }
            continue;
        };
        if [kind, direction] != [own_kind, own_direction] {
            wrong.push(format!(
                "{name}: hostmot2 {kind} {direction}, ours {own_kind} {own_direction}"
            ));
        } else if value != own_value && !is_known(OTHER_VALUE, name) && !is_of_function(name) {
            wrong.push(format!("{name}: hostmot2 {value}, ours {own_value}"));
        } else {
            same += 1;
        }
    }
    for (name, [kind, direction, value]) in ours {
        if !theirs.contains_key(name) && !is_known(ONLY_OURS, name) {
            wrong.push(format!("only ours: {kind} {direction} {name} = {value}"));
        }
    }
    println!(
        "hostmot2 has {}, ours {}, the same {same}",
        theirs.len(),
        ours.len()
    );
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(same >= at_least, "only {same} are the same");
}

/// Times of functions, which HAL makes and which differ in each run.
fn is_of_function(name: &str) -> bool {
    let last = name.rsplit('.').next();
    last.is_some_and(|last| last == "time" || last.starts_with("tmax"))
}

fn is_known(reasons: Reasons, name: &str) -> bool {
    reasons.iter().any(|(pattern, _)| fits(pattern, name))
}

fn fits(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((head, tail)) => name.strip_prefix(head).is_some_and(|rest| {
            let mut starts = (0..=rest.len()).filter(|&at| rest.is_char_boundary(at));
            starts.any(|at| fits(tail, &rest[at..]))
        }),
    }
}
