//! Whether each wire is at its terminal: somebody actuates one input after the other, and what changes
//! tells.
//!
//! A [`Check`] is fed with what the inputs show in each cycle, and knows no clock and no board:
//!
//! ```
//! use mesa_hal::bus::Instant;
//! use mesa_tools::diagnosis::wiring::{Check, Verdict, points};
//! use mesa_hal::hal::{AnyValue, PinMaker, PinStore, Place};
//!
//! # fn main() -> Result<(), mesa_hal::hal::PinError> {
//! let mut store = PinStore::default();
//! let group = store.add_group();
//! let place = Place { terminal: "TB8 pin 3".into(), signal: "INPUT2".into() };
//! PinMaker::new(&mut store, group, "card.").at(place).input::<bool>("input-02")?;
//! let mut check = Check::new(points(&store, &[group], |_| true));
//! let mut found = None;
//! for ms in (0..4000).step_by(5) {
//!     if ms == 1500 {
//!         check.ask(0); // hands off until here
//!     }
//!     let is_pressed = (2000..2500).contains(&ms);
//!     let now = Instant::from_nanos(ms * 1_000_000);
//!     found = found.or(check.observe(now, |_| Some(AnyValue::from(is_pressed))));
//! }
//! assert_eq!(found.map(|found| found.verdict), Some(Verdict::Ok));
//! # Ok(())
//! # }
//! ```

mod index;
mod movement;
mod points;
#[cfg(test)]
mod tests;
mod track;

use core::time::Duration;
use std::collections::{BTreeSet, VecDeque};

use self::index::Latch;
use self::track::Track;
use mesa_hal::bus::Instant;
use mesa_hal::hal::{AnyValue, PinId};

pub use points::{Kind, Point, outputs, points};

/// How long nobody should touch anything before the first ask: what changes meanwhile changes by
/// itself.
pub const HANDS_OFF: Duration = Duration::from_millis(1500);

/// Another one that changes is told so much later, if the one that was asked for has not changed.
const INSTEAD: Duration = Duration::from_millis(300);
/// Levels that change together differ by no more.
const TOGETHER: Duration = Duration::from_millis(30);
/// It has to rest for so long afterwards: others may be late, and what chatters goes on.
const GRACE: Duration = Duration::from_millis(200);
/// The one before may still be let go.
const LET_GO: Duration = Duration::from_secs(2);

/// What became of an input that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Verdict {
    /// It changed, and came back; no other did so with it. An index was latched while its encoder moved.
    Ok,
    /// It counted down, though it was turned in its positive direction: A and B are exchanged, or its
    /// scale has to be negative. A drive that is enabled so runs away.
    CountsDown,
    /// It did not change; an index did not come, whether its encoder was turned or not.
    NoChange,
    /// It did not change, but others did.
    OtherChanged,
    /// Others changed with it: they are connected, or actuated by the same thing.
    Together,
    /// It changed, and did not come back; or it counts and does not rest.
    NotBack,
    /// It changes by itself, or counts up and down and gets nowhere; an index came while its encoder
    /// stood.
    Unstable,
    /// It was skipped.
    Skipped,
    /// What it shows is not valid.
    NotValid,
}

/// What became of an input that was asked for, and what else was seen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Judgement {
    /// What became of it.
    pub verdict: Verdict,
    /// Others that changed while it was asked for: their numbers.
    pub others: Vec<usize>,
    /// Where it rested, and the farthest from there that it was: for a counter, which way it counts. For
    /// an index, where its encoder was when its latch was armed, and where it was when this ended.
    pub moved: Option<(AnyValue, AnyValue)>,
}

/// What is to be said while an input is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// It rests, and can be actuated.
    Ready(AnyValue),
    /// What it shows is not valid.
    NotValid,
    /// It was not valid for a while, and is not where it rested before: it has to be let go first.
    Held(AnyValue),
    /// It has changed, and can be let go.
    Changed(AnyValue),
    /// Another one changed instead.
    Instead(usize),
    /// This one changes by itself, and does not count until it is quiet.
    Restless(usize),
    /// It counts up and down, and gets nowhere: one of A and B does not arrive.
    Dithers,
    /// The encoder was turned from here to there, and its index has not come.
    NoIndex(AnyValue, AnyValue),
}

