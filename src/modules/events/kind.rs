//! The kinds of events.

use crate::hostmot2::RemoteId;
use core::fmt;
use core::time::Duration;

use bitflags::bitflags;

use crate::bus::BusErrorKind;
use crate::modules::serial::OfflineReason;
use crate::sslbp::Failure;

/// The kind of an event.
///
/// Events that may happen in every cycle, [`Repeating`], are reported once for a row of them, and
/// once more for each other reason; their number is reported when the row is over:
/// [`Repeated`](Self::Repeated).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "event", rename_all = "kebab-case"))]
pub enum EventKind {
    /// A transfer of a remote failed; the first of a row with this reason.
    TransferFailed {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteId,
        /// The reason.
        failure: Failure,
    },
    /// A remote went offline: its outputs are safe until it is re-armed.
    RemoteOffline {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteId,
        /// The reason this time. The first reason since the remote was re-armed last stays in
        /// [`RemoteStatus::first_fault`](crate::driver::RemoteStatus::first_fault).
        reason: OfflineReason,
    },
    /// A remote that is offline was tried again, and stays offline for another reason than before.
    RemoteStaysOffline {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteId,
        /// The reason.
        reason: OfflineReason,
    },
    /// A remote that was offline transfers again, with safe outputs until it is re-armed.
    RemoteBack {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteId,
    },
    /// An optional remote that was absent at the start came up. It waits to be armed.
    RemoteUp {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteId,
    },
    /// A remote that had been offline follows the application again; its first fault is cleared.
    RemoteRearmed {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteId,
    },
    /// The board's watchdog was found to have bitten: the host was late, or another program let it
    /// bite. Everything is safe.
    WatchdogBitten,
    /// The board was found to have been reset, or to have lost power, or another program wrote the
    /// time of its watchdog. Everything is safe.
    BoardReset,
    /// The bus failed too often in too short a time. Everything is safe.
    BusDown,
    /// The board got back the set-up that it had lost.
    BoardSetUp,
    /// Another board, or another firmware, answers than at the driver's start. It gets no part of
    /// the driver's set-up, and everything stays safe.
    OtherFirmware,
    /// [`Driver::rearm`](crate::driver::Driver::rearm) let outputs follow the application again.
    Rearmed {
        /// Groups that were armed.
        armed: u32,
        /// Groups that do not run yet.
        waiting: u32,
    },
    /// A read failed; the first of a row with this reason.
    ReadFailed {
        /// The error of the bus.
        why: BusErrorKind,
    },
    /// A read found no HostMot2 board; the first of a row of failed reads.
    NotThere {
        /// Content of the cookie's address.
        found: u32,
    },
    /// A row is over: 10 s have passed without a further event, the remote went offline, or the
    /// driver stops. Not reported if all events of the row were reported one by one.
    Repeated {
        /// The kind of the row.
        #[cfg_attr(feature = "serde", serde(flatten))]
        what: Repeating,
        /// Number of events, including those that were reported.
        count: u32,
        /// Time from the first to the last, in whole milliseconds.
        #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
        lasted: Duration,
    },
    /// A write failed; the first of a row with this reason.
    WriteFailed {
        /// The error of the bus.
        why: BusErrorKind,
    },
    /// Writes are known to be lost; the first of a row.
    LostWrites {
        /// Number in this cycle.
        count: u32,
    },
    /// Periods passed without a good read, where the [board paces](crate::driver::Pace::Board); the
    /// first of a row.
    MissedPeriods {
        /// Number in this cycle.
        count: u32,
    },
    /// The queue was full: from this event on, until it was empty again, events were dropped.
    Dropped {
        /// Number of dropped events.
        count: u32,
    },
    /// A second master drives the board as well; the first of a row.
    OtherMaster {
        /// Number of its packets when it was detected.
        packets: u32,
    },
    /// The application writes and does not read: all inputs are invalid, and everything is safe.
    NotRead {
        /// Number of writes since the last read.
        writes: u32,
    },
}

/// Events that may happen in every cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "what", rename_all = "kebab-case"))]
pub enum Repeating {
    /// [`EventKind::TransferFailed`] of a remote.
    FailedTransfers {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteId,
    },
    /// [`EventKind::ReadFailed`] and [`EventKind::NotThere`].
    FailedReads,
    /// [`EventKind::WriteFailed`].
    FailedWrites,
    /// [`EventKind::LostWrites`].
    LostWrites,
    /// [`EventKind::MissedPeriods`].
    MissedPeriods,
    /// [`EventKind::OtherMaster`], which reports its packets every second.
    OtherMaster,
}

