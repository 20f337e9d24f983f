//! Printing to an output that may be closed.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};

/// Prints text. A closed pipe (`head`, for example) is not an error: the board is driven on without
/// an output. Other errors are reported on standard error.
pub fn print(text: impl Display) {
    let mut out = io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            print_error(format_args!("standard output: {error}"));
        }
        _ => {}
    }
}

/// Prints an error message on standard error, if that is still open.
pub fn print_error(text: impl Display) {
    let _ = writeln!(io::stderr(), "{text}");
}
