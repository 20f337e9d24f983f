//! Context, ending and failure of a command.

use std::error::Error;
use std::fmt::{self, Display};
use std::process::ExitCode;

use mesa_hal::MesaError;
use mesa_hal::driver::StopError;
use mesa_hal::runner::{Signal, Stop};
use serde::Serialize;

use mesa_tools::advice::{advice_of, told};

use crate::ui::hurry::Hurry;
use crate::ui::output;

/// Context of every command.
#[derive(Debug)]
pub struct Context {
    /// Makes the command line, with the help of each command.
    pub command_line: fn() -> clap::Command,
    /// True if results are printed as JSON, for programs.
    pub json: bool,
    /// Set by a signal that asks for the end.
    pub stop: Stop,
    /// What a signal has cut short.
    pub hurry: Hurry,
}

impl Context {
    /// Prints the result of a command: as text, or as JSON for programs. The JSON of a command is
    /// described in `docs/mesa.schema.json` under its name.
    pub fn print<T: Serialize + Display>(&self, found: &T) -> Result<(), Failure> {
        if self.json {
            let text = serde_json::to_string_pretty(found).map_err(Failure::refused)?;
            output::say(format_args!("{text}\n"));
        } else {
            output::say(found);
        }
        Ok(())
    }

    /// Ending of a command that did what it could: `Stopped` if a signal came, else `Done`.
    pub fn ending(&self) -> Ending {
        match self.stop.signal() {
            Some(signal) => Ending::Stopped(signal),
            None => Ending::Done,
        }
    }
}

/// Ending of a command whose result is printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Done as requested.
    Done,
    /// Refused by the board or the machine; the reason is printed.
    Refused,
    /// Stopped by a signal, with everything safe.
    Stopped(Signal),
}

/// Error of a command that was not carried out.
#[derive(Debug)]
pub struct Failure {
    why: Why,
    message: String,
    advice: Option<String>,
    /// True if an exchange with the board failed, and nothing is to be said about outputs.
    is_of_exchange: bool,
}

/// A failure as JSON, for programs: one line of standard error.
#[derive(Debug, Serialize)]
struct FailureJson<'a> {
    /// The text that is printed without `--json`.
    message: &'a str,
    /// The part of the message about what to do, if it has one.
    advice: Option<&'a str>,
    exit_code: u8,
}

#[derive(Clone, Copy, Debug)]
enum Why {
    Usage,
    Refused,
    Stopped(Signal),
}

impl Failure {
    /// Invalid arguments.
    pub fn usage(message: impl Display) -> Self {
        Self::new(Why::Usage, message)
    }

    /// Refusal by the board or the machine.
    pub fn refused(message: impl Display) -> Self {
        Self::new(Why::Refused, message)
    }

    /// End by a signal before the command was begun or done.
    pub fn stopped(signal: Signal, message: impl Display) -> Self {
        Self::new(Why::Stopped(signal), message)
    }

    fn new(why: Why, message: impl Display) -> Self {
        Self {
            why,
            message: message.to_string(),
            advice: None,
            is_of_exchange: false,
        }
    }

    /// Refusal because of an error of the library, with a text that contains [what it says](told).
    pub fn of(error: &dyn MesaError, message: impl Display) -> Self {
        Self {
            advice: advice_of(error),
            is_of_exchange: (error as &dyn Error).downcast_ref::<StopError>().is_none(),
            ..Self::refused(message)
        }
    }

    /// The failure of a command after a signal. If waits for replies were cut short, a failed
    /// exchange says nothing about the board, and is the end by the signal.
    pub fn after(self, context: &Context) -> Self {
        match context.hurry.gave_up() {
            Some(signal) if self.is_of_exchange => {
                let what = "while replies of the board were missing";
                Self::stopped(signal, format_args!("ended by {signal}, {what}"))
            }
            _ => self,
        }
    }

    /// The same as a mistake in the arguments.
    pub fn for_usage(self) -> Self {
        Self {
            why: Why::Usage,
            ..self
        }
    }

    /// Names the part of the message about what to do.
    pub fn advising(mut self, advice: impl Display) -> Self {
        self.advice = Some(advice.to_string());
        self
    }

    /// Reports the failure on standard error, as text or as JSON, and returns the exit code.
    pub fn report(&self, is_json: bool) -> ExitCode {
        let code = self.exit_status();
        let json = FailureJson {
            message: &self.message,
            advice: self.advice.as_deref(),
            exit_code: code,
        };
        match serde_json::to_string(&json).ok().filter(|_| is_json) {
            Some(json) => output::complain(json),
            None => output::complain(format_args!("mesa: {self}")),
        }
        ExitCode::from(code)
    }

    const fn exit_status(&self) -> u8 {
        match self.why {
            Why::Usage => 2,
            Why::Refused => 1,
            Why::Stopped(signal) => signal.exit_status(),
        }
    }
}

impl Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl<E: MesaError> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::of(&error, told(&error))
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use mesa_hal::bus::{BusError, BusErrorKind, Clock, Fault, LinkError};
    use mesa_hal::driver::RemoteWatchdog;
    use mesa_hal::sslbp::PortError;
    use mesa_hal::transport::Faulty;
    use mesa_hal::{Board, Settings};

    use super::*;
    use crate::machine::built::Machine;
    use crate::machine::embedded::Simulated;

    /// A stop without a way to the board, and with a remote that nothing switches off.
    fn failed_stop() -> StopError {
        let described = "5i25-7i77".parse().expect("a machine");
        let machine = Machine::new(&described).expect("it can be built");
        let bus = Faulty::new(Simulated::new(machine.board).on_pci(), 1);
        let board = Board::identify(bus, Settings::default()).expect("a board");
        let board = board.discover().expect("its remotes");
        let mut driver = board.start().expect("all of them run");
        let pins = driver.pins_mut();
        let output = pins.id("hm2_5i25.0.7i77.0.0.output-00").expect("its pin");
        pins.set_any(output, true.into()).expect("it takes it");
        for _ in 0..20 {
            assert_eq!(driver.read().expect("inputs").failed, 0);
            driver.write().expect("outputs");
            driver.bus_mut().wait(Duration::from_millis(1));
        }
        let bus = driver.bus_mut();
        bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 1.0);
        let (_, stopped) = driver.shutdown();
        let mut error = stopped.expect_err("nothing gets through");
        error.failed = Some(PortError::from(BusError::from(LinkError::Unreachable)));
        error.not_reached[0].watchdog = RemoteWatchdog::Off;
        error
    }

    #[test]
    fn failed_stop_has_the_advice_of_the_remote_and_of_the_bus() {
        let error = failed_stop();
        let of_step = error.failed.as_ref().and_then(PortError::advice);
        let advice = [error.advice(), of_step].map(|advice| advice.expect("one").to_string());
        assert_ne!(advice[0], advice[1]);
        let failure = Failure::from(error);
        for advice in advice {
            assert!(failure.message.contains(&advice), "{failure}: {advice}");
        }
        assert!(!failure.is_of_exchange);
    }
}
