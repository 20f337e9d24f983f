//! Statistics of a driver, and the result of re-arming.

/// Statistics of a driver since it was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DriverStatistics {
    /// Calls of `read`.
    pub reads: u64,
    /// Calls of `write`.
    pub writes: u64,
    /// Reads that failed as a whole.
    pub read_errors: u64,
    /// Writes that failed as a whole.
    pub write_errors: u64,
    /// Writes that the bus has lost.
    pub lost_writes: u64,
    /// Periods that passed without a good read, where the [board paces](super::Pace::Board).
    pub missed_periods: u64,
    /// Cycles that the board's clock has not begun, where the [board paces](super::Pace::Board).
    pub unpaced_cycles: u64,
    /// Number of bites of the board's watchdog that were detected.
    pub watchdog_bites: u64,
    /// Number of resets of the board that were detected.
    pub resets: u64,
    /// Number of times that everything was made safe because the bus failed too often.
    pub bus_down: u64,
    /// Packets of a second master that drives the board too:
    /// [`BusStatistics::foreign_packets`](crate::bus::BusStatistics::foreign_packets).
    pub foreign_packets: u64,
}

/// Result of [`Driver::rearm`](super::Driver::rearm) and
/// [`Driver::rearm_when_running`](super::Driver::rearm_when_running).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[must_use = "some outputs may still be safe"]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Rearmed {
    /// Groups whose outputs follow the application again.
    pub armed: usize,
    /// Groups with outputs that are still safe, because they do not run yet.
    pub waiting: usize,
    /// Part of `waiting`: groups that come up because the board got its set-up back, and all that
    /// [`rearm_when_running`](super::Driver::rearm_when_running) waits for. Each of them is armed
    /// as soon as it runs, unless a fault comes first. The other groups need another call in a
    /// later cycle.
    pub rearm_pending: usize,
}
