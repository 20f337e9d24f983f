//! What the examples share: they end well on a signal, and print to whoever still listens.
#![allow(
    dead_code,
    reason = "each example that includes this uses what it needs"
)]

use std::{
    fmt::Display,
    io::{self, ErrorKind, Write},
};

pub use mesa_hal::runner::Stop;

/// Prints. A reader that has seen enough, such as `head`, is no error, and nobody stops driving a
/// board because nobody reads what it says; anything else is said on standard error.
pub fn say(text: impl Display) {
    let mut out = io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            complain(format_args!("standard output: {error}"));
        }
        _ => {}
    }
}

/// Says on standard error, if it is still open, why something was not done.
pub fn complain(text: impl Display) {
    let _ = writeln!(io::stderr(), "{text}");
}