/// A guided check of the wiring of inputs.
///
/// # Real time
/// Not for the cycle: it allocates. In proportion to the number of inputs.
#[derive(Debug)]
pub struct Check {
    points: Vec<Point>,
    tracks: Vec<Track>,
    now: Instant,
    ask: Option<Ask>,
    /// The one that was asked for last, if it has changed: it may still be let go.
    last: Option<usize>,
    /// Those of which was told that they change by themselves.
    restless: BTreeSet<usize>,
    news: VecDeque<News>,
    /// Each `index-enable` that is to be set, and its value.
    requests: VecDeque<(PinId, bool)>,
}

#[derive(Debug)]
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
struct Ask {
    point: usize,
    /// Since when it could be actuated.
    ready: Option<Instant>,
    /// Was told.
    is_invalid: bool,
    /// Was told.
    is_held: bool,
    has_changed: bool,
    dithers: bool,
    others: Vec<usize>,
    latch: Latch,
}

impl Check {
    /// Of these inputs; a number is that of one of them.
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

    /// Asks for an input, from now on. The latch of an index has to be armed for it: see
    /// [`index_enable`](Self::index_enable).
    pub fn ask(&mut self, point: usize) {
        self.news.clear();
        // It is told of this one again.
        self.restless.remove(&point);
        self.ask = Some(Ask {
            point,
            ready: None,
            is_invalid: false,
            is_held: false,
            has_changed: false,
            dithers: false,
            others: Vec::new(),
            latch: Latch::default(),
        });
    }

    /// What is to be said next.
    pub fn news(&mut self) -> Option<News> {
        self.news.pop_front()
    }

    /// Takes what the inputs showed in a cycle, `None` for what is not valid, and gives the judgement
    /// on the one that is asked for as soon as there is one. Call it at least ten times a second.
    pub fn observe(
        &mut self,
        now: Instant,
        read: impl Fn(PinId) -> Option<AnyValue>,
    ) -> Option<Judgement> {
        self.now = now;
        let is_quiet = self.ask.is_none();
        for (point, track) in self.points.iter().zip(&mut self.tracks) {
            track.take(now, read(point.pin), is_quiet);
        }
        let mut ask = self.ask.take()?;
        self.tell_restless();
        let judgement = self.follow(&mut ask);
        match &judgement {
            Some(found) => self.last = (found.verdict == Verdict::Ok).then_some(ask.point),
            None => self.ask = Some(ask),
        }
        judgement
    }

    /// What an input shows.
    pub fn value(&self, point: usize) -> Option<AnyValue> {
        self.tracks.get(point)?.value()
    }

