//! Report of a jog.

use std::fmt::{self, Display};
use std::time::Duration;

use mesa_hal::hal::{AnyValue, PinInfo};
use serde::Serialize;
use serde_json::Value;

use crate::board::named;
use crate::board::reason::Reason;
use mesa_tools::Counted;

/// Outcome of a jog.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case", tag = "outcome", content = "reason")]
pub enum Outcome {
    Done,
    Stopped(String),
    Failed(Reason),
    /// Never had the value.
    NotSet(Reason),
    /// Was set, and ended before the value was confirmed.
    NotConfirmed(Reason),
}

/// Report of a finished jog.
#[derive(Debug, Serialize)]
pub struct SetReport {
    pin: String,
    terminal: String,
    value: Value,
    unit: String,
    seconds: f64,
    #[serde(flatten)]
    outcome: Outcome,
    #[serde(flatten)]
    inputs: Inputs,
    /// Remotes that have not confirmed that the output is off again.
    pub not_reached: Vec<String>,
    #[serde(skip)]
    text: String,
}

/// Inputs during a jog.
#[derive(Debug, Serialize)]
pub struct Inputs {
    /// Inputs that changed while the output was set.
    pub changes: Vec<Change>,
    /// Number of inputs that were not valid before the output was set, so that their changes are
    /// unknown.
    pub not_seen: usize,
}

/// An input that changed while the output was set.
#[derive(Debug, Serialize)]
pub struct Change {
    pin: String,
    terminal: String,
    unit: String,
    before: Value,
    during: Value,
    after: Value,
    #[serde(skip)]
    text: [String; 3],
}

impl Change {
    pub fn new(info: &PinInfo, values: [Option<AnyValue>; 3]) -> Self {
        let json = |value: Option<AnyValue>| value.map_or(Value::Null, named::json);
        let text = |value: Option<AnyValue>| value.map_or("not valid".to_owned(), named::text);
        let [before, during, after] = values.map(json);
        Self {
            pin: info.name.clone(),
            terminal: info.place.terminal.clone(),
            unit: info.unit.clone(),
            before,
            during,
            after,
            text: values.map(text),
        }
    }
}

impl SetReport {
    pub fn new(
        info: &PinInfo,
        value: AnyValue,
        time: Duration,
        outcome: Outcome,
        inputs: Inputs,
        not_reached: Vec<String>,
    ) -> Self {
        Self {
            pin: info.name.clone(),
            terminal: info.place.terminal.clone(),
            value: named::json(value),
            unit: info.unit.clone(),
            seconds: time.as_secs_f64(),
            outcome,
            inputs,
            not_reached,
            text: named::text(value),
        }
    }

    /// Reason for an end before the time, if the machine ended the jog.
    pub fn failure(&self) -> Option<String> {
        match &self.outcome {
            Outcome::Failed(reason) => Some(format!("{}: {reason}", self.pin)),
            Outcome::NotConfirmed(reason) => Some(format!(
                "{} was set, and nothing confirmed it: {reason}",
                self.pin
            )),
            Outcome::NotSet(reason) => Some(format!("{} was not set: {reason}", self.pin)),
            Outcome::Done | Outcome::Stopped(_) => None,
        }
    }
}

impl Display for SetReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = format!("{} {}", self.text, self.unit);
        let how = match &self.outcome {
            Outcome::Done => format!("for {} s, and is safe again", self.seconds),
            Outcome::Stopped(signal) => format!("until {signal}, and is safe again"),
            Outcome::Failed(reason) => format!("until it failed: {reason}"),
            Outcome::NotConfirmed(reason) => {
                let value = value.trim_end();
                return writeln!(f, "{} may have been {value}: {reason}", self.pin);
            }
            Outcome::NotSet(reason) => {
                return writeln!(f, "{} was never {}: {reason}", self.pin, value.trim_end());
            }
        };
        writeln!(f, "{} was {} {how}", self.pin, value.trim_end())?;
        if self.inputs.not_seen > 0 {
            let count = Counted::of(self.inputs.not_seen, "input");
            writeln!(
                f,
                "{count} not valid before, so changes there are not known"
            )?;
        }
        if self.inputs.changes.is_empty() {
            return writeln!(f, "no input changed");
        }
        writeln!(f, "inputs that changed: before, while it was set, after")?;
        for change in &self.inputs.changes {
            let [before, during, after] = &change.text;
            let Change { pin, terminal, .. } = change;
            writeln!(f, "  {pin}  {before} -> {during} -> {after}  {terminal}")?;
        }
        Ok(())
    }
}
