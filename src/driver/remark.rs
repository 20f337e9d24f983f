//! Remarks for the operator: remotes that are missing or unusual, and parts of the board that are
//! not driven.

use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;

use crate::advice::{self, Advice, MesaError};
use crate::boards::{IdentityError, i7i77};
use crate::discovery::{Discovery, Problem, RemoteTable};
use crate::events::OfflineReason;
use crate::modules::Undriven;
use crate::modules::serial::{RemotePart, RemoteWatchdog};
use crate::remote::RemoteError;
use crate::sslbp::{
    MAX_CHANNELS, PortParameters, RemoteLabel, RemoteName, StartFailure, StartFailureReason,
    StartedRemote,
};

/// A remark about a remote that does not take part, an unusual remote, or a part of the board that
/// is not driven.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}{kind}", match .remote {
    Some(remote) => alloc::format!("{remote}: "),
    None => alloc::string::String::new(),
})]
pub struct Remark {
    /// The remote, without a name if it has no pins; `None` for the board itself.
    pub remote: Option<RemoteLabel>,
    /// The kind of the remark, with its data.
    pub kind: RemarkKind,
}

/// Kind of a [`Remark`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RemarkKind {
    /// A module of the firmware, or a part of one, is not driven. Its pins are plain I/O.
    #[error("{0}")]
    Undriven(Box<Undriven>),
    /// Missing: the channel does not exist.
    #[error("this firmware has only {channels} channels on the port")]
    NoSuchChannel {
        /// Number of channels.
        channels: u8,
    },
    /// Missing: the remote did not start; the registers contain the reason.
    #[error(transparent)]
    DidNotStart(StartFailure),
    /// Missing: the remote is not the configured one.
    #[error(transparent)]
    WrongRemote(IdentityError),
    /// Another remote answers than in discovery, when a parameter is to be written.
    #[error(
        "{found} answers, expected the {name} of discovery with the same description; no parameter was \
         written"
    )]
    Changed {
        /// Name of the discovered remote.
        name: RemoteName,
        /// Name of the remote that answers.
        found: RemoteName,
    },
    /// The remote was found, and does not run at the start: its pins are there, not valid, and it
    /// is tried again, as one that goes offline later.
    #[error("card offline: {reason}")]
    Offline {
        /// The reason.
        reason: OfflineReason,
    },
    /// Missing: the pins cannot be made.
    #[error(transparent)]
    Pins(RemoteError),
    /// A problem of the remote's tables. The remote is missing if its process data is uncertain
    /// because of it, so that its pins could be wrong.
    #[error("{0}")]
    Tables(Problem),
    /// The remote's description differs from the built-in table of its kind. Its own description
    /// takes precedence (FACTS 8.5); terminals and ranges of the card's manual may not be true for
    /// it.
    #[error("this {name} differs from the {title}: {difference}; its own description is used")]
    Table {
        /// Name of the remote.
        name: RemoteName,
        /// Title of the table.
        title: &'static str,
        /// The difference, in words.
        difference: String,
    },
    /// The analog part of a 7I77, with the field I/O on the next channel: on the card's connector
    /// the field I/O comes first (FACTS 8.1).
    #[error(
        "the analog part of a 7I77 is on this channel and its field I/O on the next one, expected in the \
         other order"
    )]
    Swapped,
    /// Missing: one part of a 7I77 does not answer, and the other one on a neighbouring channel
    /// does.
    #[error(
        "no reply from the {part}, although the {other} on channel {beside} of the same 7I77 answers"
    )]
    PartSilent {
        /// The part that does not answer.
        part: &'static str,
        /// The part that answers.
        other: &'static str,
        /// The channel of the part that answers.
        beside: u8,
    },
    /// The remote's own watchdog is off, or [slow](RemoteWatchdog::is_slow): its outputs stay on
    /// when it cannot be reached any more.
    #[error(
        "without process data the outputs of this {name} {}",
        match .watchdog.time() {
            Some(time) => alloc::format!("stay on for {}", crate::Rounded(&time)),
            None => "stay on for ever, because its own watchdog is off".into(),
        }
    )]
    SlowWatchdog {
        /// Name of the remote.
        name: RemoteName,
        /// Watchdog of the remote.
        watchdog: RemoteWatchdog,
    },
    /// The port has an older version of SSLBP than this crate was tested with
    /// ([`PortParameters::is_old`]). Reported for the first channel in use, and valid for all of
    /// them.
    #[error("the port has SSLBP {major}.{minor}: {}", PortParameters::OLD_VERSION)]
    OldSslbp {
        /// Major version.
        major: u8,
        /// Minor version.
        minor: u8,
    },
    /// The step generators have a version with faults in the times of their pulses
    /// ([`modules::stepgen`](crate::modules::stepgen)).
    #[error("StepGen (05) version {version}: its pulse times have faults; pulses may be too short")]
    OldStepgen {
        /// Version of the module.
        version: u8,
    },
    /// A remote with the name of a card whose parts differ in the unit number, and with a unit
    /// number of no known part: it has no terminals and no safe values of its own.
    #[error(
        "{name} with unit number {unit_number:#010x}, which no known part of the card has; its pins are \
         made from its own description"
    )]
    UnknownPart {
        /// Name of the remote.
        name: RemoteName,
        /// Unit number of the remote.
        unit_number: u32,
    },
}

