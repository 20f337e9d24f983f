//! One latch request, from the control word that asks for it to the evidence that it has happened.
//!
//! A latch that was taken leaves `JUST_ONCE` set and clears its enable bit (FACTS 12.5). That
//! evidence is demanded in every stage, since writes on a network can be late, duplicate or lost:
//!
//! - A late write of an older word without a request takes the request back: neither bit is left.
//!   It is made again.
//! - A duplicate of the request itself, or the driver's own repetition of its settings, arms the
//!   latch again after it was taken: both bits are set, but the latched count has changed. That
//!   count is the one that was asked for. Where it happens to be the same as before, as after
//!   homing twice to the same index, the movement over that index tells.
//! - A late write of an earlier request leaves the same bits as this one. An exchange in which that
//!   may have happened is no evidence.
//! - After a gap between two reads in which the counter has wrapped around at the speed before, the
//!   latched count may be 65,536 counts or more away from here. The request is made again.

use super::registers::{bits, latched};
use core::mem::take;

/// What is to be latched, once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LatchRequest {
    /// Nothing.
    #[default]
    None,
    /// The count becomes 0 where the index was: `index-enable` of LinuxCNC.
    Index,
    /// The count is latched at the probe's edge.
    Probe,
}

impl LatchRequest {
    pub(super) const fn bits(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Index => bits::LATCH_ON_INDEX | bits::JUST_ONCE,
            Self::Probe => bits::LATCH_ON_PROBE | bits::JUST_ONCE,
        }
    }
}

/// The bits that enable a latch or a clear.
const ENABLES: u32 = bits::LATCH_ON_INDEX | bits::LATCH_ON_PROBE | bits::CLEAR_ON_INDEX;

/// The bits of the control register that any request sets.
const ANY_REQUEST: u32 = ENABLES | bits::JUST_ONCE;

/// After this number of reads no packet of an earlier request or set-up is in flight any more.
pub(super) const HORIZON: u32 = 100;

/// How far a request has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    /// The control register still shows an earlier request, or is not known: nothing is written
    /// until that is gone, so that its end is not taken for the end of this one.
    #[default]
    Settling,
    /// Not in the control register yet, as far as is known.
    Asked,
    /// Was seen in the control register.
    Armed,
}

/// An index that was passed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Passed {
    /// The latched count, 16 bits of the counter.
    latched: u16,
    /// Where it is, in counts without wrap-around: indexes that are 65,536 counts apart are latched
    /// with the same count.
    at: i64,
    upwards: bool,
}

/// The request that an encoder works on.
#[derive(Clone, Debug, Default)]
pub(super) struct Latch {
    /// `None` once it has happened.
    pub wanted: LatchRequest,
    stage: Stage,
    /// Whether the control register showed no request when it was read last.
    is_clean: bool,
    /// The latched count before this request.
    before: u16,
    /// The index that was latched last.
    index: Option<Passed>,
    /// The request before this one, ...
    previous: LatchRequest,
    /// ... and for how many more reads a packet of it may be in flight.
    previous_for: u32,
    /// Since the last read, other writes than the newest may have been executed.
    pub is_doubtful: bool,
    /// Since the last read, the control word of this encoder was written, perhaps again and unchanged.
    pub is_repeated: bool,
}

impl Latch {
    /// Asks for a latch, or takes the request back.
    pub fn request(&mut self, wanted: LatchRequest) {
        if wanted == self.wanted {
            return;
        }
        let is_fresh = take(&mut self.is_clean) && self.wanted == LatchRequest::None;
        self.end();
        self.wanted = wanted;
        self.stage = if is_fresh {
            Stage::Asked
        } else {
            Stage::Settling
        };
    }

    /// The bits of the control word that ask for it.
    pub const fn bits(&self) -> u32 {
        match self.stage {
            Stage::Settling => 0,
            Stage::Asked | Stage::Armed => self.wanted.bits(),
        }
    }

    /// Whether the control register is not known to hold [`bits`](Self::bits): they have to be
    /// written again.
    pub fn is_unsettled(&self) -> bool {
        self.wanted != LatchRequest::None && self.stage != Stage::Armed
    }

    /// The counter may have been reset.
    pub fn forget(&mut self) {
        self.is_clean = false;
        self.index = None;
        self.stage = Stage::Settling;
    }

    /// Takes a read that showed the same as the read before, if that can not make a difference:
    /// nothing is asked for, and nothing was lately.
    pub fn rests(&mut self) -> bool {
        let rests = self.wanted == LatchRequest::None && self.previous_for == 0;
        if rests {
            (self.is_doubtful, self.is_repeated) = (false, false);
        }
        rests
    }

    /// Takes what a read showed, after the counter went `from` one count `to` another since the read
    /// before, both without wrap-around; `behind` is how far a latched count is behind `to`, if that is
    /// known. Gives the latched count once the latch has happened.
    pub fn observe(
        &mut self,
        control: u32,
        (from, to): (i64, i64),
        behind: impl Fn(u16) -> Option<i64>,
    ) -> Option<u16> {
        let is_trusted = self.is_trusted();
        let is_suspect = take(&mut self.is_doubtful) | take(&mut self.is_repeated);
        self.previous_for = self.previous_for.saturating_sub(1);
        self.is_clean = control & ANY_REQUEST == 0;
        let enable = self.wanted.bits() & ENABLES;
        let is_other = control & ENABLES & !enable != 0 || control & bits::JUST_ONCE == 0;
        if self.wanted == LatchRequest::None || self.stage == Stage::Settling || is_other {
            self.stage = Stage::Settling;
            if self.is_clean {
                // Nothing of an earlier request is in the register: the request can be written.
                self.before = latched(control);
                self.stage = Stage::Asked;
            }
            return None;
        }
        let is_armed = control & enable != 0;
        let is_passed = is_suspect && self.has_passed_again(from, to);
        if is_armed && latched(control) == self.before && !is_passed {
            self.stage = Stage::Armed;
            return None;
        }
        self.stage = Stage::Settling;
        let latched = latched(control);
        let behind = behind(latched).filter(|_| is_trusted)?;
        if self.wanted == LatchRequest::Index {
            self.index = (to != from).then(|| Passed {
                latched,
                at: to.wrapping_sub(behind),
                upwards: to > from,
            });
        }
        self.end();
        self.wanted = LatchRequest::None;
        Some(latched)
    }

    /// Whether what this read shows comes from this request, and not from a late write of the one
    /// before.
    fn is_trusted(&self) -> bool {
        let is_same = self.stage == Stage::Armed && self.previous == self.wanted;
        !self.is_doubtful || self.previous_for == 0 || is_same
    }

    /// Whether the movement went over the index that was latched before, in the same direction,
    /// while the latch was armed: it was taken with the same count.
    fn has_passed_again(&self, from: i64, to: i64) -> bool {
        let Some(index) = self.index.filter(|index| index.latched == self.before) else {
            return false;
        };
        let is_over = if index.upwards {
            from < to && (from..=to).contains(&index.at)
        } else {
            to < from && (to..=from).contains(&index.at)
        };
        let is_asked_for = self.wanted == LatchRequest::Index && self.stage == Stage::Armed;
        is_asked_for && is_over
    }

    fn end(&mut self) {
        if self.wanted != LatchRequest::None {
            self.previous = self.wanted;
            self.previous_for = HORIZON;
        }
    }
}
