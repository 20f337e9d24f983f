//! Which reply belongs to which request.
//!
//! Every request carries its number into a scratch register of the board, and every reply
//! carries the number back (FACTS 10.1). A reply is taken for the request that waits for it and
//! for no other; what it is otherwise can be said from the recent past.

/// The requests sent lately. The newest is the one that is waited for, if any is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Requests {
    newest: u32,
    /// How many were sent, as far as 32 bits count.
    opened: u32,
    /// A bit for each of the newest 64, the newest lowest: it was answered.
    answered: u64,
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
    /// The number of the next request. Nobody waits for those before any more.
    pub(super) fn open(&mut self) -> u32 {
        self.newest = self.newest.wrapping_add(1);
        self.opened = self.opened.saturating_add(1);
        self.answered <<= 1;
        self.newest
    }

    /// What a reply with this number is. It counts as answered from now on.
    pub(super) fn classify(&mut self, number: u32) -> Match {
        let age = self.newest.wrapping_sub(number);
        if age >= self.opened {
            return Match::Foreign;
        }
        let Some(bit) = 1_u64.checked_shl(age) else {
            return Match::Stale;
        };
        let is_duplicate = self.answered & bit != 0;
        self.answered |= bit;
        match age {
            _ if is_duplicate => Match::Duplicate,
            0 => Match::Current,
            _ => Match::Late,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reply_is_taken_once_and_only_by_its_own_request() {
        let mut requests = Requests {
            newest: u32::MAX - 1,
            ..Requests::default()
        };
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
        let mut requests = Requests::default();
        let first = requests.open();
        let second = requests.open();
        assert_eq!(requests.classify(first), Match::Late);
        assert_eq!(requests.classify(first), Match::Duplicate);
        assert_eq!(requests.classify(second), Match::Current);
    }

    #[test]
    fn a_forgotten_request_is_stale_and_a_number_never_sent_is_foreign() {
        let mut requests = Requests::default();
        let first = requests.open();
        assert_eq!(requests.classify(first.wrapping_add(1)), Match::Foreign);
        for _ in 0..u64::BITS {
            requests.open();
        }
        assert_eq!(requests.classify(first), Match::Stale);
        assert_eq!(requests.classify(0), Match::Foreign);
        assert_eq!(requests.classify(0x8000_0000), Match::Foreign);
    }
}
