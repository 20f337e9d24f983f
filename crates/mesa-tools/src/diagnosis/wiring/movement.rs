//! Movement of a level or a number away from its rest, and back.

use core::time::Duration;

use mesa_hal::bus::Instant;

/// Settling time of a level: longer than a contact bounces, shorter than a hand actuates.
const SETTLED: Duration = Duration::from_millis(20);
/// A level that has not settled within this time chatters.
const CHATTER: Duration = Duration::from_millis(500);
/// Time without movement after which a number is still.
const STILL: Duration = Duration::from_millis(400);

/// Change of a level or a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Turn {
    /// Time at which the change began.
    pub at: Instant,
    pub way: TurnDirection,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TurnDirection {
    /// Away from the rest.
    Away,
    /// Back to the rest, or to a new one.
    Back,
    /// Away and back without settling.
    Spike,
}

/// State of a level.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Level {
    /// Last value, and the time of its last change.
    pub value: Option<bool>,
    since: Instant,
    /// Time at which the settled level was first left.
    edge: Option<Instant>,
    settled: Option<bool>,
    rest: Option<bool>,
    /// True after an invalid period, until the level has been seen at its earlier rest.
    is_held: bool,
}

impl Level {
    /// Takes the settled level as the rest, unless the level was invalid and may be held.
    pub fn begin(&mut self) {
        if !self.is_held {
            self.rest = self.settled;
        }
    }

    /// The state after an invalid period, which keeps the rest only.
    pub fn anew(&self) -> Self {
        Self {
            rest: self.rest,
            is_held: self.rest.is_some(),
            ..Self::default()
        }
    }

    /// True if the level was invalid and is not back at its earlier rest.
    pub fn is_held(&self) -> bool {
        self.is_held && self.settled != self.rest
    }

    /// Ends the held state: the next request takes the level as the rest.
    pub fn let_go(&mut self) {
        self.is_held = false;
    }

    pub fn take(&mut self, now: Instant, value: bool) -> Option<Turn> {
        if self.value != Some(value) {
            if self.value.is_some() {
                self.edge.get_or_insert(now);
            }
            self.value = Some(value);
            self.since = now;
        }
        if now.since(self.since) < SETTLED {
            return None;
        }
        let before = self.settled.replace(value);
        self.is_held &= self.rest != Some(value);
        let (at, before) = self.edge.take().zip(before)?;
        let way = if before == value {
            TurnDirection::Spike
        } else if *self.rest.get_or_insert(before) == value {
            TurnDirection::Back
        } else {
            TurnDirection::Away
        };
        Some(Turn { at, way })
    }

    pub fn rests(&self) -> bool {
        self.settled.is_some() && self.edge.is_none()
    }

    pub fn chatters(&self, now: Instant) -> bool {
        self.edge.is_some_and(|edge| now.since(edge) > CHATTER)
    }

    /// The rest, and the opposite level.
    pub fn moved(&self) -> Option<(bool, bool)> {
        self.rest.map(|rest| (rest, !rest))
    }
}

/// State of a number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Number {
    /// Distance that makes a movement.
    threshold: f64,
    /// Last value.
    pub value: Option<f64>,
    /// Reference of a still number, and the time since when the number has been near it.
    near: (f64, Instant),
    rest: Option<f64>,
    /// Start of the last movement, and its farthest distance.
    from: f64,
    far: f64,
    is_away: bool,
    is_rising: Option<bool>,
    /// Number of reversals since the request began.
    pub reversals: u32,
}

impl Number {
    pub fn new(threshold: f64) -> Self {
        Self {
            threshold,
            value: None,
            near: (0.0, Instant::default()),
            rest: None,
            from: 0.0,
            far: 0.0,
            is_away: false,
            is_rising: None,
            reversals: 0,
        }
    }

    /// The initial state, with the same threshold.
    pub fn anew(&self) -> Self {
        Self::new(self.threshold)
    }

    /// Clears the movement and the reversals at the start of a request.
    pub fn begin(&mut self) {
        self.far = 0.0;
        self.reversals = 0;
    }

    pub fn take(&mut self, now: Instant, value: f64) -> Option<Turn> {
        let before = self.value.replace(value);
        if before.is_none() || (value - self.near.0).abs() > self.threshold / 4.0 {
            self.near = (value, now);
        }
        self.count_reversals(value - before.unwrap_or(value));
        let is_still = now.since(self.near.1) >= STILL;
        let Some(rest) = self.rest else {
            self.rest = is_still.then_some(value);
            return None;
        };
        let distance = value - rest;
        if !self.is_away {
            if distance.abs() < self.threshold {
                return None;
            }
            self.is_away = true;
            (self.from, self.far) = (rest, distance);
            return Some(Turn {
                at: now,
                way: TurnDirection::Away,
            });
        }
        if distance.abs() > self.far.abs() {
            self.far = distance;
        }
        if !is_still {
            return None;
        }
        self.is_away = false;
        self.rest = Some(value);
        Some(Turn {
            at: now,
            way: TurnDirection::Back,
        })
    }

    fn count_reversals(&mut self, step: f64) {
        if step != 0.0 {
            let is_rising = step > 0.0;
            if self.is_rising.replace(is_rising) == Some(!is_rising) {
                self.reversals = self.reversals.saturating_add(1);
            }
        }
    }

    pub fn rests(&self) -> bool {
        self.rest.is_some() && !self.is_away
    }

    /// Start of the last movement, and its farthest point.
    pub fn moved(&self) -> Option<(f64, f64)> {
        (self.far != 0.0).then_some((self.from, self.from + self.far))
    }
}
