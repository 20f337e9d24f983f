//! A remote as it is now, for the application.

use super::{FailureCounts, OfflineReason, RemoteState, RemoteWatchdog};
use crate::discovery::RemoteDescriptor;
use crate::remote::RemotePins;
use crate::sslbp::{RemoteFaults, StartedRemote};

/// A remote as it is now.
///
/// With the feature `serde` it is `Serialize`: of its pins what their names begin with, and nothing of
/// its own description, which is in the inventory (`mesa_tools::inventory`).
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct RemoteStatus<'a> {
    /// What START found; of one that was absent at the start and has not been plugged in yet,
    /// what is expected.
    pub started: &'a StartedRemote,
    /// What discovery found out about it.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub descriptor: &'a RemoteDescriptor,
    /// Its pins, and their group, to re-arm it.
    #[cfg_attr(
        feature = "serde",
        serde(serialize_with = "crate::serial_form::prefix")
    )]
    pub pins: &'a RemotePins,
    /// What it is doing.
    pub state: RemoteState,
    /// Why it went offline first since it was re-armed last; later reasons do not replace it.
    /// `None` while nothing has happened since.
    pub first_fault: Option<OfflineReason>,
    /// How long its outputs stay on without process data: its own watchdog.
    ///
    /// A period longer than that can not feed it.
    pub watchdog: RemoteWatchdog,
    /// What it reported with its last reply, or START found when it could not clear it.
    #[cfg_attr(
        feature = "serde",
        serde(serialize_with = "crate::serial_form::flags::serialize")
    )]
    pub faults: RemoteFaults,
    /// Transfers of its own so far, failed ones included.
    pub transfers: u64,
    /// Its failures so far.
    pub failures: &'a FailureCounts,
    /// How often it was restarted.
    pub restarts: u64,
}
