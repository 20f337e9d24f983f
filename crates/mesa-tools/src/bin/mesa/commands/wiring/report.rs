//! Report on the terminals.

use std::fmt::{self, Display};
use std::path::Path;

use mesa_hal::hal::{AnyValue, HalType, PinId, PinInfo};
use mesa_tools::diagnosis::wiring::{Point, PointKind, WiringJudgement, WiringVerdict, exchanged};
use serde::Serialize;
use serde_json::Value;

use super::head::Head;
use crate::board::named;
use crate::board::place;
use crate::board::reason::{Reason, with_reason};
use crate::commands::watch::view;
use crate::ui::context::Failure;
use crate::ui::files;
use mesa_tools::Counted;

/// A terminal to check.
pub struct Item {
    pub info: PinInfo,
    pub what: What,
    pub mark: Mark,
    pub judgement: Option<WiringJudgement>,
    /// Answer of a person about an output.
    pub said: Option<String>,
    /// Reason why it is not valid, is unstable, or has failed.
    pub reason: Option<Reason>,
}

/// An input or an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    Input(Input),
    Output(PinId),
}

/// An input to check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Input {
    /// Number of the input in the check.
    pub point: usize,
    pub kind: PointKind,
}

/// Result of a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Mark {
    Judged(WiringVerdict),
    Not(Not),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Not {
    /// Not reached before the end.
    NotChecked,
    /// The output could not be driven to the end of its time.
    Failed,
}

/// End of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Still running.
    Unfinished,
    /// All terminals were gone through.
    Done,
    /// Ended by a person.
    Ended,
    /// Ended by a signal.
    Stopped,
    /// Ended by the machine.
    Failed,
}

impl Item {
    pub const fn is_output(&self) -> bool {
        matches!(self.what, What::Output(_))
    }

    pub fn new(info: PinInfo, what: What) -> Self {
        Self {
            info,
            what,
            mark: Mark::Not(Not::NotChecked),
            judgement: None,
            said: None,
            reason: None,
        }
    }

    /// Kind of an input.
    pub const fn input_kind(&self) -> Option<PointKind> {
        match self.what {
            What::Input(input) => Some(input.kind),
            What::Output(_) => None,
        }
    }

    fn others(&self) -> &[usize] {
        self.judgement.as_ref().map_or(&[], |found| &found.others)
    }

    fn moved(&self) -> Option<(AnyValue, AnyValue)> {
        self.judgement.as_ref()?.moved
    }

    /// Direction in which a number changed.
    fn direction(&self) -> Option<&'static str> {
        let (before, after) = self.moved()?;
        let is_number = matches!(
            self.input_kind(),
            Some(PointKind::Counter | PointKind::Analog)
        );
        let word = if after.as_f64() > before.as_f64() {
            "up"
        } else {
            "down"
        };
        is_number.then_some(word)
    }

    /// Result as text.
    pub fn words(&self, names: &Names<'_>) -> String {
        let is_output = self.is_output();
        let others = || {
            let others = self.others().iter().map(|&n| names.point(n));
            others.collect::<Vec<_>>().join(", ")
        };
        let with_reason = |result: &str| with_reason(result, self.reason.as_ref());
        match self.mark {
            Mark::Not(Not::NotChecked) => "not checked".to_owned(),
            Mark::Not(Not::Failed) => with_reason("FAILED"),
            Mark::Judged(verdict) => match verdict {
                WiringVerdict::Ok => {
                    let before = match &others()[..] {
                        "" => String::new(),
                        others => format!("; before that {others} changed"),
                    };
                    format!("ok{}{before}", self.path())
                }
                WiringVerdict::CountsDown => format!(
                    "COUNTS DOWN{}: exchange A and B, or give it a negative scale, before a drive is enabled",
                    self.range()
                        .map(|range| format!(", {range}"))
                        .unwrap_or_default()
                ),
                WiringVerdict::NoChange if is_output => "DID NOT COME ON".to_owned(),
                WiringVerdict::NoChange => with_reason("NO CHANGE"),
                WiringVerdict::OtherChanged if is_output => match &self.said {
                    Some(said) => format!("INSTEAD CAME ON: {said}"),
                    None => "SOMETHING ELSE CAME ON".to_owned(),
                },
                WiringVerdict::OtherChanged => format!("INSTEAD CHANGED: {}", others()),
                WiringVerdict::Together => {
                    format!("CHANGED TOGETHER with {}: connected?", others())
                }
                WiringVerdict::NotBack => format!("DID NOT COME BACK{}", self.path()),
                WiringVerdict::Unstable => with_reason("UNSTABLE"),
                WiringVerdict::NotValid => with_reason("NOT VALID"),
                WiringVerdict::Skipped => "skipped".to_owned(),
            },
        }
    }

    fn path(&self) -> String {
        let Some(range) = self.range() else {
            return String::new();
        };
        match (self.input_kind(), self.direction()) {
            (Some(PointKind::Counter), Some(way)) => format!(": counts {way}, {range}"),
            (Some(PointKind::Index), _) => {
                format!(": it came, the encoder counted {range}")
            }
            _ => format!(": {range}"),
        }
    }

    /// Value at rest, and the value farthest from it.
    fn range(&self) -> Option<String> {
        let (before, after) = self.moved()?;
        let range = format!("{} to {} {}", text(before), text(after), self.info.unit);
        Some(range.trim_end().to_owned())
    }
}

