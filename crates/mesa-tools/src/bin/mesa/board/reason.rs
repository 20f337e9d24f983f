//! Reasons in messages and reports.

use std::fmt::{self, Display};

use mesa_hal::RemoteLabel;
use mesa_hal::driver::{BoardState, OfflineReason, RemoteState};
use serde::Serialize;

use mesa_tools::advice::told;

/// A reason. It always has words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Reason(String);

impl Reason {
    /// The reason in these words.
    pub fn new(words: impl Display) -> Self {
        let words = words.to_string();
        match words.trim() {
            "" => Self("the reason is not known".to_owned()),
            trimmed => Self(trimmed.to_owned()),
        }
    }
}

impl From<BoardState> for Reason {
    fn from(state: BoardState) -> Self {
        Self::new(state)
    }
}

impl Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// A result in words, with its reason if there is one.
pub fn with_reason(result: &str, reason: Option<&Reason>) -> String {
    match reason {
        Some(reason) => format!("{result}: {reason}"),
        None => result.to_owned(),
    }
}

/// Reason why a remote does not take part in full.
pub fn of_remote(remote: RemoteLabel, state: RemoteState, first: Option<OfflineReason>) -> Reason {
    match (state, first) {
        (RemoteState::Offline { reason, .. } | RemoteState::Restarting { reason }, _) => {
            Reason::new(format_args!("{remote} is offline: {}", told(&reason)))
        }
        (_, Some(first)) => Reason::new(format_args!(
            "{remote} went offline and has not been re-armed since: {}",
            told(&first)
        )),
        (_, None) => Reason::new(format_args!("{remote} does not answer")),
    }
}

#[cfg(test)]
mod tests {
    use mesa_hal::sslbp::RemoteName;

    use super::*;

    #[test]
    fn reason_has_words_whatever_it_is_made_of() {
        for nothing in ["", "  ", "\n"] {
            assert_eq!(Reason::new(nothing).to_string(), "the reason is not known");
        }
        assert_eq!(Reason::new(" a fuse \n").to_string(), "a fuse");
        let states = [
            BoardState::Running,
            BoardState::WatchdogBitten,
            BoardState::Reset,
            BoardState::BusDown,
            BoardState::OtherFirmware,
        ];
        for state in states {
            let text = with_reason("NOT VALID", Some(&state.into()));
            assert!(text.len() > "NOT VALID: the board".len(), "{text}");
        }
        assert_eq!(with_reason("NOT VALID", None), "NOT VALID");
    }

    #[test]
    fn remote_that_runs_is_not_called_offline() {
        let first = Some(OfflineReason::Watchdog);
        let remote = RemoteLabel::new((0, 1), RemoteName(*b"7I77"));
        let running = of_remote(remote, RemoteState::Running, first).to_string();
        assert!(!running.contains("is offline"), "{running}");
        let reason = OfflineReason::Absent;
        let restarting = of_remote(remote, RemoteState::Restarting { reason }, first);
        let restarting = restarting.to_string();
        let begin = "7i77.0.1 is offline: absent at the start";
        assert!(restarting.starts_with(begin), "{restarting}");
    }
}
