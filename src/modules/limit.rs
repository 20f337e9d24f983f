//! Values that a register cannot have: corrected where they are set, and reported.

use super::WriteCycle;
use crate::events::{CorrectedValue, EventKind};
use crate::hal::{Output, Param, Value};

/// The values that a setting may have.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limit {
    /// The setting, and the number of its instance or bank.
    pub setting: CorrectedValue,
    pub number: u32,
    /// The smallest and the largest value.
    pub lowest: i64,
    pub highest: i64,
    /// The value in place of one out of range; `None` for the nearest one.
    pub instead: Option<i64>,
}

impl Limit {
    /// The numbers of the source of a latch: -1 none, 0 the DPLL's reference, 1 to 4 its timers.
    pub const fn timer(setting: CorrectedValue, instead: i64) -> Self {
        Self {
            setting,
            number: 0,
            lowest: -1,
            highest: 4,
            instead: Some(instead),
        }
    }

    /// The value of a parameter, which becomes an allowed one, with an event.
    pub fn param<T>(&self, cycle: &mut WriteCycle<'_>, param: Param<T>) -> T
    where
        T: Value + Into<i64> + TryFrom<i64>,
    {
        let asked = cycle.pins.param(param);
        let Some(used) = self.correction(asked) else {
            return asked;
        };
        if cycle.pins.set_param(param, used).is_ok() {
            self.report(cycle, asked.into(), used.into());
        }
        used
    }

    /// The value of a pin, with an event for each new value that is not allowed: LinuxCNC's HAL
    /// owns the pin, so that it keeps its value there. `reported` is the last one.
    pub fn pin<T>(
        &self,
        cycle: &mut WriteCycle<'_>,
        pin: Output<T>,
        reported: &mut Option<i64>,
    ) -> T
    where
        T: Value + Into<i64> + TryFrom<i64>,
    {
        let asked = cycle.pins.fetch(pin);
        let used = self.correction(asked);
        let wrong = used.map(|_| asked.into());
        if core::mem::replace(reported, wrong) != wrong
            && let Some(used) = used
        {
            self.report(cycle, asked.into(), used.into());
        }
        used.unwrap_or(asked)
    }

    /// The value in place of one that is not allowed.
    fn correction<T: Copy + Into<i64> + TryFrom<i64>>(&self, asked: T) -> Option<T> {
        let asked = asked.into();
        let nearest = asked.min(self.highest).max(self.lowest);
        let used = self.instead.unwrap_or(nearest);
        (nearest != asked).then(|| T::try_from(used).ok()).flatten()
    }

    /// Reports a value that is not allowed.
    pub fn report(&self, cycle: &WriteCycle<'_>, asked: i64, used: i64) {
        let event = EventKind::ValueCorrected {
            setting: self.setting,
            number: self.number,
            asked,
            used,
            lowest: self.lowest,
            highest: self.highest,
        };
        cycle.events.report(cycle.now, event);
    }
}
