//! Writes of which another part is made each time.

use alloc::{boxed::Box, vec, vec::Vec};

use super::layout::WriteLayout;
use super::plan::Register;
use super::words::By;
use super::{ImagePlan, Words, WritePhase};
use crate::bus::Access;

/// Everything that is written, for writes that hold settings: what comes first, data, each setting by
/// itself and stage by stage, triggers, and what comes first once more.
#[derive(Debug)]
pub(super) struct Parts {
    pub accesses: Box<[Access]>,
    /// Which of them are written next.
    pub wanted: Box<[bool]>,
    /// Where data begins, ...
    data: usize,
    /// ... settings, with the number of each, ...
    settings: usize,
    order: Box<[u16]>,
    /// ... and what comes first once more.
    last: usize,
}

impl Parts {
    pub fn new(plan: &ImagePlan, writes: &WriteLayout, first_setting: u16) -> Self {
        let first = writes.phase(WritePhase::First);
        let mut accesses = first.clone();
        let data = accesses.len();
        accesses.extend(writes.phase(WritePhase::Data));
        let settings = accesses.len();
        let mut order: Vec<(u16, &Register)> = (0u16..).zip(&plan.settings).collect();
        order.sort_by_key(|(_, register)| register.stage);
        for (n, register) in &order {
            accesses.push(Access::write(register.address, first_setting + n, 1));
        }
        accesses.extend(writes.phase(WritePhase::Trigger));
        let last = accesses.len();
        accesses.extend(first);
        Self {
            wanted: vec![false; accesses.len()].into_boxed_slice(),
            accesses: accesses.into_boxed_slice(),
            data,
            settings,
            order: order.iter().map(|(n, _)| *n).collect(),
            last,
        }
    }

    /// Everything of a cycle, and the settings that go with it.
    pub fn want_cycle(&mut self, words: &Words) {
        self.wanted.fill(true);
        self.want_settings(|setting| words.is_asked(setting, By::Cycle));
        self.wanted
            .iter_mut()
            .skip(self.last)
            .for_each(|one| *one = false);
    }

    /// Data and settings of the set-up, then what drives the pins, and the watchdog's word at the end:
    /// it bites on a board that was reset before or meanwhile, whose watchdog has no time.
    pub fn want_guarded(&mut self, words: &Words) {
        let (data, settings, last) = (self.data, self.settings, self.last);
        for (n, wanted) in self.wanted.iter_mut().enumerate() {
            *wanted = (data..settings).contains(&n) || n >= last;
        }
        self.want_settings(|setting| words.is_asked(setting, By::Guarded));
    }

    fn want_settings(&mut self, is_wanted: impl Fn(u16) -> bool) {
        let wanted = self.wanted.iter_mut().skip(self.settings);
        for (wanted, &setting) in wanted.zip(&self.order) {
            *wanted = is_wanted(setting);
        }
    }
}
