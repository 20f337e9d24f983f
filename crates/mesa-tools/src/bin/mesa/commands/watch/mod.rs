//! `mesa watch`: live pins of a machine on a full screen.

mod columns;
mod passive;
mod screen;
pub mod view;

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::Args;
use mesa_hal::Settings;
use mesa_hal::runner::{Runner, SnapshotReader};
use ratatui::Frame;
use ratatui::crossterm::event::KeyEvent;

use crate::board::bus::Bus;
use crate::board::look;
use crate::board::modes::Modes;
use crate::board::running::{self, Keeper};
use crate::board::target::Target;
use crate::machine::embedded::Passage;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::full_screen::{self, Screen, Wish};
use crate::ui::output::complain;
use screen::Pins;

const AFTER_HELP: &str = "\
Starts the machine with all outputs off and drives nothing. A board that another program drives is
left alone; with --passive its registers are shown beside that program. Pins at terminals come
first, encoders with their position. Keys: a lists parameters and inverted pins (-not), and all pins
of encoders, or hides them; / filters while typing, Enter ends typing; arrows, PgUp, PgDn, Home, End
scroll; q, Esc or Ctrl-C end the command, with outputs off and ports stopped.

Examples:
  mesa watch --sim 7i92-7i77
  mesa watch 'TB8' --addr 10.10.10.10 --period 2
  mesa watch encoder --passive --addr 10.10.10.10";

/// Show the pins of a machine live on a full screen; drives nothing
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Watch {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
    /// Initial filter: a part of a pin's name, terminal or signal, or a pattern with * or ?
    #[arg(default_value = "", hide_default_value = true)]
    pattern: String,
    /// List parameters, inverted pins and all pins of encoders from the start, as key a does
    #[arg(long)]
    all: bool,
    /// Period of the cycle in milliseconds, 1 to 10
    #[arg(long, value_name = "MS", default_value_t = 5)]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=10))]
    period: u64,
    /// Look at a running machine: show the values in the registers of the board beside LinuxCNC or
    /// another program that drives it. Writes nothing. With --json one object per line, until the
    /// end
    #[arg(long, conflicts_with_all = ["modes", "all", "period"])]
    passive: bool,
    /// Time between two looks with --passive: 50ms to 3600s, as 200ms or 2s
    #[arg(
        long,
        value_name = "TIME",
        default_value = "100ms",
        requires = "passive"
    )]
    #[arg(value_parser = look::parse_every)]
    every: Duration,
}

impl Watch {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        if self.passive {
            let found = self.target.find(context)?.pass_time(Passage::Paced);
            return passive::run(&found, context, &self.pattern, self.every);
        }
        full_screen::check(
            context,
            "`mesa pins` prints the pins once, `mesa pins --json` for programs",
        )?;
        let found = self.target.find(context)?.pass_time(Passage::Paced);
        let mut settings = Settings {
            period: Duration::from_millis(self.period),
            watchdog: Some(running::WATCHDOG),
            ..Settings::default()
        };
        self.modes.put(&mut settings);
        let driver = running::start(found.open()?, found.with_patience(settings))?;
        let (name, period) = (driver.name(), driver.period());
        let pins = Pins::new(name, period, self.pattern.clone(), self.all);
        let mut runner = Runner::new(driver).stop_on(context.stop.clone());
        let reader = runner.snapshot();
        let mut live = Live { pins, reader };
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        let cycle = std::thread::spawn(move || runner.run(cycle_until(over)));
        let shown = full_screen::show(context, &mut live);
        is_over.store(true, Ordering::Relaxed);
        let ended = cycle
            .join()
            .map_err(|_| Failure::refused("the cycle's thread panicked"))?;
        running::check_end(&ended)?;
        shown?;
        complain("mesa: outputs were never on; the ports are stopped");
        Ok(context.ending())
    }
}

/// Work of each cycle: sets up a board again that lost its set-up, and ends if another program
/// drives it.
fn cycle_until(
    is_over: Arc<AtomicBool>,
) -> impl FnMut(&mut mesa_hal::runner::Cycle<'_, Bus>) -> ControlFlow<()> {
    let mut keeper = Keeper::default();
    move |cycle| {
        let is_alone = running::check_alone(cycle.driver.bus()).is_ok();
        if is_over.load(Ordering::Relaxed) || !is_alone {
            return ControlFlow::Break(());
        }
        keeper.look_after(cycle.driver);
        ControlFlow::Continue(())
    }
}

/// Pins of a running machine.
struct Live {
    pins: Pins,
    reader: SnapshotReader,
}

impl Screen for Live {
    fn refresh(&mut self) -> Wish {
        if let Ok(snapshot) = self.reader.read() {
            self.pins.take(&snapshot);
        }
        if self.reader.has_ended() {
            Wish::End
        } else {
            Wish::Continue
        }
    }

    fn key(&mut self, key: KeyEvent) -> Wish {
        self.pins.key(key)
    }

    fn draw(&mut self, frame: &mut Frame<'_>) {
        self.pins.draw(frame);
    }
}
