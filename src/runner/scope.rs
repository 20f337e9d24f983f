//! Recording of cycles around a trigger.

use alloc::vec::Vec;
use core::ops::Range;

use crate::advice::{self, Advice, MesaError};
use crate::bus::Instant;
use crate::hal::{AnyValue, HalType, PinId, Pins};
use crate::tally::Tally;

/// Largest number of pins of a [`Scope`].
pub const MAX_SCOPE_PINS: usize = 16;
/// Largest number of cycles of a [`Scope`].
pub const MAX_SCOPE_CYCLES: usize = 100_000;

/// Words of a cycle before its values: its number, its time, and a bit for each valid value.
const HEAD: usize = 3;

/// Records pins in a number of cycles before and after a trigger, as an oscilloscope does. Fed in
/// the thread of the cycle, and read afterwards.
///
/// ```
/// use std::ops::ControlFlow;
/// use mesa_hal::runner::{Edge, Runner, Scope, ScopeRange, ScopeState, Trigger};
/// use mesa_hal::{Driver, Settings};
/// use mesa_hal_sim::machines;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let board = machines::six_axes_7i92(Default::default());
/// let driver = Driver::start(board, Settings::default())?;
/// let lamp = driver.pins().output::<bool>("hm2_7i92.0.7i77.0.0.output-00")?;
/// let trigger = Trigger { pin: lamp.into(), level: 0.5, edge: Edge::Rising };
/// let range = ScopeRange { before: 5, cycles: 10 };
/// let mut scope = Scope::new(driver.pins(), &[lamp.into()], trigger, range)?;
/// let ended = Runner::new(driver).run(|cycle| {
///     let is_lit = cycle.number >= 50;
///     cycle.pins_mut().set(lamp, is_lit);
///     match scope.sample(cycle.pins()) {
///         ScopeState::Done => ControlFlow::Break(()),
///         _ => ControlFlow::Continue(()),
///     }
/// });
/// ended.stopped?;
/// let first = scope.rows().next().ok_or("recorded")?;
/// assert_eq!((scope.rows().count(), first.offset), (10, -5));
/// # Ok(())
/// # }
/// ```
///
/// # Real time
/// [`sample`](Self::sample) takes constant time for each pin and does not allocate.
/// [`new`](Self::new) allocates: 8 bytes for each value, and 24 for each cycle.
#[derive(Clone, Debug)]
pub struct Scope {
    pins: Vec<(PinId, HalType)>,
    trigger: Trigger,
    range: ScopeRange,
    /// A ring of rows, one for each cycle of the range.
    words: Vec<u64>,
    /// Number of rows written so far.
    written: usize,
    /// The value of the trigger's pin in the last cycle.
    last: Option<f64>,
    /// The row of the trigger.
    triggered: Option<usize>,
}

/// The cycles that a scope records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScopeRange {
    /// Cycles before the trigger: less than `cycles`.
    pub before: usize,
    /// All cycles: 2 to [`MAX_SCOPE_CYCLES`].
    pub cycles: usize,
}

/// Trigger condition of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trigger {
    /// The watched pin; a bit is 0 or 1.
    pub pin: PinId,
    /// The level that its value crosses.
    pub level: f64,
    /// The direction of the crossing.
    pub edge: Edge,
}

/// The direction in which a level is crossed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// From below the level to the level or above.
    Rising,
    /// From above the level to the level or below.
    Falling,
}

/// State of a scope.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ScopeState {
    /// The cycles before the trigger are not complete: a trigger is still ignored.
    Filling,
    /// Waiting for the trigger.
    Waiting,
    /// The trigger has occurred.
    Triggered,
    /// All cycles are recorded.
    Done,
}

/// Reason why a scope cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ScopeError {
    /// Too few or too many pins.
    #[error("{count} pins: 1 to {MAX_SCOPE_PINS} can be recorded at once")]
    Pins {
        /// Number of pins.
        count: usize,
    },
    /// Too few or too many cycles.
    #[error(
        "{before} of {cycles} cycles before the trigger: there must be 2 to {MAX_SCOPE_CYCLES} cycles, \
         and at least one from the trigger on"
    )]
    Cycles {
        /// Cycles before the trigger.
        before: usize,
        /// All cycles.
        cycles: usize,
    },
    /// A pin belongs to another driver.
    #[error("a pin belongs to another driver's pins, or to none")]
    ForeignPin,
}

impl MesaError for ScopeError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::ForeignPin => Some(advice::ASK_THIS_DRIVER),
            Self::Pins { .. } | Self::Cycles { .. } => None,
        }
    }
}

/// A recorded cycle.
#[derive(Clone, Copy, Debug)]
pub struct ScopeRow<'a> {
    /// Cycles since the trigger; negative before it.
    pub offset: i64,
    /// The number of the cycle.
    pub cycle: u64,
    /// Start of the cycle.
    pub time: Instant,
    pins: &'a [(PinId, HalType)],
    valid: u64,
    words: &'a [u64],
}

