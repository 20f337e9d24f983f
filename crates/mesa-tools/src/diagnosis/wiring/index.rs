//! Check of an encoder's index by its latch: the level of the line shows a pulse of a few counts
//! only by chance.

use core::time::Duration;

use super::request::InputRequest;
use super::{PointKind, Track, WiringCheck, WiringJudgement, WiringMessage, WiringVerdict};
use mesa_hal::bus::Instant;
use mesa_hal::hal::{AnyValue, PinId};

/// Interval after which an arming request is repeated, if no cycle has taken it.
const AGAIN: Duration = Duration::from_millis(500);
/// Counts that make a movement: an encoder that stands on an edge shows one count to and fro.
const STANDS: f64 = 2.0;

impl WiringCheck {
    /// Returns the next `index-enable` to set, and its value: on to arm the latch of an index, and
    /// off when a request has ended without the index. Each setting is returned once; the caller
    /// writes it in its next cycle, and calls this again after each [`observe`](Self::observe) and
    /// [`give_up`](Self::give_up).
    pub fn index_enable(&mut self) -> Option<(PinId, bool)> {
        self.requests.pop_front()
    }

    pub(super) fn is_index(&self, point: usize) -> bool {
        let point = self.points.get(point);
        point.is_some_and(|point| point.kind == PointKind::Index)
    }

    /// Follows an index whose latch is valid: the latch is armed, and turns off when the index
    /// arrives.
    pub(super) fn follow_index(&mut self, ask: &mut InputRequest) -> Option<WiringJudgement> {
        let armed = self.value(ask.point)?;
        let is_armed = armed.as_f64() != 0.0;
        match (ask.ready, is_armed) {
            (None, false) => self.request(ask),
            (None, true) => {
                ask.ready = Some(self.now);
                ask.latch.from = self.encoder_value(ask.point);
                self.tracks.iter_mut().for_each(Track::begin);
                self.news.push_back(WiringMessage::Ready(armed));
            }
            (Some(_), true) => self.follow_encoder(ask),
            (Some(_), false) => {
                let moved = self.encoder_moved(ask);
                let has_encoder = ask.latch.from.is_some();
                let verdict = if has_encoder && moved.is_none() {
                    WiringVerdict::Unstable
                } else {
                    WiringVerdict::Ok
                };
                return Some(WiringJudgement {
                    verdict,
                    others: Vec::new(),
                    moved,
                });
            }
        }
        None
    }

    /// Ends the request for an index that has not arrived.
    pub(super) fn give_up_index(
        &mut self,
        ask: &InputRequest,
        is_skipped: bool,
    ) -> Option<WiringJudgement> {
        let pin = self.points.get(ask.point)?.pin;
        self.requests.push_back((pin, false));
        let moved = self.encoder_moved(ask);
        let verdict = if !self.tracks.get(ask.point)?.is_valid(self.now) {
            WiringVerdict::NotValid
        } else if is_skipped && moved.is_none() {
            WiringVerdict::Skipped
        } else {
            WiringVerdict::NoChange
        };
        Some(WiringJudgement {
            verdict,
            others: Vec::new(),
            moved,
        })
    }

    fn request(&mut self, ask: &mut InputRequest) {
        let is_due = |at: Instant| self.now.since(at) >= AGAIN;
        let pin = self.points.get(ask.point).map(|point| point.pin);
        if let Some(pin) = pin
            && ask.latch.requested.is_none_or(is_due)
        {
            ask.latch.requested = Some(self.now);
            self.requests.push_back((pin, true));
        }
    }

    /// Reports the encoder's movement, and its coming to rest without the index.
    fn follow_encoder(&mut self, ask: &mut InputRequest) {
        let Some(encoder) = self.encoder_of(ask.point) else {
            return;
        };
        let now = self.now;
        let Some(track) = self.tracks.get_mut(encoder) else {
            return;
        };
        if track.left.is_some() && !ask.has_changed {
            ask.has_changed = true;
            self.news.extend(track.value().map(WiringMessage::Changed));
        }
        if track.back.is_some() && track.rests(now) {
            track.begin();
            ask.has_changed = false;
            let to = track.value();
            let path = ask.latch.from.zip(to);
            self.news
                .extend(path.map(|(from, to)| WiringMessage::NoIndex(from, to)));
        }
    }

    /// The counter of an index's encoder.
    fn encoder_of(&self, index: usize) -> Option<usize> {
        let index = self.points.get(index)?;
        let mut points = self.points.iter();
        points.position(|point| point.counts_for(index))
    }

    fn encoder_value(&self, index: usize) -> Option<AnyValue> {
        self.value(self.encoder_of(index)?)
    }

    /// Position of the encoder when the latch was armed and now, if it has moved.
    fn encoder_moved(&self, ask: &InputRequest) -> Option<(AnyValue, AnyValue)> {
        let to = self.encoder_value(ask.point)?;
        let from = ask.latch.from?;
        ((to.as_f64() - from.as_f64()).abs() >= STANDS).then_some((from, to))
    }
}
