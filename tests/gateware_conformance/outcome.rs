//! What a comparison found, and how far times may be apart.

use mesa_hal::sim::wire::Nanos;

/// Times may differ by this much, or by a twentieth, whichever is more (index.txt).
pub const TOLERANCE: Nanos = 15_000;

/// Whether two durations agree.
pub fn within_tolerance(expected: Nanos, actual: Nanos) -> bool {
    expected.abs_diff(actual) <= TOLERANCE.max(expected / 20)
}

/// One item that is not as recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Line of the transcript.
    pub line: usize,
    /// What was recorded.
    pub expected: String,
    /// What the simulator did.
    pub actual: String,
}

impl Difference {
    /// Whether only a time differs, or a number of chatter frames.
    pub fn is_time(&self) -> bool {
        self.expected.contains(" ns") || self.expected.ends_with(" chatter frames")
    }
}

/// Everything that was compared in one file.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Values, bursts and times that were compared.
    pub compared: usize,
    /// Those that differ.
    pub differences: Vec<Difference>,
}

impl Outcome {
    /// Counts one comparison.
    pub fn compare(
        &mut self,
        equal: bool,
        line: usize,
        describe: impl FnOnce() -> (String, String),
    ) {
        self.compared += 1;
        if !equal {
            let (expected, actual) = describe();
            self.differences.push(Difference {
                line,
                expected,
                actual,
            });
        }
    }

    /// Adds what another comparison of the same file found.
    pub fn add(&mut self, other: Self) {
        self.compared += other.compared;
        self.differences.extend(other.differences);
        self.differences.sort_by_key(|difference| difference.line);
    }
}
