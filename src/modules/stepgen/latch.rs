//! The latch of the accumulator on index or probe, of version C2.
//!
//! The generator latches once, and then clears the bit that enabled it. Writes on a network can be
//! late, duplicated or lost:
//!
//! - A late write of an older word without a request clears the bits as well. So clear bits are
//!   evidence with another latched value, or after an exchange without doubt; else the request is
//!   written again.
//! - A duplicate of the request arms the latch again after it happened: the latched value has
//!   changed, and is the requested one.
//! - A late write of an earlier request of the other kind can latch, too: for some time after one,
//!   an exchange in doubt is no evidence.
//!
//! A request that is in the register stays there in doubt: a probe has no second edge.
//!
//! Source: FACTS 14.2 and 14.14.

use crate::bus::HORIZON;
use crate::modules::latch::{LatchRequest, LatchStage};

/// Bits of the MODE register.
pub(super) mod bits {
    /// Latch on the edge of the index.
    pub const LATCH_ON_INDEX: u32 = 1 << 4;
    /// The rising edge of the index; else the falling one.
    pub const INDEX_RISES: u32 = 1 << 5;
    /// Latch on the edge of the probe.
    pub const LATCH_ON_PROBE: u32 = 1 << 6;
    /// The rising edge of the probe; else the falling one.
    pub const PROBE_RISES: u32 = 1 << 7;
}

const ENABLES: u32 = bits::LATCH_ON_INDEX | bits::LATCH_ON_PROBE;

/// The bit that makes a request.
const fn bits_of(request: LatchRequest) -> u32 {
    match request {
        LatchRequest::None => 0,
        LatchRequest::Index => bits::LATCH_ON_INDEX,
        LatchRequest::Probe => bits::LATCH_ON_PROBE,
    }
}

/// A request, from the word that makes it to the evidence that it has happened.
#[derive(Clone, Debug, Default)]
pub(super) struct AccumulatorLatch {
    /// `None` once it has happened.
    pub wanted: LatchRequest,
    stage: LatchStage,
    /// The latched value before the request.
    before: u32,
    /// The register showed a request that is not made.
    is_stray: bool,
    /// The previous request.
    previous: LatchRequest,
    /// Number of further reads during which a packet of it may be in flight.
    previous_for: u32,
}

impl AccumulatorLatch {
    /// Requests an event, or cancels the request.
    pub fn request(&mut self, wanted: LatchRequest) {
        if wanted != self.wanted {
            self.end();
            self.wanted = wanted;
            self.stage = LatchStage::Settling;
        }
    }

    fn end(&mut self) {
        if self.wanted != LatchRequest::None {
            (self.previous, self.previous_for) = (self.wanted, HORIZON.into());
        }
    }

    /// The bits of the request for the MODE register.
    pub const fn bits(&self) -> u32 {
        match self.stage {
            LatchStage::Settling => 0,
            LatchStage::Asked | LatchStage::Armed => bits_of(self.wanted),
        }
    }

    /// True if the register may not contain the [`bits`](Self::bits), so that they are written
    /// again.
    pub fn is_unsettled(&self) -> bool {
        self.is_stray || self.wanted != LatchRequest::None && self.stage != LatchStage::Armed
    }

    /// Begins the request again, because the register may have been written by another.
    pub fn forget(&mut self) {
        self.stage = LatchStage::Settling;
    }

