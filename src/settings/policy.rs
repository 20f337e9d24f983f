//! Limits at which a remote goes offline, and limits of the attempts to restart it.

use core::time::Duration;

/// Rules for taking remotes offline, and for their recovery.
///
/// # What is promised
/// - A remote that reports any fault goes offline with the reply that reports it. It gets no frame
///   of any kind from then on, so that its own [watchdog](crate::driver::RemoteWatchdog) bites and
///   switches *all* its outputs off: 50 ms after that reply for a remote as delivered, within 60
///   ms at most; for a remote with another watchdog time within that time and a fifth more. The
///   outputs stay off until the application re-arms the remote: even if the cause of the fault
///   goes away, during attempts to start it, and during
///   [`Driver::shutdown`](crate::driver::Driver::shutdown). A remote whose watchdog is switched
///   off is started again at once instead, which switches its outputs off unless START cannot
///   clear the fault.
/// - A remote whose transfers fail goes offline when its `fault-count` reaches `fault_lim`, with
///   the same silence and the same result.
/// - A START follows at the earliest when the silence is over, and sends safe values only. If it
///   fails, the next one follows after a pause that doubles from `first_backoff` to
///   `longest_backoff`; the pause is reset after 1000 good transfers.
/// - Attempts take the port from the other remotes: 2 to 4 cycles if the remote is present (2 more
///   for the first start of a remote that was absent at start-up, whose sizes are read), 17 ms if
///   not, because of the gateware (FACTS 5.7). Attempts are therefore limited for the port as a
///   whole, independent of the state of its remotes: when attempts have taken 60 ms, further ones
///   wait until an attempt of 20 ms for each `longest_backoff` is paid off. With the defaults that
///   is less than 0.6 % of any minute, and no gap is longer than one attempt: measured in
///   [`neighbours`](crate::guides::neighbours). A remote that comes back is found within
///   `longest_backoff` and one attempt. An attempt that the application requests is made as soon as
///   the silence is over.
///
/// The counters are LinuxCNC's `fault-inc`, `fault-dec` and `fault-lim`, kept for each remote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct FaultPolicy {
    /// Increment of the remote's `fault-count` for a failed transfer.
    pub fault_inc: u32,
    /// Decrement for a good transfer.
    pub fault_dec: u32,
    /// The `fault-count` at which the remote goes offline.
    pub fault_lim: u32,
    /// Retries remotes that are offline without a request of the application.
    pub automatic: bool,
    /// Time before the first attempt. The first attempt after a fault that START may clear
    /// (watchdog, mode, over-current, over-temperature …) follows when the silence is over.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub first_backoff: Duration,
    /// Upper limit of the time between attempts, which doubles up to this. In the long run,
    /// attempts disturb the other remotes at most once in this time.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub longest_backoff: Duration,
    /// Time for which a channel is left out of transfers after a failed one, at least
    /// [`SHORTEST_REST`](Self::SHORTEST_REST). A late reply within this time is recognised as late;
    /// one that comes even later cannot be distinguished from the reply to the next request. Three
    /// quarters of the period are used if that is longer.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub rest: Duration,
    /// Age limit of inputs, of remotes and of the board itself, in cycles: inputs are valid while
    /// they are younger, 1 to 1000. Also the number of writes without a
    /// [read](crate::driver::Driver::read) after which everything becomes safe.
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
