use alloc::sync::Arc;
use core::fmt::Display;
use core::sync::atomic::{AtomicUsize, Ordering};
use std::io;
use std::process::ExitCode;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

/// Whether a signal asked the program to end. What drives a board looks at it in every cycle.
///
/// # Real time
/// Looking at it is one load.
#[derive(Clone, Debug)]
pub struct Stop(Arc<AtomicUsize>);

impl Stop {
    /// From now on SIGINT (Ctrl-C), SIGTERM and SIGHUP (a terminal or a connection that is closed) do
    /// not end the program, but are noted here.
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

    /// The signal that came, if one did.
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
    /// What shells expect of a program that a signal has ended: 128 and its number.
    pub fn exit_code(self) -> ExitCode {
        ExitCode::from(128_u8.wrapping_add(self.0 as u8))
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
