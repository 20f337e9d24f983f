//! Shared parts of the examples: ending on a signal, and printing to an output that may be closed.
#![allow(
    dead_code,
    reason = "each example that includes this uses what it needs"
)]

use std::{
    fmt::Display,
    io::{self, ErrorKind, Write},
};

pub use mesa_hal::runner::Stop;

/// Prints text. A closed pipe (`head`, for example) is not an error: the board is driven on without
/// an output. Other errors are reported on standard error.
pub fn say(text: impl Display) {
    let mut out = io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            complain(format_args!("standard output: {error}"));
        }
        _ => {}
    }
}

/// Prints an error message on standard error, if that is still open.
pub fn complain(text: impl Display) {
    let _ = writeln!(io::stderr(), "{text}");
}
