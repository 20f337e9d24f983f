//! Times for people.

use core::fmt;
use core::time::Duration;

/// A time as people read it: up to four digits that count, and its unit, `ns`, `us`, `ms` or `s`.
///
/// ```
/// use core::time::Duration;
/// use mesa_wire::Rounded;
///
/// assert_eq!(Rounded(&Duration::from_nanos(50_224_296)).to_string(), "50.22 ms");
/// assert_eq!(Rounded(&Duration::from_millis(8)).to_string(), "8 ms");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rounded<'a>(pub &'a Duration);

impl fmt::Display for Rounded<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let nanos = self.0.as_nanos();
        let (one, unit) = match nanos {
            0 => return f.write_str("0 s"),
            1..1_000 => (1, "ns"),
            1_000..1_000_000 => (1_000, "us"),
            1_000_000..1_000_000_000 => (1_000_000, "ms"),
            _ => (1_000_000_000, "s"),
        };
        let (mut digits, mut parts) = match nanos / one {
            1_000.. => (0, 1),
            100.. => (1, 10),
            10.. => (2, 100),
            _ => (3, 1_000),
        };
        // Not more than the longest time in tenths of a second: it fits.
        let mut count = (nanos * parts + one / 2) / one;
        while digits > 0 && count.is_multiple_of(10) {
            (digits, parts, count) = (digits - 1, parts / 10, count / 10);
        }
        write!(f, "{}", count / parts)?;
        if digits > 0 {
            write!(f, ".{:0digits$}", count % parts)?;
        }
        write!(f, " {unit}")
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;

    #[test]
    fn four_digits_and_the_unit_are_left() {
        for (nanos, text) in [
            (0, "0 s"),
            (1, "1 ns"),
            (999, "999 ns"),
            (1_000, "1 us"),
            (5_629, "5.629 us"),
            (1_050, "1.05 us"),
            (99_999, "100 us"),
            (123_456, "123.5 us"),
            (999_960, "1000 us"),
            (1_000_000, "1 ms"),
            (1_000_400, "1 ms"),
            (50_224_296, "50.22 ms"),
            (65_535_000, "65.54 ms"),
            (1_500_000_000, "1.5 s"),
            (60_000_000_000, "60 s"),
            (86_400_000_000_000, "86400 s"),
        ] {
            assert_eq!(Rounded(&Duration::from_nanos(nanos)).to_string(), text);
        }
        assert_eq!(
            Rounded(&Duration::MAX).to_string(),
            "18446744073709551616 s"
        );
    }
}
