//! A port in the cycle as a state machine: what COMMAND, DATA and CS mean, and which command is
//! next. It knows neither bus nor pins, never waits, and does one step for each read and write.

mod restart;
mod words;

use core::time::Duration;

pub(crate) use words::{Next, Observation, Outcome, PerChannel};

use super::attempts::Cost;
use super::channel::{Channel, RemoteState, Verdict};
use super::statistics::PortStatistics;
use super::{Failure, FaultPolicy, SetAside};
use crate::bus::Instant;
use crate::sslbp::{Channel as Number, ChannelMask, Command, CsStatus, DataStatus};
use words::{Asked, Pending, Restart, at};

/// One port in the cycle.
#[derive(Debug)]
pub(crate) struct Machine {
    channels: PerChannel<Option<Channel>>,
    pub policy: FaultPolicy,
    pub run: bool,
    /// The port is switched off, and its remotes have been told safe values.
    told_off: bool,
    pub statistics: PortStatistics,
    /// COMMAND was 0 when it was read last, and nothing was written since.
    idle: bool,
    pending: Option<Pending>,
    /// What `written` has to remember, once it is known whether it was written.
    chosen: Option<Asked>,
    restart: Restart,
    /// Restarts wait at least until then, so that the other channels are served meanwhile.
    no_restart_before: Instant,
    cost: Cost,
    no_free_before: Instant,
}

/// The way out is not tried more often than this.
const BETWEEN_FREES: Duration = Duration::from_secs(1);
/// A busy COMMAND is stuck only after this many reads, however slow the cycle.
const MIN_BUSY_READS: u32 = 3;

impl Machine {
    /// A port whose channels have just been started and run.
    pub fn new(channels: PerChannel<Option<Channel>>, policy: FaultPolicy, now: Instant) -> Self {
        Self {
            channels,
            policy,
            run: true,
            told_off: false,
            statistics: PortStatistics::default(),
            // Nothing is written before the first read has seen COMMAND.
            idle: false,
            pending: None,
            chosen: None,
            restart: Restart::None,
            no_restart_before: now,
            cost: Cost::default(),
            no_free_before: now,
        }
    }

    pub fn channel(&self, number: Number) -> Option<&Channel> {
        self.channels.get(usize::from(number.index()))?.as_ref()
    }

    fn channel_mut(&mut self, number: Number) -> Option<&mut Channel> {
        self.channels.get_mut(usize::from(number.index()))?.as_mut()
    }

    /// The channels for which `condition` holds.
    fn mask(&self, condition: impl Fn(&Channel) -> bool) -> ChannelMask {
        let has = |number: &Number| self.channel(*number).is_some_and(&condition);
        Number::ALL.into_iter().filter(has).collect()
    }

    /// The outputs of a remote follow the application.
    pub fn armed(&mut self, number: Number) {
        if let Some(channel) = self.channel_mut(number) {
            channel.armed();
        }
    }

    /// Channels with a remote.
    pub fn known(&self) -> ChannelMask {
        self.mask(|_| true)
    }

    /// Channels that transfer.
    pub fn running(&self) -> ChannelMask {
        self.mask(Channel::is_running)
    }

    /// Whether the next read must show the interface registers as START leaves them.
    pub fn needs_start_data(&self) -> bool {
        self.restart == Restart::Starting
    }

    /// Whether the next write must hold the software modes.
    pub fn needs_modes(&self) -> bool {
        matches!(self.restart, Restart::Stopped { .. })
    }

    /// Whether a transfer is under way.
    pub fn is_transferring(&self) -> bool {
        self.pending
            .is_some_and(|pending| matches!(pending.asked, Asked::Transfer(_)))
    }

    /// Whether a remote that runs has transferred since it was started.
    pub fn has_transferred(&self) -> bool {
        let has = |channel: &Channel| channel.is_running() && channel.good_since_restart() > 0;
        !self.mask(has).is_empty()
    }

    /// Whether a STOP is in flight.
    pub fn is_stopping(&self) -> bool {
        self.pending
            .is_some_and(|pending| matches!(pending.asked, Asked::Stop(_)))
    }

