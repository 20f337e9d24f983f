//! `mesa param get` and `mesa param set`.

use std::fmt::{self, Display};

use clap::Args;
use mesa_hal::hal::AnyValue;
use mesa_hal::remote::ParameterError;
use mesa_tools::setup::{Cabinet, SavedValue, parse_value};
use serde::Serialize;

use super::list::Shown;
use super::{Named, Where, go_on, named, warning};
use crate::consent::{Asks, Plan};
use crate::context::{Context, Ending, Failure, told};

/// Read one parameter
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa param get 0.0.NVWatchDogTimeout --sim 7i92-7i77")]
pub struct Get {
    /// Name of the parameter, with PORT.CHANNEL in front if several remotes have it
    #[arg(value_name = "[PORT.CHANNEL.]NAME")]
    name: String,
    #[command(flatten)]
    at: Where,
}

/// Write one parameter and read it back
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa param set NVWatchDogTimeout 100 --serial /dev/ttyUSB0")]
pub struct Set {
    /// Name of the parameter, with PORT.CHANNEL in front if several remotes have it
    #[arg(value_name = "[PORT.CHANNEL.]NAME")]
    name: String,
    /// New value: decimal, hexadecimal after 0x, or real; in the range that `mesa param list` shows
    #[arg(value_parser = parse, allow_negative_numbers = true)]
    value: AnyValue,
    #[command(flatten)]
    asks: Asks,
    #[command(flatten)]
    at: Where,
}

fn parse(text: &str) -> Result<AnyValue, String> {
    parse_value(text).map_err(|text| format!("`{text}` is no number such as 100, 0x64 or 1.5"))
}

/// A parameter and its previous value.
#[derive(Debug, Serialize)]
struct One {
    place: String,
    card: String,
    unit_number: u32,
    parameter: Shown,
    /// Value before it was set.
    #[serde(skip_serializing_if = "Option::is_none")]
    before: Option<SavedValue>,
}

impl One {
    fn new(named: &Named, raw: u64, before: Option<SavedValue>) -> Self {
        Self {
            place: named.remote.place.to_string(),
            card: named.remote.descriptor.name.to_string(),
            unit_number: named.remote.descriptor.unit_number,
            parameter: Shown::new(&named.record, raw),
            before,
        }
    }
}

impl Get {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let mut cabinet = self.at.cabinet.open()?;
        let named = named(&cabinet, &self.name)?;
        let raw = cabinet.read(named.remote.place, &named.record.name)?;
        context.print(&One::new(&named, raw, None))?;
        Ok(context.ending())
    }
}

impl Set {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let mut cabinet = self.at.cabinet.open()?;
        let named = named(&cabinet, &self.name)?;
        let (place, record) = (named.remote.place, &named.record);
        let name = &record.name;
        let wanted: Result<u64, ParameterError> = record.raw_of(self.value);
        let wanted = wanted.map_err(|error| {
            let why = format!("{place}.{name}: {}", told(&error));
            match error {
                ParameterError::DoesNotFit { .. } | ParameterError::OutOfRange { .. } => {
                    Failure::usage(why)
                }
                _ => Failure::refused(why),
            }
        })?;
        let raw = cabinet.read(place, name)?;
        let before = SavedValue::from(record.typed(raw));
        if raw != wanted {
            let after = SavedValue::from(record.typed(wanted));
            let kept = if record.data_type.is_nonvolatile() {
                "in non-volatile memory; it is used from the next power-up on"
            } else {
                "until it is switched off"
            };
            let warning = warning(name, wanted);
            let plan = Plan::at(
                format_args!("{place}, {}", named.remote.descriptor.name),
                format_args!("write {name} = {after} (now {before}), {kept}{warning}"),
            );
            self.asks.consent(context, &plan, cabinet.found())?;
            go_on(context)?;
            cabinet.write(place, name, self.value)?;
        }
        let raw = cabinet.read(place, name)?;
        context.print(&One::new(&named, raw, Some(before)))?;
        Ok(context.ending())
    }
}

impl Display for One {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            place,
            card,
            parameter,
            ..
        } = self;
        write!(f, "{place}  {card}  {parameter}")?;
        match self.before {
            Some(before) if before == parameter.value => writeln!(f, ", was so already"),
            Some(before) => writeln!(f, ", was {before}"),
            None => writeln!(f),
        }
    }
}
