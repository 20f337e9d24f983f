//! The positions that have become unsure in a read, as few events.

use super::ReadCycle;
use crate::events::{EventKind, Positions};

/// The counters of a module whose positions have become unsure in a read.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct UnsureMask {
    /// Bit n of word k is counter 32k + n.
    words: [u32; 8],
    is_any: bool,
}

impl UnsureMask {
    #[cold]
    pub fn add(&mut self, number: u8) {
        if let Some(word) = self.words.get_mut(usize::from(number >> 5)) {
            *word |= 1 << (number & 31);
            self.is_any = true;
        }
    }

    /// Reports them, 32 numbers with an event.
    #[inline]
    pub fn report(&self, cycle: &ReadCycle<'_>, of: Positions) {
        if self.is_any {
            self.report_each(cycle, of);
        }
    }

    #[cold]
    fn report_each(&self, cycle: &ReadCycle<'_>, of: Positions) {
        for (first, &mask) in (0_u32..).step_by(32).zip(&self.words) {
            if mask != 0 {
                let kind = EventKind::PositionUnsure { of, first, mask };
                cycle.events.report(cycle.now, kind);
            }
        }
    }
}
