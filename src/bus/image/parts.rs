//! Writes of which another part is made each time.

use alloc::vec::Vec;

use super::layout::WriteLayout;
use super::plan::Register;
use super::words::By;
use super::{ImagePlan, Words, WritePhase};
use crate::bus::Access;

/// Everything that is written, for writes that hold settings.
#[derive(Debug)]
pub(super) struct Parts {
    first: Vec<Access>,
    data: Vec<Access>,
    /// Each by itself, stage by stage, with its number.
    settings: Vec<(u16, Access)>,
    triggers: Vec<Access>,
    /// What is written next. It has room for everything.
    chosen: Vec<Access>,
}

impl Parts {
    pub fn new(plan: &ImagePlan, writes: &WriteLayout, first_setting: u16) -> Self {
        let mut order: Vec<(u16, &Register)> = (0u16..).zip(&plan.settings).collect();
        order.sort_by_key(|(_, register)| register.stage);
        let access = |n, register: &Register| Access::write(register.address, first_setting + n, 1);
        Self {
            first: writes.phase(WritePhase::First),
            data: writes.phase(WritePhase::Data),
            settings: order
                .iter()
                .map(|(n, register)| (*n, access(*n, register)))
                .collect(),
            triggers: writes.phase(WritePhase::Trigger),
            chosen: Vec::with_capacity(plan.writes.len() + plan.settings.len()),
        }
    }

    /// Data, and the settings that go `by` this write. In that of the cycle all other writes are where
    /// they are without settings. One that drives pins ends with what comes first otherwise, the
    /// watchdog's word: it bites on a board that was reset before or meanwhile, whose watchdog has no
    /// time.
    pub fn choose(&mut self, words: &Words, by: By) -> &[Access] {
        let (before, after) = match by {
            By::Cycle => (&self.first[..], &self.triggers),
            By::Guarded => (&[][..], &self.first),
        };
        let asked = self.settings.iter().filter(|(n, _)| words.is_asked(*n, by));
        self.chosen.clear();
        self.chosen.extend_from_slice(before);
        self.chosen.extend_from_slice(&self.data);
        self.chosen.extend(asked.map(|(_, access)| access));
        self.chosen.extend_from_slice(after);
        &self.chosen
    }
}
