//! Points of time on the clock of a bus, virtual in simulation.

use core::time::Duration;

/// A point on the clock of a bus: nanoseconds since an origin that the bus chooses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(transparent))]
pub struct Instant(u64);

impl Instant {
    /// The point `nanos` nanoseconds after the origin.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the origin.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Time from `earlier` to here; zero if `earlier` is later.
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// The point `duration` later; saturates on overflow.
    #[must_use]
    pub const fn after(self, duration: Duration) -> Self {
        match duration.as_nanos() {
            nanos @ 0..=0xFFFF_FFFF_FFFF_FFFF => Self(self.0.saturating_add(nanos as u64)),
            _ => Self(u64::MAX),
        }
    }
}
