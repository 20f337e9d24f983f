//! Doubt in a position: what its pin shows, and what is reported of it.

use crate::bus::HORIZON;

/// Reads after the first set-up in which an application has no position yet, unless it has homed or
/// enabled the axis before. While packets of the set-up may be in flight, which is as long, doubts
/// are needless but not rare on a busy computer.
const YOUNG: u32 = HORIZON as u32;

/// Doubt in the position of an encoder or a step generator.
#[derive(Clone, Copy, Debug)]
pub(super) struct PositionDoubt {
    is_unsure: bool,
    /// It has become unsure when it was one that the application had: a loss.
    is_lost: bool,
    /// The loss has been reported.
    is_reported: bool,
    /// Reads that are left of [`YOUNG`].
    young_for: u32,
}

impl Default for PositionDoubt {
    fn default() -> Self {
        Self {
            is_unsure: false,
            is_lost: false,
            is_reported: false,
            young_for: YOUNG,
        }
    }
}

impl PositionDoubt {
    /// True if the position may be wrong, a loss or not.
    pub const fn is_unsure(self) -> bool {
        self.is_unsure
    }

    /// The position is unsure from now on, if it `is_doubtful`.
    #[inline]
    pub const fn add(&mut self, is_doubtful: bool) {
        self.is_unsure |= is_doubtful;
        self.is_lost |= is_doubtful && self.young_for == 0;
    }

    /// The application has made the position a known one.
    pub const fn settle(&mut self) {
        (self.is_unsure, self.is_lost, self.is_reported) = (false, false, false);
        self.young_for = 0;
    }

    /// The application uses the position as it is.
    #[inline]
    pub const fn rely(&mut self) {
        self.young_for = 0;
    }

    /// The board has its set-up back: what is unsure with it is reported, even if it was before.
    pub const fn set_up_again(&mut self) {
        self.is_reported = false;
        if self.young_for > 0 {
            self.young_for = YOUNG;
        }
    }

    /// Ends a read. Returns true if a loss is to be reported, once.
    #[inline]
    pub const fn read(&mut self) -> bool {
        if let Some(left) = self.young_for.checked_sub(1) {
            self.young_for = left;
        }
        self.is_lost && !core::mem::replace(&mut self.is_reported, true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_loss_is_reported_before_there_was_a_position() {
        let mut doubt = PositionDoubt::default();
        doubt.add(true);
        for _ in 0..2 * YOUNG {
            assert!(!doubt.read());
            assert!(doubt.is_unsure());
        }
        // Unsure already, and now lost.
        doubt.add(true);
        assert!(doubt.read() && !doubt.read());
    }

    #[test]
    fn position_is_one_with_the_first_act() {
        for act in [PositionDoubt::settle, PositionDoubt::rely] {
            let mut doubt = PositionDoubt::default();
            doubt.read();
            act(&mut doubt);
            doubt.add(true);
            assert!(doubt.read() && !doubt.read());
            doubt.set_up_again();
            assert!(doubt.read() && !doubt.read());
            doubt.settle();
            assert!(!doubt.read() && !doubt.is_unsure());
        }
    }

    #[test]
    fn second_set_up_restarts_the_wait_before_losses_are_reported() {
        let mut doubt = PositionDoubt::default();
        for _ in 0..YOUNG - 1 {
            doubt.read();
        }
        doubt.add(true);
        doubt.set_up_again();
        for _ in 0..YOUNG {
            doubt.add(true);
            assert!(!doubt.read());
        }
        doubt.add(true);
        assert!(doubt.read());
    }
}
