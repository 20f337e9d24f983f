//! Assignment of replies to requests.
//!
//! Every request carries its number into a scratch register of the board, and every reply carries
//! the number back (FACTS 10.1). A reply is accepted only for the request that is waiting for it;
//! the recent history classifies all others.

/// The recent requests. A reply is awaited for the newest at most.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Requests {
    newest: u32,
    /// Number of requests sent, up to the limit of 32 bits.
    opened: u32,
    /// One bit for each of the newest 64 requests, the newest lowest: set if answered.
    answered: u64,
}

/// Classification of a reply by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Match {
    /// The awaited reply.
    Current,
    /// The reply to a request that was given up: late, not lost.
    Late,
    /// A reply that arrived before.
    Duplicate,
    /// A reply to a request that is no longer in the history.
    Stale,
    /// A reply to none of our requests.
    Foreign,
}

impl Requests {
    /// Returns the number of the next request. Earlier requests are no longer awaited.
    pub(super) fn open(&mut self) -> u32 {
        self.newest = self.newest.wrapping_add(1);
        self.opened = self.opened.saturating_add(1);
        self.answered <<= 1;
        self.newest
    }

    /// Classifies a reply with this number, and marks its request as answered.
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
    fn reply_is_taken_once_and_only_by_its_own_request() {
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
    fn reply_to_a_given_up_request_is_late_once_and_never_current() {
        let mut requests = Requests::default();
        let first = requests.open();
        let second = requests.open();
        assert_eq!(requests.classify(first), Match::Late);
        assert_eq!(requests.classify(first), Match::Duplicate);
        assert_eq!(requests.classify(second), Match::Current);
    }

    #[test]
    fn forgotten_request_is_stale_and_unsent_number_is_foreign() {
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
