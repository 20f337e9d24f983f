//! The pins and parameters of real machines: what hm2_eth and hm2_pci printed there, and what this
//! driver makes for a simulated board of the same kind, with the same public firmware and simulated
//! cards.
//!
//! The lists are in `tests/field_pins/lists`, each with three comment lines: board, firmware,
//! cards. The environment variable `FIELD_PINS` selects another directory of such lists, and
//! `FIRMWARES` another one of firmwares.

mod cards;
mod compose;
mod list;
mod reasons;

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::PathBuf;

use cards::Choice;
use list::{Entry, List};
use mesa_eth::Config;
use mesa_hal::driver::Driver;
use mesa_hal::hal::{AnyValue, HalType, PinInfo};
use mesa_hal_sim::{FirmwareImage, SimFpga};

/// All lists of the directory, by name.
fn lists() -> Vec<List> {
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/field_pins/lists");
    let directory = std::env::var_os("FIELD_PINS").map_or_else(|| own.into(), PathBuf::from);
    let entries = fs::read_dir(&directory);
    let entries = entries.unwrap_or_else(|error| panic!("{}: {error}", directory.display()));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a file").path()).collect();
    let is_list = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        path.extension().is_some_and(|kind| kind == "txt") && name != "README"
    };
    paths.retain(is_list);
    paths.sort();
    assert!(!paths.is_empty(), "{}: no lists", directory.display());
    let list = |path: PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let text = fs::read_to_string(&path).expect("a text");
        List::parse(&name, &text).unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    paths.into_iter().map(list).collect()
}

/// What the driver makes for a simulated board of the list's kind, with the cards that fit best.
fn made(list: &List) -> Result<BTreeMap<String, Entry>, String> {
    let text = compose::compose(list)?;
    let mut chosen = Vec::new();
    for card in &list.cards {
        let prefix = cards::prefix(card);
        let mut best = None;
        let mut failure = format!("{prefix}: no such card");
        for choice in cards::choices(list, card) {
            match made_with(&text, std::slice::from_ref(&choice)) {
                Ok(made) => {
                    let Differences { missing, differing } = compare(list, &made);
                    let of_card = missing.iter().chain(&differing);
                    let wrong = of_card.filter(|name| name.starts_with(&prefix)).count();
                    if best.as_ref().is_none_or(|(least, _)| wrong < *least) {
                        best = Some((wrong, choice));
                    }
                }
                Err(error) => failure = error,
            }
        }
        let (_, choice) = best.ok_or(failure)?;
        chosen.push(choice);
    }
    made_with(&text, &chosen)
}

/// What the driver makes for a firmware with cards.
fn made_with(text: &str, cards: &[Choice]) -> Result<BTreeMap<String, Entry>, String> {
    let image = FirmwareImage::parse(text).map_err(|error| error.to_string())?;
    let mut fpga = SimFpga::from_image(&image).map_err(|error| error.to_string())?;
    let mut modes = BTreeMap::<usize, [u8; 8]>::new();
    for Choice { card, make, mode } in cards {
        let channels = modes.entry(card.port).or_insert(*b"00000000");
        *channels.get_mut(card.channel).ok_or("a channel")? = b'0' + mode;
        let end = make().map_err(|error| error.to_string())?;
        fpga.plug(card.port, card.channel, Some(end));
    }
    let words = modes.iter().map(|(port, modes)| {
        let modes = String::from_utf8_lossy(modes);
        format!("sserial_port_{port}={modes}")
    });
    let words: Vec<String> = words.collect();
    let config = Config::parse(&words.join(" ")).map_err(|error| error.to_string())?;
    let driver = Driver::start(fpga, config.settings).map_err(|error| error.to_string())?;
    let pins = driver.pins();
    let prefix = format!("{}.", driver.name());
    let own = |name: &str| name.strip_prefix(&prefix).unwrap_or(name).to_owned();
    let entries = pins.infos().iter().zip(pins.values());
    let mut made: BTreeMap<String, Entry> = entries
        .map(|(info, value)| (own(&info.name), entry(info, value)))
        .collect();
    // HAL shows the second name in the place of the first.
    for (alias, id) in pins.aliases() {
        let first = pins.info_of(id).map(|info| own(&info.name));
        if let Some(entry) = first.and_then(|first| made.get(&first).cloned()) {
            made.insert(own(alias), entry);
        }
    }
    Ok(made)
}

/// As `halcmd` prints it. HAL has numbers of 32 bits.
fn entry(info: &PinInfo, value: AnyValue) -> Entry {
    let bits = value.bits;
    let (hal_type, value) = match info.hal_type {
        HalType::Bit => ("bit", if bits == 0 { "FALSE" } else { "TRUE" }.into()),
        HalType::Float => ("float", float(f64::from_bits(bits))),
        HalType::S32 | HalType::S64 => ("s32", (bits as i64 as i32).to_string()),
        HalType::U32 | HalType::U64 => ("u32", format!("0x{:08X}", bits as u32)),
    };
    Entry {
        hal_type: hal_type.into(),
        direction: info.role.hal_direction().into(),
        value,
    }
}

/// With seven digits, as `halcmd` prints a number: `%.7g`.
fn float(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    let rounded: f64 = format!("{number:.6e}").parse().expect("a number");
    let exponent = rounded.abs().log10().floor();
    if (-4.0..7.0).contains(&exponent) {
        return rounded.to_string();
    }
    let text = format!("{rounded:e}");
    let (digits, exponent) = text.split_once('e').expect("an exponent");
    let exponent: i32 = exponent.parse().expect("a number");
    let sign = if exponent < 0 { '-' } else { '+' };
    format!("{digits}e{sign}{:02}", exponent.abs())
}

/// Names that are missing or differ without a reason.
#[derive(Debug, Default)]
struct Differences {
    missing: Vec<String>,
    differing: Vec<String>,
}

fn compare(list: &List, made: &BTreeMap<String, Entry>) -> Differences {
    let mut found = Differences::default();
    for (name, theirs) in &list.entries {
        let has_reason = reasons::of_name(list, name, theirs);
        let Some(ours) = made.get(name).filter(|_| !has_reason) else {
            if !has_reason {
                found.missing.push(name.clone());
            }
            continue;
        };
        let is_same = (&theirs.hal_type, &theirs.direction) == (&ours.hal_type, &ours.direction);
        let has_value = !theirs.is_setting()
            || theirs.value == ours.value
            || reasons::of_value(list, name, theirs);
        if !is_same || !has_value {
            let show = |entry: &Entry| [&*entry.hal_type, &entry.direction, &entry.value].join(" ");
            let text = format!("{name}: {}, ours {}", show(theirs), show(ours));
            found.differing.push(text);
        }
    }
    found
}

/// Prints a line for whoever runs the test, even if it passes.
fn show(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

#[test]
fn every_name_of_real_machines_is_there_with_type_and_value() {
    let mut failures = Vec::new();
    for list in lists() {
        let (name, names) = (&list.name, list.entries.len());
        match made(&list) {
            Ok(made) => {
                let Differences { missing, differing } = compare(&list, &made);
                let (absent, differ) = (missing.len(), differing.len());
                show(&format!(
                    "{name}: {names} names, missing {absent}, differ {differ}"
                ));
                let missing = missing
                    .iter()
                    .map(|missing| format!("{name}: no {missing}"));
                failures.extend(missing);
                failures.extend(differing.iter().map(|text| format!("{name}: {text}")));
            }
            Err(error) => {
                show(&format!(
                    "{name}: {names} names, missing {names}, differ 0: {error}"
                ));
                failures.push(format!("{name}: {error}"));
            }
        }
    }
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}
