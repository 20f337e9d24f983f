//! Full-screen commands: the terminal, the drawing loop, and parts shared by screens.

mod lines;
mod trend;

use std::io::{self, IsTerminal};
use std::time::Duration;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::{DefaultTerminal, Frame};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::ui::context::{Context, Failure};
use crate::ui::output;
pub use lines::{fitting, wrapped, wrapped_text};
pub use trend::{SAMPLES, Trend};

/// Interval between two pictures, and between two samples of the trend lines.
const PICTURE: Duration = Duration::from_millis(100);

/// Decision of a screen to continue or to end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    Continue,
    End,
}

/// Content of the full screen.
pub trait Screen {
    /// Updates the content before each picture.
    fn refresh(&mut self) -> Wish;
    /// Handles a key press.
    fn key(&mut self, key: KeyEvent) -> Wish;
    /// Draws a picture.
    fn draw(&mut self, frame: &mut Frame<'_>);
}

/// Refuses a command line that cannot have a screen: without a terminal, or with `--json`.
/// `instead` names the alternative.
pub fn check(context: &Context, instead: &str) -> Result<(), Failure> {
    if context.json {
        let why = format!("a full screen has no JSON output; {instead}");
        return Err(Failure::usage(why));
    }
    if !(io::stdout().is_terminal() && io::stdin().is_terminal()) {
        let why = format!("this needs a terminal; {instead}");
        return Err(Failure::usage(why));
    }
    Ok(())
}

/// Shows pictures until a key, a signal or the screen ends the loop, and restores the terminal.
/// Messages are held back until then, unless the screen takes them.
pub fn show(context: &Context, screen: &mut impl Screen) -> io::Result<()> {
    output::hold();
    let shown = ratatui::try_init().and_then(|mut terminal| {
        let shown = pictures(context, screen, &mut terminal);
        shown.and(ratatui::try_restore())
    });
    output::release();
    match context.stop.signal() {
        // The signal may come from a closed terminal, where drawing fails.
        Some(_) => Ok(()),
        None => shown,
    }
}

fn pictures(
    context: &Context,
    screen: &mut impl Screen,
    terminal: &mut DefaultTerminal,
) -> io::Result<()> {
    while context.stop.signal().is_none() && screen.refresh() == Wish::Continue {
        terminal.draw(|frame| screen.draw(frame))?;
        if !wait_for_keys()? {
            return Ok(());
        }
        // All pending keys are handled before the next picture.
        while event::poll(Duration::ZERO)? {
            if let Event::Key(key) = event::read()?
                && key.kind != KeyEventKind::Release
                && (is_control(key, 'c') || screen.key(key) == Wish::End)
            {
                return Ok(());
            }
        }
    }
    Ok(())
}

/// Waits for a key press or the time of the next picture. Returns `false` if the terminal was
/// closed, which crossterm 0.29 does not detect: it would read the end of the input for ever.
fn wait_for_keys() -> io::Result<bool> {
    let limit = Timespec {
        tv_sec: 0,
        tv_nsec: PICTURE.subsec_nanos().into(),
    };
    let input = io::stdin();
    let mut fds = [PollFd::new(&input, PollFlags::IN)];
    match poll(&mut fds, Some(&limit)) {
        Ok(_) | Err(Errno::INTR) => {}
        Err(error) => return Err(error.into()),
    }
    let closed = PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL;
    Ok(!fds.iter().any(|fd| fd.revents().intersects(closed)))
}

/// True if a letter is pressed with Ctrl.
pub fn is_control(key: KeyEvent, letter: char) -> bool {
    key.code == KeyCode::Char(letter) && key.modifiers.contains(KeyModifiers::CONTROL)
}

/// Scroll position of a list.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scroll {
    /// First visible line.
    pub first: usize,
    lines: usize,
    /// Visible rows, as drawn last.
    pub rows: usize,
}

impl Scroll {
    /// Sets the length of the list and the number of visible rows.
    pub fn fit(&mut self, lines: usize, rows: usize) {
        (self.lines, self.rows) = (lines, rows);
        self.to(self.first);
    }

    /// Scrolls to a line, or to the end of the list if that comes first.
    pub fn to(&mut self, line: usize) {
        self.first = line.min(self.lines.saturating_sub(self.rows));
    }

    /// Scrolls with the arrow and page keys, Home and End; ignores others.
    pub fn key(&mut self, key: KeyCode) {
        match key {
            KeyCode::Up => self.to(self.first.saturating_sub(1)),
            KeyCode::Down => self.to(self.first + 1),
            KeyCode::PageUp => self.to(self.first.saturating_sub(self.rows)),
            KeyCode::PageDown => self.to(self.first + self.rows),
            KeyCode::Home => self.to(0),
            KeyCode::End => self.to(usize::MAX),
            _ => {}
        }
    }
}

/// Formats a time with one or two units.
pub fn short_time(time: Duration) -> String {
    match time.as_secs() {
        0 => format!("{} ms", time.as_millis()),
        seconds @ 1..60 => format!("{seconds} s"),
        seconds @ 60..3600 => format!("{} min {} s", seconds / 60, seconds % 60),
        seconds => format!("{} h {} min", seconds / 3600, seconds % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_short() {
        let seconds = |s| short_time(Duration::from_secs(s));
        assert_eq!(short_time(Duration::from_micros(1999)), "1 ms");
        let times = [1, 59, 61, 3661].map(seconds);
        assert_eq!(times, ["1 s", "59 s", "1 min 1 s", "1 h 1 min"]);
    }

    #[test]
    fn list_is_scrolled_as_far_as_it_goes() {
        let mut scroll = Scroll::default();
        scroll.fit(25, 10);
        scroll.key(KeyCode::PageDown);
        scroll.key(KeyCode::PageDown);
        assert_eq!(scroll.first, 15);
        scroll.key(KeyCode::PageUp);
        assert_eq!(scroll.first, 5);
        scroll.key(KeyCode::PageUp);
        assert_eq!(scroll.first, 0);
        scroll.key(KeyCode::End);
        scroll.fit(12, 10);
        assert_eq!(scroll.first, 2, "the list became shorter");
        scroll.fit(3, 10);
        assert_eq!(scroll.first, 0);
    }
}