impl fmt::Display for Repeating {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::FailedTransfers { .. } => "transfers failed",
            Self::FailedReads => "reads failed",
            Self::FailedWrites => "writes failed",
            Self::LostWrites => "writes were lost",
            Self::MissedPeriods => "periods went by without a good read",
            Self::OtherMaster => "packets of somebody else came",
        })
    }
}

bitflags! {
    /// Kinds of events, as in
    /// [`TraceSettings::freeze_on`](crate::driver::TraceSettings::freeze_on).
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct EventMask: u32 {
        /// [`EventKind::TransferFailed`].
        const TRANSFER_FAILED = 1 << 0;
        /// [`EventKind::RemoteOffline`].
        const REMOTE_OFFLINE = 1 << 1;
        /// [`EventKind::RemoteStaysOffline`].
        const REMOTE_STAYS_OFFLINE = 1 << 2;
        /// [`EventKind::RemoteBack`].
        const REMOTE_BACK = 1 << 3;
        /// [`EventKind::RemoteUp`].
        const REMOTE_UP = 1 << 4;
        /// [`EventKind::RemoteRearmed`].
        const REMOTE_REARMED = 1 << 5;
        /// [`EventKind::WatchdogBitten`].
        const WATCHDOG_BITTEN = 1 << 6;
        /// [`EventKind::BoardReset`].
        const BOARD_RESET = 1 << 7;
        /// [`EventKind::BusDown`].
        const BUS_DOWN = 1 << 8;
        /// [`EventKind::BoardSetUp`].
        const BOARD_SET_UP = 1 << 9;
        /// [`EventKind::Rearmed`].
        const REARMED = 1 << 10;
        /// [`EventKind::ReadFailed`].
        const READ_FAILED = 1 << 11;
        /// [`EventKind::NotThere`].
        const NOT_THERE = 1 << 12;
        /// [`EventKind::Repeated`].
        const REPEATED = 1 << 13;
        /// [`EventKind::WriteFailed`].
        const WRITE_FAILED = 1 << 14;
        /// [`EventKind::LostWrites`].
        const LOST_WRITES = 1 << 15;
        /// [`EventKind::MissedPeriods`].
        const MISSED_PERIODS = 1 << 16;
        /// [`EventKind::Dropped`].
        const DROPPED = 1 << 17;
        /// [`EventKind::OtherMaster`].
        const OTHER_MASTER = 1 << 18;
        /// [`EventKind::OtherFirmware`].
        const OTHER_FIRMWARE = 1 << 19;
        /// [`EventKind::NotRead`].
        const NOT_READ = 1 << 20;
        /// Events after which outputs are safe until they are re-armed.
        const OUTPUTS_SAFE = Self::REMOTE_OFFLINE.bits()
            | Self::WATCHDOG_BITTEN.bits()
            | Self::BOARD_RESET.bits()
            | Self::BUS_DOWN.bits()
            | Self::NOT_READ.bits();
    }
}

impl EventKind {
    /// The bit of this kind.
    pub const fn mask(&self) -> EventMask {
        match self {
            Self::TransferFailed { .. } => EventMask::TRANSFER_FAILED,
            Self::RemoteOffline { .. } => EventMask::REMOTE_OFFLINE,
            Self::RemoteStaysOffline { .. } => EventMask::REMOTE_STAYS_OFFLINE,
            Self::RemoteBack { .. } => EventMask::REMOTE_BACK,
            Self::RemoteUp { .. } => EventMask::REMOTE_UP,
            Self::RemoteRearmed { .. } => EventMask::REMOTE_REARMED,
            Self::WatchdogBitten => EventMask::WATCHDOG_BITTEN,
            Self::BoardReset => EventMask::BOARD_RESET,
            Self::BusDown => EventMask::BUS_DOWN,
            Self::BoardSetUp => EventMask::BOARD_SET_UP,
            Self::Rearmed { .. } => EventMask::REARMED,
            Self::ReadFailed { .. } => EventMask::READ_FAILED,
            Self::NotThere { .. } => EventMask::NOT_THERE,
            Self::Repeated { .. } => EventMask::REPEATED,
            Self::WriteFailed { .. } => EventMask::WRITE_FAILED,
            Self::LostWrites { .. } => EventMask::LOST_WRITES,
            Self::MissedPeriods { .. } => EventMask::MISSED_PERIODS,
            Self::Dropped { .. } => EventMask::DROPPED,
            Self::OtherMaster { .. } => EventMask::OTHER_MASTER,
            Self::OtherFirmware => EventMask::OTHER_FIRMWARE,
            Self::NotRead { .. } => EventMask::NOT_READ,
        }
    }

