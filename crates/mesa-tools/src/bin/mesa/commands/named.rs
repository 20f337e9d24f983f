//! Pins given by a person: by the whole name, or by its end.

use mesa_hal::Remark;
use mesa_hal::RemoteId;
use mesa_hal::hal::{AnyValue, HalType, PinError, PinId, PinInfo, Pins, Value};

use crate::context::{Failure, told};
use crate::number::{self, end};

/// Fails with the reason if the remote in a pin's name is missing. Port and channel of the remote
/// follow the card in the name (`7i77.0.0.output-03`).
pub fn present(missing: &[Remark], name: &str) -> Result<(), Failure> {
    let parts: Vec<&str> = name.split('.').collect();
    let mut ids = parts.windows(3).filter_map(|parts| {
        let [card, port, channel] = parts else {
            return None;
        };
        let is_card = card.parse::<u32>().is_err();
        let id = RemoteId::new(port.parse().ok()?, channel.parse().ok()?);
        is_card.then_some(id)
    });
    let found = ids.find_map(|id| {
        let mut missing = missing.iter();
        missing
            .find(|remark| remark.remote == Some(id))
            .map(|remark| (id, remark))
    });
    found.map_or(
        Ok(()),
        |(RemoteId { port, channel }, Remark { kind, .. })| {
            Err(Failure::refused(format_args!(
                "{name}: its remote on {port}.{channel} is missing: {}",
                told(kind)
            )))
        },
    )
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
            PinError::NotFound { nearest: None, .. } => Failure::usage(format_args!(
                "no pin or parameter `{name}`; `mesa pins` lists them"
            )),
            error => Failure::usage(told(&error)),
        }),
        [info] => pins
            .id(&info.name)
            .map_err(|error| Failure::usage(told(&error))),
        [one, other, ..] => Err(Failure::usage(format_args!(
            "`{name}` is the end of {} names, such as `{}` and `{}`: give more of it",
            ends.len(),
            one.name,
            other.name
        ))),
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

/// Converts a value to JSON.
pub fn json(value: AnyValue) -> serde_json::Value {
    match value.hal_type {
        HalType::Bit => bool::from_bits(value.bits).into(),
        HalType::Float => f64::from_bits(value.bits).into(),
        HalType::S32 | HalType::S64 => i64::from_bits(value.bits).into(),
        HalType::U32 | HalType::U64 => value.bits.into(),
    }
}
