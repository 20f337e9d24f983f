use alloc::sync::Arc;
use core::fmt::Display;
use core::sync::atomic::{AtomicUsize, Ordering};
use std::io;
use std::process::ExitCode;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

/// Flag that a signal has asked the program to end. A program that drives a board checks it in
/// every cycle.
///
/// # Real time
/// A check is one load.
#[derive(Clone, Debug)]
pub struct Stop(Arc<AtomicUsize>);

impl Stop {
    /// Makes SIGINT (Ctrl-C), SIGTERM and SIGHUP (a closed terminal or connection) set this flag
    /// instead of ending the program.
    ///
    /// # Errors
    /// The operating system refuses a handler.
    pub fn on_signals() -> io::Result<Self> {
        let noted = Arc::new(AtomicUsize::new(0));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            signal_hook::flag::register_usize(signal, Arc::clone(&noted), signal as usize)?;
        }
        Ok(Self(noted))
    }

    /// The signal that arrived, if any.
    pub fn signal(&self) -> Option<Signal> {
        match self.0.load(Ordering::Relaxed) {
            0 => None,
            number => Some(Signal(number as i32)),
        }
    }
}

/// A signal that ends a program. `Display` is its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signal(i32);

impl Signal {
    /// The exit status that shells expect of a program ended by a signal: 128 plus its number.
    pub const fn exit_status(self) -> u8 {
        128_u8.wrapping_add(self.0 as u8)
    }

    /// The [exit status](Self::exit_status), for `main` to return.
    pub fn exit_code(self) -> ExitCode {
        ExitCode::from(self.exit_status())
    }
}

impl Display for Signal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self.0 {
            SIGINT => "SIGINT",
            SIGTERM => "SIGTERM",
            SIGHUP => "SIGHUP",
            _ => "a signal",
        })
    }
}
