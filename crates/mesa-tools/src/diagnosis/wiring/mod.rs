//! Guided check of wiring: an operator actuates one input after the other, and the changes show
//! whether each wire is at its terminal.
//!
//! A [`WiringCheck`] takes the values of the inputs in each cycle; it has no clock and no board of
//! its own:
//!
//! ```
//! use mesa_hal::bus::Instant;
//! use mesa_tools::diagnosis::wiring::{WiringCheck, WiringVerdict, points};
//! use mesa_hal::hal::{AnyValue, PinMaker, PinStore, Place};
//!
//! # fn main() -> Result<(), mesa_hal::hal::PinError> {
//! let mut store = PinStore::default();
//! let group = store.add_group();
//! let place = Place { terminal: "TB8 pin 3".into(), signal: "INPUT2".into() };
//! PinMaker::new(&mut store, group, "card.").at(place).input::<bool>("input-02")?;
//! let mut check = WiringCheck::new(points(&store, &[group], |_| true));
//! let mut found = None;
//! for ms in (0..4000).step_by(5) {
//!     if ms == 1500 {
//!         check.ask(0); // hands off until here
//!     }
//!     let is_pressed = (2000..2500).contains(&ms);
//!     let now = Instant::from_nanos(ms * 1_000_000);
//!     found = found.or(check.observe(now, |_| Some(AnyValue::from(is_pressed))));
//! }
//! assert_eq!(found.map(|found| found.verdict), Some(WiringVerdict::Ok));
//! # Ok(())
//! # }
//! ```

mod index;
mod movement;
mod points;
mod request;
#[cfg(test)]
mod tests;
mod track;

use core::time::Duration;
use std::collections::{BTreeSet, VecDeque};

use self::request::{IndexLatch, InputRequest};
use self::track::Track;
use mesa_hal::bus::Instant;
use mesa_hal::hal::{AnyValue, PinId};

pub use points::{Point, PointKind, outputs, points};

/// Time before the first request in which nothing should be touched: an input that changes then
/// changes by itself.
pub const HANDS_OFF: Duration = Duration::from_millis(1500);

/// Delay before a change of another input is reported, if the requested one has not changed.
const INSTEAD: Duration = Duration::from_millis(300);
/// Largest time difference of levels that change together.
const TOGETHER: Duration = Duration::from_millis(30);
/// Rest required after a return: related changes of other inputs may be late, and a chattering
/// contact goes on.
const GRACE: Duration = Duration::from_millis(200);
/// Time in which the previously requested input may still be released.
const LET_GO: Duration = Duration::from_secs(2);

/// Verdict on a requested input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum WiringVerdict {
    /// The input changed and came back, and no other did so with it. An index was latched while its
    /// encoder moved.
    Ok,
    /// The counter counted down when turned in its positive direction: A and B are exchanged, or
    /// its scale must be negative. An enabled drive with such an encoder runs away.
    CountsDown,
    /// The input did not change. An index did not arrive, whether or not its encoder was turned.
    NoChange,
    /// Other inputs changed, but not the requested one.
    OtherChanged,
    /// Other inputs changed with the requested one: they are connected, or actuated by the same
    /// thing.
    Together,
    /// The input changed and did not come back, or it counts and does not come to rest.
    NotBack,
    /// The input changes by itself, or counts up and down without getting anywhere. An index
    /// arrived while its encoder stood.
    Unstable,
    /// The operator skipped the input.
    Skipped,
    /// The value of the input is not valid.
    NotValid,
}

/// Result for a requested input, with other observations.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WiringJudgement {
    /// Verdict on the input.
    pub verdict: WiringVerdict,
    /// Numbers of the other inputs that changed during the request.
    pub others: Vec<usize>,
    /// The rest, and the farthest value from it, which shows the direction of a counter. For an
    /// index, the position of its encoder when the latch was armed, and at the end of the request.
    pub moved: Option<(AnyValue, AnyValue)>,
}

/// Message about the requested input, for the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WiringMessage {
    /// The input rests and can be actuated; its value.
    Ready(AnyValue),
    /// The value of the input is not valid.
    NotValid,
    /// The input was invalid for some time and is not at its earlier rest: it has to be released
    /// first.
    Held(AnyValue),
    /// The input has changed and can be released.
    Changed(AnyValue),
    /// Another input changed instead; its number.
    Instead(usize),
    /// The input with this number changes by itself, and is ignored until it is quiet.
    Restless(usize),
    /// The counter counts up and down without getting anywhere: one of A and B does not arrive.
    Dithers,
    /// The encoder was turned from the first position to the second, and its index has not arrived.
    NoIndex(AnyValue, AnyValue),
}

