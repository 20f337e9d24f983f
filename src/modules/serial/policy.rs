//! When a remote goes offline, and what may be done to bring it back.

use core::time::Duration;

/// When a remote goes offline, and how it comes back.
///
/// # What is promised
/// - A remote that reports any fault goes offline with the reply that reports it. It gets no frame of
///   any kind from then on, so that its own [watchdog](super::RemoteWatchdog) bites and switches *all* its
///   outputs off: 50 ms after that reply for a remote as it is delivered, within 60 ms at most; for
///   one with another watchdog within that time and a fifth more. They stay off until the
///   application re-arms the remote: through the cause of the fault going away, attempts to start
///   it, and [`Driver::shutdown`](crate::driver::Driver::shutdown). A remote whose watchdog is
///   switched off is started again at once instead, which switches its outputs off unless START can
///   not clear the fault.
/// - A remote whose transfers fail goes offline when its `fault-count` reaches `fault_lim`, with
///   the same silence and the same end.
/// - A START follows when the silence is over, at the earliest, and sends safe values only. If it
///   fails, the next one follows after a pause that doubles from
///   `first_backoff` to `longest_backoff`; it begins anew after 1000 good transfers.
/// - Attempts take the port from the other remotes: 2 to 4 cycles if the remote is there (2 more the
///   first time that one runs which was absent at the start: its sizes are read), 17 ms if not, as
///   the gateware does it (FACTS 5.7). So they are limited for the port as a whole,
///   whatever its remotes do: when attempts have taken 60 ms, further ones wait until one of 20 ms
///   for each `longest_backoff` is paid off. With the defaults that is less than 0.6 % of any
///   minute, and no gap is longer than one attempt: measured in
///   [`neighbours`](crate::driver::neighbours). A remote that comes back is found within
///   `longest_backoff` and one attempt. An attempt that the application asks for is made at once,
///   when the silence is over.
///
/// The counters are LinuxCNC's `fault-inc`, `fault-dec` and `fault-lim`, kept for each remote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct FaultPolicy {
    /// What a failed transfer adds to the remote's `fault-count`.
    pub fault_inc: u32,
    /// What a good transfer takes away.
    pub fault_dec: u32,
    /// The `fault-count` at which it goes offline.
    pub fault_lim: u32,
    /// Whether remotes that are offline are tried again by themselves.
    pub automatic: bool,
    /// Time before the first attempt. The first one after a fault that START may clear (watchdog,
    /// mode, over-current, over-temperature …) follows when the silence is over.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub first_backoff: Duration,
    /// The time between attempts doubles up to this. It also says how often attempts may disturb
    /// the other remotes in the long run: once in this time.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub longest_backoff: Duration,
    /// How long a channel is left out of transfers after a failed one, at least
    /// [`SHORTEST_REST`](Self::SHORTEST_REST). In this time a late reply shows itself as late; one
    /// that comes even later can not be distinguished from the reply to the next request. It is
    /// three quarters of the period if that is longer.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub rest: Duration,
    /// Inputs, of remotes and of the board itself, are valid while they are younger than so many cycles:
    /// 1 to 1000. Also writes without a [read](crate::driver::Driver::read), after which everything is
    /// safe.
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
