//! `mesa param get` and `mesa param set`.

use std::fmt::{self, Display};

use clap::Args;
use mesa_hal::hal::{AnyValue, HalType};
use mesa_hal::remote::ParameterError;
use mesa_tools::setup::{Cabinet, ManualWord, SavedValue, parse_value};
use serde::Serialize;

use super::cabinet::OpenCabinet;
use super::list::Shown;
use super::{Named, NamedValue, Where, go_on, named, warning};
use crate::board::consent::{Asks, Plan};
use crate::ui::context::{Context, Ending, Failure};
use mesa_tools::advice::told;

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
            parameter: match &named.value {
                NamedValue::Parameter(record) => Shown::new(record, raw),
                NamedValue::Word(word) => Shown::of_word(word, raw),
            },
            before,
        }
    }
}

impl Get {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let mut cabinet = self.at.cabinet.open(context)?;
        let named = named(&cabinet, &self.name)?;
        let raw = named.read(&mut cabinet)?;
        context.print(&One::new(&named, raw, None))?;
        Ok(context.ending())
    }
}

impl Set {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let mut cabinet = self.at.cabinet.open(context)?;
        let named = named(&cabinet, &self.name)?;
        let wanted = self.wanted(&named)?;
        let raw = named.read(&mut cabinet)?;
        let (before, after) = (named.shown(raw), named.shown(wanted));
        if raw != wanted {
            let place = named.remote.place;
            let (name, card) = (named.value.name(), named.remote.descriptor.name);
            let plan = Plan::at(
                format_args!("{place}, {card}"),
                format_args!(
                    "write {name} = {after} (now {before}), {}",
                    named.effect(wanted)
                ),
            );
            self.asks
                .consent_to_change(context, &plan, cabinet.found())?;
            go_on(context)?;
            match &named.value {
                NamedValue::Parameter(record) => cabinet.write(place, &record.name, self.value)?,
                NamedValue::Word(word) => {
                    word.write(&mut cabinet, place, wanted)?;
                    check_taken(&named, word, wanted, &mut cabinet)?;
                }
            }
        }
        let raw = named.read(&mut cabinet)?;
        context.print(&One::new(&named, raw, Some(before)))?;
        Ok(context.ending())
    }

    /// The bits of the value, if the parameter can have it.
    fn wanted(&self, named: &Named) -> Result<u64, Failure> {
        let (place, name) = (named.remote.place, named.value.name());
        let wanted: Result<u64, ParameterError> = match &named.value {
            NamedValue::Parameter(record) => record.raw_of(self.value),
            NamedValue::Word(word) => {
                let AnyValue { hal_type, bits } = self.value;
                let is_whole = matches!(hal_type, HalType::U32 | HalType::U64);
                if is_whole && bits <= word.highest() {
                    return Ok(bits);
                }
                let (value, most) = (SavedValue::from(self.value), word.highest());
                return Err(Failure::usage(format_args!(
                    "{place}.{name}: {value} does not fit: allowed is 0 to {most}"
                )));
            }
        };
        wanted.map_err(|error| {
            let why = format!("{place}.{name}: {}", told(&error));
            match error {
                ParameterError::DoesNotFit { .. }
                | ParameterError::OutOfRange { .. }
                | ParameterError::NoBaudRate { .. } => Failure::usage(why),
                _ => Failure::refused(why),
            }
        })
    }
}

impl Named {
    /// A raw value as in LinuxCNC.
    fn shown(&self, raw: u64) -> SavedValue {
        match &self.value {
            NamedValue::Parameter(record) => record.typed(raw).into(),
            NamedValue::Word(_) => AnyValue::from(raw).into(),
        }
    }

    /// Duration and effect of a value.
    fn effect(&self, wanted: u64) -> String {
        match &self.value {
            NamedValue::Parameter(record) if record.data_type.is_nonvolatile() => {
                let warning = warning(&record.name, wanted);
                format!("in non-volatile memory; it is used from the next power-up on{warning}")
            }
            NamedValue::Parameter(record) => {
                format!("until it is switched off{}", warning(&record.name, wanted))
            }
            NamedValue::Word(ManualWord::Output(_)) => {
                "which DRIVES ITS OUTPUTS AT ONCE, until its watchdog bites or it is switched off"
                    .to_owned()
            }
            NamedValue::Word(ManualWord::Fault) => {
                "which clears its faults, so that its outputs can be driven".to_owned()
            }
            NamedValue::Word(ManualWord::Status) => "which clears it".to_owned(),
        }
    }
}

/// Fails if outputs are not as written: a card with a fault does not drive them.
fn check_taken(
    named: &Named,
    word: &ManualWord,
    wanted: u64,
    cabinet: &mut OpenCabinet,
) -> Result<(), Failure> {
    let place = named.remote.place;
    let ManualWord::Output(_) = word else {
        return Ok(());
    };
    let faults = ManualWord::Fault.read(cabinet, place)?;
    if faults == 0 && word.read(cabinet, place)? == wanted {
        return Ok(());
    }
    Err(Failure::refused(format_args!(
        "{place}: its outputs are not driven: FAULT is {faults:#04X}. `mesa param set {place}.FAULT 0` clears \
         it; its watchdog sets it again unless its time is 0"
    )))
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
