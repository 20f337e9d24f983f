//! Arming of groups, at once and as soon as they run.

use super::BoardCycle;
use crate::bus::Instant;
use crate::driver::{EventKind, Rearmed};
use crate::hal::{ArmingCondition, ArmingEvent, GroupId, PinError, ShortName};
use crate::tally::Tally;

impl BoardCycle {
    /// Lets all outputs follow the application again.
    pub fn rearm(&mut self, now: Instant) -> Rearmed {
        let (mut armed, mut is_news) = (0, false);
        if self.is_running() {
            armed = self.pins.rearm_all();
            let event = ArmingEvent::Request(ArmingCondition::WithBoard);
            is_news = self.pins.change_arming_of(self.group, event);
            for port in &self.parts.ports {
                is_news |= port.arm_with_board(&mut self.pins);
            }
        }
        self.rearmed(now, armed, is_news)
    }

    /// Arms all groups that run, and the others as soon as they do. A board that has lost its
    /// set-up gets it back with one of the next writes.
    pub fn rearm_when_running(&mut self, now: Instant) -> Rearmed {
        let when = self.condition();
        let mut armed = 0;
        if when == ArmingCondition::Running {
            armed = self.pins.rearm_all();
        } else {
            self.want_set_up();
        }
        let mut is_news = false;
        for number in 0..self.pins.group_count() {
            let group = self.pins.group_of(number);
            let is_armed = self.pins.group_state(group).is_none_or(|state| state.armed);
            if !is_armed && !self.is_port_off(group) {
                is_news |= self
                    .pins
                    .change_arming_of(group, ArmingEvent::Request(when));
            }
        }
        self.rearmed(now, armed, is_news)
    }

    /// Arms a group if it runs, and otherwise as soon as it does; returns true if it is armed.
    pub fn rearm_group_when_running(&mut self, group: GroupId) -> Result<bool, PinError> {
        let state = self.pins.group_state(group);
        let state = state.ok_or(PinError::ForeignHandle)?;
        if state.armed {
            return Ok(true);
        }
        if self.is_port_off(group) {
            let first = self.pins.infos().iter().find(|info| info.group == group);
            let pin = ShortName::new(first.map_or("", |info| &info.name));
            return Err(PinError::PortOff { pin });
        }
        let when = self.condition();
        if when == ArmingCondition::Running && self.pins.rearm(group).is_ok() {
            return Ok(true);
        }
        self.pins
            .change_arming_of(group, ArmingEvent::Request(when));
        Ok(false)
    }

    /// The condition on which a group that does not run is armed.
    fn condition(&self) -> ArmingCondition {
        if self.is_running() {
            ArmingCondition::Running
        } else {
            ArmingCondition::SetUp
        }
    }

    fn is_port_off(&self, group: GroupId) -> bool {
        let mut ports = self.parts.ports.iter();
        ports.any(|port| port.is_off(&self.pins, group))
    }

    /// Cancels the arming of groups that do not run, because of a fault: with
    /// [`ArmingEvent::Cancel`] of all that are awaited, and with [`ArmingEvent::CancelTransfer`] of
    /// all but those that wait for the board's set-up.
    pub(super) fn cancel_rearm(&mut self, now: Instant, event: ArmingEvent) {
        let groups = self.pins.change_all_arming(event);
        if groups > 0 {
            self.events
                .report(now, EventKind::RearmCancelled { groups });
        }
    }

    /// Counts the groups that are not armed after `armed` were.
    fn rearmed(&mut self, now: Instant, armed: usize, is_news: bool) -> Rearmed {
        let (mut waiting, mut rearm_pending) = (0_usize, 0_usize);
        for group in self.pins.groups() {
            let state = self.pins.group_state(group);
            waiting.tally(usize::from(state.is_some_and(|state| !state.armed)));
            rearm_pending.tally(usize::from(state.is_some_and(|state| state.rearm_pending)));
        }
        if armed > 0 || is_news {
            let [armed, waiting] =
                [armed, waiting].map(|count| u32::try_from(count).unwrap_or(u32::MAX));
            self.events
                .report(now, EventKind::Rearmed { armed, waiting });
        }
        Rearmed {
            armed,
            waiting,
            rearm_pending,
        }
    }
}
