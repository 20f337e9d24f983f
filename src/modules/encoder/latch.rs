//! One latch request, from the control word that asks for it to the evidence that it has happened.
//!
//! After a latch, `JUST_ONCE` is still set and the enable bit is cleared (FACTS 12.5). Every stage
//! requires that evidence, since writes on a network can be late, duplicated or lost:
//!
//! - A late write of an older word without a request cancels the request: both bits are clear. The
//!   request is written again.
//! - A duplicate of the request itself, or the driver's own repetition of its settings, arms the
//!   latch again after it happened: both bits are set, but the latched count has changed. The
//!   changed count is the requested one. Where it happens to equal the previous one, as after
//!   homing twice to the same index, the movement over that index is the evidence.
//! - A late write of an earlier request leaves the same bits as this one. An exchange in which such
//!   a write may have been executed is no evidence.
//! - After a gap between two reads in which the counter has wrapped around at the previous speed,
//!   the latched count may be 65,536 counts or more away from the current one. The request is
//!   written again.

use super::registers::{bits, latched};
use crate::bus::HORIZON;
use crate::modules::latch::{LatchRequest, LatchStage};
use core::mem::take;

/// The bits that make a request.
const fn bits_of(request: LatchRequest) -> u32 {
    match request {
        LatchRequest::None => 0,
        LatchRequest::Index => bits::LATCH_ON_INDEX | bits::JUST_ONCE,
        LatchRequest::Probe => bits::LATCH_ON_PROBE | bits::JUST_ONCE,
    }
}

/// The bits that enable a latch or a clear.
const ENABLES: u32 = bits::LATCH_ON_INDEX | bits::LATCH_ON_PROBE | bits::CLEAR_ON_INDEX;

/// The bits of the control register that any request sets.
const ANY_REQUEST: u32 = ENABLES | bits::JUST_ONCE;

/// Movement of a counter between two reads, in counts without wrap-around.
#[derive(Clone, Copy, Debug)]
pub(super) struct Movement {
    pub from: i64,
    pub to: i64,
}

/// An index that was latched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct LatchedIndex {
    /// The latched count, 16 bits of the counter.
    latched: u16,
    /// Its position in counts without wrap-around: indexes that are 65,536 counts apart have the
    /// same latched count.
    at: i64,
    upwards: bool,
}

/// The current request of an encoder.
#[derive(Clone, Debug, Default)]
pub(super) struct Latch {
    /// `None` once it has happened.
    pub wanted: LatchRequest,
    stage: LatchStage,
    /// The last read showed no request in the control register.
    is_clean: bool,
    /// The latched count before this request.
    before: u16,
    /// The last latched index.
    index: Option<LatchedIndex>,
    /// The previous request.
    previous: LatchRequest,
    /// Number of further reads during which a packet of the previous request may be in flight.
    previous_for: u32,
    /// Writes other than the newest may have been executed since the last read.
    pub is_doubtful: bool,
    /// The control word of this encoder was written since the last read, perhaps repeated
    /// unchanged.
    pub is_repeated: bool,
}

impl Latch {
    /// Requests a latch, or cancels the request.
    pub fn request(&mut self, wanted: LatchRequest) {
        if wanted == self.wanted {
            return;
        }
        let is_fresh = take(&mut self.is_clean) && self.wanted == LatchRequest::None;
        self.end();
        self.wanted = wanted;
        self.stage = if is_fresh {
            LatchStage::Asked
        } else {
            LatchStage::Settling
        };
    }

    /// The request bits of the control word.
    pub const fn bits(&self) -> u32 {
        match self.stage {
            LatchStage::Settling => 0,
            LatchStage::Asked | LatchStage::Armed => bits_of(self.wanted),
        }
    }

    /// True if the control register may not contain [`bits`](Self::bits), so that they have to be
    /// written again.
    pub fn is_unsettled(&self) -> bool {
        self.wanted != LatchRequest::None && self.stage != LatchStage::Armed
    }

    /// Discards all evidence, because the counter may have been reset.
    pub fn forget(&mut self) {
        self.is_clean = false;
        self.index = None;
        self.stage = LatchStage::Settling;
    }

    /// Skips a read that showed the same as the read before, if it cannot make a difference:
    /// nothing is requested, and nothing was requested lately. Returns false for any other read.
    pub fn rests(&mut self) -> bool {
        let rests = self.wanted == LatchRequest::None && self.previous_for == 0;
        if rests {
            (self.is_doubtful, self.is_repeated) = (false, false);
        }
        rests
    }

    /// Evaluates the control register of a read. The counter has moved since the read before;
    /// `behind` returns the distance of a latched count behind the end of the movement, if it is
    /// known. Returns the latched count once the latch has happened.
    pub fn observe(
        &mut self,
        control: u32,
        moved: Movement,
        behind: impl Fn(u16) -> Option<i64>,
    ) -> Option<u16> {
        let is_trusted = self.is_trusted();
        let is_suspect = take(&mut self.is_doubtful) | take(&mut self.is_repeated);
        self.previous_for = self.previous_for.saturating_sub(1);
        self.is_clean = control & ANY_REQUEST == 0;
        let enable = bits_of(self.wanted) & ENABLES;
        let is_other = control & ENABLES & !enable != 0 || control & bits::JUST_ONCE == 0;
        if self.wanted == LatchRequest::None || self.stage == LatchStage::Settling || is_other {
            self.stage = LatchStage::Settling;
            if self.is_clean {
                // Nothing of an earlier request is in the register, so this request can be written.
                self.before = latched(control);
                self.stage = LatchStage::Asked;
            }
            return None;
        }
        let is_armed = control & enable != 0;
        let is_passed = is_suspect && self.has_passed_again(moved);
        if is_armed && latched(control) == self.before && !is_passed {
            self.stage = LatchStage::Armed;
            return None;
        }
        self.stage = LatchStage::Settling;
        let latched = latched(control);
        let behind = behind(latched).filter(|_| is_trusted)?;
        if self.wanted == LatchRequest::Index {
            let Movement { from, to } = moved;
            self.index = (to != from).then(|| LatchedIndex {
                latched,
                at: to.wrapping_sub(behind),
                upwards: to > from,
            });
        }
        self.end();
        self.wanted = LatchRequest::None;
        Some(latched)
    }

    /// True if the register content of this read comes from this request, and not from a late write
    /// of the previous one.
    fn is_trusted(&self) -> bool {
        let is_same = self.stage == LatchStage::Armed && self.previous == self.wanted;
        !self.is_doubtful || self.previous_for == 0 || is_same
    }

    /// True if the counter moved over the last latched index in the same direction while the latch
    /// was armed: the index was then latched with the same count as before.
    fn has_passed_again(&self, Movement { from, to }: Movement) -> bool {
        let Some(index) = self.index.filter(|index| index.latched == self.before) else {
            return false;
        };
        let is_over = if index.upwards {
            from < to && (from..=to).contains(&index.at)
        } else {
            to < from && (to..=from).contains(&index.at)
        };
        let is_asked_for = self.wanted == LatchRequest::Index && self.stage == LatchStage::Armed;
        is_asked_for && is_over
    }

    fn end(&mut self) {
        if self.wanted != LatchRequest::None {
            self.previous = self.wanted;
            self.previous_for = HORIZON.into();
        }
    }
}
