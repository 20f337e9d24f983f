//! Groups of pins: validity, age, and arming.

use alloc::vec::Vec;

use super::arming::{Arming, ArmingEvent};
use super::{Age, GroupState};
use crate::bus::Instant;

/// The groups of a store. A pin refers to its group by its number; a
/// [`GroupId`](super::GroupId) refers to a part of a group.
#[derive(Debug, Default)]
pub(super) struct Groups {
    all: Vec<Group>,
    /// The group of each part. The pins of a part are those whose changes are detected together.
    parts: Vec<u32>,
    cycle: u64,
    now: Instant,
    /// Age in cycles from which on inputs are not valid; 0 for never.
    stale_after: u32,
    /// Number of faults of groups that were armed, or ran.
    losses: u64,
}

/// Origin of the values of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// Transfers.
    Machine,
    /// The driver itself: they do not become stale.
    Driver,
    /// The application, which shows them: they do not become stale.
    Application,
}

#[derive(Debug)]
struct Group {
    origin: Origin,
    /// The last transfer that counts was good. The inputs are valid until they become stale: see
    /// [`Groups::is_valid`].
    is_good: bool,
    last_good: Option<(u64, Instant)>,
    /// Changed by [`Groups::change_arming`] alone.
    arming: Arming,
    faults: u64,
    /// Its outputs, to set them to their safe values.
    outputs: Vec<u32>,
    /// Its first part, whose index is the group's public id.
    part: u32,
}

/// Set-up. Allocates.
impl Groups {
    /// Adds a group, which is armed; returns its first part.
    pub fn add(&mut self) -> u32 {
        let part = self.parts.len() as u32;
        let number = self.all.len();
        self.all.push(Group {
            origin: Origin::Machine,
            is_good: false,
            last_good: None,
            arming: Arming::Armed,
            faults: 0,
            outputs: Vec::new(),
            part,
        });
        self.add_part(number)
    }

    /// Adds a part to a group; returns its index.
    pub fn add_part(&mut self, number: usize) -> u32 {
        let part = self.parts.len() as u32;
        self.parts.push(number as u32);
        part
    }

    pub fn add_output(&mut self, number: usize, pin: u32) {
        if let Some(group) = self.all.get_mut(number) {
            group.outputs.push(pin);
        }
    }

    /// Sets the origin of the values of a group. Those of the application are valid from now on.
    pub fn set_origin(&mut self, number: usize, origin: Origin) {
        let now = (self.cycle, self.now);
        if let Some(group) = self.all.get_mut(number) {
            group.origin = origin;
            if origin == Origin::Application {
                (group.is_good, group.last_good) = (true, Some(now));
            }
        }
    }

    pub const fn set_stale_after(&mut self, cycles: u32) {
        self.stale_after = cycles;
    }

    /// Removes all groups, parts and outputs from these numbers on.
    pub fn truncate(&mut self, groups: usize, parts: usize, pins: usize) {
        self.all.truncate(groups);
        self.parts.truncate(parts);
        for group in &mut self.all {
            group.outputs.retain(|&index| (index as usize) < pins);
        }
    }

    /// Releases the memory that was kept for further groups and outputs.
    pub fn shrink_to_fit(&mut self) {
        self.parts.shrink_to_fit();
        self.all.shrink_to_fit();
        for group in &mut self.all {
            group.outputs.shrink_to_fit();
        }
    }
}

/// The cycle. Constant time, no allocation.
impl Groups {
    pub const fn begin_cycle(&mut self, now: Instant) {
        self.cycle = self.cycle.saturating_add(1);
        self.now = now;
    }

    /// Records a good transfer that was started at `started` and completed `cycles` cycles after it
    /// was due. Returns true if it arms the group: its inputs are valid, and it is awaited.
    pub fn note_good(&mut self, number: usize, cycles: u64, started: Instant) -> bool {
        let good = (self.cycle.saturating_sub(cycles), started.min(self.now));
        let Some(group) = self.all.get_mut(number) else {
            return false;
        };
        (group.is_good, group.last_good) = (true, Some(good));
        group.arming.is_awaited() && self.is_valid(number)
    }

