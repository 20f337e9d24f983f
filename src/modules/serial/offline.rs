//! Why a remote is offline.

use super::Failure;
use crate::sslbp::RemoteName;
use crate::sslbp::{CsStatus, ProcessDataSizes, RemoteFaults};

/// Why a remote is offline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum OfflineReason {
    /// It was not there when the driver was started.
    #[error("it was absent at the start; plug it in")]
    Absent,
    /// Too many transfers failed in too short a time.
    #[error("too many failed transfers, the last: {0}")]
    TooManyFailures(Failure),
    /// Its channel does not run any more.
    #[error("its channel does not run: {0}")]
    NotRunning(CsStatus),
    /// Its watchdog has bitten or it lost power: it needs a START.
    #[error("its watchdog has bitten or its power was off; it is restarted in its mode")]
    Watchdog,
    /// It does not know its software mode any more.
    #[error("it does not know its software mode any more")]
    IllegalMode,
    /// Its field power is missing, too low or too high.
    #[error("{0}: check its field power")]
    FieldPower(
        #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::flags"))] RemoteFaults,
    ),
    /// It reported another fault: over-temperature, over-current, no enable, communication.
    #[error("it reported {0}; check its loads and its supply, then re-arm it")]
    Reported(
        #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::flags"))] RemoteFaults,
    ),
    /// START did not succeed; CS says how far it came.
    #[error("it did not start: {0}")]
    DidNotStart(CsStatus),
    /// Another device is on its channel.
    #[error(
        "another device answers ({name}, unit number {unit_number:#010X}); it is not taken over: \
         plug the right one in, or build the driver anew"
    )]
    AnotherDevice {
        /// Its name.
        name: RemoteName,
        /// Its unit number.
        unit_number: u32,
    },
    /// The right device is on its channel, with tables in another place: another firmware.
    #[error(
        "its tables (GTOC and PTOC) are at {found:08X}, expected {expected:08X}: it has another \
         firmware; build the driver anew with it plugged in"
    )]
    OtherTables {
        /// Interface register 2 after START: its GTOC and PTOC.
        found: u32,
        /// What its pins are made for.
        expected: u32,
    },
    /// The right device is on its channel, with other process data: another firmware.
    #[error(
        "its process data is RX {}, TX {} bytes, expected RX {}, TX {}: it has another firmware; \
         build the driver anew with it plugged in",
        found.rx, found.tx, expected.rx, expected.tx
    )]
    OtherSizes {
        /// What it exchanges.
        found: ProcessDataSizes,
        /// What its pins are made for.
        expected: ProcessDataSizes,
    },
    /// The port never finished a command.
    #[error("the port never finished a command")]
    PortStuck,
    /// The application switched its port off.
    #[error("its port is switched off")]
    Stopped,
    /// The application asked for a restart.
    #[error("the application asked for a restart")]
    Requested,
}

impl OfflineReason {
    /// Why a remote that reports these faults goes offline.
    ///
    /// All of them alike: a remote with a fault does not take outputs over, and every transfer
    /// feeds its watchdog, so that what was on stays on while transfers go on (FACTS 1.5).
    pub(super) fn of_faults(faults: RemoteFaults) -> Self {
        let voltage = RemoteFaults::LOW_VOLTAGE.union(RemoteFaults::HIGH_VOLTAGE);
        if faults.contains(RemoteFaults::ILLEGAL_MODE) {
            Self::IllegalMode
        } else if faults.contains(RemoteFaults::WATCHDOG) {
            // After a loss of power its software mode is another one, and with it the meaning of
            // its data.
            Self::Watchdog
        } else if faults.intersects(voltage) {
            Self::FieldPower(faults)
        } else {
            Self::Reported(faults)
        }
    }

    /// Whether it is a fault that a START clears.
    pub(super) const fn is_cleared_by_start(&self) -> bool {
        matches!(self, Self::Watchdog | Self::IllegalMode | Self::Reported(_))
    }

    /// Whether the application wants it, so that nothing is wrong.
    pub(super) const fn is_asked_for(&self) -> bool {
        matches!(self, Self::Stopped | Self::Requested)
    }

    /// Whether what answers is not what was expected: more important than why it went.
    pub(super) const fn is_about_identity(&self) -> bool {
        matches!(
            self,
            Self::AnotherDevice { .. } | Self::OtherTables { .. } | Self::OtherSizes { .. }
        )
    }
}
