//! Comparison of the pins and parameters of `mesa-hal` with LinuxCNC's for the same machine.

use std::collections::BTreeMap;

use mesa_hal::hal::{PinInfo, Pins};

use super::expected::List;

/// Reasons for names on one side only. `*` stands for any characters.
type Reasons = &'static [(&'static str, &'static str)];

const ONLY_LINUXCNC: Reasons = &[
    ("*.debug", "of the hostmot2 module, not of a board"),
    (
        "*.time",
        "how long LinuxCNC's own functions take: see DriverStatistics",
    ),
    ("*.tmax*", "how long LinuxCNC's own functions take"),
    (
        "pwmgen.p*_frequency",
        "of a descriptor without instances, where there are no generators",
    ),
    ("gpio.*.in*", "level of a pin that a module uses"),
    (
        "gpio.*.out",
        "of a pin of serial channel that is not used here",
    ),
    (
        "gpio.*.is_output",
        "of a pin of a serial channel that is not used here",
    ),
    (
        "gpio.*.invert_output",
        "of a pin of a serial channel that is not used here",
    ),
    (
        "gpio.*.is_opendrain",
        "of a pin of a serial channel that is not used here",
    ),
    ("*.invert_output", "another name of gpio.NNN.invert_output"),
    ("*.is_opendrain", "another name of gpio.NNN.is_opendrain"),
];

const ONLY_OURS: Reasons = &[
    ("lost-writes", "LinuxCNC does not notice them"),
    (
        "encoder.*.count-unsure",
        "LinuxCNC does not notice a gap that hides a wrap-around",
    ),
    (
        "encoder.*.max-count-rate",
        "LinuxCNC does not tell which rates are followed",
    ),
    (
        "encoder.*.near-max-count-rate",
        "LinuxCNC does not notice a speed that is not followed",
    ),
    (
        "encoder.*.probe-enable",
        "latch on probe, made for every encoder",
    ),
    (
        "encoder.*.probe-invert",
        "latch on probe, made for every encoder",
    ),
    (
        "gpio.*.invert_output",
        "LinuxCNC shows it under its other name",
    ),
    (
        "gpio.*.is_opendrain",
        "LinuxCNC shows it under its other name",
    ),
    ("7i*.fault-*", "each fault of a remote is a pin of its own"),
    ("7i*.running", "remotes go offline alone"),
    ("7i*.failures", "failures are counted for each remote"),
    ("7i*.restarts", "remotes come back by themselves"),
    ("sserial.port-*.transfers", "statistics"),
    ("sserial.port-*.too-short", "statistics"),
];

/// Fails if a type or a direction differs, if a name is on one side only without a reason, or if
/// fewer than `at_least` names are on both sides.
pub fn compare(prefix: &str, [pins, params]: [&List; 2], ours: &Pins, at_least: usize) {
    let linuxcnc: BTreeMap<_, _> = pins.iter().chain(params).collect();
    let of = |info: &PinInfo| {
        let name = info.name.strip_prefix(&format!("{prefix}."));
        let name = name.unwrap_or(&info.name).to_owned();
        let kind = info.hal_type.as_str().to_owned();
        (name, (kind, info.role.hal_direction().to_owned()))
    };
    let ours: List = ours.infos().iter().map(of).collect();

    let mut wrong = Vec::new();
    let mut same = 0;
    for (name, theirs) in &linuxcnc {
        match ours.get(*name) {
            Some(own) if own == *theirs => same += 1,
            Some(own) => wrong.push(format!("{name}: LinuxCNC {theirs:?}, ours {own:?}")),
            None if reason(ONLY_LINUXCNC, name).is_some() => {}
            None => wrong.push(format!("{name}: only LinuxCNC has it: {theirs:?}")),
        }
    }
    for (name, own) in &ours {
        if !linuxcnc.contains_key(name) && reason(ONLY_OURS, name).is_none() {
            wrong.push(format!("{name}: only we have it: {own:?}"));
        }
    }
    println!(
        "{prefix}: {same} names, types and directions are LinuxCNC's; it has {}, we have {}",
        linuxcnc.len(),
        ours.len()
    );
    let theirs_alone: Vec<&str> = linuxcnc
        .keys()
        .map(|name| name.as_str())
        .filter(|name| !ours.contains_key(*name))
        .collect();
    let ours_alone: Vec<&str> = ours
        .keys()
        .map(String::as_str)
        .filter(|name| !linuxcnc.contains_key(&(*name).to_owned()))
        .collect();
    print_reasons("only LinuxCNC", ONLY_LINUXCNC, &theirs_alone);
    print_reasons("only ours", ONLY_OURS, &ours_alone);
    assert!(wrong.is_empty(), "{prefix}: {wrong:#?}");
    assert!(same > at_least, "{prefix}: only {same} names are the same");
}

fn print_reasons(side: &str, reasons: Reasons, alone: &[&str]) {
    for (pattern, why) in reasons {
        let is_it = |name: &&&str| reason(reasons, name) == Some((pattern, why));
        let count = alone.iter().filter(is_it).count();
        if count > 0 {
            println!("  {side}: {count} {pattern}: {why}");
        }
    }
}

fn reason<'r>(reasons: &'r [(&'r str, &'r str)], name: &str) -> Option<(&'r &'r str, &'r &'r str)> {
    reasons
        .iter()
        .find(|(pattern, _)| fits(pattern, name))
        .map(|(pattern, why)| (pattern, why))
}

/// True if `name` matches `pattern`, in which `*` stands for any characters.
fn fits(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((head, tail)) => name.strip_prefix(head).is_some_and(|rest| {
            (0..=rest.len())
                .filter(|&at| rest.is_char_boundary(at))
                .any(|at| fits(tail, &rest[at..]))
        }),
    }
}
