//! `mesa scope`: recording of cycles around a trigger.

mod plot;

use std::fmt::{self, Display, Write};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};
use mesa_hal::hal::{HalType, PinId, PinInfo};
use mesa_hal::runner::{Edge, Ended, Runner, Scope as Recorder, ScopeRange, ScopeState, Trigger};
use mesa_hal::transport::udp::UdpConfig;
use mesa_hal::{Driver, Settings};
use serde::Serialize;

use super::named;
use crate::consent::Asks;
use crate::context::{Context, Ending, Failure, told};
use crate::link::Bus;
use crate::target::Target;
use crate::{files, running};

/// Timeout of a reply: a late cycle is better than none.
const DEADLINE: Duration = Duration::from_millis(20);

const AFTER_HELP: &str = "\
Drives nothing: all outputs are off. A board that another program drives is left alone. PIN is a
name, or its end if no other name has that end. The CSV file has a line for each cycle: seconds and
cycles since the trigger, then the values; a value that was not valid is empty. Files are written as
a whole or not at all.

Example:
  mesa scope encoder.00.position encoder.00.velocity --trigger 7i77.0.0.input-02 \\
    --cycles 2000 --before 500 --csv home.csv --plot home.svg --addr 10.10.10.10";

/// Record pins in the cycles around a trigger
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Scope {
    #[command(flatten)]
    target: Target,
    /// Pins or parameters to record, 1 to 16
    #[arg(value_name = "PIN", required = true, num_args = 1..=16)]
    pins: Vec<String>,
    /// Pin that triggers when it crosses the level; a bit is 0 or 1
    #[arg(long, value_name = "PIN")]
    trigger: String,
    /// Level of the trigger, any number
    #[arg(long, default_value_t = 0.5, allow_negative_numbers = true, value_parser = finite)]
    level: f64,
    /// Direction in which the level is crossed
    #[arg(long, value_enum, default_value_t = Direction::Rising)]
    edge: Direction,
    /// Number of cycles to record, including those before the trigger: 2 to 100000
    #[arg(long, value_name = "N", default_value_t = 1000,
        value_parser = clap::value_parser!(u32).range(2..=100_000))]
    cycles: u32,
    /// Number of cycles before the trigger: 0 to one less than --cycles
    #[arg(long, value_name = "N", default_value_t = 100)]
    before: u32,
    /// Period of the cycle, in microseconds, 250 to 10000
    #[arg(long, value_name = "US", default_value_t = 1000,
        value_parser = clap::value_parser!(u32).range(250..=10_000))]
    period: u32,
    /// Time to wait for the trigger, in seconds, 1 to 3600
    #[arg(long, value_name = "S", default_value_t = 60,
        value_parser = clap::value_parser!(u32).range(1..=3600))]
    timeout: u32,
    /// File for the values
    #[arg(long, value_name = "FILE")]
    csv: PathBuf,
    /// File for a picture of the values
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    asks: Asks,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Direction {
    Rising,
    Falling,
}

/// Summary of a recording.
#[derive(Debug, Serialize)]
struct Report {
    pins: Vec<String>,
    trigger: String,
    cycles: usize,
    before: u32,
    failed_reads: u64,
    skipped_periods: u64,
    csv: PathBuf,
    plot: Option<PathBuf>,
}