/// Formats a value; a level is on or off.
pub fn text(value: AnyValue) -> String {
    match (value.hal_type, value.as_f64() != 0.0) {
        (HalType::Bit, true) => "on".to_owned(),
        (HalType::Bit, false) => "off".to_owned(),
        _ => named::text(value),
    }
}

/// Names of terminals.
pub struct Names<'a> {
    pub board: &'a str,
    pub points: &'a [Point],
}

impl Names<'_> {
    /// Terminal and signal, and the name of the pin without that of the board.
    pub fn info(&self, info: &PinInfo) -> String {
        let name = view::short(&info.name, self.board);
        match place::short(&info.place) {
            place if place.is_empty() => name.to_owned(),
            place => format!("{place} ({name})"),
        }
    }

    /// As [`info`](Self::info), for an input by its number.
    pub fn point(&self, number: usize) -> String {
        let point = self.points.get(number);
        point.map_or_else(String::new, |point| self.info(&point.info))
    }
}

/// Remotes that take no part.
pub struct Missing {
    /// Why each of them is missing.
    pub remotes: Vec<String>,
    /// True if the check is incomplete without them.
    pub is_incomplete: bool,
}

/// Report of a check.
#[derive(Debug, Serialize)]
pub struct WiringResult {
    #[serde(flatten)]
    head: Head,
    outcome: Outcome,
    pub ok: bool,
    terminals: Vec<Row>,
    /// Pairs of pins, by name: each changed when the other one was asked for.
    exchanged: Vec<[String; 2]>,
    missing: Vec<String>,
    #[serde(skip)]
    pairs: Vec<[String; 2]>,
}

#[derive(Debug, Serialize)]
struct Row {
    pin: String,
    terminal: String,
    signal: String,
    kind: &'static str,
    verdict: Mark,
    others: Vec<String>,
    before: Value,
    after: Value,
    unit: String,
    direction: Option<&'static str>,
    said: Option<String>,
    reason: Option<Reason>,
    #[serde(skip)]
    text: [String; 2],
}

impl WiringResult {
    pub fn new(
        head: Head,
        items: &[Item],
        names: &Names<'_>,
        outcome: Outcome,
        missing: &Missing,
    ) -> Self {
        let row = |item: &Item| Row::new(item, names);
        let of_input = |number: usize| {
            let mut items = items.iter();
            let item = items.find(
                |item| matches!(item.what, What::Input(Input { point, .. }) if point == number),
            );
            item?.judgement.as_ref()
        };
        let pairs = exchanged(of_input, names.points.len());
        let named = |name: &dyn Fn(usize) -> String| {
            let pairs = pairs.iter().map(|&(one, two)| [name(one), name(two)]);
            pairs.collect()
        };
        let is_ok = |item: &Item| item.mark == Mark::Judged(WiringVerdict::Ok);
        Self {
            head,
            outcome,
            ok: !missing.is_incomplete && items.iter().all(is_ok),
            terminals: items.iter().map(row).collect(),
            exchanged: named(&|n| names.points[n].info.name.clone()),
            missing: missing.remotes.clone(),
            pairs: named(&|n| names.point(n)),
        }
    }

    /// Writes the report to a file: JSON if its name ends in .json, else text.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        let is_json = path.extension().is_some_and(|end| end == "json");
        let text = if is_json {
            serde_json::to_string_pretty(self).map_err(Failure::refused)? + "\n"
        } else {
            self.to_string()
        };
        files::write(path, text.as_bytes())
    }
}

impl Row {
    fn new(item: &Item, names: &Names<'_>) -> Self {
        let name = |&n: &usize| names.points.get(n).map(|point| point.info.name.clone());
        let value = |value: Option<AnyValue>| value.map_or(Value::Null, named::json);
        let info = &item.info;
        Self {
            pin: info.name.clone(),
            terminal: info.place.terminal.clone(),
            signal: info.place.signal.clone(),
            kind: match item.input_kind() {
                Some(PointKind::Digital) => "digital",
                Some(PointKind::Counter) => "counter",
                Some(PointKind::Index) => "index",
                Some(PointKind::Analog) => "analog",
                None => "output",
            },
            verdict: item.mark,
            others: item.others().iter().filter_map(name).collect(),
            before: value(item.moved().map(|(before, _)| before)),
            after: value(item.moved().map(|(_, after)| after)),
            unit: info.unit.clone(),
            direction: item.direction(),
            said: item.said.clone(),
            reason: item.reason.clone(),
            text: [names.info(info), item.words(names)],
        }
    }
}

impl Display for WiringResult {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_ok = |row: &&Row| row.verdict == Mark::Judged(WiringVerdict::Ok);
        let ok = self.terminals.iter().filter(is_ok).count();
        let how = match self.outcome {
            Outcome::Done => "",
            Outcome::Unfinished => "; not finished",
            Outcome::Ended => "; ended before all were checked",
            Outcome::Stopped => "; ended by a signal before all were checked",
            Outcome::Failed => "; the machine ended it",
        };
        let count = Counted(self.terminals.len() as u64, "terminal");
        writeln!(f, "{}{ok} of {count} in order{how}", self.head)?;
        for missing in &self.missing {
            writeln!(f, "MISSING, and not checked: {missing}")?;
        }
        let widths = self.terminals.iter().map(|row| row.text[0].chars().count());
        let width = widths.max().unwrap_or(0).min(60);
        for row in &self.terminals {
            let [name, words] = &row.text;
            writeln!(f, "{name:<width$}  {words}")?;
        }
        for [one, two] in &self.pairs {
            writeln!(f, "EXCHANGED: {one} and {two}")?;
        }
        Ok(())
    }
}