    /// Ends the ask: the judgement as far as it is known. `is_skipped`: a person has given up, and no
    /// timeout. If it is asked for again, it rests where it is then.
    pub fn give_up(&mut self, is_skipped: bool) -> Option<Judgement> {
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
            Verdict::NotValid
        } else if track.is_restless(self.now) {
            Verdict::Unstable
        } else if ask.has_changed {
            if let Some(found) = self.judge(&ask) {
                return Some(found);
            }
            moved = track.moved();
            Verdict::NotBack
        } else if !ask.others.is_empty() {
            Verdict::OtherChanged
        } else if ask.dithers {
            Verdict::Unstable
        } else if is_skipped {
            Verdict::Skipped
        } else {
            Verdict::NoChange
        };
        Some(Judgement {
            verdict,
            moved,
            others: ask.others,
        })
    }

    /// The ones that change by themselves.
    pub fn restless(&self) -> impl Iterator<Item = usize> + '_ {
        let tracks = self.tracks.iter().enumerate();
        tracks.filter_map(|(n, track)| track.is_restless(self.now).then_some(n))
    }

    /// Those that change by themselves are told once, as long as they do.
    fn tell_restless(&mut self) {
        let restless: BTreeSet<usize> = self.restless().collect();
        let fresh = restless.difference(&self.restless);
        self.news.extend(fresh.copied().map(News::Restless));
        self.restless = restless;
    }

    /// Follows the one that is asked for.
    fn follow(&mut self, ask: &mut Ask) -> Option<Judgement> {
        let now = self.now;
        let track = self.tracks.get(ask.point)?;
        let is_lost = !track.is_valid(now) || track.is_restless(now);
        if is_lost {
            if !track.is_valid(now) && !ask.is_invalid {
                self.news.push_back(News::NotValid);
            }
            ask.is_invalid = !track.is_valid(now);
            (ask.ready, ask.has_changed, ask.is_held) = (None, false, false);
            ask.latch = Latch::default();
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
                    .extend(track.value().filter(|_| !told).map(News::Held));
            } else if track.rests(now) {
                ask.ready = Some(now);
                self.news.extend(track.value().map(News::Ready));
                self.tracks.iter_mut().for_each(Track::begin);
            }
            return None;
        };
        if track.left.is_some() && !ask.has_changed {
            ask.has_changed = true;
            self.news.extend(track.value().map(News::Changed));
        }
        if track.dithers() && !ask.dithers {
            ask.dithers = true;
            self.news.push_back(News::Dithers);
        }
        if track.back.is_none() || !track.rests(now) || track.since_turn(now) < GRACE {
            self.look_elsewhere(ask, ready);
            return None;
        }
        self.judge(ask)
    }

    /// Whether it was actuated, when it is back.
    fn judge(&self, ask: &Ask) -> Option<Judgement> {
        let track = self.tracks.get(ask.point)?;
        let (left, back) = track.left.zip(track.back)?;
        let with_it = self.of_its_kind(ask.point).filter(|(_, other)| {
            let Some(other_left) = other.left else {
                return false;
            };
            match self.points.get(ask.point).map(|point| point.kind) {
                Some(Kind::Digital) => {
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
        let is_counter = self.points.get(ask.point)?.kind == Kind::Counter;
        let is_down = moved.is_some_and(|(from, to)| to.as_f64() < from.as_f64());
        let (verdict, others) = if !with_it.is_empty() {
            (Verdict::Together, with_it)
        } else if is_counter && is_down {
            (Verdict::CountsDown, ask.others.clone())
        } else {
            (Verdict::Ok, ask.others.clone())
        };
        Some(Judgement {
            verdict,
            others,
            moved,
        })
    }

    /// Whether another one changed instead.
    fn look_elsewhere(&mut self, ask: &mut Ask, ready: Instant) {
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
        self.news.extend(instead.iter().copied().map(News::Instead));
        ask.others.extend(instead);
    }

    /// The others of its kind that do not change by themselves. What else changes has other reasons:
    /// an axis that is pushed onto its limit switch counts.
    fn of_its_kind(&self, point: usize) -> impl Iterator<Item = (usize, &Track)> {
        let kind = self.points.get(point).map(|point| point.kind);
        let all = self.points.iter().zip(&self.tracks).enumerate();
        all.filter_map(move |(n, (other, track))| {
            let is_it = n != point && Some(other.kind) == kind && !track.is_restless(self.now);
            is_it.then_some((n, track))
        })
    }
}

/// Pairs that are exchanged: each changed when the other one was asked for. `judged` has what became
/// of each input, by its number.
pub fn exchanged<'a>(
    judged: impl Fn(usize) -> Option<&'a Judgement>,
    count: usize,
) -> Vec<(usize, usize)> {
    let changed_for = |asked: usize, other: usize| {
        let found = judged(asked).filter(|found| found.verdict == Verdict::OtherChanged);
        found.is_some_and(|found| found.others.contains(&other))
    };
    let pairs = (0..count).flat_map(|one| (one + 1..count).map(move |two| (one, two)));
    let are_exchanged =
        |&(one, two): &(usize, usize)| changed_for(one, two) && changed_for(two, one);
    pairs.filter(are_exchanged).collect()
}