impl Scope {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        self.check_files(context)?;
        let driver = self.start()?;
        let pins = driver.pins();
        let find = |name: &String| named::find(pins, driver.missing(), name);
        let recorded = self.pins.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        let pin = find(&self.trigger)?;
        let info = |pin| pins.info_of(pin).cloned().ok_or("the pin is gone");
        let infos = recorded.iter().map(|&pin| info(pin));
        let infos = infos.collect::<Result<Vec<_>, _>>()?;
        self.check_level(&info(pin)?)?;
        let trigger = self.trigger_at(pin);
        let range = ScopeRange {
            before: self.before as usize,
            cycles: self.cycles as usize,
        };
        let mut scope = Recorder::new(pins, &recorded, trigger, range)
            .map_err(|error| Failure::usage(told(&error)))?;
        let trigger = info(pin)?.name;
        let ended = self.record(context, driver, &mut scope)?;
        if let Some(signal) = ended.signal {
            crate::output::complain(format_args!(
                "mesa: ended by {signal}; nothing was written, and the ports are stopped"
            ));
            return Ok(Ending::Stopped(signal));
        }
        if scope.state() != ScopeState::Done {
            return Err(Failure::refused(format_args!(
                "{trigger} has not crossed {} {} in {} s; nothing was written",
                self.level,
                self.edge.word(),
                self.timeout
            )));
        }
        files::write(&self.csv, table(&infos, &scope).as_bytes())?;
        if let Some(plot) = &self.plot {
            files::write(plot, plot::draw(&infos, &scope)?.as_bytes())?;
        }
        context.print(&Report {
            pins: infos.into_iter().map(|info| info.name).collect(),
            trigger,
            cycles: scope.rows().count(),
            before: self.before,
            failed_reads: ended.statistics.failed_reads,
            skipped_periods: ended.statistics.skipped_periods,
            csv: self.csv.clone(),
            plot: self.plot.clone(),
        })?;
        Ok(Ending::Done)
    }

    fn trigger_at(&self, pin: PinId) -> Trigger {
        let edge = match self.edge {
            Direction::Rising => Edge::Rising,
            Direction::Falling => Edge::Falling,
        };
        Trigger {
            pin,
            level: self.level,
            edge,
        }
    }

    fn start(&self) -> Result<Driver<Bus>, Failure> {
        let found = self.target.find()?;
        let settings = Settings {
            period: Duration::from_micros(self.period.into()),
            watchdog: Some(running::WATCHDOG),
            ..Settings::default()
        };
        let bus = found.open_with(UdpConfig {
            cycle_deadline: DEADLINE,
            ..UdpConfig::default()
        })?;
        running::start(bus, found.with_patience(settings))
    }

    /// Runs cycles until the recording is complete, the trigger is late, or a signal comes.
    fn record(
        &self,
        context: &Context,
        driver: Driver<Bus>,
        scope: &mut Recorder,
    ) -> Result<Ended<Bus>, Failure> {
        let begun = driver.pins().now();
        let patience = Duration::from_secs(self.timeout.into());
        let runner = Runner::new(driver).stop_on(context.stop.clone());
        let mut checked = Ok(());
        let ended = runner.run(|cycle| {
            checked = running::check(cycle.driver);
            if checked.is_err() {
                return ControlFlow::Break(());
            }
            let state = scope.sample(cycle.pins());
            let is_waiting = matches!(state, ScopeState::Filling | ScopeState::Waiting);
            let is_late = is_waiting && cycle.pins().now().since(begun) > patience;
            if is_late || state == ScopeState::Done {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        });
        checked.map_err(|why| Failure::refused(format_args!("{why}; nothing was written")))?;
        ended.stopped.clone()?;
        Ok(ended)
    }
}

impl Scope {
    /// Checks the files to write before the trigger is awaited.
    fn check_files(&self, context: &Context) -> Result<(), Failure> {
        if let Some(plot) = &self.plot
            && files::is_same(plot, &self.csv)
        {
            return Err(Failure::usage(format_args!(
                "{}: the values and the picture need a file each",
                self.csv.display()
            )));
        }
        let mut files = std::iter::once(&self.csv).chain(&self.plot);
        files.try_for_each(|file| self.asks.replaces(context, file))
    }

    /// Refuses a level that a bit never crosses.
    fn check_level(&self, info: &PinInfo) -> Result<(), Failure> {
        let is_crossed = match self.edge {
            Direction::Rising => self.level > 0.0 && self.level <= 1.0,
            Direction::Falling => self.level >= 0.0 && self.level < 1.0,
        };
        if info.hal_type != HalType::Bit || is_crossed {
            return Ok(());
        }
        Err(Failure::usage(format_args!(
            "{} is a bit, 0 or 1, and never crosses {} {}; leave --level out",
            info.name,
            self.level,
            self.edge.word()
        )))
    }
}

impl Direction {
    const fn word(self) -> &'static str {
        match self {
            Self::Rising => "rising",
            Self::Falling => "falling",
        }
    }
}

/// Seconds and cycles since the trigger, and the values, as CSV.
fn table(infos: &[PinInfo], scope: &Recorder) -> String {
    let names: Vec<&str> = infos.iter().map(|info| &*info.name).collect();
    // A name may contain a comma, but cannot contain a quote.
    let names = names.iter().map(|name| format!("\"{name}\""));
    let mut text = format!("time_s,cycle,{}\n", names.collect::<Vec<_>>().join(","));
    for (seconds, row) in times(scope).zip(scope.rows()) {
        let _ = write!(text, "{seconds:.9},{}", row.offset);
        for value in row.values() {
            text.push(',');
            if let Some(value) = value {
                let _ = write!(text, "{}", value.as_f64());
            }
        }
        text.push('\n');
    }
    text
}

/// Seconds since the trigger, for each cycle.
fn times(scope: &Recorder) -> impl Iterator<Item = f64> + '_ {
    let trigger = scope.rows().find(|row| row.offset == 0);
    let trigger = trigger.map_or(0, |row| row.time.as_nanos() as i64);
    let rows = scope.rows();
    rows.map(move |row| (row.time.as_nanos() as i64 - trigger) as f64 / 1e9)
}

impl Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} cycles of {} pins around {}, {} of them before",
            self.cycles,
            self.pins.len(),
            self.trigger,
            self.before
        )?;
        if self.failed_reads + self.skipped_periods > 0 {
            writeln!(
                f,
                "{} reads failed, {} periods had no cycle: the time of each line is the true one",
                self.failed_reads, self.skipped_periods
            )?;
        }
        let files = std::iter::once(&self.csv).chain(&self.plot);
        files
            .into_iter()
            .try_for_each(|file| writeln!(f, "{}", file.display()))
    }
}

fn finite(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("`{text}` is no finite number"))
}
