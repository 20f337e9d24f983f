//! Console output: commands, their answers, and complaints.

use std::collections::VecDeque;

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph};

use crate::full_screen::{Palette, Scroll};

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
}

impl Messages {
    pub fn command(&mut self, text: String) {
        self.push(Kind::Command, text);
    }

    /// Adds the lines of an answer. An answer longer than the available rows gets the whole screen,
    /// from its beginning.
    pub fn answer(&mut self, text: &str) {
        let first = self.lines.len().saturating_sub(1);
        for line in text.lines() {
            let kind = if line.starts_with("error: ") {
                Kind::Refusal
            } else {
                Kind::Answer
            };
            self.push(kind, line.to_owned());
        }
        if text.lines().count() > self.scroll.rows {
            self.is_large = true;
            self.scroll.fit(self.lines.len(), self.scroll.rows);
            self.scroll.to(first);
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
        self.scroll.fit(self.lines.len(), rows);
        if !self.is_large {
            self.scroll.to(usize::MAX);
        }
        let shown = self.lines.iter().skip(self.scroll.first).take(rows);
        let lines = shown.map(|(kind, text)| {
            let style = match kind {
                Kind::Command => Style::new().add_modifier(Modifier::BOLD),
                Kind::Answer => Style::new(),
                Kind::Refusal => palette.style(Color::Red),
            };
            Line::styled(text.clone(), style)
        });
        let keys = if self.is_large {
            " PgUp, PgDn: scroll   q, Esc: back to the machine "
        } else {
            " Tab: next board   PgUp, PgDn: scroll   Up, Down: last commands   q: end "
        };
        let block = Block::bordered().title(" console ").title_bottom(keys);
        frame.render_widget(Paragraph::new(lines.collect::<Vec<_>>()).block(block), area);
    }
}
