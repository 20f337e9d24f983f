//! Writes that are made when somebody asks for them, until they have arrived.

use alloc::{boxed::Box, vec};
use core::ops::Range;

use crate::bus::Access;

/// Which accesses of a list of writes are to be made next.
#[derive(Debug)]
pub(super) struct Requests {
    /// Those of every cycle, and one for each register that is written when it is asked for.
    accesses: Box<[Access]>,
    /// Those of every cycle, and those that are asked for.
    wanted: Box<[bool]>,
    states: Box<[State]>,
    /// How many are asked for, and how many were sent and are not confirmed.
    asked: usize,
    sent: usize,
}

/// After so many reads no older write is under way any more.
const HORIZON: u8 = 100;

/// What becomes of one access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// It is made in every cycle.
    Always,
    /// Nobody asks for it.
    Rests,
    Asked,
    /// It was sent. It may have been lost, or be undone by an older one that comes late, for so many
    /// reads more.
    Sent(u8),
}

impl Requests {
    /// Nothing is asked for. `is_extended` says which accesses are not those of every cycle.
    pub fn new(accesses: Box<[Access]>, is_extended: Box<[bool]>) -> Self {
        let mut states = vec![State::Always; accesses.len()].into_boxed_slice();
        let mut wanted = is_extended;
        for (state, wanted) in states.iter_mut().zip(&mut wanted) {
            if *wanted {
                *state = State::Rests;
            }
            *wanted = !*wanted;
        }
        Self {
            accesses,
            wanted,
            states,
            asked: 0,
            sent: 0,
        }
    }

    /// Whether only the writes of every cycle are to be made.
    pub fn is_empty(&self) -> bool {
        self.asked == 0
    }

    /// Asks for the registers whose words are in `range`.
    pub fn add(&mut self, range: Range<usize>) {
        for (n, access) in self.accesses.iter().enumerate() {
            if !range.contains(&usize::from(access.first)) {
                continue;
            }
            let (Some(state), Some(wanted)) = (self.states.get_mut(n), self.wanted.get_mut(n))
            else {
                continue;
            };
            match *state {
                State::Always | State::Asked => continue,
                State::Rests => {}
                State::Sent(_) => self.sent -= 1,
            }
            (*state, *wanted) = (State::Asked, true);
            self.asked += 1;
        }
    }

    /// The list, and which of its accesses are to be made.
    pub fn list(&self) -> (&[Access], &[bool]) {
        (&self.accesses, &self.wanted)
    }

    /// The writes were made, as far as the bus can tell.
    pub fn sent(&mut self) {
        for (state, wanted) in self.states.iter_mut().zip(&mut self.wanted) {
            if *state == State::Asked {
                (*state, *wanted) = (State::Sent(HORIZON), false);
            }
        }
        self.sent += core::mem::take(&mut self.asked);
    }

    /// Nothing is asked for any more.
    pub fn clear(&mut self) {
        if self.asked + self.sent == 0 {
            return;
        }
        for (state, wanted) in self.states.iter_mut().zip(&mut self.wanted) {
            if *state != State::Always {
                (*state, *wanted) = (State::Rests, false);
            }
        }
        (self.asked, self.sent) = (0, 0);
    }

    /// The board was heard: whether the newest write, and nothing older after it, has arrived.
    pub fn confirm(&mut self, is_certain: bool) {
        if self.sent == 0 {
            return;
        }
        for (state, wanted) in self.states.iter_mut().zip(&mut self.wanted) {
            let State::Sent(left) = state else {
                continue;
            };
            if !is_certain {
                (*state, *wanted) = (State::Asked, true);
                self.asked += 1;
            } else if *left > 0 {
                *left -= 1;
                continue;
            } else {
                *state = State::Rests;
            }
            self.sent -= 1;
        }
    }
}
