//! Current state of a remote, for the application.

use super::{FailureCounts, RemoteState, RemoteWatchdog};
use crate::discovery::RemoteDescriptor;
use crate::events::OfflineReason;
use crate::remote::RemotePins;
use crate::sslbp::{RemoteFaults, RemoteLabel, StartedRemote};

/// Current state of a remote.
///
/// With the feature `serde` it is `Serialize`: the pins are represented by their prefix, and the
/// description is omitted, since it is part of the inventory (`mesa_tools::inventory`).
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct RemoteStatus<'a> {
    /// The address and the name of the remote, in texts as `7i77.0.1`.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub label: RemoteLabel,
    /// The identity that START reported; for a remote that was absent at the start and has not been
    /// plugged in yet, the expected one.
    pub started: &'a StartedRemote,
    /// The description from discovery.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub descriptor: &'a RemoteDescriptor,
    /// The pins, and their group, to re-arm it.
    #[cfg_attr(
        feature = "serde",
        serde(serialize_with = "crate::serial_form::prefix")
    )]
    pub pins: &'a RemotePins,
    /// The current state.
    pub state: RemoteState,
    /// The first reason for going offline since the last re-arming; later reasons do not replace
    /// it. `None` if the remote has not gone offline since.
    pub first_fault: Option<OfflineReason>,
    /// The remote's own watchdog: the time for which its outputs stay on without process data.
    ///
    /// A period longer than that cannot feed it.
    pub watchdog: RemoteWatchdog,
    /// The faults that it reported with its last reply, or that START could not clear.
    #[cfg_attr(
        feature = "serde",
        serde(serialize_with = "crate::serial_form::flags::serialize")
    )]
    pub faults: RemoteFaults,
    /// Transfers of this remote so far, failed ones included.
    pub transfers: u64,
    /// Failures so far.
    pub failures: &'a FailureCounts,
    /// Number of restarts.
    pub restarts: u64,
}
