//! What is printed, to whoever still listens.

use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// While a screen has the terminal, what is complained about waits here, up to this many lines.
static HELD: Mutex<Option<Vec<String>>> = Mutex::new(None);
const MAX_HELD: usize = 1000;

/// Whether something could not be printed that somebody still waits for.
static IS_LOST: AtomicBool = AtomicBool::new(false);

/// Prints. A reader that has seen enough, such as `head`, is no error. Anything else is said once on
/// standard error and [kept](is_lost); nobody stops driving a board because nobody reads what it says.
pub fn say(text: impl Display) {
    let mut out = io::stdout().lock();
    let done = match width() {
        Some(width) => write!(out, "{}", wrapped(&text.to_string(), width)),
        None => write!(out, "{text}"),
    };
    printed(done.and_then(|()| out.flush()));
}

/// Columns of the terminal that standard output is, if it is one.
fn width() -> Option<usize> {
    let size = ratatui::crossterm::terminal::size();
    let is_shown = io::stdout().is_terminal();
    let width = size.ok().filter(|_| is_shown)?.0;
    (width >= 40).then_some(width.into())
}

/// Breaks lines that are longer at a gap, or else at a space, and indents what goes on.
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

/// Where to break a line that is longer than so many characters, if that can be done.
fn breaking(line: &str, width: usize, is_first: bool) -> Option<usize> {
    let line = line.trim_end();
    // What is behind may begin with the space that is broken at.
    let (end, next) = line.char_indices().nth(width)?;
    let fits = line.get(..end + next.len_utf8())?;
    let begin = fits.len() - fits.trim_start_matches(' ').len();
    let begin = if is_first { begin } else { 0 };
    let gap = fits.rfind("  ").filter(|&gap| gap >= width / 2);
    let at = gap.or_else(|| fits.rfind(' '));
    at.filter(|&at| at > begin)
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
        Some(lines) if lines.len() < MAX_HELD => lines.push(text.to_string()),
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
}
