//! What a comparison found.

/// One thing that differs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Line of the recording.
    pub line: usize,
    /// What was recorded.
    pub expected: String,
    /// What was simulated instead.
    pub actual: String,
}

/// How much was compared, and what differs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Number of things compared.
    pub compared: usize,
    /// Those that differ.
    pub differences: Vec<Difference>,
}

impl Outcome {
    /// Counts one comparison; `actual` is shown if it differs.
    pub fn compare(&mut self, line: usize, same: bool, expected: String, actual: String) {
        self.compared += 1;
        if !same {
            self.differences.push(Difference {
                line,
                expected,
                actual,
            });
        }
    }

    /// Notes something that can not be compared at all, which is a difference, too.
    pub fn fail(&mut self, line: usize, expected: String, reason: String) {
        self.compare(line, false, expected, reason);
    }
}
