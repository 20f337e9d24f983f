//! Colours of texts on a terminal.

use std::fmt::Display;
use std::io::{self, IsTerminal};

use ratatui::style::{Color, Style};

/// Colour of a text on a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    Good,
    Doubt,
    Bad,
}

impl Tone {
    /// The text in this colour on standard output; without a colour if that is no terminal, or if
    /// `NO_COLOR` disables colours.
    pub fn of(self, text: &str) -> impl Display {
        let colour = match self {
            Self::Good => 32,
            Self::Doubt => 33,
            Self::Bad => 31,
        };
        if is_coloured() {
            format!("\x1b[{colour}m{text}\x1b[0m")
        } else {
            text.to_owned()
        }
    }
}

fn is_coloured() -> bool {
    io::stdout().is_terminal() && !Palette::from_environment().is_plain()
}

/// Colours, unless NO_COLOR disables them.
#[derive(Clone, Copy, Debug)]
pub struct Palette {
    is_coloured: bool,
}

impl Palette {
    pub fn from_environment() -> Self {
        Self {
            is_coloured: std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()),
        }
    }

    /// True if `NO_COLOR` disables colours.
    pub fn is_plain(self) -> bool {
        !self.is_coloured
    }

    pub fn style(self, color: Color) -> Style {
        if self.is_coloured {
            Style::new().fg(color)
        } else {
            Style::new()
        }
    }
}
