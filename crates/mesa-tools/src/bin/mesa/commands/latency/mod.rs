//! `mesa latency`: lateness and cost of cycles on this host with this board, and the rates that
//! they allow.

mod advice;
mod measure;
mod plot;
mod report;
mod setting;

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use mesa_hal::driver::Pace;
use mesa_hal::runner::Realtime;

use crate::board::bus::Bus;
use crate::board::consent::Asks;
use crate::board::modes::Modes;
use crate::board::target::Target;
use crate::machine::embedded::Passage;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::output::complain;
use measure::{Measured, Measurement};
use report::LatencyReport;

const AFTER_HELP: &str = "\
Runs the cycle of the board with everything on it; all outputs stay off. Put the host under its
usual load meanwhile: an idle host shows little.

Late is how much later than planned a cycle begins; at the board's pace, how much more than a period
after the previous one. Used is the time from the planned begin of a cycle to its end; at the
board's pace, the period minus the time that the board waited for its end. A rate can be kept if
this time, followed by the transfers to the remotes, fits into its period.

Exits with 1 if a remote was offline meanwhile: no rate is judged then.

SIGINT (Ctrl-C) and SIGTERM end it early, with the ports stopped, and what was measured is printed.

Examples:
  mesa latency --sim 7i97 --seconds 5
  sudo mesa latency --addr 10.10.10.10 --seconds 60 --realtime 40 --cpu 3 --lock-memory \\
    --plot late.svg";

/// Measure cycle latency and cost: percentiles, histogram, CPU, packets, verdict
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Latency {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
    /// Time to measure at each pace, in seconds, 0.1 to 86400
    #[arg(long, value_name = "N", default_value = "10", value_parser = seconds)]
    seconds: f64,
    /// Cycles per second, 100 to 10000
    #[arg(long, value_name = "HZ", default_value_t = 1000,
          value_parser = clap::value_parser!(u32).range(100..=10_000))]
    rate: u32,
    /// Clock that starts the cycles; `board` needs a firmware with a DPLL, as that of a 7I97
    #[arg(long, value_enum, default_value = "host")]
    pace: Paces,
    /// File for a picture of the histograms and the verdicts, as SVG
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// SCHED_FIFO priority of the cycle, 1 to 99
    #[arg(long, value_name = "PRIORITY", value_parser = clap::value_parser!(u8).range(1..=99))]
    realtime: Option<u8>,
    /// CPU for the cycle, 0 to one less than there are; repeat for more
    #[arg(long, value_name = "N")]
    cpu: Vec<usize>,
    /// Keep all memory of the process in RAM
    #[arg(long)]
    lock_memory: bool,
    /// Poll the clock in the last 20 us before a cycle instead of sleeping: cycles begin earlier,
    /// and cost more CPU
    #[arg(long)]
    spin: bool,
    #[command(flatten)]
    asks: Asks,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Paces {
    #[value(help = "this host's clock")]
    Host,
    #[value(help = "the board's clock")]
    Board,
    #[value(help = "one after the other")]
    Both,
}

impl Paces {
    const fn each(self) -> &'static [Pace] {
        match self {
            Self::Host => &[Pace::Host],
            Self::Board => &[Pace::Board],
            Self::Both => &[Pace::Host, Pace::Board],
        }
    }
}

impl Latency {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        if let Some(file) = &self.plot {
            self.asks.replaces(context, file)?;
        }
        let found = self.target.find(context)?.pass_time(Passage::Host);
        let bus = found.open()?;
        let measured = self.watched(|| measure::each(&self.measurement(), bus, context))?;
        let report = LatencyReport::of(self.rate, &measured);
        context.print(&report)?;
        let drawn = self
            .plot
            .as_ref()
            .map(|file| plot::draw(file, &report, &measured));
        let was_offline = measured.iter().any(|run| !run.offline.is_empty());
        for run in measured {
            run.stopped.map_err(Failure::refused)?;
        }
        drawn.transpose()?;
        if let Some(signal) = context.stop.signal() {
            complain(format_args!(
                "mesa: ended by {signal} before its time; no output was ever on, and the ports are stopped"
            ));
        }
        Ok(match context.ending() {
            Ending::Done if was_offline => Ending::Refused,
            ending => ending,
        })
    }

    /// Measures in a thread of its own, which alone gets the real-time settings, and shows the
    /// progress on a terminal.
    fn watched(
        &self,
        measure: impl FnOnce() -> Result<Vec<Measured>, Failure> + Send,
    ) -> Result<Vec<Measured>, Failure> {
        let bar = self.progress_bar();
        std::thread::scope(|scope| {
            let thread = scope.spawn(measure);
            while !thread.is_finished() {
                std::thread::sleep(Duration::from_millis(20));
                bar.set_position(bar.elapsed().as_millis() as u64);
            }
            bar.finish_and_clear();
            let ended = thread.join();
            ended.unwrap_or_else(|_| Err(Failure::refused("the thread of the cycle has panicked")))
        })
    }

    /// Progress bar, which hides itself if standard error is not a terminal.
    fn progress_bar(&self) -> ProgressBar {
        let seconds = self.seconds * self.pace.each().len() as f64;
        let bar = ProgressBar::new((seconds * 1000.0) as u64);
        if let Ok(style) = ProgressStyle::with_template("{bar:40} {elapsed} of {msg}") {
            bar.set_style(style);
        }
        bar.set_message(format!("{seconds} s"));
        bar
    }

    fn measurement(&self) -> Measurement {
        Measurement {
            paces: self.pace.each(),
            rate: self.rate,
            cycles: (self.seconds * f64::from(self.rate)).round() as u64,
            modes: self.modes.clone(),
            realtime: Realtime {
                priority: self.realtime,
                lock_memory: self.lock_memory,
                cpus: self.cpu.clone(),
            },
            is_spinning: self.spin,
        }
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.1..=86400.0).contains(&seconds) => Ok(seconds),
        _ => Err(String::from("it must be 0.1 to 86400")),
    }
}

/// A measurement for people.
#[derive(Debug)]
pub struct Picture {
    pub svg: String,
    /// The figures, or the source of the picture.
    pub text: String,
}

/// Measures cycles at 1 kHz with all outputs off, paced by this host, without real-time settings.
pub fn picture(
    target: &Target,
    modes: &Modes,
    seconds: f64,
    bus: Bus,
    context: &Context,
) -> Result<Picture, Failure> {
    let plain = Latency {
        target: target.clone(),
        modes: modes.clone(),
        seconds,
        rate: 1000,
        pace: Paces::Host,
        plot: None,
        realtime: None,
        cpu: Vec::new(),
        lock_memory: false,
        spin: false,
        asks: Asks { yes: false },
    };
    let measured = plain.watched(|| measure::each(&plain.measurement(), bus, context))?;
    let report = LatencyReport::of(plain.rate, &measured);
    let svg = plot::svg(&report, &measured)?;
    let text = report.to_string();
    for run in measured {
        run.stopped.map_err(Failure::refused)?;
    }
    Ok(Picture { svg, text })
}
