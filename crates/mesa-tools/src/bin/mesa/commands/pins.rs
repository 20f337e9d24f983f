//! `mesa pins`: all HAL pins and parameters with their values.

use std::fmt::{self, Display};
use std::ops::ControlFlow;
use std::time::Duration;

use clap::Args;
use mesa_hal::Settings;
use mesa_hal::hal::{AnyValue, HalType, PinInfo, Place, Reading};
use mesa_hal::runner::Runner;
use mesa_hal::transport::udp::UdpConfig;
use serde::Serialize;
use serde_json::Value;

use crate::board::modes::Modes;
use crate::board::pattern::Pattern;
use crate::board::place;
use crate::board::running;
use crate::board::target::Target;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::number;
use crate::ui::output::complain;

/// Period of the cycle.
const PERIOD: Duration = Duration::from_millis(4);
/// Timeout of a reply: a late cycle is better than none.
const DEADLINE: Duration = Duration::from_millis(20);

const AFTER_HELP: &str = "\
Starts the machine with all outputs off, reads it for a while, and stops it. A board that another
program drives is left alone.

PATTERN is a part of a pin's name, terminal or signal; with * or ?, a pattern of the whole. Signals
of an encoder belong to the pins that show them: QA0 to the count, IDX0 to index-enable. TB8-20 is
terminal 20 of TB8.

Exits with 1 if no pin fits.

Example:
  mesa pins 'QA' --addr 10.10.10.10
  mesa pins '*.input-0?' --sim 7i92-7i77";

/// List all HAL pins and parameters: type, direction, terminal, signal, value
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Pins {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
    /// Pattern that selects pins; all unless given
    pattern: Option<Pattern>,
    /// Time to read the machine, in seconds, 0.01 to 3600: filtered inputs need some time
    #[arg(long, value_name = "S", default_value_t = 0.4, value_parser = seconds)]
    seconds: f64,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok();
    let seconds = seconds.filter(|seconds| (0.01..=3600.0).contains(seconds));
    seconds.ok_or_else(|| format!("`{text}` is no number of seconds from 0.01 to 3600"))
}

/// Result of the command.
#[derive(Debug, Serialize)]
#[serde(transparent)]
struct Rows(Vec<Row>);

/// A pin or parameter.
#[derive(Debug, Serialize)]
struct Row {
    name: String,
    #[serde(rename = "type")]
    hal_type: &'static str,
    direction: &'static str,
    terminal: String,
    signal: String,
    value: Value,
    unit: String,
    valid: bool,
    /// Microseconds since the transfer of the value; `None` for a parameter, and for a pin that was
    /// never read.
    age_us: Option<u64>,
}

impl Pins {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let found = self.target.find(context)?;
        let mut settings = Settings {
            period: PERIOD,
            watchdog: Some(running::WATCHDOG),
            ..Settings::default()
        };
        self.modes.put(&mut settings);
        let bus = found.open_with(UdpConfig {
            cycle_deadline: DEADLINE,
            ..UdpConfig::default()
        })?;
        let driver = running::start(bus, found.with_patience(settings))?;
        let mut runner = Runner::new(driver).stop_on(context.stop.clone());
        let reader = runner.snapshot();
        let cycles = (self.seconds / PERIOD.as_secs_f64()).ceil() as u64;
        let mut checked = Ok(());
        let mut seen = None;
        let ended = runner.run(|cycle| {
            checked = running::check(cycle.driver);
            if cycle.number <= cycles && checked.is_ok() {
                return ControlFlow::Continue(());
            }
            // Taken while the machine runs: afterwards no value is valid.
            seen = Some(reader.read());
            ControlFlow::Break(())
        });
        checked?;
        ended.stopped?;
        if let Some(signal) = ended.signal {
            complain(format_args!(
                "mesa: ended by {signal}; outputs were never on"
            ));
            return Ok(Ending::Stopped(signal));
        }
        let all = Pattern::default();
        let pattern = self.pattern.as_ref().unwrap_or(&all);
        let snapshot = seen.unwrap_or_else(|| reader.read())?;
        let rows = snapshot.pins().filter_map(|(info, reading)| {
            let fits = pattern.fits(info);
            fits.then(|| Row::new(info, reading))
        });
        let rows = Rows(rows.collect());
        context.print(&rows)?;
        if rows.0.is_empty() {
            let advice = "`mesa pins` without a pattern has all";
            let failure = Failure::refused(format_args!("no pin fits; {advice}"));
            return Err(failure.advising(advice));
        }
        Ok(Ending::Done)
    }
}

impl Row {
    fn new(info: &PinInfo, reading: Reading<AnyValue>) -> Self {
        let age = reading.age.time;
        let has_age = !info.role.is_param() && age != Duration::MAX;
        Self {
            name: info.name.clone(),
            hal_type: info.hal_type.as_str(),
            direction: info.role.hal_direction(),
            terminal: info.place.terminal.clone(),
            signal: info.place.signal.clone(),
            value: value(reading.value),
            unit: info.unit.clone(),
            valid: reading.valid,
            age_us: has_age.then(|| u64::try_from(age.as_micros()).unwrap_or(u64::MAX)),
        }
    }
}

/// Converts a value to JSON; a number that is not finite becomes null.
fn value(value: AnyValue) -> Value {
    match value.hal_type {
        HalType::Bit => (value.bits != 0).into(),
        HalType::Float => f64::from_bits(value.bits).into(),
        HalType::S32 | HalType::S64 => (value.bits as i64).into(),
        HalType::U32 | HalType::U64 => value.bits.into(),
    }
}

impl Display for Rows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.0.iter().map(|row| row.name.len()).max().unwrap_or(0);
        self.0.iter().try_for_each(|row| {
            let place = place::short(&Place {
                terminal: row.terminal.clone(),
                signal: row.signal.clone(),
            });
            let number = match row.value.as_f64().filter(|_| row.value.is_f64()) {
                Some(value) => number::value(value),
                None => row.value.to_string(),
            };
            let number = format!("{number} {}", row.unit);
            let state = match (row.valid, row.age_us) {
                (true, None) => String::new(),
                (true, Some(age)) => format!("{:.1} ms old", age as f64 / 1e3),
                (false, None) => "not valid".to_owned(),
                (false, Some(age)) => format!("not valid, {:.1} ms old", age as f64 / 1e3),
            };
            let line = format!(
                "{:<width$}  {:<5} {:<3}  {:<16} {state:<14} {}",
                row.name,
                row.hal_type,
                row.direction,
                number.trim_end(),
                place,
            );
            writeln!(f, "{}", line.trim_end())
        })
    }
}
