//! A trend line.

use std::collections::VecDeque;
use std::fmt::{self, Display, Write};

/// Samples of a trend line.
pub const SAMPLES: usize = 24;

/// Last samples of a value. `Display` draws them in eight heights between their minimum and
/// maximum, with a precision at most so many of the last ones. A constant value is flat: at the top
/// if positive, as a bit that is on, else at the bottom.
#[derive(Clone, Debug, Default)]
pub struct Trend(VecDeque<f64>);

impl Trend {
    pub fn push(&mut self, sample: f64) {
        if self.0.len() == SAMPLES {
            self.0.pop_front();
        }
        self.0.push_back(sample);
    }
}

impl Display for Trend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const HEIGHTS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
        let first = f
            .precision()
            .map_or(0, |most| self.0.len().saturating_sub(most));
        let shown = || self.0.iter().copied().skip(first);
        let finite = shown().filter(|sample| sample.is_finite());
        let (least, largest) = finite.fold((f64::MAX, f64::MIN), |(least, largest), sample| {
            (least.min(sample), largest.max(sample))
        });
        let range = largest - least;
        for sample in shown() {
            let height = if range > 0.0 {
                (((sample - least) / range * 7.0).round() as usize).min(7)
            } else if sample > 0.0 {
                7
            } else {
                0
            };
            f.write_char(HEIGHTS[height])?;
        }
        // Pads to the width of the column.
        for _ in shown().count()..f.width().unwrap_or_default() {
            f.write_char(' ')?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trend_goes_from_the_least_to_the_largest() {
        let line = |samples: &[f64]| {
            let mut trend = Trend::default();
            for sample in samples {
                trend.push(*sample);
            }
            trend.to_string()
        };
        assert_eq!(line(&[0.0, 1.0, 0.0]), "▁█▁");
        assert_eq!(line(&[-7.0, -3.5, 0.0]), "▁▅█");
        assert_eq!(line(&[0.0, 0.0]), "▁▁");
        assert_eq!(line(&[1.0, 1.0]), "██");
        assert_eq!(line(&[f64::NAN, f64::INFINITY, 1.0]).chars().count(), 3);
        assert_eq!(line(&[]), "");
        assert_eq!(line(&[1.0; 2 * SAMPLES]).chars().count(), SAMPLES);
        assert_eq!(format!("{:4}|", Trend([1.0].into())), "█   |");
        let trend = Trend([0.0, 1.0, 2.0, 3.0].into());
        assert_eq!(format!("{trend:3.2}|"), "▁█ |", "the last two");
    }
}
