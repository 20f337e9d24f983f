//! Console output: commands, their answers, and complaints.

use std::collections::VecDeque;

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph};

use crate::ui::colours::Palette;
use crate::ui::full_screen::{Scroll, fitting, wrapped};

/// Older lines are dropped.
const MAX_LINES: usize = 2000;

/// Kind of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Command,
    Answer,
    /// The reason why a command was refused.
    Refusal,
}

/// The last lines of the console; the part that fits is shown.
#[derive(Debug, Default)]
pub struct Messages {
    lines: VecDeque<(Kind, String)>,
    /// True while the messages have the whole screen.
    pub is_large: bool,
    pub scroll: Scroll,
    /// The first line of an answer that has got the whole screen, until that is drawn.
    begin: Option<usize>,
}

impl Messages {
    pub fn command(&mut self, text: String) {
        self.push(Kind::Command, text);
    }

    /// Adds the lines of an answer. An answer longer than the available rows gets the whole screen,
    /// from its beginning.
    pub fn answer(&mut self, text: &str) {
        let count = text.lines().count();
        for line in text.lines() {
            let kind = if line.starts_with("error: ") {
                Kind::Refusal
            } else {
                Kind::Answer
            };
            self.push(kind, line.to_owned());
        }
        if count > self.scroll.rows {
            self.is_large = true;
            // From the line of its command on.
            self.begin = self.lines.len().checked_sub(count + 1);
        }
    }

    pub fn complaint(&mut self, text: String) {
        self.push(Kind::Refusal, text);
    }

    fn push(&mut self, kind: Kind, text: String) {
        if self.lines.len() == MAX_LINES {
            self.lines.pop_front();
        }
        self.lines.push_back((kind, text));
    }

    pub fn draw(&mut self, frame: &mut Frame<'_>, area: Rect, palette: Palette) {
        let rows = usize::from(area.height.saturating_sub(2));
        let width = usize::from(area.width.saturating_sub(2));
        let mut lines = Vec::new();
        let mut begin = None;
        for (number, (kind, text)) in self.lines.iter().enumerate() {
            if self.begin == Some(number) {
                begin = Some(lines.len());
            }
            let style = match kind {
                Kind::Command => Style::new().add_modifier(Modifier::BOLD),
                Kind::Answer => Style::new(),
                Kind::Refusal => palette.style(Color::Red),
            };
            lines.extend(wrapped(&Line::styled(text, style), width, 4));
        }
        self.begin = None;
        self.scroll.fit(lines.len(), rows);
        if !self.is_large {
            self.scroll.to(usize::MAX);
        } else if let Some(begin) = begin {
            self.scroll.to(begin);
        }
        let shown = lines.into_iter().skip(self.scroll.first).take(rows);
        let block = Block::bordered().title(" console ");
        let block = block.title_bottom(fitting(width, self.keys()));
        frame.render_widget(Paragraph::new(shown.collect::<Vec<_>>()).block(block), area);
    }

    /// What keys do, in several lengths.
    fn keys(&self) -> Vec<String> {
        let keys: &[&str] = if self.is_large {
            &[
                " PgUp, PgDn: scroll   q, Esc: back to the machine ",
                " PgUp, PgDn: scroll   q: back ",
            ]
        } else {
            &[
                " Tab: next board   PgUp, PgDn: scroll   Up, Down: last commands   q: end ",
                " Tab: next board   PgUp, PgDn   q: end ",
                " Tab, PgUp, PgDn   q: end ",
            ]
        };
        keys.iter().map(|&keys| keys.to_owned()).collect()
    }
}
