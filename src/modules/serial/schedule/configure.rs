//! Parameters of remotes, written while their port is restarted: setup START, accesses, STOP.

use super::{Remotes, Restart, Schedule, WrittenParameter};
use crate::bus::Instant;
use crate::events::EventKind;
use crate::remote::ParameterWrite;
use crate::sslbp::{ChannelMask, CompletedOperation, PortOperation, StartMode};

impl Schedule {
    /// Makes room for this number of requests, so that [`request`](Self::request) does not
    /// allocate.
    pub fn reserve_requests(&mut self, count: usize) {
        self.requests.reserve_exact(count);
    }

    /// Requests the write of a parameter when the port is switched on again. Replaces an earlier
    /// request for the same parameter.
    pub fn request(&mut self, write: ParameterWrite) {
        self.requests.retain(|other| !is_same(other, &write));
        debug_assert!(self.requests.len() < self.requests.capacity(), "no room");
        self.requests.push(write);
    }

    /// Keeps a write that was begun and has not succeeded for the next time, unless the parameter
    /// has been requested anew since.
    pub(super) fn request_again(&mut self, write: ParameterWrite) {
        if !self.requests.iter().any(|other| is_same(other, &write)) {
            self.request(write);
        }
    }

    /// Takes whether the application has the port switched on.
    pub fn switch(&mut self, run: bool) {
        self.may_configure |= run && !self.run;
        self.run = run;
    }

    /// Begins the setup of those of these channels that have parameters to write: their setup
    /// START; `None` if there are none. While other remotes transfer, which setup mode would stop,
    /// they wait for a restart of the whole port.
    pub(super) fn begin_setup(
        &mut self,
        remotes: &Remotes,
        stopped: ChannelMask,
    ) -> Option<PortOperation> {
        if !remotes.running().is_empty() || !core::mem::take(&mut self.may_configure) {
            return None;
        }
        let channels = self.requests.iter().map(|write| write.channel);
        let asked = channels.collect::<ChannelMask>().intersection(stopped);
        if asked.is_empty() {
            return None;
        }
        self.restart = Restart::SettingUp(stopped);
        Some(PortOperation::Start(StartMode::Setup, asked))
    }

    /// Takes the remotes that are in setup mode. A setup START that may not have happened is
    /// repeated, after another STOP.
    pub(super) fn setup_started(&mut self, now: Instant, complete: &CompletedOperation) {
        let Restart::SettingUp(all) = self.restart else {
            return;
        };
        if complete.certain {
            let ready = complete.good;
            self.restart = Restart::Configuring { all, ready };
        } else {
            self.end_restart(now);
        }
    }

    /// The next access to a remote in setup mode; after the last one the STOP. A port that is
    /// switched off meanwhile ends the write in progress first, because its memory is selected.
    pub(super) fn configure(
        &mut self,
        remotes: &Remotes,
        now: Instant,
        all: ChannelMask,
        ready: ChannelMask,
    ) -> Option<PortOperation> {
        if !self.writer.is_busy() && self.run {
            let mut requests = self.requests.iter();
            let next = requests.position(|write| ready.contains(write.channel));
            if let Some(write) = next.map(|index| self.requests.swap_remove(index)) {
                self.writer.begin(write);
            }
        }
        if self.writer.is_busy() {
            return self.writer.next(now);
        }
        if !self.writer.count_quiet_write() {
            return None;
        }
        for write in &self.requests {
            report_failure(remotes, now, write);
        }
        self.restart = Restart::None;
        Some(PortOperation::Stop(all))
    }

    /// Handles the end of a write. A value that the remote does not keep is reported now, an
    /// unknown one with all that were not written; those are tried again at the next restart of the
    /// port.
    pub(super) fn parameter_ended(
        &mut self,
        remotes: &Remotes,
        now: Instant,
        ended: WrittenParameter,
    ) {
        if ended.kept.is_none() {
            if let Restart::Configuring { ready, .. } = &mut self.restart {
                *ready = ready.difference(ended.write.channel.mask());
            }
            self.request_again(ended.write);
        } else if !ended.is_as_requested() {
            report_failure(remotes, now, &ended.write);
        }
    }
}

/// Reports a parameter that was not written.
fn report_failure(remotes: &Remotes, now: Instant, write: &ParameterWrite) {
    if let Some(remote) = remotes.get(write.channel) {
        let (remote, parameter) = (remote.label(), write.parameter.into());
        let kind = EventKind::ParameterNotWritten { remote, parameter };
        remotes.events().report(now, kind);
    }
}

/// True if both write the same parameter.
fn is_same(one: &ParameterWrite, other: &ParameterWrite) -> bool {
    (one.channel, one.parameter) == (other.channel, other.parameter)
}
