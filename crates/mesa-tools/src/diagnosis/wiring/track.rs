//! State of one input: validity, rest, spontaneous changes and actuation.

use core::time::Duration;
use std::collections::VecDeque;

use super::movement::{Level, Number, Turn, TurnDirection};
use super::{Point, PointKind};
use mesa_hal::bus::Instant;
use mesa_hal::hal::{AnyValue, HalType, Value};

/// Longest invalid period that counts as a lost transfer.
const GAP: Duration = Duration::from_millis(100);
/// Counts that make a movement; an encoder that stands on an edge shows one count to and fro.
const COUNTS: f64 = 8.0;
/// Part of a value's range that makes a movement.
const PART: f64 = 0.05;
/// Turns, and the time in which no hand makes that many: the input changes by itself.
const TURNS: usize = 16;
const RESTLESS: Duration = Duration::from_secs(10);
/// Time without a turn after which an input no longer counts as changing by itself.
const CALM: Duration = Duration::from_secs(3);
/// Reversals without a movement that show a counter getting nowhere.
const REVERSALS: u32 = 30;

/// State of one input.
#[derive(Debug)]
pub(super) struct Track {
    hal_type: HalType,
    shape: Shape,
    /// Start of the invalid period.
    lost: Option<Instant>,
    /// Times of the last turns.
    turns: VecDeque<Instant>,
    /// Last time at which the input changed by itself.
    restless: Option<Instant>,
    /// Times at which the input left its rest and was back, since the request began.
    pub left: Option<Instant>,
    pub back: Option<Instant>,
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    Level(Level),
    Number(Number),
    /// Latch of an index: set and cleared by the driver, not by hand.
    Latch(Option<bool>),
}

impl Track {
    pub fn new(point: &Point) -> Self {
        let info = &point.info;
        let shape = match point.kind {
            PointKind::Digital => Shape::Level(Level::default()),
            PointKind::Counter => Shape::Number(Number::new(COUNTS)),
            PointKind::Index => Shape::Latch(None),
            PointKind::Analog => {
                let (min, max) = info.limits.unwrap_or((0.0, 1.0));
                Shape::Number(Number::new((max - min) * PART))
            }
        };
        Self {
            hal_type: info.hal_type,
            shape,
            lost: Some(Instant::default()),
            turns: VecDeque::with_capacity(TURNS),
            restless: None,
            left: None,
            back: None,
        }
    }

    /// Starts a request: forgets earlier movements.
    pub fn begin(&mut self) {
        (self.left, self.back) = (None, None);
        match &mut self.shape {
            Shape::Level(level) => level.begin(),
            Shape::Number(number) => number.begin(),
            Shape::Latch(_) => {}
        }
    }

    /// Takes the value of a cycle. `is_quiet`: no input is requested, so nothing should change.
    pub fn take(&mut self, now: Instant, value: Option<AnyValue>, is_quiet: bool) {
        let Some(value) = value.filter(|value| value.is_finite()) else {
            self.lost.get_or_insert(now);
            if !self.is_valid(now) {
                // The next valid value is no change, and a number rests at it.
                self.forget();
            }
            return;
        };
        self.lost = None;
        let value = value.as_f64();
        let turn = match &mut self.shape {
            Shape::Level(level) => level.take(now, value != 0.0),
            Shape::Number(number) => number.take(now, value),
            Shape::Latch(latch) => {
                *latch = Some(value != 0.0);
                None
            }
        };
        if let Some(turn) = turn {
            self.turned(now, turn);
        }
        let goes_on = match &self.shape {
            Shape::Level(level) if level.chatters(now) => true,
            Shape::Level(_) => turn.is_some() && self.is_restless(now),
            Shape::Number(number) => !number.rests() && self.is_restless(now),
            Shape::Latch(_) => false,
        };
        if goes_on || turn.is_some() && is_quiet {
            self.restless = Some(now);
        }
    }

    fn turned(&mut self, now: Instant, turn: Turn) {
        match turn.way {
            TurnDirection::Away => _ = self.left.get_or_insert(turn.at),
            TurnDirection::Back if self.left.is_some() => _ = self.back.get_or_insert(turn.at),
            TurnDirection::Back | TurnDirection::Spike => {}
        }
        if self.since_turn(now) >= CALM {
            self.turns.clear();
        }
        if self.turns.len() == TURNS {
            self.turns.pop_front();
        }
        self.turns.push_back(now);
        let first = self.turns.front().filter(|_| self.turns.len() == TURNS);
        if first.is_some_and(|&first| now.since(first) <= RESTLESS) {
            self.restless = Some(now);
        }
    }

    fn forget(&mut self) {
        (self.left, self.back) = (None, None);
        match &mut self.shape {
            Shape::Level(level) => *level = level.anew(),
            Shape::Number(number) => *number = number.anew(),
            Shape::Latch(latch) => *latch = None,
        }
    }

    pub fn is_valid(&self, now: Instant) -> bool {
        self.lost.is_none_or(|since| now.since(since) <= GAP)
    }

    /// True if the input changes by itself.
    pub fn is_restless(&self, now: Instant) -> bool {
        self.restless.is_some_and(|last| now.since(last) < CALM)
    }

    /// True if the input rests, so that a request can begin.
    pub fn rests(&self, now: Instant) -> bool {
        let rests = match &self.shape {
            Shape::Level(level) => level.rests(),
            Shape::Number(number) => number.rests(),
            Shape::Latch(latch) => latch.is_some(),
        };
        rests && self.is_valid(now) && !self.is_restless(now)
    }

    /// True if the input was invalid and is not back at its rest: it may be held.
    pub fn is_held(&self) -> bool {
        matches!(&self.shape, Shape::Level(level) if level.is_held())
    }

    /// Accepts the present level as the rest: the input is not held.
    pub fn let_go(&mut self) {
        if let Shape::Level(level) = &mut self.shape {
            level.let_go();
        }
    }

    /// Time since the last turn.
    pub fn since_turn(&self, now: Instant) -> Duration {
        let last = self.turns.back();
        last.map_or(Duration::MAX, |&last| now.since(last))
    }

    /// True if the counter counts up and down without getting anywhere: one of A and B does not
    /// arrive.
    pub fn dithers(&self) -> bool {
        let Shape::Number(number) = &self.shape else {
            return false;
        };
        number.rests() && self.left.is_none() && number.reversals >= REVERSALS
    }

    /// Last value.
    pub fn value(&self) -> Option<AnyValue> {
        match &self.shape {
            Shape::Level(level) => level.value.map(AnyValue::from),
            Shape::Number(number) => number.value.map(|value| self.any(value)),
            Shape::Latch(latch) => latch.map(AnyValue::from),
        }
    }

    /// The rest, and the farthest value from it.
    pub fn moved(&self) -> Option<(AnyValue, AnyValue)> {
        self.left?;
        match &self.shape {
            Shape::Level(level) => level.moved().map(|(from, to)| (from.into(), to.into())),
            Shape::Number(number) => number
                .moved()
                .map(|(from, to)| (self.any(from), self.any(to))),
            Shape::Latch(_) => None,
        }
    }

    fn any(&self, value: f64) -> AnyValue {
        match self.hal_type {
            HalType::Bit => bool::from_f64(value).into(),
            HalType::Float => value.into(),
            HalType::S32 => i32::from_f64(value).into(),
            HalType::U32 => u32::from_f64(value).into(),
            HalType::S64 => i64::from_f64(value).into(),
            HalType::U64 => u64::from_f64(value).into(),
        }
    }
}
