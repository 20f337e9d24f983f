//! SSLBP ports in the cycle.

mod channel;
mod machine;
mod pins;
mod port;
mod statistics;

pub use channel::{Failure, FailureCounts, RemoteState, SetAside};
pub use port::SerialPort;
pub use statistics::{PortStatistics, TimeHistogram};

use core::time::Duration;

pub(super) use pins::{PortPins, RemoteFaultPins};
pub(super) use port::Remote;

/// A remote as it is now.
#[derive(Clone, Copy, Debug)]
pub struct RemoteStatus<'a> {
    remote: &'a Remote,
    channel: &'a channel::Channel,
}

/// When a remote is set aside, and how it comes back.
///
/// The counters are LinuxCNC's `fault-inc`, `fault-dec` and `fault-lim`, kept for each remote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultPolicy {
    /// What a failed transfer adds to the remote's `fault-count`.
    pub fault_inc: u32,
    /// What a good transfer takes away.
    pub fault_dec: u32,
    /// The `fault-count` at which it is set aside.
    pub fault_lim: u32,
    /// Whether remotes that were set aside are tried again by themselves. An attempt takes 2 to 4
    /// cycles if the remote is there and about 17 ms if not, during which the other remotes of
    /// the port transfer nothing (FACTS 5.7).
    pub automatic: bool,
    /// Time before the first attempt. After a remote's watchdog has bitten, the first attempt
    /// follows at once.
    pub first_backoff: Duration,
    /// The time between attempts doubles up to this.
    pub longest_backoff: Duration,
    /// How long a channel is left out of transfers after a failed one, at least
    /// [`SHORTEST_REST`](Self::SHORTEST_REST). In this time a late reply shows itself as late; one
    /// that comes even later can not be told from the reply to the next request. The builder sets
    /// three quarters of the period if that is longer.
    pub rest: Duration,
    /// Cycles without a new transfer after which inputs are no longer valid.
    pub stale_after: u32,
}

impl FaultPolicy {
    /// The idle interval after which a channel is clean again (FACTS 5.4: about 100 us).
    pub const SHORTEST_REST: Duration = Duration::from_micros(150);
}

impl Default for FaultPolicy {
    /// LinuxCNC's 10, 1 and 200; attempts after 100 ms up to every 5 s; stale after 5 cycles.
    fn default() -> Self {
        Self {
            fault_inc: 10,
            fault_dec: 1,
            fault_lim: 200,
            automatic: true,
            first_backoff: Duration::from_millis(100),
            longest_backoff: Duration::from_secs(5),
            rest: Self::SHORTEST_REST,
            stale_after: 5,
        }
    }
}
