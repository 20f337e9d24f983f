//! Answers to console commands, and the words of commands.
//!
//! The answer to a command is a list of lines `name value`, then a line `ok`; or `error: ` and a
//! reason.

use std::fmt::{Display, Write};
use std::str::FromStr;

/// Text to print, and whether the process ends.
#[derive(Debug)]
pub struct Answer {
    pub text: String,
    pub quit: bool,
}

impl Answer {
    /// The answer for a result: its lines and `ok`, or the error.
    pub fn of(done: Result<String, String>) -> Self {
        let text = match done {
            Ok(text) => text + "ok\n",
            Err(reason) => format!("error: {reason}\n"),
        };
        Self { text, quit: false }
    }

    pub fn refused(reason: impl Into<String>) -> Self {
        Self::of(Err(reason.into()))
    }

    /// The answer to `quit`, which ends all boards.
    pub fn quit() -> Self {
        Self {
            text: "ok\n".to_owned(),
            quit: true,
        }
    }

    /// The reason for a refusal, if the answer is one.
    pub fn reason(&self) -> Option<&str> {
        self.text.strip_prefix("error: ").map(str::trim_end)
    }
}

/// Adds one line to an answer.
pub fn line(text: &mut String, name: &str, value: impl Display) {
    let _ = writeln!(text, "{name} {value}");
}

/// The reason for which a command is refused whose words do not fit.
pub fn wrong(word: &str) -> String {
    format!("`{word}` is no command, or it takes something else; try help")
}

pub fn number<T: FromStr>(word: &str) -> Result<T, String> {
    word.parse()
        .map_err(|_| format!("`{word}` is no number that fits here"))
}

pub fn on_off(word: &str) -> Result<bool, String> {
    match word {
        "on" | "1" => Ok(true),
        "off" | "0" => Ok(false),
        _ => Err(format!("`{word}`: expected on or off")),
    }
}

pub fn probability(word: &str) -> Result<f64, String> {
    let chance = number::<f64>(word).ok();
    let chance = chance.filter(|chance| (0.0..=1.0).contains(chance));
    chance.ok_or_else(|| format!("`{word}` is no probability from 0 to 1"))
}