impl MesaError for RemarkKind {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Undriven(undriven) => undriven.reason.advice(),
            Self::DidNotStart(failure) => failure.advice(),
            Self::WrongRemote(error) => error.advice(),
            Self::Changed { .. } => Some(advice::PLUG_IN_RIGHT_REMOTE),
            Self::Offline { reason, .. } => reason.advice(),
            Self::Pins(error) => error.advice(),
            Self::Tables(problem) => problem.advice(),
            Self::Table { .. } => Some(advice::CHECK_MANUAL),
            Self::Swapped => Some(advice::EXCHANGE_ON_CONNECTOR),
            Self::PartSilent { .. } => Some(advice::CHECK_CARD_POWER),
            Self::SlowWatchdog { .. } => Some(advice::SET_REMOTE_WATCHDOG),
            Self::OldSslbp { .. } | Self::OldStepgen { .. } => Some(advice::LOAD_NEWER_FIRMWARE),
            Self::NoSuchChannel { .. } | Self::UnknownPart { .. } => None,
        }
    }
}

impl Remark {
    /// True if there is no answer on the channel: nothing is plugged in, or it has no power.
    pub fn is_silent(&self) -> bool {
        matches!(
            &self.kind,
            RemarkKind::DidNotStart(failure) if failure.reason == StartFailureReason::NoReply
        )
    }

    pub(super) fn new(remote: impl Into<RemoteLabel>, kind: RemarkKind) -> Self {
        Self {
            remote: Some(remote.into()),
            kind,
        }
    }

    pub(super) fn of_board(kind: RemarkKind) -> Self {
        Self { remote: None, kind }
    }
}

impl MesaError for Remark {
    fn advice(&self) -> Option<Advice> {
        self.kind.advice()
    }
}

/// Checks that a remote that was started again has the same identity as in discovery, except for
/// CS. The error is the reason for it to be offline.
pub(super) fn is_same(
    is: &StartedRemote,
    outcome: Result<StartedRemote, StartFailure>,
) -> Result<StartedRemote, OfflineReason> {
    let found = outcome.map_err(|failure| OfflineReason::of_failed_start(failure.cs))?;
    let tables = |of: &StartedRemote| u32::from(of.gtoc) << 16 | u32::from(of.ptoc);
    if (found.name, found.unit_number) != (is.name, is.unit_number) {
        Err(OfflineReason::AnotherDevice {
            found: found.identity(),
            expected: is.identity(),
        })
    } else if tables(&found) != tables(is) {
        Err(OfflineReason::OtherTables {
            found: tables(&found),
            expected: tables(is),
        })
    } else if found.sizes != is.sizes {
        Err(OfflineReason::OtherSizes {
            found: found.sizes,
            expected: is.sizes,
        })
    } else {
        Ok(found)
    }
}

/// All remarks about a remote with this built-in table, if any.
pub(super) fn on(
    discovered: &Discovery,
    tables: &[&'static RemoteTable],
    table: Option<&RemoteTable>,
) -> Vec<RemarkKind> {
    let descriptor = &discovered.descriptor;
    let name = descriptor.name;
    let mut kinds = Vec::new();
    if let Some(table) = table {
        let title = table.title;
        let differences = table.differences(descriptor).into_iter();
        kinds.extend(differences.map(|difference| RemarkKind::Table {
            name,
            title,
            difference,
        }));
    } else if tables.iter().any(|table| table.name == name.0) {
        let unit_number = descriptor.unit_number;
        kinds.push(RemarkKind::UnknownPart { name, unit_number });
    }
    kinds.extend(discovered.problems.iter().cloned().map(RemarkKind::Tables));
    kinds
}

/// The channels of a port on which a 7I77 is plugged the wrong way round, unless its analog part
/// could follow the field I/O of the previous channel.
pub(super) fn swapped(remotes: &[RemotePart]) -> impl Iterator<Item = u8> {
    (0..MAX_CHANNELS).filter(|&channel| {
        is(remotes, Some(channel), &i7i77::ANALOG)
            && is(remotes, channel.checked_add(1), &i7i77::FIELD)
            && !is(remotes, channel.checked_sub(1), &i7i77::FIELD)
    })
}

/// Returns the remark for a channel without an answer next to the other part of a 7I77, which
/// points to a fault: on the card's connector the field I/O comes first, then the analog part
/// (FACTS 8.1). `is` returns true if a channel has a remote of a table. `None` if no part is
/// missing there.
pub fn silent_part(
    is: impl Fn(Option<u8>, &RemoteTable) -> bool,
    channel: u8,
) -> Option<RemarkKind> {
    let (field, analog) = (&i7i77::FIELD, &i7i77::ANALOG);
    let (before, after) = (channel.checked_sub(1), channel.checked_add(1));
    let (part, other, beside) = if is(before, field) {
        (analog, field, before)
    } else if is(after, analog) && !is(channel.checked_add(2), field) {
        (field, analog, after)
    } else {
        return None;
    };
    Some(RemarkKind::PartSilent {
        part: part.title,
        other: other.title,
        beside: beside?,
    })
}

/// True if a channel has a remote of that table.
pub(super) fn is(remotes: &[RemotePart], channel: Option<u8>, table: &RemoteTable) -> bool {
    let mut remotes = remotes.iter();
    remotes.any(|remote| {
        Some(remote.started.channel.index()) == channel && table.matches(&remote.descriptor)
    })
}