/// A guided check of the wiring of inputs.
///
/// # Real time
/// Not for the cycle: it allocates. In proportion to the number of inputs.
#[derive(Debug)]
pub struct WiringCheck {
    points: Vec<Point>,
    tracks: Vec<Track>,
    now: Instant,
    ask: Option<InputRequest>,
    /// The previously requested input, if it has changed: it may still be released.
    last: Option<usize>,
    /// Inputs already reported as changing by themselves.
    restless: BTreeSet<usize>,
    news: VecDeque<WiringMessage>,
    /// Pending `index-enable` settings: pin and value.
    requests: VecDeque<(PinId, bool)>,
}

impl WiringCheck {
    /// Creates a check of these inputs. The number of an input is its index in `points`.
    pub fn new(points: Vec<Point>) -> Self {
        Self {
            tracks: points.iter().map(Track::new).collect(),
            points,
            now: Instant::default(),
            ask: None,
            last: None,
            restless: BTreeSet::new(),
            news: VecDeque::new(),
            requests: VecDeque::new(),
        }
    }

    /// The inputs.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Requests an input, from now on. For an index its latch has to be armed: see
    /// [`index_enable`](Self::index_enable).
    pub fn ask(&mut self, point: usize) {
        self.news.clear();
        // If this input changes by itself, that is reported again.
        self.restless.remove(&point);
        self.ask = Some(InputRequest {
            point,
            ready: None,
            is_invalid: false,
            is_held: false,
            has_changed: false,
            dithers: false,
            others: Vec::new(),
            latch: IndexLatch::default(),
        });
    }

    /// Removes and returns the next message.
    pub fn news(&mut self) -> Option<WiringMessage> {
        self.news.pop_front()
    }

    /// Takes the values of the inputs in a cycle, `None` for an invalid one. Returns the result for
    /// the requested input as soon as it is known. Call it at least ten times a second.
    pub fn observe(
        &mut self,
        now: Instant,
        read: impl Fn(PinId) -> Option<AnyValue>,
    ) -> Option<WiringJudgement> {
        self.now = now;
        let is_quiet = self.ask.is_none();
        for (point, track) in self.points.iter().zip(&mut self.tracks) {
            track.take(now, read(point.pin), is_quiet);
        }
        let mut ask = self.ask.take()?;
        self.tell_restless();
        let judgement = self.follow(&mut ask);
        match &judgement {
            Some(found) => self.last = (found.verdict == WiringVerdict::Ok).then_some(ask.point),
            None => self.ask = Some(ask),
        }
        judgement
    }

    /// Last value of an input.
    pub fn value(&self, point: usize) -> Option<AnyValue> {
        self.tracks.get(point)?.value()
    }

    /// Ends the request and returns the result as far as it is known. `is_skipped`: the operator
    /// gave up, as opposed to a timeout. If the input is requested again, its level at that time is
    /// its rest.
    pub fn give_up(&mut self, is_skipped: bool) -> Option<WiringJudgement> {
        let ask = self.ask.take()?;
        if self.is_index(ask.point) {
            self.last = None;
            return self.give_up_index(&ask, is_skipped);
        }
        self.tracks.get_mut(ask.point).map(Track::let_go);
        self.last = ask.has_changed.then_some(ask.point);
        let track = self.tracks.get(ask.point)?;
        let mut moved = None;
        let verdict = if !track.is_valid(self.now) {
            WiringVerdict::NotValid
        } else if track.is_restless(self.now) {
            WiringVerdict::Unstable
        } else if ask.has_changed {
            if let Some(found) = self.judge(&ask) {
                return Some(found);
            }
            moved = track.moved();
            WiringVerdict::NotBack
        } else if !ask.others.is_empty() {
            WiringVerdict::OtherChanged
        } else if ask.dithers {
            WiringVerdict::Unstable
        } else if is_skipped {
            WiringVerdict::Skipped
        } else {
            WiringVerdict::NoChange
        };
        Some(WiringJudgement {
            verdict,
            moved,
            others: ask.others,
        })
    }

