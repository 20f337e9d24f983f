//! Comparison of the pins and parameters of `mesa-hal` with LinuxCNC's for the same machine: names,
//! types, directions, and the values of a fresh load.

use std::collections::BTreeMap;

use mesa_hal::hal::{PinId, PinInfo, Pins, Role};

use super::expected::List;

/// Reasons for names on one side only. `*` stands for any characters.
type Reasons = &'static [(&'static str, &'static str)];

const ONLY_LINUXCNC: Reasons = &[
    (
        "*.time",
        "how long LinuxCNC's own functions take: see DriverStatistics",
    ),
    ("*.tmax*", "how long LinuxCNC's own functions take"),
    (
        "pwmgen.p*_frequency",
        "of a descriptor without instances, where there are no generators",
    ),
];

const ONLY_OURS: Reasons = &[
    ("lost-writes", "LinuxCNC does not notice them"),
    ("*.*.homed", "a joint is homed without an index"),
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
        "encoder.*.position-interpolated",
        "of newer versions of LinuxCNC",
    ),
    (
        "encoder.*.no_clear_on_index",
        "of newer versions of LinuxCNC",
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
        "stepgen.*.position-unsure",
        "LinuxCNC goes on after a bite as if nothing were lost",
    ),
    (
        "stepgen.*.near-max-rate",
        "beyond the highest rate the position lags, and LinuxCNC does not notice it",
    ),
    ("stepgen.*.position-lag", "as near-max-rate"),
    (
        "stepgen.*.disable-ramp",
        "LinuxCNC stops at once when a generator is disabled",
    ),
    ("7i*.fault-*", "each fault of a remote is a pin of its own"),
    ("7i*.running", "remotes go offline alone"),
    ("7i*.failures", "failures are counted for each remote"),
    ("7i*.restarts", "remotes come back by themselves"),
    ("sserial.port-*.transfers", "statistics"),
    ("sserial.port-*.too-short", "statistics"),
];

/// Differences of initial values. `*` stands for any characters.
const OTHER_VALUES: Reasons = &[
    (
        "dpll.base-freq-khz",
        "LinuxCNC has -1 until its thread runs",
    ),
    ("dpll.time-const", "differs between versions of LinuxCNC"),
];

/// Our pins and parameters without the board's prefix, each under the name that LinuxCNC shows: the
/// second one, if there is one.
fn shown<'p>(prefix: &str, ours: &'p Pins) -> BTreeMap<String, (PinId, &'p PinInfo)> {
    let aliases: BTreeMap<usize, &str> = ours
        .aliases()
        .map(|(alias, pin)| (pin.index(), alias))
        .collect();
    let named = ours.ids().zip(ours.infos()).map(|(pin, info)| {
        let name = aliases.get(&pin.index()).copied().unwrap_or(&info.name);
        let short = name.strip_prefix(&format!("{prefix}.")).unwrap_or(name);
        (short.to_owned(), (pin, info))
    });
    named.collect()
}

/// Fails if the initial value of a pin or parameter that an application may set differs from that
/// of a fresh load of LinuxCNC without a reason, or if fewer than `at_least` are compared.
pub fn compare_values(
    prefix: &str,
    linuxcnc: &BTreeMap<String, String>,
    ours: &Pins,
    at_least: usize,
) {
    let mut wrong = Vec::new();
    let mut same = 0;
    for (name, (pin, info)) in shown(prefix, ours) {
        let Some(theirs) = linuxcnc.get(&name).filter(|_| info.role != Role::Input) else {
            continue;
        };
        let own = ours.read_any(pin).value.as_f64();
        let is_same = number(theirs).is_some_and(|theirs| (theirs - own).abs() <= 1e-6 * own.abs());
        if is_same {
            same += 1;
        } else if reason(OTHER_VALUES, &name).is_none() {
            wrong.push(format!("{name}: LinuxCNC {theirs}, ours {own}"));
        }
    }
    println!("{prefix}: {same} initial values are LinuxCNC's");
    assert!(wrong.is_empty(), "{prefix}: {wrong:#?}");
    assert!(same > at_least, "{prefix}: only {same} values are the same");
}

/// A value as `halcmd show` prints it.
fn number(text: &str) -> Option<f64> {
    match (text, text.strip_prefix("0x")) {
        ("TRUE", _) => Some(1.0),
        ("FALSE", _) => Some(0.0),
        (_, Some(digits)) => u32::from_str_radix(digits, 16).ok().map(f64::from),
        _ => text.parse().ok(),
    }
}

/// Fails if a type or a direction differs, if a name is on one side only without a reason, or if
/// fewer than `at_least` names are on both sides.
pub fn compare(prefix: &str, [pins, params]: [&List; 2], ours: &Pins, at_least: usize) {
    let linuxcnc: BTreeMap<_, _> = pins.iter().chain(params).collect();
    let of = |(name, (_, info)): (String, (PinId, &PinInfo))| {
        let kind = info.hal_type.as_str().to_owned();
        (name, (kind, info.role.hal_direction().to_owned()))
    };
    let ours: List = shown(prefix, ours).into_iter().map(of).collect();

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