    /// True if the event is a fault or a loss. All others report a recovery, or the end of a row.
    pub const fn is_fault(&self) -> bool {
        let well = EventMask::REMOTE_BACK
            .union(EventMask::REMOTE_UP)
            .union(EventMask::REMOTE_REARMED)
            .union(EventMask::BOARD_SET_UP)
            .union(EventMask::REARMED)
            .union(EventMask::REPEATED);
        !well.contains(self.mask())
    }

    /// The remote of an event about one; `None` for other events.
    pub const fn remote(&self) -> Option<RemoteId> {
        match *self {
            Self::TransferFailed { remote, .. }
            | Self::RemoteOffline { remote, .. }
            | Self::RemoteStaysOffline { remote, .. }
            | Self::RemoteBack { remote }
            | Self::RemoteUp { remote }
            | Self::RemoteRearmed { remote }
            | Self::Repeated {
                what: Repeating::FailedTransfers { remote },
                ..
            } => Some(remote),
            _ => None,
        }
    }
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(remote) = self.remote() {
            write!(f, "{remote}: ")?;
        }
        match self {
            Self::TransferFailed { failure, .. } => write!(f, "a transfer failed: {failure}"),
            Self::RemoteOffline { reason, .. } => {
                write!(f, "offline, its outputs are safe: {reason}")
            }
            Self::RemoteStaysOffline { reason, .. } => {
                write!(f, "tried again, and still offline: {reason}")
            }
            Self::RemoteBack { .. } => f.write_str("back; its outputs are safe until re-armed"),
            Self::RemoteUp { .. } => {
                f.write_str("plugged in, and running; its outputs are safe until re-armed")
            }
            Self::RemoteRearmed { .. } => f.write_str("re-armed, its outputs follow again"),
            Self::WatchdogBitten => f.write_str(
                "the board's watchdog has bitten: everything is safe until re-armed; find out why \
                 the host was late, or which other program lets it bite",
            ),
            Self::BoardReset => f.write_str(
                "the board was reset or lost power, or another program wrote its watchdog's time: \
                 everything is safe until re-armed; check its supply, and end the other program",
            ),
            Self::BusDown => f.write_str(
                "the bus failed too often: everything is safe until re-armed; check cable and power",
            ),
            Self::BoardSetUp => f.write_str("the board has its set-up again"),
            Self::OtherFirmware => f.write_str(
                "another board, or another firmware, answers than before, and gets no set-up: \
                 everything stays safe; start the driver anew",
            ),
            Self::Rearmed { armed, waiting: 0 } => {
                write!(f, "re-armed; groups that follow again: {armed}")
            }
            Self::Rearmed { armed, waiting } => write!(
                f,
                "re-armed; groups that follow again: {armed}, that do not run yet: {waiting}"
            ),
            Self::ReadFailed { why } => write!(f, "a read failed: {why}"),
            Self::NotThere { found } => write!(
                f,
                "no HostMot2 board: address 0x0100 reads {found:#010X}, expected 0x55AACAFE"
            ),
            Self::Repeated {
                what,
                count,
                lasted,
            } => write!(
                f,
                "in all {count} {what} within {:.3} s",
                lasted.as_secs_f64()
            ),
            Self::WriteFailed { why } => write!(f, "a write failed: {why}"),
            Self::LostWrites { count } => write!(f, "writes that were lost: {count}"),
            Self::MissedPeriods { count } => write!(f, "periods without a good read: {count}"),
            Self::Dropped { count } => {
                write!(
                    f,
                    "events that were dropped from here on, because nobody took them: {count}"
                )
            }
            Self::OtherMaster { packets } => write!(
                f,
                "somebody else drives this board: within a second it received {packets} packets that \
                 are not ours; end the other program (LinuxCNC, mesaflash, another driver), also \
                 on other hosts"
            ),
            Self::NotRead { writes } => write!(
                f,
                "the application has written {writes} times and not read: no input is valid, and \
                 everything is safe until re-armed; call `read` before each `write`"
            ),
        }
    }
}