    /// Inputs that change by themselves.
    pub fn restless(&self) -> impl Iterator<Item = usize> + '_ {
        let tracks = self.tracks.iter().enumerate();
        tracks.filter_map(|(n, track)| track.is_restless(self.now).then_some(n))
    }

    /// Reports each input that has begun to change by itself, once until it stops.
    fn tell_restless(&mut self) {
        let restless: BTreeSet<usize> = self.restless().collect();
        let fresh = restless.difference(&self.restless);
        self.news
            .extend(fresh.copied().map(WiringMessage::Restless));
        self.restless = restless;
    }

    /// Follows the requested input.
    fn follow(&mut self, ask: &mut InputRequest) -> Option<WiringJudgement> {
        let now = self.now;
        let track = self.tracks.get(ask.point)?;
        let is_lost = !track.is_valid(now) || track.is_restless(now);
        if is_lost {
            if !track.is_valid(now) && !ask.is_invalid {
                self.news.push_back(WiringMessage::NotValid);
            }
            ask.is_invalid = !track.is_valid(now);
            (ask.ready, ask.has_changed, ask.is_held) = (None, false, false);
            ask.latch = IndexLatch::default();
            return None;
        }
        ask.is_invalid = false;
        if self.is_index(ask.point) {
            return self.follow_index(ask);
        }
        let Some(ready) = ask.ready else {
            if track.rests(now) && track.is_held() {
                let told = std::mem::replace(&mut ask.is_held, true);
                self.news
                    .extend(track.value().filter(|_| !told).map(WiringMessage::Held));
            } else if track.rests(now) {
                ask.ready = Some(now);
                self.news.extend(track.value().map(WiringMessage::Ready));
                self.tracks.iter_mut().for_each(Track::begin);
            }
            return None;
        };
        if track.left.is_some() && !ask.has_changed {
            ask.has_changed = true;
            self.news.extend(track.value().map(WiringMessage::Changed));
        }
        if track.dithers() && !ask.dithers {
            ask.dithers = true;
            self.news.push_back(WiringMessage::Dithers);
        }
        if track.back.is_none() || !track.rests(now) || track.since_turn(now) < GRACE {
            self.look_elsewhere(ask, ready);
            return None;
        }
        self.judge(ask)
    }

    /// Returns the result once the input is back.
    fn judge(&self, ask: &InputRequest) -> Option<WiringJudgement> {
        let track = self.tracks.get(ask.point)?;
        let (left, back) = track.left.zip(track.back)?;
        let with_it = self.of_its_kind(ask.point).filter(|(_, other)| {
            let Some(other_left) = other.left else {
                return false;
            };
            match self.points.get(ask.point).map(|point| point.kind) {
                Some(PointKind::Digital) => {
                    let is_near = |one: Instant, two: Instant| {
                        one.since(two) <= TOGETHER && two.since(one) <= TOGETHER
                    };
                    is_near(other_left, left) && other.back.is_some_and(|b| is_near(b, back))
                }
                _ => other_left <= back && other.back.is_none_or(|b| b >= left),
            }
        });
        let with_it: Vec<usize> = with_it.map(|(n, _)| n).collect();
        let moved = track.moved();
        let is_counter = self.points.get(ask.point)?.kind == PointKind::Counter;
        let is_down = moved.is_some_and(|(from, to)| to.as_f64() < from.as_f64());
        let (verdict, others) = if !with_it.is_empty() {
            (WiringVerdict::Together, with_it)
        } else if is_counter && is_down {
            (WiringVerdict::CountsDown, ask.others.clone())
        } else {
            (WiringVerdict::Ok, ask.others.clone())
        };
        Some(WiringJudgement {
            verdict,
            others,
            moved,
        })
    }

    /// Reports other inputs that changed instead.
    fn look_elsewhere(&mut self, ask: &mut InputRequest, ready: Instant) {
        let now = self.now;
        let left = self.tracks.get(ask.point).and_then(|track| track.left);
        let instead = self.of_its_kind(ask.point).filter(|(n, other)| {
            let is_instead = |at: Instant| {
                let is_let_go = self.last == Some(*n) && at.since(ready) < LET_GO;
                let is_alone = left.is_none_or(|left| left.since(at) > INSTEAD);
                !is_let_go && is_alone && now.since(at) >= INSTEAD
            };
            other.left.is_some_and(is_instead) && !ask.others.contains(n)
        });
        let instead: Vec<usize> = instead.map(|(n, _)| n).collect();
        self.news
            .extend(instead.iter().copied().map(WiringMessage::Instead));
        ask.others.extend(instead);
    }

    /// The other inputs of its kind that do not change by themselves. Changes of other kinds have
    /// other reasons: an axis that is pushed onto its limit switch counts.
    fn of_its_kind(&self, point: usize) -> impl Iterator<Item = (usize, &Track)> {
        let kind = self.points.get(point).map(|point| point.kind);
        let all = self.points.iter().zip(&self.tracks).enumerate();
        all.filter_map(move |(n, (other, track))| {
            let is_it = n != point && Some(other.kind) == kind && !track.is_restless(self.now);
            is_it.then_some((n, track))
        })
    }
}

/// Returns the pairs of exchanged inputs: each changed when the other one was requested. `judged`
/// returns the result for an input, by its number.
pub fn exchanged<'a>(
    judged: impl Fn(usize) -> Option<&'a WiringJudgement>,
    count: usize,
) -> Vec<(usize, usize)> {
    let changed_for = |asked: usize, other: usize| {
        let found = judged(asked).filter(|found| found.verdict == WiringVerdict::OtherChanged);
        found.is_some_and(|found| found.others.contains(&other))
    };
    let pairs = (0..count).flat_map(|one| (one + 1..count).map(move |two| (one, two)));
    let are_exchanged =
        |&(one, two): &(usize, usize)| changed_for(one, two) && changed_for(two, one);
    pairs.filter(are_exchanged).collect()
}
