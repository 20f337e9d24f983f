//! One input: whether it is valid, rests, changes by itself, or was actuated.

use core::time::Duration;
use std::collections::VecDeque;

use super::movement::{Level, Number, Turn, Way};
use super::{Kind, Point};
use mesa_hal::bus::Instant;
use mesa_hal::hal::{AnyValue, HalType, Value};

/// What is not valid for less is a lost transfer.
const GAP: Duration = Duration::from_millis(100);
/// Counts that are a movement; an encoder that stands on an edge shows one to and fro.
const COUNTS: f64 = 8.0;
/// Part of its range that is a movement of a value.
const PART: f64 = 0.05;
/// So many turns within this time are nobody's hand ...
const TURNS: usize = 16;
const RESTLESS: Duration = Duration::from_secs(10);
/// ... and what is restless stays so until it has not turned for so long.
const CALM: Duration = Duration::from_secs(3);
/// Reversals of a counter that gets nowhere.
const REVERSALS: u32 = 30;

/// One input.
#[derive(Debug)]
pub(super) struct Track {
    hal_type: HalType,
    shape: Shape,
    /// Since when it is not valid.
    lost: Option<Instant>,
    /// Its last turns.
    turns: VecDeque<Instant>,
    /// When it was seen last to change by itself.
    restless: Option<Instant>,
    /// When it left its rest, and was back, since the ask began.
    pub left: Option<Instant>,
    pub back: Option<Instant>,
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    Level(Level),
    Number(Number),
    /// An index's latch: the driver sets it on and off, and no hand does.
    Latch(Option<bool>),
}

impl Track {
    pub fn new(point: &Point) -> Self {
        let info = &point.info;
        let shape = match point.kind {
            Kind::Digital => Shape::Level(Level::default()),
            Kind::Counter => Shape::Number(Number::new(COUNTS)),
            Kind::Index => Shape::Latch(None),
            Kind::Analog => {
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

    /// An ask begins: what it does is told from now on.
    pub fn begin(&mut self) {
        (self.left, self.back) = (None, None);
        match &mut self.shape {
            Shape::Level(level) => level.begin(),
            Shape::Number(number) => number.begin(),
            Shape::Latch(_) => {}
        }
    }

    /// What it showed in a cycle. `is_quiet`: nobody was asked to touch anything.
    pub fn take(&mut self, now: Instant, value: Option<AnyValue>, is_quiet: bool) {
        let Some(value) = value.filter(|value| value.is_finite()) else {
            self.lost.get_or_insert(now);
            if !self.is_valid(now) {
                // What it shows next is no change, and of a number where it rests.
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
            Way::Away => _ = self.left.get_or_insert(turn.at),
            Way::Back if self.left.is_some() => _ = self.back.get_or_insert(turn.at),
            Way::Back | Way::Spike => {}
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

    /// Whether it changes by itself.
    pub fn is_restless(&self, now: Instant) -> bool {
        self.restless.is_some_and(|last| now.since(last) < CALM)
    }

    /// Whether it rests, so that an ask can begin.
    pub fn rests(&self, now: Instant) -> bool {
        let rests = match &self.shape {
            Shape::Level(level) => level.rests(),
            Shape::Number(number) => number.rests(),
            Shape::Latch(latch) => latch.is_some(),
        };
        rests && self.is_valid(now) && !self.is_restless(now)
    }

    /// Whether it was lost, and is back elsewhere than it rested: somebody holds it.
    pub fn is_held(&self) -> bool {
        matches!(&self.shape, Shape::Level(level) if level.is_held())
    }

    /// It rests where it is: nobody holds it.
    pub fn let_go(&mut self) {
        if let Shape::Level(level) = &mut self.shape {
            level.let_go();
        }
    }

    /// How long ago it turned last.
    pub fn since_turn(&self, now: Instant) -> Duration {
        let last = self.turns.back();
        last.map_or(Duration::MAX, |&last| now.since(last))
    }

    /// It counts up and down, and gets nowhere: one of A and B does not arrive.
    pub fn dithers(&self) -> bool {
        let Shape::Number(number) = &self.shape else {
            return false;
        };
        number.rests() && self.left.is_none() && number.reversals >= REVERSALS
    }

    /// What it shows.
    pub fn value(&self) -> Option<AnyValue> {
        match &self.shape {
            Shape::Level(level) => level.value.map(AnyValue::from),
            Shape::Number(number) => number.value.map(|value| self.any(value)),
            Shape::Latch(latch) => latch.map(AnyValue::from),
        }
    }

    /// Where it rested, and the farthest from there that it was.
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