    /// How far a restart is: 1 STOP, 2 START, 0 none.
    pub fn restart_step(&self) -> u32 {
        match self.restart {
            Restart::Starting => 2,
            Restart::Stopped { .. } => 1,
            Restart::None => u32::from(self.run && self.is_stopping()),
        }
    }

    /// The largest `fault-count` of its channels.
    pub fn fault_count(&self) -> u32 {
        let counts = self.channels.iter().flatten().map(|c| c.fault_count);
        counts.max().unwrap_or(0)
    }

    /// Whether every remote was found stopped, by nobody's order.
    pub fn appears_reset(&self) -> bool {
        self.channels.iter().flatten().all(|channel| {
            matches!(channel.state, RemoteState::SetAside { .. })
                && matches!(channel.cause, Some(SetAside::NotRunning(cs)) if cs.is_stopped())
        })
    }

    /// Notes when a transfer was complete, where somebody polled for it.
    pub fn transfer_complete(&mut self, now: Instant) {
        if let Some(pending) = &mut self.pending
            && matches!(pending.asked, Asked::Transfer(_))
            && !core::mem::replace(&mut pending.measured, true)
        {
            self.statistics.doit.record(now.since(pending.issued));
        }
    }

    /// Takes what a read showed. `writes_lost`: the bus knows that the last write, or one before,
    /// was not executed.
    pub fn observe(&mut self, now: Instant, seen: &Observation, writes_lost: bool) -> Outcome {
        self.chosen = None;
        if let Some(pending) = &mut self.pending {
            // Also while it is busy: with what, is not known.
            pending.sure &= !writes_lost;
        }
        if seen.command != 0 {
            return self.observe_busy(now);
        }
        self.idle = true;
        let Some(pending) = self.pending.take() else {
            return Outcome::default();
        };
        match pending.asked {
            Asked::Transfer(mask) if pending.sure => Outcome {
                started: pending.issued,
                reads_before: pending.reads_before,
                ..self.judge(now, mask, seen)
            },
            Asked::Transfer(mask) => {
                self.statistics.unknown += 1;
                self.judge_doubtful(now, mask, seen)
            }
            Asked::Stop(mask) => self.stopped(now, mask, seen),
            Asked::Start(mask) => self.started(now, mask, seen),
            Asked::Free => self.set_all_aside(now),
        }
    }

    /// A read failed: nothing is known about COMMAND.
    pub fn not_observed(&mut self) {
        self.idle = false;
        self.chosen = None;
        if let Some(pending) = &mut self.pending {
            pending.reads_before = pending.reads_before.saturating_add(1);
        }
    }

    /// Whatever was asked for may not have happened: the board was found without its set-up.
    pub fn doubt(&mut self) {
        if let Some(pending) = &mut self.pending {
            pending.sure = false;
        }
    }

    fn observe_busy(&mut self, now: Instant) -> Outcome {
        self.idle = false;
        let pending = self.pending.get_or_insert(Pending {
            // Somebody else wrote it; it is treated as the longest of ours.
            asked: Asked::Start(ChannelMask::NONE),
            issued: now,
            sure: false,
            busy_reads: 0,
            reads_before: 0,
            measured: false,
        });
        pending.busy_reads = pending.busy_reads.saturating_add(1);
        pending.reads_before = pending.reads_before.saturating_add(1);
        let too_short = matches!(pending.asked, Asked::Transfer(_));
        self.statistics.too_short += u64::from(too_short);
        Outcome {
            too_short,
            ..Outcome::default()
        }
    }

    fn is_stuck(&self, now: Instant) -> bool {
        self.pending.is_some_and(|pending| {
            pending.busy_reads >= MIN_BUSY_READS
                && now.since(pending.issued) > pending.asked.limit()
        })
    }

