//! Context, ending and failure of a command.

use std::error::Error;
use std::fmt::{self, Display};
use std::process::ExitCode;

use mesa_hal::runner::{Signal, Stop};
use serde::Serialize;

use mesa_tools::advice::{advice_of, with_advice};
use mesa_tools::setup::RestoreError;

use crate::commands::param::cabinet::CabinetError;
use crate::output;

/// Context of every command.
#[derive(Debug)]
pub struct Context {
    /// True if results are printed as JSON, for programs.
    pub json: bool,
    /// Set by a signal that asks for the end.
    pub stop: Stop,
}

impl Context {
    /// Prints the result of a command: as text, or as JSON for programs. The JSON of a command is
    /// described in `docs/mesa.schema.json` under its name.
    pub fn print<T: Serialize + Display>(&self, found: &T) -> Result<(), Failure> {
        if self.json {
            let text = serde_json::to_string_pretty(found)?;
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
        }
    }

    pub fn exit_code(&self) -> ExitCode {
        match self.why {
            Why::Usage => ExitCode::from(2),
            Why::Refused => ExitCode::FAILURE,
            Why::Stopped(signal) => signal.exit_code(),
        }
    }
}

impl Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl<E: Into<Box<dyn Error>>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::refused(told(&*error.into()))
    }
}

/// The facts of an error, and its advice in the words of the command line.
pub fn told(error: &(dyn Error + 'static)) -> String {
    let cabinet = match error.downcast_ref() {
        Some(RestoreError::Cabinet(error)) => Some(error),
        Some(other) => return with_advice(other, other.advice()),
        None => error.downcast_ref::<CabinetError>(),
    };
    let inner: &(dyn Error + 'static) = match cabinet {
        Some(CabinetError::Board(error)) => error,
        Some(CabinetError::Serial(error)) => error,
        None => error,
    };
    with_advice(error, advice_of(inner))
}
