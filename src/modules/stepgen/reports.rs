//! The events of a generator: each once for each change of what it is about.

use super::timing::{PulseTicks, PulseTimes};
use crate::events::EventKind;
use crate::modules::ReadCycle;

/// Events to report with the next read, and what they are about.
#[derive(Debug)]
pub(super) struct Reports {
    generator: u32,
    events: [Option<EventKind>; 4],
    has_events: bool,
    /// The limit of the speed has been reported since it changed.
    has_said_limit: bool,
    /// The times that the parameters asked for last.
    times: Option<PulseTimes>,
    /// The hold time that they leave, in ns, if that is less than they ask for.
    short_hold: Option<u32>,
}

impl Reports {
    pub fn new(generator: u8) -> Self {
        Self {
            generator: generator.into(),
            events: [None; 4],
            has_events: false,
            has_said_limit: false,
            times: None,
            short_hold: None,
        }
    }

    /// Reports what there is.
    #[inline]
    pub fn report(&mut self, cycle: &ReadCycle<'_>) {
        if core::mem::take(&mut self.has_events) {
            for event in self.events.iter_mut().filter_map(Option::take) {
                cycle.events.report(cycle.now, event);
            }
        }
    }

    fn add(&mut self, number: usize, event: EventKind) {
        debug_assert!(number < self.events.len(), "no place for event {number}");
        if let Some(place) = self.events.get_mut(number) {
            *place = Some(event);
            self.has_events = true;
        }
    }

    /// The limits have changed.
    pub fn limit_changed(&mut self) {
        self.has_said_limit = false;
    }

    /// A rate in steps per second that is above the limit.
    pub fn limited(&mut self, asked: f64, limit: f64) {
        if !core::mem::replace(&mut self.has_said_limit, true) {
            let event = EventKind::StepRateLimited {
                generator: self.generator,
                asked: asked as u32,
                limit: limit as u32,
            };
            self.add(0, event);
        }
    }

    /// A time that no register holds.
    pub fn clipped(&mut self, asked: u32, longest: u32) {
        let event = EventKind::StepTimeClipped {
            generator: self.generator,
            asked,
            longest,
        };
        self.add(1, event);
    }

    /// The times that the parameters ask for, and what becomes of them.
    pub fn observe_times(&mut self, times: PulseTimes, ticks: &PulseTicks, clock_hz: u32) {
        if self.times.replace(times) != Some(times) {
            let left = ticks.hold_left(clock_hz);
            self.short_hold = (left < times.dir_hold).then_some(left);
        }
    }

    /// The generator is enabled with the times of before. Fresh parameters have no room for a hold,
    /// which is no news before somebody uses them.
    #[inline]
    pub fn enabled(&mut self) {
        if let (Some(left), Some(times)) = (self.short_hold.take(), self.times) {
            let event = EventKind::StepHoldShort {
                generator: self.generator,
                asked: times.dir_hold,
                left,
            };
            self.add(2, event);
        }
    }

    /// The accumulator stands still at a rate in steps per second.
    pub fn stands(&mut self, rate: f64) {
        let event = EventKind::StepgenStalled {
            generator: self.generator,
            rate: rate as u32,
        };
        self.add(3, event);
    }
}
