//! A remote before it takes part in the cycle.

use super::RemoteWatchdog;
use crate::discovery::RemoteDescriptor;
use crate::events::OfflineReason;
use crate::remote::RemotePins;
use crate::sslbp::{RemoteLabel, StartedRemote};

/// A remote that takes part: as found, whether it runs or not, or, while absent, as described by
/// its table.
#[derive(Debug)]
#[non_exhaustive]
pub struct RemotePart {
    /// The identity that START reported. For an absent remote, the expected identity: 0 for an
    /// unknown unit number or unknown tables, and the class of the unit number in the top byte.
    pub started: StartedRemote,
    /// The description from discovery; for an absent remote, from its table.
    pub descriptor: RemoteDescriptor,
    /// The pins of the remote.
    pub pins: RemotePins,
    /// Reason for which the remote does not run at the start; it is offline from then on, and tried
    /// again. `None` if it runs, or has not been started yet.
    pub offline: Option<OfflineReason>,
}

impl RemotePart {
    /// The address and the name of the remote, in texts as `7i77.0.1`.
    pub fn label(&self) -> RemoteLabel {
        self.pins.label
    }

    /// The remote's own watchdog: the time for which its outputs stay on without process data.
    pub fn watchdog(&self) -> RemoteWatchdog {
        RemoteWatchdog::of(&self.pins)
    }

    /// True if the remote was absent: it may come up when it is plugged in.
    pub fn is_absent(&self) -> bool {
        self.offline == Some(OfflineReason::Absent)
    }
}