    /// Makes the inputs of a group not valid after a failed transfer.
    pub fn invalidate(&mut self, number: usize) {
        if let Some(group) = self.all.get_mut(number) {
            group.is_good = false;
        }
    }

    /// Records that the application has shown a value of a group; returns false if the group is
    /// none of the application's.
    pub fn note_shown(&mut self, number: usize) -> bool {
        let now = (self.cycle, self.now);
        let group = self.all.get_mut(number);
        let own = group.filter(|group| group.origin == Origin::Application);
        own.map(|group| group.last_good = Some(now)).is_some()
    }

    /// Changes the arming of a group; returns the one before and the one after.
    pub fn change_arming(&mut self, number: usize, event: ArmingEvent) -> Option<[Arming; 2]> {
        let group = self.all.get_mut(number)?;
        let before = group.arming;
        group.arming = before.after(event);
        let is_disarmed = before.is_armed() && !group.arming.is_armed();
        group.faults = group.faults.saturating_add(is_disarmed.into());
        let is_loss = is_disarmed || event.is_loss();
        self.losses = self.losses.saturating_add(is_loss.into());
        Some([before, group.arming])
    }
}

impl Groups {
    pub const fn cycle(&self) -> u64 {
        self.cycle
    }

    pub const fn now(&self) -> Instant {
        self.now
    }

    pub const fn stale_after(&self) -> u32 {
        self.stale_after
    }

    #[cfg(feature = "std")]
    pub const fn losses(&self) -> u64 {
        self.losses
    }

    pub const fn len(&self) -> usize {
        self.all.len()
    }

    pub const fn part_count(&self) -> usize {
        self.parts.len()
    }

    /// The group of a part.
    #[inline]
    pub fn of_part(&self, part: usize) -> Option<usize> {
        Some(*self.parts.get(part)? as usize)
    }

    /// The first part of a group.
    pub fn part_of(&self, number: usize) -> Option<u32> {
        Some(self.all.get(number)?.part)
    }

    pub fn is_of_application(&self, number: usize) -> bool {
        let group = self.all.get(number);
        group.is_some_and(|group| group.origin == Origin::Application)
    }

    /// The outputs of a group.
    pub fn outputs(&self, number: usize) -> &[u32] {
        self.all
            .get(number)
            .map_or(&[], |group| group.outputs.as_slice())
    }

    #[cfg(feature = "std")]
    pub fn faults(&self, number: usize) -> u64 {
        self.all.get(number).map_or(0, |group| group.faults)
    }

    /// True if the outputs of a group follow the application.
    #[inline]
    pub fn is_armed(&self, number: usize) -> bool {
        let group = self.all.get(number);
        group.is_some_and(|group| group.arming.is_armed())
    }

    /// True if the inputs of a group are valid. Staleness is decided here and nowhere else.
    #[inline]
    pub fn is_valid(&self, number: usize) -> bool {
        self.all.get(number).is_some_and(|group| {
            let is_stale = self.stale_after > 0
                && group.origin == Origin::Machine
                && self.age_of(group).cycles >= u64::from(self.stale_after);
            group.is_good && !is_stale
        })
    }

    /// Time since the last good transfer of a group.
    #[inline]
    pub fn age(&self, number: usize) -> Age {
        let group = self.all.get(number);
        group.map_or(Age::NEVER, |group| self.age_of(group))
    }

    pub fn state(&self, number: usize) -> Option<GroupState> {
        let group = self.all.get(number)?;
        Some(GroupState {
            valid: self.is_valid(number),
            armed: group.arming.is_armed(),
            age: self.age_of(group),
            faults: group.faults,
            rearm_pending: group.arming.is_awaited(),
        })
    }

    #[inline]
    fn age_of(&self, group: &Group) -> Age {
        group.last_good.map_or(Age::NEVER, |(cycle, time)| Age {
            cycles: self.cycle.saturating_sub(cycle),
            time: self.now.since(time),
        })
    }
}
