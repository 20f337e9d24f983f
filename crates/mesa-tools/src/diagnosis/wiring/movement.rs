//! How a level or a number goes away from where it rests, and comes back.

use core::time::Duration;

use mesa_hal::bus::Instant;

/// A level counts when it has been the same for so long: longer than a contact bounces, shorter than
/// a hand actuates.
const SETTLED: Duration = Duration::from_millis(20);
/// A level that does not settle for so long chatters.
const CHATTER: Duration = Duration::from_millis(500);
/// A number that has not moved for so long is still.
const STILL: Duration = Duration::from_millis(400);

/// A level or a number turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Turn {
    /// When it began to.
    pub at: Instant,
    pub way: Way,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    /// From where it rests.
    Away,
    /// To where it rests, or where it rests from now on.
    Back,
    /// Away and back at once.
    Spike,
}

/// A level.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Level {
    /// As it was read last, and since when.
    pub value: Option<bool>,
    since: Instant,
    /// When it left its settled level first.
    edge: Option<Instant>,
    settled: Option<bool>,
    rest: Option<bool>,
    /// It was lost, and has not been seen since where it rested before.
    is_held: bool,
}

impl Level {
    /// It rests where it is, unless it was lost and may be held.
    pub fn begin(&mut self) {
        if !self.is_held {
            self.rest = self.settled;
        }
    }

    /// The same one, of which only is known where it rested.
    pub fn anew(&self) -> Self {
        Self {
            rest: self.rest,
            is_held: self.rest.is_some(),
            ..Self::default()
        }
    }

    /// Whether it was lost, and is not where it rested before.
    pub fn is_held(&self) -> bool {
        self.is_held && self.settled != self.rest
    }

    /// It rests where it is: nobody holds it.
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
            Way::Spike
        } else if *self.rest.get_or_insert(before) == value {
            Way::Back
        } else {
            Way::Away
        };
        Some(Turn { at, way })
    }

    pub fn rests(&self) -> bool {
        self.settled.is_some() && self.edge.is_none()
    }

    pub fn chatters(&self, now: Instant) -> bool {
        self.edge.is_some_and(|edge| now.since(edge) > CHATTER)
    }

    /// Where it rests, and where it is when it does not.
    pub fn moved(&self) -> Option<(bool, bool)> {
        self.rest.map(|rest| (rest, !rest))
    }
}

/// A number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Number {
    /// How far is a movement.
    threshold: f64,
    /// As it was read last.
    pub value: Option<f64>,
    /// What it is near to, and since when.
    near: (f64, Instant),
    rest: Option<f64>,
    /// Where its last movement began, and how far it went at most.
    from: f64,
    far: f64,
    is_away: bool,
    is_rising: Option<bool>,
    /// How often it turned round since the ask began.
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

    /// The same one, of which nothing is known.
    pub fn anew(&self) -> Self {
        Self::new(self.threshold)
    }

    /// Nothing has moved yet.
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
                way: Way::Away,
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
            way: Way::Back,
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

    /// Where its last movement began, and the farthest that it came.
    pub fn moved(&self) -> Option<(f64, f64)> {
        (self.far != 0.0).then_some((self.from, self.from + self.far))
    }
}
