//! `mesa scope`: recording of cycles around a trigger.

mod plot;
mod table;

use std::fmt::{self, Display};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use clap::{Args, ValueEnum};
use mesa_hal::bus::Instant;
use mesa_hal::driver::Pace;
use mesa_hal::hal::{HalType, PinId, PinInfo, Role};
use mesa_hal::runner::{
    Cycle, Edge, Ended, MAX_SCOPE_PINS, RunStatistics, Runner, Scope as Recorder, ScopeRange,
    ScopeState, Signal, Trigger,
};
use mesa_hal::transport::Recording as RecordedBus;
use mesa_hal::transport::udp::UdpConfig;
use mesa_hal::{Driver, Settings};
use mesa_tools::Counted;
use mesa_tools::diagnosis::{PacketMark, Packets};
use serde::Serialize;

use crate::board::bus::Bus;
use crate::board::bus_log::BusLogFile;
use crate::board::consent::Asks;
use crate::board::modes::Modes;
use crate::board::named;
use crate::board::running;
use crate::board::target::Target;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::files;
use crate::ui::output::complain;
use crate::ui::stamp;
use mesa_tools::advice::told;

/// Timeout of a reply: a late cycle is better than none.
const DEADLINE: Duration = Duration::from_millis(20);

const AFTER_HELP: &str = "\
Drives nothing: all outputs are off. A board that another program drives is left alone. PIN is a
name, or its end if no other name has that end. The pin of the trigger is recorded too, if there are
less than 16 others. Says when it waits for the trigger, and the present value of its pin.

The CSV file has a line for each cycle: seconds and cycles since the trigger, the values, and 1 in
the cycle of the trigger, whose pin, level and time are the name of that column; a value that was
not valid is empty. The picture has a panel for each number, and one line for each bit. Files are
written as a whole or not at all.

Example:
  mesa scope encoder.00.position encoder.00.velocity --trigger 7i77.0.0.input-02 \\
    --cycles 2000 --before 500 --csv home.csv --plot home.svg --addr 10.10.10.10";

