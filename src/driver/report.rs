//! What a driver counts, and what it has armed.

/// What a driver counted since it was built.
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
    /// Periods that went by without a good read, where the [board paces](super::Pace::Board).
    pub missed_periods: u64,
    /// Cycles that the board's clock has not begun, where the [board paces](super::Pace::Board).
    pub unpaced_cycles: u64,
    /// Times that the board's watchdog was found to have bitten.
    pub watchdog_bites: u64,
    /// Times that the board was found to have been reset.
    pub resets: u64,
    /// Times that everything was made safe because the bus failed too often.
    pub bus_down: u64,
    /// Packets of somebody else who drives the board too:
    /// [`BusStatistics::others`](crate::bus::BusStatistics::others).
    pub others: u64,
}

/// What [`Driver::rearm`](super::Driver::rearm) achieved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[must_use = "some outputs may still be safe"]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Rearmed {
    /// Groups whose outputs follow the application again.
    pub armed: usize,
    /// Groups whose outputs are still safe: they do not run yet.
    pub waiting: usize,
    /// Of those, groups that come up because the board got its set-up back: each is armed by this call
    /// as soon as it runs, unless a fault comes before. For the others call it again in a later cycle.
    pub coming: usize,
}
