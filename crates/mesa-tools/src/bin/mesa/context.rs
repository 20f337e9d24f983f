//! What every command gets, and how it ends.

use std::error::Error;
use std::fmt::{self, Display};
use std::process::ExitCode;

use mesa_hal::runner::{Signal, Stop};
use serde::Serialize;

use crate::{output, words};

/// What every command gets.
#[derive(Debug)]
pub struct Context {
    /// For programs.
    pub json: bool,
    /// Whether a signal asks for the end.
    pub stop: Stop,
}

impl Context {
    /// Prints what a command found: for people, or as JSON for programs. The JSON of a command is in
    /// `docs/mesa.schema.json` under its name.
    pub fn print<T: Serialize + Display>(&self, found: &T) -> Result<(), Failure> {
        if self.json {
            let text = serde_json::to_string_pretty(found)?;
            output::say(format_args!("{text}\n"));
        } else {
            output::say(found);
        }
        Ok(())
    }

    /// How a command ends that has done what it can: by the signal that came, if one did.
    pub fn ending(&self) -> Ending {
        match self.stop.signal() {
            Some(signal) => Ending::Stopped(signal),
            None => Ending::Done,
        }
    }
}

/// How a command ends that has said all there is to say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// As asked for.
    Done,
    /// The board or the machine says no, and it was printed.
    Refused,
    /// By a signal, with everything safe.
    Stopped(Signal),
}

/// Why a command was not done.
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
    /// Arguments that make no sense.
    pub fn usage(message: impl Display) -> Self {
        Self::new(Why::Usage, message)
    }

    /// The board or the machine says no.
    pub fn refused(message: impl Display) -> Self {
        Self::new(Why::Refused, message)
    }

    /// A signal came before it was begun, or done.
    pub fn stopped(signal: Signal, message: impl Display) -> Self {
        Self::new(Why::Stopped(signal), message)
    }

    fn new(why: Why, message: impl Display) -> Self {
        Self {
            why,
            message: words::typed(&message),
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
        Self::refused(error.into())
    }
}
