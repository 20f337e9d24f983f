//! Pins given by a person: by the whole name, its end, a terminal or a signal.

use mesa_hal::driver::RemarkKind;
use mesa_hal::hal::{AnyValue, HalType, PinError, PinId, PinInfo, Pins, Role, Value};
use mesa_hal::{Remark, RemoteId};

use crate::board::hazard::{Hazard, hazard};
use crate::board::place::{self, Typed};
use crate::ui::context::Failure;
use crate::ui::number::{self, end};
use mesa_tools::advice::told;

/// Most names that a refusal of an ambiguous one lists.
const LISTED: usize = 8;

/// Fails with the reason if the remote in a pin's name is missing.
pub fn present(missing: &[Remark], name: &str) -> Result<(), Failure> {
    takes_part(missing, name, "missing")
}

/// Fails with the reason if the remote in a pin's name did not run at the start.
pub fn running(remarks: &[Remark], name: &str) -> Result<(), Failure> {
    let remarks = remarks.iter();
    let offline = remarks.filter(|remark| matches!(remark.kind, RemarkKind::Offline { .. }));
    takes_part(offline, name, "offline")
}

fn takes_part<'a>(
    not: impl IntoIterator<Item = &'a Remark>,
    name: &str,
    state: &str,
) -> Result<(), Failure> {
    let Some(id) = place::remote(name) else {
        return Ok(());
    };
    let mut not = not.into_iter();
    let found = not.find(|remark| remark.remote.is_some_and(|remote| remote == id));
    found.map_or(Ok(()), |Remark { kind, .. }| {
        let RemoteId { port, channel } = id;
        let said = match kind {
            RemarkKind::Offline { reason } => told(reason),
            kind => told(kind),
        };
        let what = format_args!("{name}: its remote on {port}.{channel} is {state}: {said}");
        Err(Failure::of(kind, what))
    })
}

/// Finds an output by its name as [`find`], or by its terminal or signal. Of several pins there
/// only those count that [`can_be_set`]; fails if more than one is left.
pub fn find_output(pins: &Pins, missing: &[Remark], text: &str) -> Result<PinId, Failure> {
    let by_name = match find(pins, missing, text) {
        Ok(pin) => return Ok(pin),
        Err(failure) => failure,
    };
    let typed = Typed::from(text);
    let there: Vec<&PinInfo> = pins.infos().iter().filter(|pin| typed.fits(pin)).collect();
    let outputs = there.iter().filter(|pin| can_be_set(pin));
    let outputs: Vec<&PinInfo> = outputs.copied().collect();
    match (&outputs[..], &there[..]) {
        ([output], _) => pins.id(&output.name).map_err(|error| usage(&error)),
        ([], [input, ..]) => Err(Failure::usage(format_args!(
            "`{text}` is not an output: {}",
            with_place(input)
        ))),
        ([], []) if typed.is_terminal_form() => no_terminal(missing, text),
        // The end of a name that several pins have.
        ([], []) if pins.infos().iter().any(|pin| pin.name.ends_with(text)) => Err(by_name),
        ([], []) => Err(no_output(pins, &typed).unwrap_or(by_name)),
        (several, _) => Err(ambiguous(text, several)),
    }
}

/// True for an output that `mesa set` takes: no parameter, and nothing that changes what another
/// output means.
fn can_be_set(info: &PinInfo) -> bool {
    info.role == Role::Output && !matches!(hazard(info), Hazard::Making | Hazard::Watchdog)
}

/// Refusal of an unknown signal, with the outputs whose signals begin with the same letters.
fn no_output(pins: &Pins, typed: &Typed) -> Option<Failure> {
    let mut alike = pins.infos().iter().filter(|pin| can_be_set(pin));
    let alike: Vec<&PinInfo> = alike.by_ref().filter(|pin| typed.is_alike(pin)).collect();
    let ([first, ..], Some(last)) = (&alike[..], alike.last()) else {
        return None;
    };
    let (first, last) = (with_place(first), with_place(last));
    let found = if first == last {
        first
    } else {
        format!("{first} to {last}")
    };
    let advice = format!("the outputs with such a signal are {found}");
    let what = format_args!("no output `{typed}`; {advice}");
    Some(Failure::usage(what).advising(&advice))
}

/// Refusal of a terminal that no pin has. Remotes that answer without taking part may be the
/// reason.
fn no_terminal(missing: &[Remark], text: &str) -> Result<PinId, Failure> {
    let missing = missing.iter().filter(|remark| !remark.is_silent());
    let missing: Vec<String> = missing.map(|remark| told(remark)).collect();
    if missing.is_empty() {
        let advice = "`mesa pins` lists those that there are";
        let what = format_args!("no terminal `{text}`; {advice}");
        return Err(Failure::usage(what).advising(advice));
    }
    Err(Failure::refused(format_args!(
        "no terminal `{text}`; missing: {}",
        missing.join("; missing: ")
    )))
}

/// Refusal of a text that several pins fit.
fn ambiguous(text: &str, several: &[&PinInfo]) -> Failure {
    let names = several.iter().map(|info| with_place(info));
    let names: Vec<String> = names.take(LISTED).collect();
    let more = match several.len().saturating_sub(names.len()) {
        0 => String::new(),
        more => format!(", and {more} more"),
    };
    let names = names.join(", or ");
    let mut cards: Vec<String> = several.iter().map(|info| place::card(&info.name)).collect();
    cards.dedup();
    let advice = match &cards[..] {
        [first, _, ..] if several.iter().all(|info| !info.place.terminal.is_empty()) => {
            format!("give the name of one, or the card behind it, as `{text} of {first}`")
        }
        _ => "give the name of one".to_owned(),
    };
    Failure::usage(format_args!("`{text}` may be {names}{more}: {advice}")).advising(&advice)
}

