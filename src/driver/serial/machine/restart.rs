//! How channels are set aside, and how they come back: STOP, START, and what START found.

use core::time::Duration;

use super::super::attempts::Cost;
use super::super::channel::{Identity, RemoteState};
use super::super::{RemoteWatchdog, SetAside};
use super::Machine;
use super::words::{Asked, Observation, Outcome, Restart, at};
use crate::bus::Instant;
use crate::sslbp::{Channel as Number, ChannelMask, ComState, CsStatus, DataStatus};

/// Other remotes' watchdogs allow 50 ms without process data (FACTS 1.5); a restart takes up to
/// 18 ms, and this much lies between two.
const BETWEEN_RESTARTS: Duration = Duration::from_millis(60);

impl Machine {
    /// Tries a remote again at once, whatever its pause; not before its outputs must be off.
    pub fn restart_now(&mut self, number: Number, now: Instant) {
        let policy = self.policy;
        if let Some(channel) = self.channel_mut(number) {
            channel.ask_for_restart(now, &policy);
        }
    }

    /// Whatever was asked of COMMAND, somebody else has used it since.
    pub fn taken_over(&mut self) {
        self.pending = None;
        self.chosen = None;
        self.idle = false;
        self.restart = Restart::None;
        self.cost = Cost::default();
    }

    pub fn set_watchdog(&mut self, number: Number, watchdog: RemoteWatchdog) {
        if let Some(channel) = self.channel_mut(number) {
            channel.watchdog = watchdog;
        }
    }

    /// Sets a remote aside.
    pub(super) fn set_aside(&mut self, now: Instant, number: Number, reason: SetAside) {
        let policy = self.policy;
        if let Some(channel) = self.channel_mut(number) {
            channel.set_aside(now, reason, &policy);
        }
    }

    /// COMMAND had to be freed: what was sent to whom is not known.
    pub(super) fn set_all_aside(&mut self, now: Instant) -> Outcome {
        self.end_restart(now);
        let known = self.known();
        for number in known.iter() {
            self.set_aside(now, number, SetAside::PortStuck);
        }
        Outcome {
            set_aside: known,
            ..Outcome::default()
        }
    }

    /// Channels whose time to be tried again has come.
    pub(super) fn due(&self, now: Instant) -> ChannelMask {
        if now < self.no_restart_before {
            return ChannelMask::NONE;
        }
        let due = self.mask(|channel| match channel.state {
            RemoteState::SetAside { next_attempt, .. } => {
                next_attempt.is_some_and(|time| time <= now)
            }
            // Left over from a command that was lost.
            RemoteState::Restarting { .. } => true,
            RemoteState::Running => false,
        });
        if !self.is_free(due) && !self.cost.allows(now, &self.policy) {
            return ChannelMask::NONE;
        }
        due.union(self.along_with(due, now))
    }

    /// One START that waits for a remote which does not answer takes as long as one that waits for
    /// several: those that did not answer before are all tried with the first of them.
    fn along_with(&self, due: ChannelMask, now: Instant) -> ChannelMask {
        let failed = self.mask(|channel| channel.attempts.has_failed);
        if due.intersection(failed).is_empty() {
            return ChannelMask::NONE;
        }
        self.mask(|channel| {
            let is_planned = matches!(
                channel.state,
                RemoteState::SetAside {
                    next_attempt: Some(_),
                    ..
                }
            );
            is_planned && channel.attempts.has_failed && channel.attempts.silent_until <= now
        })
    }

    /// Nobody else is there, or the application has asked for it: the cost does not count.
    fn is_free(&self, due: ChannelMask) -> bool {
        let asked = self.mask(|channel| channel.attempts.is_asked_for);
        self.running().is_empty() || !due.intersection(asked).is_empty()
    }

    pub(super) fn begin_restart(&mut self, now: Instant, due: ChannelMask) -> Asked {
        if !self.is_free(due) {
            self.cost.begin(now);
        }
        for number in due.iter() {
            if let Some(channel) = self.channel_mut(number) {
                channel.restarting();
            }
        }
        Asked::Stop(due)
    }

    pub(super) fn end_restart(&mut self, now: Instant) {
        self.restart = Restart::None;
        self.cost.end(now, &self.policy);
    }

    /// STOP is complete.
    pub(super) fn stopped(
        &mut self,
        now: Instant,
        mask: ChannelMask,
        seen: &Observation,
    ) -> Outcome {
        let is_stopped =
            |number: &Number| CsStatus::from_register(at(&seen.cs, *number)).is_stopped();
        let stopped: ChannelMask = mask.iter().filter(is_stopped).collect();
        for number in mask.difference(stopped).iter() {
            let cs = CsStatus::from_register(at(&seen.cs, number));
            self.set_aside(now, number, SetAside::DidNotStart(cs));
        }
        let is_wanted =
            |channel: &super::Channel| matches!(channel.state, RemoteState::Restarting { .. });
        let to_start = stopped.intersection(self.mask(is_wanted));
        if to_start.is_empty() {
            self.end_restart(now);
        } else {
            self.restart = Restart::Stopped {
                mask: to_start,
                others_served: false,
            };
        }
        Outcome::default()
    }

    /// START is complete.
    pub(super) fn started(
        &mut self,
        now: Instant,
        mask: ChannelMask,
        seen: &Observation,
    ) -> Outcome {
        if self.restart == Restart::Starting {
            self.no_restart_before = now.after(BETWEEN_RESTARTS);
        }
        self.end_restart(now);
        let data = DataStatus::from_register(seen.data);
        for number in mask.iter() {
            let cs = CsStatus::from_register(at(&seen.cs, number));
            let [unit_number, name, pointers] = at(&seen.start, number);
            let found = Identity {
                unit_number,
                name,
                pointers,
            };
            let runs = cs.is_ready() && cs.state() == ComState::Chatter;
            let Some(channel) = self.channel_mut(number) else {
                continue;
            };
            channel.cs = cs;
            if data.has_failed(number) || !runs {
                channel.did_not_start(cs);
                self.set_aside(now, number, SetAside::DidNotStart(cs));
            } else if found == channel.identity {
                channel.restarted(cs);
            } else {
                self.set_aside(now, number, SetAside::AnotherDevice { name, unit_number });
            }
        }
        Outcome::default()
    }

    /// The application has switched the port off.
    pub(super) fn stop_for_good(&mut self, running: ChannelMask) -> Option<Asked> {
        for number in self.known().iter() {
            if let Some(channel) = self.channel_mut(number) {
                channel.stop_for_good();
            }
        }
        (!running.is_empty()).then_some(Asked::Stop(running))
    }
}
