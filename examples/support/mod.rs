//! What the examples share: they end well on a signal, and print to whoever still listens.
#![allow(
    dead_code,
    reason = "each example that includes this uses what it needs"
)]

use std::{
    fmt::Display,
    io::{self, ErrorKind, Write},
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use signal_hook::consts::{SIGINT, SIGTERM};

/// Whether a signal asked the program to end. What drives a board looks at it in every cycle.
#[derive(Clone, Debug)]
pub struct Stop(Arc<AtomicUsize>);

impl Stop {
    /// From now on SIGINT (Ctrl-C) and SIGTERM do not end the program, but are noted here.
    pub fn on_signals() -> io::Result<Self> {
        let noted = Arc::new(AtomicUsize::new(0));
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register_usize(signal, Arc::clone(&noted), signal as usize)?;
        }
        Ok(Self(noted))
    }

    /// The signal that came, if one did.
    pub fn signal(&self) -> Option<Signal> {
        match self.0.load(Ordering::Relaxed) {
            0 => None,
            number => Some(Signal(number as i32)),
        }
    }
}

/// A signal that ended a program. `Display` is its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signal(i32);

impl Signal {
    /// What shells expect of a program that a signal has ended: 128 and its number.
    pub fn exit_code(self) -> ExitCode {
        ExitCode::from(128 + self.0 as u8)
    }
}

impl Display for Signal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self.0 {
            SIGINT => "SIGINT",
            SIGTERM => "SIGTERM",
            _ => "a signal",
        })
    }
}

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
