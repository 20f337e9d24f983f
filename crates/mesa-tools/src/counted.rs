//! Numbers with their noun.

use core::fmt;

/// A number of things: `1 byte`, `2 bytes`. The noun is given in the singular, and has its plural
/// with an s.
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
        let ending = if *count == 1 { "" } else { "s" };
        write!(f, "{count} {noun}{ending}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_is_named_in_the_singular() {
        let said = [0, 1, 2].map(|count| Counted(count, "byte").to_string());
        assert_eq!(said, ["0 bytes", "1 byte", "2 bytes"]);
    }
}
