//! Fractions of a time.

use core::time::Duration;

/// A fraction of a time, as `period.fraction(3, 4)`.
pub(crate) trait Fraction {
    /// `number` of `of` parts, rounded down to nanoseconds. The longest time where that is none.
    fn fraction(self, number: u32, of: u32) -> Self;
}

impl Fraction for Duration {
    #[inline]
    fn fraction(self, number: u32, of: u32) -> Self {
        let parts = self.saturating_mul(number).checked_div(of);
        parts.unwrap_or(Self::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::Fraction;
    use core::time::Duration;

    #[test]
    fn incomputable_fraction_of_a_duration_is_the_maximum() {
        let ms = Duration::from_millis(1);
        assert_eq!(ms.fraction(3, 4), Duration::from_micros(750));
        assert_eq!(
            Duration::from_nanos(7).fraction(1, 2),
            Duration::from_nanos(3)
        );
        assert_eq!(Duration::MAX.fraction(1, 1), Duration::MAX);
        assert_eq!(ms.fraction(1, 0), Duration::MAX);
    }
}
