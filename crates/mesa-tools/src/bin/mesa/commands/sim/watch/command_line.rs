//! Input line of the console.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use crate::ui::full_screen::is_control;

/// Length limit of the console's lines.
const MAX_CHARACTERS: usize = 1000;

/// Length of the command history.
const MAX_BEFORE: usize = 100;

/// The text being typed, and the history.
#[derive(Debug, Default)]
pub struct CommandLine {
    text: String,
    before: Vec<String>,
    /// Index of the history entry that is shown; the length of the history: none.
    at: usize,
}

impl CommandLine {
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Handles a key; returns the command that Enter completes.
    pub fn key(&mut self, key: KeyEvent) -> Option<String> {
        let is_plain = !key
            .modifiers
            .intersects(KeyModifiers::CONTROL | KeyModifiers::ALT);
        match key.code {
            _ if is_control(key, 'u') => self.text.clear(),
            KeyCode::Char(character) if is_plain && self.text.chars().count() < MAX_CHARACTERS => {
                self.text.push(character);
            }
            KeyCode::Backspace => {
                self.text.pop();
            }
            KeyCode::Esc => self.text.clear(),
            KeyCode::Up => self.show(self.at.saturating_sub(1)),
            KeyCode::Down => self.show(self.at + 1),
            KeyCode::Enter => return self.take(),
            _ => {}
        }
        None
    }

    fn show(&mut self, at: usize) {
        self.at = at.min(self.before.len());
        let before = self.before.get(self.at);
        self.text = before.cloned().unwrap_or_default();
    }

    fn take(&mut self) -> Option<String> {
        let text = std::mem::take(&mut self.text);
        self.at = self.before.len();
        if text.trim().is_empty() {
            return None;
        }
        if self.before.last() != Some(&text) {
            self.before.push(text.clone());
            if self.before.len() > MAX_BEFORE {
                self.before.remove(0);
            }
        }
        self.at = self.before.len();
        Some(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(line: &mut CommandLine, code: KeyCode) -> Option<String> {
        line.key(KeyEvent::new(code, KeyModifiers::NONE))
    }

    fn enter(line: &mut CommandLine, text: &str) -> Option<String> {
        for character in text.chars() {
            assert_eq!(press(line, KeyCode::Char(character)), None);
        }
        press(line, KeyCode::Enter)
    }

    #[test]
    fn line_is_typed_corrected_and_had_again() {
        let mut line = CommandLine::default();
        assert_eq!(enter(&mut line, "estop on").as_deref(), Some("estop on"));
        assert_eq!(enter(&mut line, "turn x 5").as_deref(), Some("turn x 5"));
        assert_eq!(enter(&mut line, "  "), None);
        for shown in ["turn x 5", "estop on", "estop on"] {
            press(&mut line, KeyCode::Up);
            assert_eq!(line.text(), shown);
        }
        press(&mut line, KeyCode::Backspace);
        assert_eq!(enter(&mut line, "ff").as_deref(), Some("estop off"));
        press(&mut line, KeyCode::Up);
        press(&mut line, KeyCode::Down);
        assert_eq!(line.text(), "");
        press(&mut line, KeyCode::Char('x'));
        line.key(KeyEvent::new(KeyCode::Char('u'), KeyModifiers::CONTROL));
        assert_eq!(line.text(), "");
        line.key(KeyEvent::new(KeyCode::Char('a'), KeyModifiers::CONTROL));
        assert_eq!(line.text(), "", "no letter");
    }

    #[test]
    fn command_line_history_and_length_are_bounded() {
        let mut line = CommandLine::default();
        for n in 0..2 * MAX_BEFORE {
            enter(&mut line, &n.to_string());
        }
        assert_eq!(line.before.len(), MAX_BEFORE);
        for _ in 0..2 * MAX_CHARACTERS {
            press(&mut line, KeyCode::Char('ü'));
        }
        assert_eq!(line.text().chars().count(), MAX_CHARACTERS);
    }
}