    fn judge(&mut self, now: Instant, mask: ChannelMask, seen: &Observation) -> Outcome {
        self.statistics.transfers += 1;
        let data = DataStatus::from_register(seen.data);
        let mut outcome = Outcome::default();
        for number in mask.iter() {
            let cs = CsStatus::from_register(at(&seen.cs, number));
            let policy = self.policy;
            let Some(channel) = self.channel_mut(number) else {
                continue;
            };
            let one = number.mask();
            let reason = match channel.judge(cs, data.has_failed(number)) {
                Verdict::Good => {
                    channel.count_good(policy.fault_dec);
                    outcome.good = outcome.good.union(one);
                    None
                }
                Verdict::Faulty(reason) => Some(reason),
                Verdict::Failed(Failure::Doubtful) => {
                    outcome.failed = outcome.failed.union(one);
                    None
                }
                Verdict::Failed(Failure::NotRunning) => Some(SetAside::NotRunning(cs)),
                Verdict::Failed(failure) => {
                    outcome.failed = outcome.failed.union(one);
                    channel.rest_until = now.after(policy.rest);
                    channel.count_fault(policy.fault_inc);
                    (channel.fault_count >= policy.fault_lim)
                        .then_some(SetAside::TooManyFailures(failure))
                }
            };
            if let Some(reason) = reason {
                outcome.set_aside = outcome.set_aside.union(one);
                self.set_aside(now, number, reason);
            }
        }
        outcome.failed = outcome.failed.difference(outcome.set_aside);
        outcome
    }

    /// It is not known whether the transfer happened: no data is taken, but a fault is a fault.
    fn judge_doubtful(&mut self, now: Instant, mask: ChannelMask, seen: &Observation) -> Outcome {
        let mut outcome = Outcome::default();
        for number in mask.iter() {
            let cs = CsStatus::from_register(at(&seen.cs, number));
            let verdict = self.channel_mut(number).and_then(|c| c.judge_doubtful(cs));
            if let Some(Verdict::Faulty(reason)) = verdict {
                outcome.set_aside = outcome.set_aside.union(number.mask());
                self.set_aside(now, number, reason);
            }
        }
        outcome
    }

    /// The command for this write; [`written`](Self::written) must follow.
    ///
    /// `hold`: channels are not restarted. The board is not set up, and that needs writes that would
    /// set it up in part; or all that run are to be told safe values now.
    pub fn next(&mut self, now: Instant, hold: bool) -> Next {
        let asked = if self.idle {
            self.choose(now, hold)
        } else if self.is_stuck(now) && now >= self.no_free_before {
            self.no_free_before = now.after(BETWEEN_FREES);
            self.statistics.stuck += 1;
            Some(Asked::Free)
        } else {
            None
        };
        self.chosen = asked;
        Next {
            command: asked.map_or(Command::IGNORED, Asked::command),
            with_data: matches!(asked, Some(Asked::Transfer(_))),
        }
    }

    fn choose(&mut self, now: Instant, hold: bool) -> Option<Asked> {
        let running = self.running();
        let ready = self.mask(|channel| channel.is_running() && channel.rest_until <= now);
        if !self.run {
            self.end_restart(now);
            // Outputs are safe already: the remotes are told before nobody talks to them any more.
            if !running.is_empty() && !core::mem::replace(&mut self.told_off, true) {
                return Some(Asked::Transfer(running));
            }
            return self.stop_for_good(running);
        }
        self.told_off = false;
        if hold {
            return (!running.is_empty()).then_some(Asked::Transfer(running));
        }
        match self.restart {
            Restart::Stopped {
                mask,
                others_served,
            } => {
                if !others_served && !ready.is_empty() {
                    self.restart = Restart::Stopped {
                        mask,
                        others_served: true,
                    };
                    return Some(Asked::Transfer(ready));
                }
                self.restart = Restart::Starting;
                self.statistics.starts += 1;
                return Some(Asked::Start(mask));
            }
            Restart::Starting => self.end_restart(now),
            Restart::None => {}
        }
        let due = self.due(now);
        if !due.is_empty() {
            return Some(self.begin_restart(now, due));
        }
        (!ready.is_empty()).then_some(Asked::Transfer(ready))
    }

    /// The write was done, or failed so that it is not known whether the board got it.
    pub fn written(&mut self, now: Instant, sure: bool) {
        let Some(asked) = self.chosen.take() else {
            return;
        };
        self.idle = false;
        self.pending = Some(Pending {
            asked,
            issued: now,
            sure,
            busy_reads: 0,
            reads_before: 0,
            measured: false,
        });
    }
}

#[cfg(test)]
mod tests;
