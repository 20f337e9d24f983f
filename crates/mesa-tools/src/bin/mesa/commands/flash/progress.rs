//! Progress of a flash operation, and the error text of one that was cut off.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use mesa_hal::MesaError;
use mesa_hal::ethernet::FlashStep;

use super::report::{Name, Written};
use crate::ui::context::{Context, Failure};
use crate::ui::output::complain;
use mesa_tools::advice::told;

/// Progress bar on standard error; hidden if that is not a terminal.
pub struct Bar(ProgressBar);

/// Redraw interval while no progress is made: erasing a sector takes up to 3 s.
const TICK: Duration = Duration::from_millis(200);

impl Bar {
    pub fn new(what: &'static str, bytes: u64) -> Self {
        let bar = ProgressBar::new(bytes);
        let template = "{msg:7} {bar:40} {bytes:>10} of {total_bytes}  {elapsed} (left {eta})";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_message(what);
        bar.enable_steady_tick(TICK);
        Self(bar)
    }

    pub fn at(&self, bytes: u64) {
        self.0.set_position(bytes);
    }

    pub fn end(&self) {
        self.0.finish_and_clear();
    }
}

/// A write of an area, which a signal does not interrupt.
pub struct Progress<'a> {
    context: &'a Context,
    bar: Bar,
    written: Written,
    is_alone: bool,
    step: Option<FlashStep>,
    is_told: bool,
}

impl<'a> Progress<'a> {
    /// `is_alone`: the user area is written, and there is no fallback.
    pub fn of_write(context: &'a Context, written: Written, is_alone: bool) -> Self {
        Self {
            context,
            bar: Bar::new("erase", written.len()),
            written,
            is_alone,
            step: None,
            is_told: false,
        }
    }

    /// Shows the bytes of a step that are done.
    pub fn step(&mut self, step: FlashStep, bytes: usize) {
        if self.step.replace(step) != Some(step) {
            self.bar.0.set_message(match step {
                FlashStep::Erase => "erase",
                FlashStep::Write => "write",
                FlashStep::Verify => "verify",
            });
        }
        self.bar.at(bytes as u64);
        if let Some(signal) = self.context.stop.signal().filter(|_| !self.is_told) {
            self.is_told = true;
            self.bar.0.suspend(|| {
                complain(format_args!(
                    "mesa: {signal}: {} is finished first, because half of it is useless; leave \
                     the board switched on",
                    self.written
                ));
            });
        }
    }

    /// Ends the progress. An error is extended by the state of the memory.
    pub fn ended<E: MesaError>(&self, done: Result<(), E>) -> Result<(), Failure> {
        self.bar.end();
        done.map_err(|error| {
            let error = told(&error);
            let state = match (self.step, self.written.area) {
                (None, _) => "if anything was erased, it was the first sector",
                (_, Some(Name::BootBlock)) => {
                    "the boot block is not whole: the FPGA would not start from this memory"
                }
                (_, Some(Name::User)) if self.is_alone => {
                    "the user configuration is not whole, and there is no fallback: the FPGA would not \
                     start from this memory"
                }
                (_, Some(Name::User)) => {
                    "the user configuration is not whole: at its next start the FPGA loads the fallback"
                }
                (_, Some(Name::Fallback)) => {
                    "the fallback is not whole: the FPGA starts from the user configuration only"
                }
                _ => "these sectors are not whole; no configuration is in them",
            };
            Failure::refused(format_args!(
                "{error}; {} was cut off: {state}. The FPGA keeps running what it has loaded: leave the \
                 board switched on, and write this again",
                self.written
            ))
        })
    }
}
