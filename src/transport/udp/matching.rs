//! Which reply belongs to which request.
//!
//! Every request carries its number into a scratch register of the board, and every reply
//! carries the number back (FACTS 10.1). A reply is taken for the request that waits for it and
//! for no other; what it is otherwise can be said from the recent past.

/// How many past requests are remembered.
const REMEMBERED: usize = 64;

/// The requests sent lately, and what became of them.
#[derive(Clone, Debug)]
pub(super) struct Requests {
    newest: u32,
    /// How many were sent, as far as 32 bits count.
    opened: u32,
    outcomes: [Outcome; REMEMBERED],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// Never sent, or too long ago.
    Unknown,
    /// Sent, and waited for.
    Waiting,
    /// A reply was taken.
    Answered,
    /// Nobody waits for it any more.
    GivenUp,
}

/// What a reply with some number is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Match {
    /// The reply that is waited for.
    Current,
    /// The reply to a request that was given up: it was not lost, but late.
    Late,
    /// A reply that came before.
    Duplicate,
    /// A reply to a request so long ago that it is forgotten.
    Stale,
    /// A reply to no request of ours.
    Foreign,
}

impl Requests {
    /// No request yet; the first will have the number after `newest`.
    pub(super) fn starting_after(newest: u32) -> Self {
        Self {
            newest,
            opened: 0,
            outcomes: [Outcome::Unknown; REMEMBERED],
        }
    }

    /// The number of the next request, which is waited for from now on.
    pub(super) fn open(&mut self) -> u32 {
        self.give_up();
        self.newest = self.newest.wrapping_add(1);
        self.opened = self.opened.saturating_add(1);
        self.set(self.newest, Outcome::Waiting);
        self.newest
    }

    /// Nobody waits for the newest request any more.
    pub(super) fn give_up(&mut self) {
        if self.outcome(self.newest) == Outcome::Waiting {
            self.set(self.newest, Outcome::GivenUp);
        }
    }

    /// What a reply with this number is. Taking the current one ends the wait for it.
    pub(super) fn classify(&mut self, number: u32) -> Match {
        match self.outcome(number) {
            Outcome::Waiting => {
                self.set(number, Outcome::Answered);
                Match::Current
            }
            Outcome::GivenUp => {
                self.set(number, Outcome::Answered);
                Match::Late
            }
            Outcome::Answered => Match::Duplicate,
            Outcome::Unknown if self.newest.wrapping_sub(number) < self.opened => Match::Stale,
            Outcome::Unknown => Match::Foreign,
        }
    }

    fn outcome(&self, number: u32) -> Outcome {
        if self.newest.wrapping_sub(number) as usize >= REMEMBERED {
            return Outcome::Unknown;
        }
        self.outcomes
            .get(number as usize % REMEMBERED)
            .copied()
            .unwrap_or(Outcome::Unknown)
    }

    fn set(&mut self, number: u32, outcome: Outcome) {
        if let Some(slot) = self.outcomes.get_mut(number as usize % REMEMBERED) {
            *slot = outcome;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reply_is_taken_once_and_only_by_its_own_request() {
        let mut requests = Requests::starting_after(u32::MAX - 1);
        let first = requests.open();
        assert_eq!(requests.classify(first), Match::Current);
        assert_eq!(requests.classify(first), Match::Duplicate);
        let second = requests.open();
        assert_eq!((first, second), (u32::MAX, 0));
        assert_eq!(requests.classify(first), Match::Duplicate);
        assert_eq!(requests.classify(second), Match::Current);
    }

    #[test]
    fn the_reply_to_a_given_up_request_is_late_once_and_never_current() {
        let mut requests = Requests::starting_after(7);
        let first = requests.open();
        requests.give_up();
        let second = requests.open();
        assert_eq!(requests.classify(first), Match::Late);
        assert_eq!(requests.classify(first), Match::Duplicate);
        assert_eq!(requests.classify(second), Match::Current);
    }

    #[test]
    fn a_forgotten_request_is_stale_and_a_number_never_sent_is_foreign() {
        let mut requests = Requests::starting_after(0);
        let first = requests.open();
        assert_eq!(requests.classify(first.wrapping_add(1)), Match::Foreign);
        for _ in 0..REMEMBERED {
            requests.open();
        }
        assert_eq!(requests.classify(first), Match::Stale);
        assert_eq!(requests.classify(0), Match::Foreign);
        assert_eq!(requests.classify(0x8000_0000), Match::Foreign);
    }
}