/// Record pins in the cycles around a trigger
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Scope {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
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
    bus_log: BusLogFile,
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
struct ScopeReport {
    pins: Vec<String>,
    trigger: String,
    /// Number of the trigger's cycle since the start of the machine.
    trigger_cycle: u64,
    cycles: usize,
    before: u32,
    failed_reads: u64,
    skipped_periods: u64,
    packets: Packets,
    csv: PathBuf,
    plot: Option<PathBuf>,
}

/// A complete recording.
struct Recording {
    /// Board, from its name in LinuxCNC: `hm2_7i92.0`.
    board: String,
    infos: Vec<PinInfo>,
    scope: Recorder,
    trigger: TriggerMark,
}

/// The trigger, as files show it.
struct TriggerMark {
    pin: String,
    level: f64,
    edge: Direction,
    /// Date and time.
    at: String,
    /// Number of its cycle.
    cycle: u64,
}

/// End of a run.
struct Run {
    signal: Option<Signal>,
    statistics: RunStatistics,
    packets: Packets,
}

/// Refuses a read-only parameter: no cycle reads it.
fn check_changes(info: &PinInfo) -> Result<(), Failure> {
    if info.role != Role::Property {
        return Ok(());
    }
    Err(Failure::usage(format_args!(
        "{} is a parameter, read once at the start; a software mode that transfers the value \
         makes it a pin: give it with --mode PORT.CHANNEL=MODE",
        info.name
    )))
}

impl Scope {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        self.check_files(context)?;
        let driver = self.start(context)?;
        let pins = driver.pins();
        let find = |name: &String| named::find(pins, driver.missing(), name);
        let mut recorded = self.pins.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        let pin = find(&self.trigger)?;
        if !recorded.contains(&pin) && recorded.len() < MAX_SCOPE_PINS {
            recorded.push(pin);
        }
        let gone = || Failure::refused("the pin is gone");
        let info = |pin| pins.info_of(pin).cloned().ok_or_else(gone);
        let infos = recorded.iter().map(|&pin| info(pin));
        let infos = infos.collect::<Result<Vec<_>, _>>()?;
        let watched = info(pin)?;
        infos.iter().chain([&watched]).try_for_each(check_changes)?;
        self.check_level(&watched)?;
        let range = ScopeRange {
            before: self.before as usize,
            cycles: self.cycles as usize,
        };
        let mut scope = Recorder::new(pins, &recorded, self.trigger_at(pin), range)
            .map_err(|error| Failure::usage(told(&error)))?;
        let board = driver.name().to_owned();
        let run = self.record(context, driver, &watched, &mut scope)?;
        if let Some(signal) = run.signal {
            complain(format_args!(
                "mesa: ended by {signal}; nothing was written, and the ports are stopped"
            ));
            return Ok(Ending::Stopped(signal));
        }
        if scope.state() != ScopeState::Done {
            return Err(self.never(&watched.name, &run.packets));
        }
        let trigger = self.mark(watched.name, &scope);
        let recording = Recording {
            board,
            infos,
            scope,
            trigger,
        };
        self.write(context, recording, &run)?;
        Ok(Ending::Done)
    }

    /// The trigger has not come.
    fn never(&self, pin: &str, packets: &Packets) -> Failure {
        let trouble = packets.trouble();
        let trouble = trouble.map_or_else(String::new, |trouble| format!(" ({trouble})"));
        Failure::refused(format_args!(
            "{pin} has not crossed {} {} in {} s{trouble}; nothing was written",
            self.level,
            self.edge.word(),
            self.timeout
        ))
    }

    /// Writes the files, and prints the summary.
    fn write(&self, context: &Context, recording: Recording, run: &Run) -> Result<(), Failure> {
        files::write(&self.csv, table::of(&recording).as_bytes())?;
        if let Some(plot) = &self.plot {
            files::write(plot, plot::draw(&recording)?.as_bytes())?;
        }
        let Recording {
            infos,
            scope,
            trigger,
            ..
        } = recording;
        context.print(&ScopeReport {
            pins: infos.into_iter().map(|info| info.name).collect(),
            trigger: trigger.pin,
            trigger_cycle: trigger.cycle,
            cycles: scope.rows().count(),
            before: self.before,
            failed_reads: run.statistics.failed_reads,
            skipped_periods: run.statistics.skipped_periods,
            packets: run.packets,
            csv: self.csv.clone(),
            plot: self.plot.clone(),
        })
    }

    /// The trigger of a complete recording, whose last cycle was just now.
    fn mark(&self, pin: String, scope: &Recorder) -> TriggerMark {
        let trigger = scope.rows().find(|row| row.offset == 0);
        let last = scope.rows().last();
        let ago = trigger.zip(last);
        let ago = ago.map_or(Duration::ZERO, |(row, last)| last.time.since(row.time));
        TriggerMark {
            pin,
            level: self.level,
            edge: self.edge,
            at: stamp::utc(SystemTime::now() - ago),
            cycle: trigger.map_or(0, |row| row.cycle),
        }
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

    fn start(&self, context: &Context) -> Result<Driver<RecordedBus<Bus>>, Failure> {
        let found = self.target.find(context)?;
        let mut settings = Settings {
            period: Duration::from_micros(self.period.into()),
            watchdog: Some(running::WATCHDOG),
            ..Settings::default()
        };
        let bus = found.open_with(UdpConfig {
            cycle_deadline: DEADLINE,
            ..UdpConfig::default()
        })?;
        self.modes.put(&mut settings);
        running::start(self.bus_log.around(bus), found.with_patience(settings))
    }

    /// Runs cycles until the recording is complete, the trigger is late, or a signal comes.
    fn record(
        &self,
        context: &Context,
        mut driver: Driver<RecordedBus<Bus>>,
        watched: &PinInfo,
        scope: &mut Recorder,
    ) -> Result<Run, Failure> {
        let packets = PacketMark::take(&mut driver.bus_mut().inner);
        let begun = driver.pins().now();
        let runner = Runner::new(driver).stop_on(context.stop.clone());
        let mut checked = Ok(());
        let mut is_armed = false;
        let ended = runner.run(|cycle| {
            checked = running::check(cycle.driver);
            if checked.is_err() {
                return ControlFlow::Break(());
            }
            let state = scope.sample(cycle.pins());
            if state == ScopeState::Waiting && !is_armed {
                is_armed = true;
                self.say_armed(cycle, watched);
            }
            if state == ScopeState::Done || self.is_over(cycle.pins().now(), begun, state) {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        });
        checked.map_err(|why| Failure::refused(format_args!("{why}; nothing was written")))?;
        let Ended {
            driver,
            stopped,
            statistics,
            signal,
            ..
        } = ended;
        let saved = self.bus_log.save(&driver.bus().log, driver.firmware());
        stopped?;
        saved?;
        Ok(Run {
            signal,
            statistics,
            packets: packets.packets_since(&mut driver.into_bus().inner, Pace::Host),
        })
    }

    /// True if the trigger has not come in its time.
    fn is_over(&self, now: Instant, begun: Instant, state: ScopeState) -> bool {
        let is_waiting = matches!(state, ScopeState::Filling | ScopeState::Waiting);
        is_waiting && now.since(begun) > Duration::from_secs(self.timeout.into())
    }

    /// Tells what is awaited, once the cycles before the trigger are recorded.
    fn say_armed(&self, cycle: &Cycle<'_, RecordedBus<Bus>>, watched: &PinInfo) {
        let pins = cycle.pins();
        let now = pins.find(&watched.name);
        let now = now.and_then(|pin| pins.read_any(pin).ok());
        let edge = self.edge.word();
        let level = self.level;
        let state = match now {
            None => "is not valid now".to_owned(),
            Some(value) => {
                let first = if self.edge.is_beyond(value.as_f64(), level) {
                    ", so that it must go back first"
                } else {
                    ""
                };
                let unit = &watched.unit;
                let text = format!("is {} {unit}", named::text(value));
                format!("{} now{first}", text.trim_end())
            }
        };
        complain(format_args!(
            "mesa: armed: waits up to {} s until {} crosses {level} {edge}; it {state}",
            self.timeout, watched.name
        ));
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
        let files = std::iter::once(&self.csv).chain(&self.plot);
        let mut files = files.chain(&self.bus_log.path);
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

    /// True if a value has crossed the level already.
    fn is_beyond(self, value: f64, level: f64) -> bool {
        match self {
            Self::Rising => value >= level,
            Self::Falling => value <= level,
        }
    }
}

/// The trigger on one line: pin, level, time and cycle.
impl Display for TriggerMark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            pin,
            level,
            edge,
            at,
            cycle,
        } = self;
        let edge = edge.word();
        write!(f, "{pin} crosses {level} {edge}, {at}, cycle {cycle}")
    }
}

impl Display for ScopeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} of {} around {} in cycle {}, {} of them before",
            Counted::of(self.cycles, "cycle"),
            Counted::of(self.pins.len(), "pin"),
            self.trigger,
            self.trigger_cycle,
            self.before
        )?;
        if self.failed_reads + self.skipped_periods > 0 {
            writeln!(
                f,
                "{} failed, {} had no cycle: the time of each line is the true one",
                Counted(self.failed_reads, "read"),
                Counted(self.skipped_periods, "period")
            )?;
        }
        if let Some(trouble) = self.packets.trouble() {
            writeln!(f, "{trouble}")?;
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
