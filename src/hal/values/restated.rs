//! Outputs whose values may change their meaning.

use alloc::vec::Vec;

/// Outputs whose values may change their meaning.
#[derive(Debug, Default)]
pub(super) struct RestatedOutputs {
    /// In ascending order of their indices.
    outputs: Vec<RestatedOutput>,
    /// Number of those of them that have an outdated value.
    outdated: u32,
}

#[derive(Clone, Copy, Debug)]
struct RestatedOutput {
    index: usize,
    /// The value that was set before the last change: repeated, it is no new command.
    outdated: Option<u64>,
}

impl RestatedOutputs {
    /// Adds an output, which was made after those before it. Allocates.
    pub fn add(&mut self, index: usize) {
        let outdated = None;
        self.outputs.push(RestatedOutput { index, outdated });
    }

    /// Removes the outputs from index `count` on.
    pub fn truncate(&mut self, count: usize) {
        self.outputs.retain(|output| output.index < count);
    }

    /// Records that an output with the value `before` is restated.
    pub fn restate(&mut self, index: usize, before: u64) {
        // That of the first change: a repeated value is still that one.
        if let Some(output) = self.find(index)
            && output.outdated.is_none()
        {
            output.outdated = Some(before);
            self.outdated = self.outdated.saturating_add(1);
        }
    }

    /// True for the value of before the meaning of the output's values changed; any other one ends
    /// that.
    #[inline]
    pub fn check_outdated(&mut self, index: usize, bits: u64) -> bool {
        self.outdated > 0 && self.take_outdated(index, bits)
    }

    #[cold]
    fn take_outdated(&mut self, index: usize, bits: u64) -> bool {
        let Some(output) = self.find(index) else {
            return false;
        };
        match output.outdated {
            Some(outdated) if outdated == bits => true,
            Some(_) => {
                output.outdated = None;
                self.outdated = self.outdated.saturating_sub(1);
                false
            }
            None => false,
        }
    }

    fn find(&mut self, index: usize) -> Option<&mut RestatedOutput> {
        let place = self
            .outputs
            .binary_search_by_key(&index, |output| output.index);
        self.outputs.get_mut(place.ok()?)
    }
}
