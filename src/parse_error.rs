//! The error of all values that are parsed from a text.

use alloc::string::String;

/// Error of parsing a text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what} '{found}': expected {expected}")]
#[non_exhaustive]
pub struct ParseError {
    /// The expected kind of value.
    pub what: &'static str,
    /// The text.
    pub found: String,
    /// The valid texts.
    pub expected: &'static str,
}
