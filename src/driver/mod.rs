//! The cycle: `read()` and `write()` on a planned image, faults, recovery, statistics.

mod serial;

pub use serial::{
    Failure, FailureCounts, FaultPolicy, PortStatistics, RemoteState, SetAside, TimeHistogram,
};