    /// Evaluates the MODE register of a read. Returns the event with bits 31 to 8 of the
    /// accumulator at it, once it has happened. `certain`: no older write than the newest was
    /// executed since the last read.
    pub fn observe(&mut self, mode: u32, certain: bool) -> Option<(LatchRequest, u32)> {
        let (shown, latched) = (mode & ENABLES, mode >> 8);
        let is_same = self.stage == LatchStage::Armed && self.previous == self.wanted;
        let is_trusted = certain || self.previous_for == 0 || is_same;
        self.previous_for = self.previous_for.saturating_sub(1);
        self.is_stray = shown & !self.bits() != 0;
        if self.wanted == LatchRequest::None {
            return None;
        }
        if self.stage == LatchStage::Settling || self.is_stray {
            self.stage = LatchStage::Settling;
            if shown == 0 {
                (self.before, self.stage) = (latched, LatchStage::Asked);
            }
            return None;
        }
        if latched == self.before {
            // Clear bits of a request that was not seen are those of one that did not arrive.
            let has_cleared = shown == 0 && self.stage == LatchStage::Armed;
            if !has_cleared || !certain {
                let is_armed = shown != 0;
                self.stage = if is_armed {
                    LatchStage::Armed
                } else {
                    LatchStage::Asked
                };
                return None;
            }
        }
        self.stage = LatchStage::Settling;
        if !is_trusted {
            return None;
        }
        self.end();
        self.is_stray = shown != 0;
        Some((core::mem::take(&mut self.wanted), latched))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INDEX: u32 = bits::LATCH_ON_INDEX;

    /// A request for the index that the register shows, with the latched value 7.
    fn armed() -> AccumulatorLatch {
        let mut latch = AccumulatorLatch::default();
        assert_eq!(latch.observe(7 << 8, true), None);
        latch.request(LatchRequest::Index);
        assert_eq!(
            latch.bits(),
            0,
            "first the register shows that nothing is requested"
        );
        assert_eq!(latch.observe(7 << 8, true), None);
        assert_eq!((latch.bits(), latch.is_unsettled()), (INDEX, true));
        assert_eq!(latch.observe(7 << 8 | INDEX, true), None);
        assert!(!latch.is_unsettled());
        latch
    }

    #[test]
    fn index_is_taken_when_its_bit_clears() {
        for value in [7, 8] {
            let mut latch = armed();
            let event = latch.observe(value << 8, true);
            assert_eq!(event, Some((LatchRequest::Index, value)));
            assert_eq!((latch.wanted, latch.bits()), (LatchRequest::None, 0));
            assert_eq!(latch.observe(value << 8, true), None, "once");
        }
    }

    #[test]
    fn index_in_first_period_and_duplicate_request_are_recognised() {
        let mut latch = AccumulatorLatch::default();
        latch.request(LatchRequest::Probe);
        latch.observe(0, true);
        assert_eq!(latch.observe(0, true), None, "the write was lost");
        assert!(latch.is_unsettled());
        assert_eq!(latch.observe(5 << 8, true), Some((LatchRequest::Probe, 5)));
        let mut latch = armed();
        let event = latch.observe(9 << 8 | INDEX, true);
        assert_eq!(event, Some((LatchRequest::Index, 9)));
        assert!(latch.is_unsettled(), "the armed bit is taken back");
    }

    #[test]
    fn edge_in_a_doubtful_exchange_is_taken_and_request_stays_armed() {
        let mut latch = armed();
        assert_eq!(latch.observe(7 << 8 | INDEX, false), None);
        assert_eq!(latch.bits(), INDEX, "no edge is missed");
        assert_eq!(latch.observe(9 << 8, false), Some((LatchRequest::Index, 9)));
    }

    /// A late word without a request clears the bits as well.
    #[test]
    fn clear_bits_in_doubt_with_the_value_of_before_are_no_edge() {
        let mut latch = armed();
        assert_eq!(latch.observe(7 << 8, false), None);
        assert_eq!((latch.bits(), latch.is_unsettled()), (INDEX, true));
        assert_eq!(latch.observe(7 << 8, true), None, "written again");
        latch.observe(7 << 8 | INDEX, true);
        assert_eq!(latch.observe(3 << 8, true), Some((LatchRequest::Index, 3)));
    }

    #[test]
    fn late_request_of_the_other_kind_is_not_taken_for_this_one() {
        for (reads, is_taken) in [(10, false), (150, true)] {
            let mut latch = armed();
            latch.request(LatchRequest::Probe);
            latch.observe(7 << 8, true);
            latch.observe(7 << 8, true);
            for _ in 0..reads {
                latch.observe(7 << 8 | bits::LATCH_ON_PROBE, true);
            }
            let event = latch.observe(9 << 8, false);
            assert_eq!(event.is_some(), is_taken, "{reads}");
        }
    }

    #[test]
    fn request_of_another_kind_in_the_register_is_no_event() {
        let mut latch = armed();
        assert_eq!(latch.observe(9 << 8 | bits::LATCH_ON_PROBE, true), None);
        assert_eq!((latch.bits(), latch.is_unsettled()), (0, true));
        let mut idle = AccumulatorLatch::default();
        assert_eq!(idle.observe(INDEX, true), None);
        assert!(idle.is_unsettled());
        idle.observe(0, true);
        assert!(!idle.is_unsettled());
    }
}
