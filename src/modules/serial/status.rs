//! A remote as it is now, for the application.

use super::health::Health;
use super::{FailureCounts, OfflineReason, Remote, RemoteState, RemoteWatchdog};
use crate::discovery::RemoteDescriptor;
use crate::hal::GroupId;
use crate::remote::RemotePins;
use crate::sslbp::{Link, RemoteFaults, StartedRemote};

/// A remote as it is now.
#[derive(Clone, Copy, Debug)]
pub struct RemoteStatus<'a> {
    pub(super) remote: &'a Remote,
    pub(super) health: &'a Health,
    pub(super) link: &'a Link,
}

impl RemoteStatus<'_> {
    /// What START told of it; of one that was absent at the start and has not been plugged in yet,
    /// what is expected.
    pub fn started(&self) -> &StartedRemote {
        &self.remote.started
    }

    /// What discovery found out about it.
    pub fn descriptor(&self) -> &RemoteDescriptor {
        &self.remote.descriptor
    }

    /// Its pins.
    pub fn pins(&self) -> &RemotePins {
        &self.remote.pins
    }

    /// The group of its pins, to re-arm it.
    pub fn group(&self) -> GroupId {
        self.remote.pins.group()
    }

    /// What it is doing.
    pub fn state(&self) -> RemoteState {
        self.health.state
    }

    /// Why it went offline first since it was re-armed last; later reasons do not replace it.
    /// `None` while nothing has happened since.
    pub fn first_fault(&self) -> Option<OfflineReason> {
        self.health.first_fault
    }

    /// How long its outputs stay on when nobody talks to it: its own watchdog.
    ///
    /// A period longer than that can not feed it.
    pub fn watchdog(&self) -> RemoteWatchdog {
        self.health.watchdog
    }

    /// What it reported with its last reply, or START found when it could not clear it.
    pub fn faults(&self) -> RemoteFaults {
        self.health.faults
    }

    /// Transfers of its own so far, failed ones included.
    pub fn transfers(&self) -> u64 {
        self.link.transfers()
    }

    /// Its failures so far.
    pub fn failures(&self) -> FailureCounts {
        *self.link.failures()
    }

    /// How often it was restarted.
    pub fn restarts(&self) -> u64 {
        self.health.restarts
    }
}
