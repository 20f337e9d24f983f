//! Haste after a signal: how long a command still waits for a board that does not answer.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use mesa_hal::bus::Instant;
use mesa_hal::runner::{Signal, Stop};

/// Time of missing replies after a signal that a command allows for its orderly end. Its outputs go
/// off without it as well: nothing feeds the board's watchdog while no reply comes.
const PATIENCE: Duration = Duration::from_millis(500);

/// Longest wait for a reply when that time is over. A board answers in less.
const HASTE: Duration = Duration::from_millis(2);

/// Time in which the command still tries with such short waits, so that it can switch off outputs
/// at a board that loses many packets. After it nothing is waited for.
const LAST_TRIES: Duration = Duration::from_millis(400);

/// Longest wait for a signal to be noticed.
const NOTICE: Duration = Duration::from_millis(100);

/// The signals that end a command, and what the command has done about them. Clones share it.
#[derive(Clone, Debug)]
pub struct Hurry {
    stop: Stop,
    state: Arc<State>,
}

#[derive(Debug, Default)]
struct State {
    /// The command changes something now, which it finishes.
    finishes: AtomicBool,
    /// Waits were cut short.
    has_given_up: AtomicBool,
}

/// The patience of one link.
#[derive(Clone, Copy, Debug, Default)]
pub struct Patience {
    /// Time waited in vain since a signal came.
    silence: Duration,
    /// End of the patience.
    given_up: Option<Instant>,
}

impl Hurry {
    pub fn new(stop: Stop) -> Self {
        Self {
            stop,
            state: Arc::default(),
        }
    }

    /// From now on a signal shortens no wait: the command writes memory, or restarts a board, and
    /// half of that would be worse than a late end.
    pub fn finish_first(&self) {
        self.state.finishes.store(true, Ordering::Relaxed);
    }

    /// The signal after which waits for replies were cut short, so that an error about missing
    /// replies says nothing about the board.
    pub fn gave_up(&self) -> Option<Signal> {
        let has_given_up = self.state.has_given_up.load(Ordering::Relaxed);
        self.stop.signal().filter(|_| has_given_up)
    }

    /// Notes a wait in vain, and returns true if its link has no patience left.
    pub fn waited(&self, patience: &mut Patience, begun: Instant, now: Instant) -> bool {
        let finishes = self.state.finishes.load(Ordering::Relaxed);
        let is_over = patience.waited(self.stop.signal().is_some() && !finishes, begun, now);
        if is_over {
            self.state.has_given_up.store(true, Ordering::Relaxed);
        }
        is_over
    }
}

impl Patience {
    /// End of the next part of a wait until `deadline`.
    pub fn until(&self, now: Instant, deadline: Instant) -> Instant {
        let longest = match self.given_up {
            None => NOTICE,
            Some(since) if now.since(since) < LAST_TRIES => HASTE,
            Some(_) => Duration::ZERO,
        };
        deadline.min(now.after(longest))
    }

    fn waited(&mut self, is_asked: bool, begun: Instant, now: Instant) -> bool {
        if is_asked {
            self.silence += now.since(begun);
        }
        if self.silence >= PATIENCE && self.given_up.is_none() {
            self.given_up = Some(now);
        }
        self.given_up.is_some()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A wait of a link whose reply comes after `reply`, if ever; returns the time at its end.
    fn wait(
        patience: &mut Patience,
        is_asked: bool,
        begun: Instant,
        reply: Option<Duration>,
        deadline: Duration,
    ) -> Instant {
        let end = begun.after(deadline);
        let arrives = reply.map(|reply| begun.after(reply));
        let mut now = begun;
        loop {
            let until = patience.until(now, end);
            if let Some(arrives) = arrives.filter(|&arrives| arrives <= until) {
                return arrives.max(now);
            }
            let is_over = patience.waited(is_asked, now, until);
            now = until;
            if now == end || is_over {
                return now;
            }
        }
    }

    #[test]
    fn waits_without_a_signal_have_their_full_length() {
        let mut patience = Patience::default();
        let mut now = Instant::from_nanos(0);
        for _ in 0..100 {
            let deadline = Duration::from_millis(500);
            let end = wait(&mut patience, false, now, None, deadline);
            assert_eq!(end.since(now), deadline);
            now = end;
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// Whatever is lost or late: the waits in vain after a signal are 0.9 s and the last part.
        #[test]
        fn wait_for_missing_replies_after_a_signal_is_under_a_second(
            replies in proptest::collection::vec(proptest::option::of(0..40_u64), 5_000),
            deadline in 1..600_u64,
        ) {
            let mut patience = Patience::default();
            let mut now = Instant::from_nanos(0);
            let (mut in_vain, mut answered) = (Duration::ZERO, 0);
            for reply in replies {
                let reply = reply.map(|tenths| Duration::from_micros(100 * tenths));
                let end = wait(&mut patience, true, now, reply, Duration::from_millis(deadline));
                if reply.is_some_and(|reply| end == now.after(reply)) {
                    answered += 1;
                } else {
                    in_vain += end.since(now);
                }
                now = end;
            }
            prop_assert!(in_vain <= PATIENCE + NOTICE + LAST_TRIES + HASTE, "{in_vain:?}");
            prop_assert!(answered > 0);
        }
    }

    /// What is driven at a board that loses half of its packets is tried to be switched off.
    #[test]
    fn board_that_loses_packets_is_tried_often() {
        let mut patience = Patience::default();
        let mut now = Instant::from_nanos(0);
        let mut tries = 0;
        while patience.until(now, now.after(PATIENCE)) > now {
            now = wait(&mut patience, true, now, None, PATIENCE);
            tries += 1;
        }
        assert!(tries > 150, "{tries}");
    }
}
