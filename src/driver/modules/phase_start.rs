//! The first periods of the phase-locked loop, in which its phase is set and not followed.

/// LinuxCNC does it for so many periods: what a machine starts with is irregular.
const PERIODS: u32 = 100;

/// Sets the phase of the loop with each write, such that the next read finds it at 0.
///
/// Left to itself, the loop takes seconds to get there, and rings (FACTS 12.4). LinuxCNC writes 0,
/// after which the read is early by what passes from a read to its write. That is what the next read
/// says, and its mean is written from then on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PhaseStart {
    writes: u32,
    /// What is written, in 2^-32 of a period.
    phase: i32,
    /// Reads that followed a write.
    reads: i32,
    is_written: bool,
}

impl PhaseStart {
    /// The read after a write found the loop at this phase.
    pub fn read(&mut self, phase: u32) {
        if core::mem::take(&mut self.is_written) && self.writes < PERIODS {
            self.reads += 1;
            self.phase = self.phase.wrapping_sub(phase as i32 / self.reads);
        }
    }

    /// What this write sets the phase to, if it still does.
    pub fn write(&mut self) -> Option<u32> {
        if self.writes == PERIODS {
            return None;
        }
        self.writes += 1;
        self.is_written = true;
        Some(self.phase as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_phase_of_the_write_is_such_that_the_read_is_at_0() {
        let mut start = PhaseStart::default();
        // Anything, before the phase was set.
        start.read(0x1234_5678);
        assert_eq!(start.write(), Some(0), "as LinuxCNC does");
        // A tenth of a period, sometimes more and sometimes less, after the read.
        let tenth = u32::MAX / 10;
        for n in 1..PERIODS {
            let delay = tenth + n % 2 * 2_000;
            let written = start.phase as u32;
            start.read(written.wrapping_sub(delay));
            let next = start.write().expect("100 periods");
            assert!(next.abs_diff(tenth) <= 2_000, "{n}: {next}");
        }
        assert!(
            (start.phase as u32).abs_diff(tenth + 1_000) < 50,
            "the mean"
        );
        assert_eq!(start.write(), None);
    }
}
