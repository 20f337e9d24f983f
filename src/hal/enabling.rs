//! Outputs that are enabled individually although several share one enable.

use super::handle::Key;
use super::rule::NONE;
use super::{Output, Pins};

/// Longest chain of enables that is followed: more than any output needs.
pub(super) const MAX_ENABLES: usize = 8;

/// Enable state of one pin, both as an output and as an enable of others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Enabling {
    /// Index of the pin that must be on for this one to reach its terminal; `NONE` without one.
    pub by: u32,
    /// As an output: the round of `by` in which it was enabled; 0 if it is not enabled.
    since: u32,
    /// As an enable: 0 until an output was enabled or disabled individually; changes whenever all
    /// enabled outputs are forgotten.
    round: u32,
    /// As an enable: number of outputs enabled in this round.
    wanted: u32,
}

impl Enabling {
    pub const NONE: Self = Self {
        by: NONE,
        since: 0,
        round: 0,
        wanted: 0,
    };

    /// Forgets all outputs that were enabled through this enable.
    pub fn forget(&mut self) {
        if self.round != 0 {
            self.round = self.round.wrapping_add(1).max(1);
            self.wanted = 0;
        }
    }
}

impl Pins {
    /// Enables an output, or holds it at its safe value. Its enable is on while any of the outputs
    /// that share it is enabled; from this call on, those of them that are not enabled are held.
    pub(super) fn enable_alone(&mut self, output: Key, enable: Key, on: bool) {
        let Some(output) = self.index(output) else {
            return self.count_foreign();
        };
        // Without a valid enable the output is held all the same.
        let by = self.index(enable).unwrap_or_else(|| {
            self.count_foreign();
            output
        });
        let (Some(before), Some(first)) = (self.enabling(output), self.enabling(by)) else {
            return;
        };
        let was_on = before.since != 0 && !self.is_held(output);
        if (before.by, first.round, was_on) != (by as u32, first.round.max(1), on) {
            self.switches = self.switches.wrapping_add(1);
            if was_on {
                self.each_enable(before.by as usize, |enable| {
                    enable.wanted = enable.wanted.saturating_sub(1);
                });
            }
            let own = |pins: &mut Self, since| {
                if let Some(rule) = pins.rule_mut(output) {
                    (rule.enabling.by, rule.enabling.since) = (by as u32, since);
                }
            };
            own(self, 0);
            self.each_enable(by, |enable| {
                enable.round = enable.round.max(1);
                enable.wanted = enable.wanted.saturating_add(u32::from(on));
            });
            let round = self.enabling(by).map_or(0, |by| by.round);
            own(self, if on { round } else { 0 });
        }
        let mut next = Some(by).filter(|by| *by != output);
        for _ in 0..MAX_ENABLES {
            let Some(enable) = next.and_then(|pin| self.enabling(pin)) else {
                return;
            };
            let key = self.key(next.map_or(NONE, |pin| pin as u32));
            self.set(Output::<bool>::new(key), enable.wanted > 0);
            next = next.and_then(|pin| self.enable_of(pin));
        }
    }

    /// True if an output has its safe value because it is not enabled while its enable is managed
    /// output by output.
    pub(super) fn is_held(&self, output: usize) -> bool {
        let Some(own) = self.enabling(output) else {
            return false;
        };
        let round = self.enabling(own.by as usize).map_or(0, |by| by.round);
        round != 0 && own.since != round
    }

    /// Changes an enable and the ones that it needs in turn.
    fn each_enable(&mut self, first: usize, change: impl Fn(&mut Enabling)) {
        let mut next = Some(first);
        for _ in 0..MAX_ENABLES {
            let Some(rule) = next.and_then(|pin| self.rule_mut(pin)) else {
                return;
            };
            change(&mut rule.enabling);
            next = next.and_then(|pin| self.enable_of(pin));
        }
    }

    /// The enable that an enable itself needs, if both belong to the same group and fail together.
    fn enable_of(&self, pin: usize) -> Option<usize> {
        let by = self.enabling(pin)?.by as usize;
        (self.slots.get(by)?.group == self.slots.get(pin)?.group).then_some(by)
    }

    fn enabling(&self, pin: usize) -> Option<Enabling> {
        Some(self.rule(pin)?.enabling)
    }
}
