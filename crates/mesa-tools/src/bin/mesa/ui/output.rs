//! Printing to standard output and standard error.

use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use rustix::termios::tcgetwinsize;

/// Messages held back while a screen uses the terminal; `MAX_HELD` lines at most.
static HELD: Mutex<Option<Vec<String>>> = Mutex::new(None);
const MAX_HELD: usize = 1000;

/// First error of standard output, other than a closed pipe.
static LOST: OnceLock<String> = OnceLock::new();

/// Standard output takes no more.
static IS_CLOSED: AtomicBool = AtomicBool::new(false);

/// True if nobody reads standard output any more: a command that prints until it is ended can end.
pub fn is_closed() -> bool {
    IS_CLOSED.load(Ordering::Relaxed)
}

/// Prints to standard output. A closed pipe, as `head` leaves it, is no error. Any other error is
/// [kept](lost) for the end: a command that drives a board continues in either case.
pub fn say(text: impl Display) {
    let mut out = io::stdout().lock();
    let done = match width(&out) {
        Some(width) => write!(out, "{}", wrapped(&text.to_string(), width)),
        None => write!(out, "{text}"),
    };
    printed(done.and_then(|()| out.flush()));
}

/// Columns of the output, if it is a terminal of at least 40. Unlike crossterm's function, it
/// starts no program where there is no terminal.
fn width(output: impl AsFd) -> Option<usize> {
    let width = tcgetwinsize(output).ok()?.ws_col;
    (width >= 40).then_some(width.into())
}

/// Breaks longer lines at a gap of two spaces, or else at a space, and indents the continuation.
fn wrapped(text: &str, width: usize) -> String {
    let mut wrapped = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        let mut left = line;
        let blanks = line.len() - line.trim_start_matches(' ').len();
        let indent = (blanks + 4).min(width / 2);
        let mut before = 0;
        while let Some(at) = breaking(left, width - before, before == 0) {
            let (now, rest) = left.split_at(at);
            wrapped.push_str(now.trim_end());
            wrapped.push('\n');
            wrapped.push_str(&" ".repeat(indent));
            left = rest.trim_start_matches(' ');
            before = indent;
        }
        wrapped.push_str(left);
    }
    wrapped
}

/// Byte index at which to break a line longer than `width` characters; `None` if the line fits or
/// has no space.
fn breaking(line: &str, width: usize, is_first: bool) -> Option<usize> {
    let line = line.trim_end();
    // The character behind the last column may be the space to break at.
    let (end, next) = shown(line).nth(width)?;
    let fits = line.get(..end + next.len_utf8())?;
    let begin = fits.len() - fits.trim_start_matches(' ').len();
    let begin = if is_first { begin } else { 0 };
    let gap = fits.rfind("  ").filter(|&gap| gap >= width / 2);
    let at = gap.or_else(|| fits.rfind(' '));
    at.filter(|&at| at > begin)
}

/// Characters that a terminal shows, with their places: all but those that set a colour.
fn shown(line: &str) -> impl Iterator<Item = (usize, char)> + '_ {
    let mut is_colour = false;
    line.char_indices().filter(move |(_, letter)| {
        let was_colour = is_colour;
        is_colour = *letter == '\x1b' || is_colour && *letter != 'm';
        !was_colour && !is_colour
    })
}

/// Takes the result of printing. The first error is kept, as in [`say`].
pub fn printed(result: io::Result<()>) {
    IS_CLOSED.fetch_or(result.is_err(), Ordering::Relaxed);
    let lost = result.err();
    if let Some(error) = lost.filter(|error| error.kind() != ErrorKind::BrokenPipe) {
        let _ = LOST.set(error.to_string());
    }
}

/// Error that lost output, so that the command did not do all it was asked for.
pub fn lost() -> Option<&'static str> {
    LOST.get().map(String::as_str)
}

/// True while the last line of a terminal is a [status].
static IS_STATUS: AtomicBool = AtomicBool::new(false);

/// Prints what passes by itself, such as seconds that are left: on a terminal in one line that the
/// next status or message replaces, else in a line of its own. Not printed while messages are
/// [held](hold).
pub fn status(text: impl Display) {
    let held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    if held.is_some() {
        return;
    }
    let mut out = io::stderr();
    let _ = if out.is_terminal() {
        IS_STATUS.store(true, Ordering::Relaxed);
        write!(out, "{REPLACE}{text}")
    } else {
        writeln!(out, "{text}")
    };
}

/// Goes to the begin of the line and clears it.
const REPLACE: &str = "\r\x1b[K";

/// Prints a message to standard error, if that is still open. While messages are [held](hold), the
/// message is kept instead.
pub fn complain(text: impl Display) {
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    match &mut *held {
        Some(lines) if lines.len() < MAX_HELD => lines.push(text.to_string()),
        Some(_) => {}
        None => {
            let is_status = IS_STATUS.swap(false, Ordering::Relaxed);
            let before = if is_status { REPLACE } else { "" };
            let text = text.to_string();
            let text = match width(io::stderr()) {
                Some(width) => wrapped(&text, width),
                None => text,
            };
            let _ = writeln!(io::stderr(), "{before}{text}");
        }
    }
}

/// Holds messages back from now on, until they are taken or released.
pub fn hold() {
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    held.get_or_insert_default();
}

/// Takes the messages held so far.
pub fn take_held() -> Vec<String> {
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    held.as_mut().map(std::mem::take).unwrap_or_default()
}

/// Prints the held messages, and stops holding messages back.
pub fn release() {
    let held = HELD.lock().unwrap_or_else(PoisonError::into_inner).take();
    for line in held.unwrap_or_default() {
        complain(line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_broken_at_gaps_and_nothing_is_lost() {
        let text =
            "short\n  hm2_7i97.0.encoder.00.count  s32   OUT  0   0.0 ms old  TB1 pin 1, 2 QA0\n";
        for width in 40..100 {
            let wrapped = wrapped(text, width);
            assert!(
                wrapped.lines().all(|line| line.chars().count() <= width),
                "{width}: {wrapped}"
            );
            let words = |text: &str| {
                text.split_whitespace()
                    .map(str::to_owned)
                    .collect::<Vec<_>>()
            };
            assert_eq!(words(&wrapped), words(text), "{width}");
        }
        assert_eq!(wrapped(text, 200), text);
        let unbroken = "x".repeat(60) + "\n";
        assert_eq!(wrapped(&unbroken, 40), unbroken);
        assert_eq!(
            wrapped("  ab  cdefghijkl mnopqrstuv wxyz ABCDEFGHIJK\n", 40),
            "  ab  cdefghijkl mnopqrstuv wxyz\n      ABCDEFGHIJK\n"
        );
    }

    #[test]
    fn colours_take_no_columns() {
        let plain = "look     kernel: not PREEMPT_RT, and more words that do not fit\n";
        let coloured = plain.replace("look    ", "\x1b[33mlook    \x1b[0m");
        let expected = wrapped(plain, 44).replace("look    ", "\x1b[33mlook    \x1b[0m");
        assert_eq!(wrapped(&coloured, 44), expected);
    }
}
