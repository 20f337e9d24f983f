//! The error of all values that are parsed from a text.

use alloc::string::String;
use core::fmt;

/// Error of parsing a text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what} '{}': expected {expected}", ParseError::shortened(found))]
#[non_exhaustive]
pub struct ParseError {
    /// The expected kind of value.
    pub what: &'static str,
    /// The text.
    pub found: String,
    /// The valid texts.
    pub expected: &'static str,
}

/// Number of characters of a text that a message repeats.
const SHOWN: usize = 80;

impl ParseError {
    /// Shows a text as messages repeat it: one of more than 80 characters by its beginning, with
    /// its length.
    pub fn shortened(text: &str) -> impl fmt::Display + '_ {
        Shortened(text)
    }
}

struct Shortened<'a>(&'a str);

impl fmt::Display for Shortened<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.char_indices().nth(SHOWN) {
            None => f.write_str(self.0),
            Some((end, _)) => {
                let (shown, all) = (self.0.get(..end).unwrap_or(""), self.0.chars().count());
                write!(f, "{shown}... ({all} characters)")
            }
        }
    }
}
