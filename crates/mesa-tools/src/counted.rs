//! Numbers with their noun.

use core::fmt;

/// A number of things: `1 byte`, `2 bytes`, `0 replies`. The noun is given in the singular; its
/// plural ends with s, or with ies in place of y.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counted(pub u64, pub &'static str);

impl Counted {
    /// The number of elements of a collection.
    pub const fn of(len: usize, noun: &'static str) -> Self {
        Self(len as u64, noun)
    }
}

impl fmt::Display for Counted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(count, noun) = self;
        match noun.strip_suffix('y') {
            _ if *count == 1 => write!(f, "1 {noun}"),
            Some(stem) => write!(f, "{count} {stem}ies"),
            None => write!(f, "{count} {noun}s"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_is_named_in_the_singular() {
        let said = [0, 1, 2].map(|count| Counted::of(count, "byte").to_string());
        assert_eq!(said, ["0 bytes", "1 byte", "2 bytes"]);
        let said = [1, 2].map(|count| Counted(count, "reply").to_string());
        assert_eq!(said, ["1 reply", "2 replies"]);
    }
}
