//! A remote's own watchdog, which switches its outputs off when it gets no process data.

use core::time::Duration;

use crate::bus::Instant;
use crate::events::OfflineReason;
use crate::fraction::Fraction;
use crate::remote::RemotePins;
use crate::sslbp::{ChannelMask, PerChannel};

/// Name of the parameter for a remote's watchdog time, in milliseconds. Manual: 7I77, "FIELD I/O
/// PARAMETERS".
pub const WATCHDOG_PARAMETER: &str = "NVWatchDogTimeout";

/// The time for which a remote's outputs stay on without process data, as far as it is known.
///
/// Source: manual 7I77, "WATCHDOG TIMEOUT", "ANALOG SECTION WATCHDOG"; FACTS 1.5.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum RemoteWatchdog {
    /// The time in the parameter `NVWatchDogTimeout`. A remote uses it from its next power-up on,
    /// so a changed value is not in use yet.
    Known(#[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))] Duration),
    /// The remote has no such parameter, or it was not read: [`USUAL`](Self::USUAL) is assumed.
    Assumed,
    /// The watchdog never bites: its parameter is 0, or it did not bite in a
    /// [test](crate::Driver::prove_watchdogs) in which the remote was heard. Nothing switches the
    /// outputs off when the remote cannot be reached, or when it has a fault that START does not
    /// clear.
    Off,
}

impl RemoteWatchdog {
    /// The default time of remotes as delivered.
    pub const USUAL: Duration = Duration::from_millis(50);

    /// The watchdog according to the remote's parameter, including the parameter's first value,
    /// which stays in use until the next power-up.
    pub(super) fn of(pins: &RemotePins) -> Self {
        let parameter = pins.parameter(WATCHDOG_PARAMETER);
        let millis = parameter.and_then(|parameter| parameter.first.zip(parameter.known));
        millis.map_or(Self::Assumed, |(first, known)| {
            Self::longer_of(first, known)
        })
    }

    /// True if the watchdog is off, or longer than a second: too long for a person to wait for an
    /// output that nothing else switches off.
    pub fn is_slow(self) -> bool {
        self.time().is_none_or(|time| time > Duration::from_secs(1))
    }

    /// The longer one of two values of `NVWatchDogTimeout`, in milliseconds, where it is unknown
    /// which one the remote uses.
    pub fn longer_of(one: u64, other: u64) -> Self {
        match one.min(other) {
            0 => Self::Off,
            _ => Self::Known(Duration::from_millis(one.max(other))),
        }
    }

    /// The time without process data after which the outputs are off; `None`: they stay on.
    pub const fn time(self) -> Option<Duration> {
        match self {
            Self::Known(time) => Some(time),
            Self::Assumed => Some(Self::USUAL),
            Self::Off => None,
        }
    }

    /// The time for which nothing is sent to a remote that is offline, so that its watchdog must
    /// have bitten: a fifth more than its time, for the tolerance of its clock. Zero for a watchdog
    /// that never bites.
    pub fn silence(self) -> Duration {
        self.time()
            .map_or(Duration::ZERO, |time| time.fraction(6, 5))
    }
}

/// The remotes of a port that are tested for their watchdogs, with their numbers of good transfers
/// before the first query.
#[derive(Clone, Debug)]
pub(crate) struct Queried {
    pub(super) channels: ChannelMask,
    pub(super) good: PerChannel<u64>,
}

/// Number of good transfers after the silence that show what a remote reports: the first can be of
/// a transfer that was not read before the silence, the second the late reply to that one.
pub(super) const HEARD: u64 = 3;

/// State of a remote's outputs, as far as it is known from the frames sent to it and its reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OutputsState {
    /// All outputs are off: the last data it took is 0, as after START, or it reported that its
    /// watchdog has bitten.
    Off,
    /// All outputs are off from this time on: the remote gets no frame, and its watchdog must have
    /// bitten by then.
    OffFrom(Instant),
    /// An output may be on.
    Driven,
}

impl OutputsState {
    pub fn are_off(self, now: Instant) -> bool {
        match self {
            Self::Off => true,
            Self::OffFrom(from) => from <= now,
            Self::Driven => false,
        }
    }

    /// Handles that nothing more is sent to the remote, for this reason; its watchdog, if its time
    /// is known, has bitten at `bitten`. A START that follows switches nothing on.
    pub fn silent(&mut self, reason: OfflineReason, watchdog: RemoteWatchdog, bitten: Instant) {
        *self = match (*self, reason, watchdog) {
            (_, OfflineReason::Watchdog, _) => Self::Off,
            (Self::Driven, _, RemoteWatchdog::Known(_)) => Self::OffFrom(bitten),
            (before, ..) => before,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_60_ms_by_default_and_0_for_a_disabled_watchdog() {
        assert_eq!(RemoteWatchdog::Assumed.silence().as_millis(), 60);
        for (millis, silence) in [(50, 60), (200, 240), (0, 0)] {
            let watchdog = RemoteWatchdog::longer_of(millis, millis);
            assert_eq!(watchdog.silence().as_millis(), silence);
            assert_eq!(watchdog.is_slow(), millis == 0);
        }
    }

    #[test]
    fn one_that_never_bites_is_the_longer_one() {
        let long = RemoteWatchdog::Known(Duration::from_millis(200));
        for (one, other, longer) in [(20, 200, long), (0, 200, RemoteWatchdog::Off)] {
            assert_eq!(RemoteWatchdog::longer_of(one, other), longer);
            assert_eq!(RemoteWatchdog::longer_of(other, one), longer);
        }
    }
}