impl Scope {
    /// A scope for the pins `recorded`, over a range of cycles around the trigger.
    ///
    /// # Errors
    /// [`ScopeError`].
    pub fn new(
        pins: &Pins,
        recorded: &[PinId],
        trigger: Trigger,
        range: ScopeRange,
    ) -> Result<Self, ScopeError> {
        let ScopeRange { before, cycles } = range;
        let count = recorded.len();
        if !(1..=MAX_SCOPE_PINS).contains(&count) {
            return Err(ScopeError::Pins { count });
        }
        if !(2..=MAX_SCOPE_CYCLES).contains(&cycles) || before >= cycles {
            return Err(ScopeError::Cycles { before, cycles });
        }
        let typed = |&pin| Some((pin, pins.info_of(pin)?.hal_type));
        let typed: Option<Vec<_>> = recorded.iter().map(typed).collect();
        let known = typed.filter(|_| pins.info_of(trigger.pin).is_some());
        Ok(Self {
            pins: known.ok_or(ScopeError::ForeignPin)?,
            trigger,
            range,
            words: alloc::vec![0; cycles.saturating_mul(HEAD.saturating_add(count))],
            written: 0,
            last: None,
            triggered: None,
        })
    }

    /// Records a cycle: call it after the read, or after the application's own work, so that its
    /// outputs are those of this cycle.
    ///
    /// # Real time
    /// Constant time for each pin, no allocation.
    pub fn sample(&mut self, pins: &Pins) -> ScopeState {
        if self.state() == ScopeState::Done {
            return ScopeState::Done;
        }
        self.look(pins);
        let at = self.row(self.written).start;
        let (mut valid, mut words) = (0, self.words.iter_mut().skip(at));
        let mut put = |word| {
            if let Some(slot) = words.next() {
                *slot = word;
            }
        };
        for (number, &(pin, _)) in self.pins.iter().enumerate() {
            valid |= u64::from(pins.read_any(pin).valid) << number;
        }
        put(pins.cycle());
        put(pins.now().as_nanos());
        put(valid);
        for &(pin, _) in &self.pins {
            put(pins.read_any(pin).value.bits);
        }
        self.written.tally(1);
        self.state()
    }

    /// The words of a row; the newest row overwrites the oldest.
    fn row(&self, number: usize) -> Range<usize> {
        debug_assert!(self.range.cycles > 0, "a scope of no cycles");
        let size = HEAD.saturating_add(self.pins.len());
        let place = number.checked_rem(self.range.cycles).unwrap_or(0);
        let at = place.saturating_mul(size);
        at..at.saturating_add(size)
    }

    /// Number of cycles from the trigger on.
    fn after(&self) -> usize {
        self.range.cycles.saturating_sub(self.range.before)
    }

    fn rows_from(&self, row: usize) -> usize {
        self.written.saturating_sub(row)
    }

    /// The state.
    pub fn state(&self) -> ScopeState {
        match self.triggered {
            Some(row) if self.rows_from(row) >= self.after() => ScopeState::Done,
            Some(_) => ScopeState::Triggered,
            None if self.written < self.range.before => ScopeState::Filling,
            None => ScopeState::Waiting,
        }
    }

    /// The recorded cycles: all of them when it is [done](ScopeState::Done), none before the
    /// trigger.
    pub fn rows(&self) -> impl Iterator<Item = ScopeRow<'_>> + '_ {
        let trigger = self.written.saturating_add(self.range.before);
        let trigger = self.triggered.unwrap_or(trigger);
        let rows = trigger.saturating_sub(self.range.before)..self.written;
        rows.filter_map(move |row| {
            let words = self.words.get(self.row(row))?;
            let (&[cycle, nanos, valid], values) = words.split_first_chunk()?;
            Some(ScopeRow {
                offset: (row as i64).wrapping_sub(trigger as i64),
                cycle,
                time: Instant::from_nanos(nanos),
                pins: &self.pins,
                valid,
                words: values,
            })
        })
    }

    /// Detects a crossing of the level, once the cycles before the trigger are complete. A value
    /// that is not valid crosses nothing.
    fn look(&mut self, pins: &Pins) {
        let reading = pins.read_any(self.trigger.pin);
        let now = reading.ok().map(AnyValue::as_f64);
        let before = core::mem::replace(&mut self.last, now);
        let (Some(before), Some(now), None) = (before, now, self.triggered) else {
            return;
        };
        let level = self.trigger.level;
        let has_crossed = match self.trigger.edge {
            Edge::Rising => before < level && now >= level,
            Edge::Falling => before > level && now <= level,
        };
        if has_crossed && self.written >= self.range.before {
            self.triggered = Some(self.written);
        }
    }
}