/// A pin with its terminals, signals and card.
pub fn with_place(info: &PinInfo) -> String {
    match &*place::on_card(info) {
        "" => info.name.clone(),
        place => format!("{} ({place})", info.name),
    }
}

fn usage(error: &PinError) -> Failure {
    Failure::of(error, told(error)).for_usage()
}

/// Finds the pin or parameter with a name, or the only one whose name ends with it behind a point.
/// `missing` are the remotes whose absence may be the reason for an unknown name.
pub fn find(pins: &Pins, missing: &[Remark], name: &str) -> Result<PinId, Failure> {
    let found = find_present(pins, name);
    if found.is_err() {
        present(missing, name)?;
    }
    found
}

fn find_present(pins: &Pins, name: &str) -> Result<PinId, Failure> {
    let error = match pins.id(name) {
        Ok(pin) => return Ok(pin),
        Err(error) => error,
    };
    let ends_so = |info: &&PinInfo| {
        let stem = info.name.strip_suffix(name);
        !name.is_empty() && stem.is_some_and(|stem| stem.ends_with('.'))
    };
    let ends: Vec<&PinInfo> = pins.infos().iter().filter(ends_so).collect();
    match ends[..] {
        [] => Err(match error {
            PinError::NotFound { nearest: None, .. } => {
                let advice = "`mesa pins` lists them";
                let what = format_args!("no pin or parameter `{name}`; {advice}");
                Failure::usage(what).advising(advice)
            }
            error => usage(&error),
        }),
        [info] => pins.id(&info.name).map_err(|error| usage(&error)),
        ref several => Err(ambiguous(name, several)),
    }
}

/// Parses a value of the type of a pin, within its range.
pub fn value(info: &PinInfo, text: &str) -> Result<AnyValue, Failure> {
    let parsed = match info.hal_type {
        HalType::Bit => bit(text).map(AnyValue::from),
        HalType::Float => text.parse::<f64>().ok().map(AnyValue::from),
        HalType::S32 => text.parse::<i32>().ok().map(AnyValue::from),
        HalType::U32 => text.parse::<u32>().ok().map(AnyValue::from),
        HalType::S64 => text.parse::<i64>().ok().map(AnyValue::from),
        HalType::U64 => text.parse::<u64>().ok().map(AnyValue::from),
    };
    let fits = |value: &AnyValue| {
        let limits = info.limits.filter(|_| info.hal_type != HalType::Bit);
        let (min, max) = limits.unwrap_or((f64::MIN, f64::MAX));
        value.is_finite() && (min..=max).contains(&value.as_f64())
    };
    parsed.filter(fits).ok_or_else(|| {
        Failure::usage(format_args!(
            "`{text}` is no value for {}: {}",
            info.name,
            range(info)
        ))
    })
}

fn bit(text: &str) -> Option<bool> {
    match text {
        "1" | "on" | "true" => Some(true),
        "0" | "off" | "false" => Some(false),
        _ => None,
    }
}

/// Text about the values that a pin accepts.
pub fn range(info: &PinInfo) -> String {
    let (kind, least, most) = match info.hal_type {
        HalType::Bit => return "0 or 1, off or on".to_owned(),
        HalType::Float => ("a number", f64::MIN, f64::MAX),
        HalType::S32 => ("a whole number", i32::MIN.into(), i32::MAX.into()),
        HalType::U32 => ("a whole number", 0.0, u32::MAX.into()),
        HalType::S64 => ("a whole number", i64::MIN as f64, i64::MAX as f64),
        HalType::U64 => ("a whole number", 0.0, u64::MAX as f64),
    };
    match info.limits {
        Some((min, max)) => format!("{kind} from {} to {} {}", end(min), end(max), info.unit)
            .trim_end()
            .to_owned(),
        None if info.hal_type == HalType::Float => kind.to_owned(),
        None => format!("{kind} from {} to {}", end(least), end(most)),
    }
}

/// Formats a value as text.
pub fn text(value: AnyValue) -> String {
    match value.hal_type {
        HalType::Bit => u8::from(bool::from_bits(value.bits)).to_string(),
        HalType::Float => number::value(f64::from_bits(value.bits)),
        _ => value.to_string(),
    }
}

/// Formats a value as text with its unit; a bit is on or off.
pub fn with_unit(info: &PinInfo, value: AnyValue) -> String {
    match (value.hal_type, bool::from_bits(value.bits)) {
        (HalType::Bit, true) => "on".to_owned(),
        (HalType::Bit, false) => "off".to_owned(),
        _ => format!("{} {}", text(value), info.unit)
            .trim_end()
            .to_owned(),
    }
}

/// Converts a value to JSON.
pub fn json(value: AnyValue) -> serde_json::Value {
    match value.hal_type {
        HalType::Bit => bool::from_bits(value.bits).into(),
        HalType::Float => f64::from_bits(value.bits).into(),
        HalType::S32 | HalType::S64 => i64::from_bits(value.bits).into(),
        HalType::U32 | HalType::U64 => value.bits.into(),
    }
}
