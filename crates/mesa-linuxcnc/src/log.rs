//! Messages, at LinuxCNC's levels and limited in number by time.

use core::ffi::CStr;
use core::fmt::{self, Write};
use core::time::Duration;

use crate::ffi::{self, Level};
use crate::interface::Interface;

/// Receives the messages that are not left out.
pub(crate) type Listener = Box<dyn FnMut(Level, &CStr) + Send>;

/// Messages of a board.
///
/// # Real time
/// Bounded by the length of a message. No allocation.
pub(crate) struct Log {
    board: String,
    listener: Listener,
    /// By [`Kind`].
    budgets: [Budget; 3],
}

/// Messages that have a limit of their own.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Error,
    Other,
    Refusal,
}

impl Kind {
    const fn of(level: Level) -> Self {
        match level {
            Level::Error => Self::Error,
            Level::Note => Self::Other,
        }
    }
}

impl fmt::Debug for Log {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Log({}, {:?})", self.board, self.budgets)
    }
}

impl Log {
    /// Messages of the board with this name.
    pub fn new(board: &str, listener: Listener) -> Self {
        Self {
            board: board.into(),
            listener,
            budgets: [Budget::default(); 3],
        }
    }

    /// Prints a message after the name of the board, unless too many were printed shortly before.
    /// `now` is the time since any fixed moment.
    pub fn print(&mut self, now: Duration, level: Level, text: fmt::Arguments<'_>) {
        let mut line = Line::of(&self.board);
        let _ = line.write_fmt(text);
        self.put(now, Kind::of(level), level, line);
    }

    /// As [`print`](Self::print), for a message that names its board or card itself.
    pub fn report(&mut self, now: Duration, level: Level, text: fmt::Arguments<'_>) {
        let mut line = Line::default();
        let _ = line.write_fmt(text);
        self.put(now, Kind::of(level), level, line);
    }

    /// As [`print`](Self::print), that something is not done that LinuxCNC's user has asked for.
    /// Faults of the board do not use up the number of these messages.
    pub fn refuse(&mut self, now: Duration, text: fmt::Arguments<'_>) {
        let mut line = Line::of(&self.board);
        let _ = line.write_fmt(text);
        self.put(now, Kind::Refusal, Level::Error, line);
    }

    /// Prints a line after the name of the board, without a limit: for what was asked for.
    pub fn line(&mut self, level: Level, text: fmt::Arguments<'_>) {
        let mut line = Line::of(&self.board);
        let _ = line.write_fmt(text);
        (self.listener)(level, line.text());
    }

    fn put(&mut self, now: Duration, kind: Kind, level: Level, mut line: Line) {
        let Some(left_out) = self.budgets[kind as usize].spend(now) else {
            return;
        };
        if left_out > 0 {
            let _ = write!(line, " (messages left out before this one: {left_out})");
        }
        (self.listener)(level, line.text());
    }
}

/// Limit of the messages in a time: a burst, and then one in each [`PAUSE`].
#[derive(Clone, Copy, Debug)]
struct Budget {
    left: u32,
    /// Time up to which messages were added to `left`.
    since: Duration,
    left_out: u32,
}

/// Messages in a burst.
const BURST: u32 = 20;
/// Time for one more message.
const PAUSE: Duration = Duration::from_secs(3);

impl Default for Budget {
    fn default() -> Self {
        Self {
            left: BURST,
            since: Duration::ZERO,
            left_out: 0,
        }
    }
}

impl Budget {
    /// Number of messages that were left out before this one; `None` if it is left out too.
    fn spend(&mut self, now: Duration) -> Option<u32> {
        let pauses = now.saturating_sub(self.since).as_nanos() / PAUSE.as_nanos();
        let pauses = u32::try_from(pauses).unwrap_or(u32::MAX);
        self.left = self.left.saturating_add(pauses).min(BURST);
        self.since = if self.left == BURST {
            now
        } else {
            self.since.saturating_add(PAUSE.saturating_mul(pauses))
        };
        if let Some(left) = self.left.checked_sub(1) {
            self.left = left;
            return Some(core::mem::take(&mut self.left_out));
        }
        self.left_out = self.left_out.saturating_add(1);
        None
    }
}