impl ScopeRow<'_> {
    /// The values in the order of the pins; `None` for a value that was not valid.
    pub fn values(&self) -> impl Iterator<Item = Option<AnyValue>> + '_ {
        let values = self.pins.iter().zip(self.words).enumerate();
        values.map(|(number, (&(_, hal_type), &bits))| {
            let is_valid = self.valid >> number & 1 != 0;
            is_valid.then_some(AnyValue { hal_type, bits })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hal::{PinMaker, PinStore};

    const fn range(before: usize, cycles: usize) -> ScopeRange {
        ScopeRange { before, cycles }
    }

    /// Feeds `volts` cycle by cycle; returns the recorded offsets and values.
    fn record(volts: &[f64], edge: Edge, range: ScopeRange) -> Vec<(i64, f64)> {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "");
        let pin = make.input::<f64>("volts").expect("made");
        let trigger = Trigger {
            pin: pin.into(),
            level: 1.0,
            edge,
        };
        let mut scope = Scope::new(&store, &[pin.into()], trigger, range).expect("possible");
        for (number, &volts) in (1..).zip(volts) {
            store.begin_cycle(Instant::from_nanos(number * 1000));
            store.publish(pin, volts);
            store.group_good(group);
            scope.sample(&store);
        }
        let rows = scope.rows().map(|row| {
            assert_eq!(row.time.as_nanos(), row.cycle * 1000);
            let value = row.values().next().flatten().expect("valid");
            (row.offset, value.as_f64())
        });
        rows.collect()
    }

    #[test]
    fn cycles_around_the_trigger_are_recorded_and_no_others() {
        let volts = [0.0, 0.1, 0.2, 0.3, 1.5, 1.6, 0.4, 1.7, 1.8];
        let rising = record(&volts, Edge::Rising, range(2, 5));
        assert_eq!(rising, [(-2, 0.2), (-1, 0.3), (0, 1.5), (1, 1.6), (2, 0.4)]);
        let falling = record(&volts, Edge::Falling, range(1, 3));
        assert_eq!(falling, [(-1, 1.6), (0, 0.4), (1, 1.7)]);
        // The first crossing comes before the cycles that must precede a trigger are complete.
        let late = record(&volts, Edge::Rising, range(6, 8));
        assert_eq!((late[0], late[6]), ((-6, 0.1), (0, 1.7)));
        assert_eq!(record(&volts[..4], Edge::Rising, range(1, 3)), []);
    }

    #[test]
    fn invalid_reading_does_not_trigger_and_has_no_value() {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "");
        let pin = make.input::<bool>("switch").expect("made");
        let trigger = Trigger {
            pin: pin.into(),
            level: 0.5,
            edge: Edge::Rising,
        };
        let mut scope = Scope::new(&store, &[pin.into()], trigger, range(0, 3)).expect("possible");
        store.publish(pin, false);
        assert_eq!(scope.sample(&store), ScopeState::Waiting);
        store.publish(pin, true);
        assert_eq!(
            scope.sample(&store),
            ScopeState::Waiting,
            "it was never valid"
        );
        store.group_good(group);
        assert_eq!(
            scope.sample(&store),
            ScopeState::Waiting,
            "it was not seen off"
        );
        store.publish(pin, false);
        scope.sample(&store);
        store.publish(pin, true);
        assert_eq!(scope.sample(&store), ScopeState::Triggered);
        store.invalidate(group);
        scope.sample(&store);
        assert_eq!(scope.sample(&store), ScopeState::Done);
        let values: Vec<_> = scope
            .rows()
            .flat_map(|row| row.values().collect::<Vec<_>>())
            .collect();
        assert_eq!(values, [Some(true.into()), None, None]);
    }

    #[test]
    fn invalid_scope_is_refused() {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "");
        let pin = PinId::from(make.input::<bool>("switch").expect("made"));
        let scope = |pins: &[PinId], pin, cycles| {
            let trigger = Trigger {
                pin,
                level: 0.5,
                edge: Edge::Rising,
            };
            Scope::new(&store, pins, trigger, cycles).err()
        };
        for count in [0, 17] {
            let pins = alloc::vec![pin; count];
            assert_eq!(
                scope(&pins, pin, range(0, 2)),
                Some(ScopeError::Pins { count })
            );
        }
        for (before, cycles) in [(2, 2), (0, 1), (0, MAX_SCOPE_CYCLES + 1)] {
            let error = ScopeError::Cycles { before, cycles };
            assert_eq!(scope(&[pin], pin, range(before, cycles)), Some(error));
        }
        let foreign = Some(ScopeError::ForeignPin);
        assert_eq!(scope(&[pin], PinId::default(), range(1, 2)), foreign);
        assert_eq!(scope(&[PinId::default()], pin, range(1, 2)), foreign);
    }
}
