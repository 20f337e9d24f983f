//! `mesa param list`.

use std::fmt::{self, Display};

use clap::Args;
use mesa_hal::discovery::{DataDirection, DataRecord, DataType};
use mesa_hal::hal::AnyValue;
use mesa_hal::remote::Scaling;
use mesa_tools::setup::{Cabinet, CabinetRemote, ManualWord, SavedValue};
use serde::Serialize;

use super::{Where, go_on};
use crate::ui::context::{Context, Ending, Failure};

/// List all parameters of all remotes
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa param list --sim 7i92-7i77")]
pub struct List {
    #[command(flatten)]
    at: Where,
}

/// All remotes with their parameters.
#[derive(Debug, Serialize)]
struct Remotes {
    remotes: Vec<OneRemote>,
}

#[derive(Debug, Serialize)]
struct OneRemote {
    place: String,
    card: String,
    unit_number: u32,
    parameters: Vec<Shown>,
}

/// A parameter in the output.
#[derive(Debug, Serialize)]
pub struct Shown {
    pub name: String,
    /// Value as in LinuxCNC: without the scale.
    pub value: SavedValue,
    pub hex: String,
    bits: u8,
    /// Value in its unit, if the record has a scale.
    scaled: Option<f64>,
    unit: String,
    min: Option<f64>,
    max: Option<f64>,
    nonvolatile: bool,
    writable: bool,
}

impl Shown {
    /// Converts a record and its raw value.
    pub fn new(record: &DataRecord, raw: u64) -> Self {
        let digits = usize::from(record.bits.div_ceil(4)) + 2;
        let (min, max) = (f64::from(record.min), f64::from(record.max));
        let is_limited = min < max;
        let has_scale = matches!(record.data_type, DataType::Unsigned | DataType::Signed);
        let scaling = Some(Scaling::of(record)).filter(|s| has_scale && !s.is_whole());
        // The maximum of a record, a 32-bit float, may be rounded up.
        let largest = record.whole_numbers().filter(|_| scaling.is_none());
        let max = largest.map_or(max, |numbers| max.min(*numbers.end() as f64));
        Self {
            name: record.name.clone(),
            value: record.typed(raw).into(),
            hex: format!("{raw:#0digits$X}"),
            bits: record.bits,
            scaled: scaling.map(|scaling| scaling.value(raw)),
            unit: record.unit.clone(),
            min: is_limited.then_some(min),
            max: is_limited.then_some(max),
            nonvolatile: record.data_type.is_nonvolatile(),
            writable: record.direction != DataDirection::Input,
        }
    }

    /// Converts a value that the manuals name.
    pub fn of_word(word: &ManualWord, raw: u64) -> Self {
        let bits = word.bits();
        let digits = usize::from(bits.div_ceil(4)) + 2;
        Self {
            name: word.name().to_owned(),
            value: AnyValue::from(raw).into(),
            hex: format!("{raw:#0digits$X}"),
            bits,
            scaled: None,
            unit: String::new(),
            min: Some(0.0),
            max: Some(word.highest() as f64),
            nonvolatile: false,
            writable: true,
        }
    }
}

impl List {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let mut cabinet = self.at.cabinet.open(context)?;
        let mut remotes = Vec::new();
        for CabinetRemote { place, descriptor } in cabinet.remotes() {
            let mut parameters = Vec::new();
            let records = descriptor.parameters.iter();
            for record in records.filter(|record| record.is_readable()) {
                go_on(context)?;
                parameters.push(Shown::new(record, cabinet.read(place, &record.name)?));
            }
            for word in ManualWord::of(&descriptor) {
                go_on(context)?;
                parameters.push(Shown::of_word(&word, word.read(&mut cabinet, place)?));
            }
            remotes.push(OneRemote {
                place: place.to_string(),
                card: descriptor.name.to_string(),
                unit_number: descriptor.unit_number,
                parameters,
            });
        }
        context.print(&Remotes { remotes })?;
        Ok(context.ending())
    }
}

impl Display for Remotes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let blank = |index| if index == 0 { "" } else { "\n" };
        for (index, remote) in self.remotes.iter().enumerate() {
            let OneRemote {
                place,
                card,
                unit_number,
                parameters,
            } = remote;
            f.write_str(blank(index))?;
            writeln!(f, "{place}  {card}, unit number {unit_number:#010X}")?;
            if parameters.is_empty() {
                writeln!(f, "  no parameters")?;
            }
            for parameter in parameters {
                writeln!(f, "  {parameter}")?;
            }
        }
        Ok(())
    }
}

impl Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name, value, hex, ..
        } = self;
        write!(
            f,
            "{name:<20} {value:>10}  {hex:<10}",
            value = value.to_string()
        )?;
        if let Some(scaled) = self.scaled {
            write!(f, " = {scaled} {},", self.unit)?;
        }
        let space = if self.unit.is_empty() { "" } else { " " };
        let unit = format!("{space}{}", self.unit);
        match (self.min, self.max) {
            (Some(min), Some(max)) if min == max => write!(f, " {min} clears it")?,
            (Some(min), Some(max)) => write!(f, " {min} to {max}{unit}")?,
            _ if self.unit.is_empty() => write!(f, " any value")?,
            _ => write!(f, " in{unit}")?,
        }
        f.write_str(match (self.writable, self.nonvolatile) {
            (false, _) => ", read only",
            (true, true) => ", non-volatile",
            (true, false) => ", until power-off",
        })
    }
}
