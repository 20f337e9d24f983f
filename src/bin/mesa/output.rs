//! What is printed, to whoever still listens.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// While a screen has the terminal, what is complained about waits here, up to this many lines.
static HELD: Mutex<Option<Vec<String>>> = Mutex::new(None);
const MOST_HELD: usize = 1000;

/// Whether something could not be printed that somebody still waits for.
static IS_LOST: AtomicBool = AtomicBool::new(false);

/// Prints. A reader that has seen enough, such as `head`, is no error. Anything else is said once on
/// standard error and [kept](is_lost); nobody stops driving a board because nobody reads what it says.
pub fn say(text: impl Display) {
    let mut out = io::stdout().lock();
    printed(write!(out, "{text}").and_then(|()| out.flush()));
}

/// Looks at how something was printed.
pub fn printed(result: io::Result<()>) {
    let lost = result.err();
    let lost = lost.filter(|error| error.kind() != ErrorKind::BrokenPipe);
    if let Some(error) = lost.filter(|_| !IS_LOST.swap(true, Ordering::Relaxed)) {
        complain(format_args!("mesa: standard output: {error}"));
    }
}

/// Whether something could not be printed: then the command has not done what it was asked for.
pub fn is_lost() -> bool {
    IS_LOST.load(Ordering::Relaxed)
}

/// Says on standard error, if it is still open, why something was not done; later, while it is held.
pub fn complain(text: impl Display) {
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    match &mut *held {
        Some(lines) if lines.len() < MOST_HELD => lines.push(text.to_string()),
        Some(_) => {}
        None => {
            let _ = writeln!(io::stderr(), "{text}");
        }
    }
}

/// From now on what is complained about waits until it is taken or released.
pub fn hold() {
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    held.get_or_insert_default();
}

/// Takes what was held.
pub fn take_held() -> Vec<String> {
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    held.as_mut().map(std::mem::take).unwrap_or_default()
}

/// Says what was held, and holds nothing any more.
pub fn release() {
    let held = HELD.lock().unwrap_or_else(PoisonError::into_inner).take();
    for line in held.unwrap_or_default() {
        complain(line);
    }
}
