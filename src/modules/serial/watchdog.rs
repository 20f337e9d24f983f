//! A remote's own watchdog: what switches its outputs off when nobody talks to it.

use core::time::Duration;

/// How long a remote's outputs stay on without process data, as far as it is known.
///
/// Source: manual 7I77, "WATCHDOG TIMEOUT", "ANALOG SECTION WATCHDOG"; FACTS 1.5.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum RemoteWatchdog {
    /// Its parameter `NVWatchDogTimeout` says this time. The remote uses it from its next power-up
    /// on, so one that was changed since is not in use yet.
    Known(Duration),
    /// It has no such parameter, or did not tell it: [`USUAL`](Self::USUAL) is assumed.
    Assumed,
    /// Its parameter is 0: it never bites. Nothing switches its outputs off when it can not be
    /// reached, or when it has a fault that START does not clear.
    Off,
}

impl RemoteWatchdog {
    /// The time of remotes as they are delivered.
    pub const USUAL: Duration = Duration::from_millis(50);

    /// From the value of `NVWatchDogTimeout`, in milliseconds.
    pub const fn from_millis(millis: u64) -> Self {
        match millis {
            0 => Self::Off,
            millis => Self::Known(Duration::from_millis(millis)),
        }
    }

    /// After this time without process data its outputs are off; `None`: they stay on.
    pub const fn time(self) -> Option<Duration> {
        match self {
            Self::Known(time) => Some(time),
            Self::Assumed => Some(Self::USUAL),
            Self::Off => None,
        }
    }

    /// How long nothing is sent to a remote that is offline, so that its watchdog must have
    /// bitten: a fifth more than its time, for the tolerance of its clock. None at all for one that
    /// never bites.
    pub fn silence(self) -> Duration {
        self.time()
            .map_or(Duration::ZERO, |time| time.saturating_add(time / 5))
    }

    /// The longer one of two, where it is not known which the remote uses.
    #[must_use]
    pub fn or_longer(self, other: Self) -> Self {
        match (self.time(), other.time()) {
            (Some(one), Some(two)) if one >= two => self,
            (Some(_), _) => other,
            (None, _) => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_silence_is_60_ms_for_the_usual_watchdog_and_none_for_one_that_is_off() {
        let of = |watchdog: RemoteWatchdog| watchdog.silence().as_millis();
        assert_eq!(of(RemoteWatchdog::Assumed), 60);
        assert_eq!(of(RemoteWatchdog::from_millis(50)), 60);
        assert_eq!(of(RemoteWatchdog::from_millis(200)), 240);
        assert_eq!(of(RemoteWatchdog::from_millis(0)), 0);
    }

    #[test]
    fn one_that_never_bites_is_the_longer_one() {
        let [off, short, long] = [0, 20, 200].map(RemoteWatchdog::from_millis);
        assert_eq!(short.or_longer(long), long);
        assert_eq!(long.or_longer(short), long);
        assert_eq!(
            short.or_longer(RemoteWatchdog::Assumed),
            RemoteWatchdog::Assumed
        );
        assert_eq!(off.or_longer(long), off);
        assert_eq!(long.or_longer(off), off);
    }
}