/// Largest length of a line, with its end. LinuxCNC's is 1020.
const LENGTH: usize = 1000;

/// A line in a buffer of fixed size, with NUL at its end.
struct Line {
    bytes: [u8; LENGTH],
    length: usize,
}

impl Default for Line {
    fn default() -> Self {
        Self {
            bytes: [0; LENGTH],
            length: 0,
        }
    }
}

impl Line {
    /// A line that begins with a name.
    fn of(name: &str) -> Self {
        let mut line = Self::default();
        // A line that is too long is cut.
        let _ = write!(line, "{name}: ");
        line
    }

    fn text(&self) -> &CStr {
        CStr::from_bytes_until_nul(&self.bytes).unwrap_or_default()
    }
}

impl Write for Line {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = LENGTH - 1 - self.length;
        let length = (0..=room.min(text.len()))
            .rev()
            .find(|&length| text.is_char_boundary(length))
            .unwrap_or(0);
        let end = self.length + length;
        self.bytes[self.length..end].copy_from_slice(&text.as_bytes()[..length]);
        self.length = end;
        if length < text.len() {
            return Err(fmt::Error);
        }
        Ok(())
    }
}

/// Prints a message at set-up, without a limit. It begins with the name of the component.
pub(crate) fn at_set_up(level: Level, text: &fmt::Arguments<'_>) {
    let mut line = Line::of(&Interface::own().name().to_string_lossy());
    let _ = line.write_fmt(*text);
    ffi::print(level, line.text());
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::{Arc, Mutex};

    type Heard = Arc<Mutex<Vec<(Level, String)>>>;

    fn log() -> (Log, Heard) {
        let heard = Heard::default();
        let copy = heard.clone();
        let listener = move |level, text: &CStr| {
            let text = text.to_str().expect("UTF-8").to_owned();
            copy.lock().expect("no panic").push((level, text));
        };
        (Log::new("hm2_7i97.0", Box::new(listener)), heard)
    }

    #[test]
    fn bad_hour_is_a_page_and_errors_are_counted_apart() {
        let (mut log, heard) = log();
        for cycle in 0..3_600_000_u64 {
            let now = Duration::from_millis(cycle);
            log.print(now, Level::Note, format_args!("cycle {cycle}"));
        }
        log.print(
            Duration::from_secs(3_600),
            Level::Error,
            format_args!("bitten"),
        );
        let heard = heard.lock().expect("no panic");
        assert_eq!(heard.len(), 20 + 1_199 + 1);
        assert_eq!(heard[0], (Level::Note, "hm2_7i97.0: cycle 0".into()));
        let later = "hm2_7i97.0: cycle 3000 (messages left out before this one: 2980)";
        assert_eq!(heard[20].1, later);
        let last = heard.last().expect("an error");
        assert_eq!(*last, (Level::Error, "hm2_7i97.0: bitten".into()));
    }

    #[test]
    fn refusal_is_printed_after_any_number_of_errors() {
        let (mut log, heard) = log();
        for cycle in 0..100 {
            let now = Duration::from_millis(cycle);
            log.print(now, Level::Error, format_args!("bitten"));
        }
        log.refuse(Duration::from_millis(100), format_args!("scale is 0"));
        let heard = heard.lock().expect("no panic");
        assert_eq!(heard.len(), 20 + 1);
        let last = heard.last().expect("a refusal");
        assert_eq!(*last, (Level::Error, "hm2_7i97.0: scale is 0".into()));
    }

    proptest! {
        #[test]
        fn long_message_is_cut_between_characters(text in "\\PC{0,600}") {
            let (mut log, heard) = log();
            log.print(Duration::ZERO, Level::Note, format_args!("{text}{text}"));
            let heard = heard.lock().expect("no panic");
            let whole = format!("hm2_7i97.0: {text}{text}");
            prop_assert!(whole.starts_with(&heard[0].1));
            prop_assert!(heard[0].1.len() >= whole.len().min(LENGTH - 4));
        }
    }
}
