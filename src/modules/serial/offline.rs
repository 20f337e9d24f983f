//! Why a remote is offline.

use core::fmt;

use super::Failure;
use crate::sslbp::{CsStatus, ProcessDataSizes, RemoteFaults};

/// Why a remote is offline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum OfflineReason {
    /// It was not there when the driver was started.
    Absent,
    /// Too many transfers failed in too short a time.
    TooManyFailures(Failure),
    /// Its channel does not run any more.
    NotRunning(CsStatus),
    /// Its watchdog has bitten or it lost power: it needs a START.
    Watchdog,
    /// It does not know its software mode any more.
    IllegalMode,
    /// Its field power is missing, too low or too high.
    FieldPower(RemoteFaults),
    /// It reported another fault: over-temperature, over-current, no enable, communication.
    Reported(RemoteFaults),
    /// START did not succeed; CS says how far it came.
    DidNotStart(CsStatus),
    /// Another device is on its channel.
    AnotherDevice {
        /// Interface register 1 after START: its name.
        name: u32,
        /// Interface register 0 after START: its unit number.
        unit_number: u32,
    },
    /// The right device is on its channel, with tables in another place: another firmware.
    OtherTables {
        /// Interface register 2 after START: its GTOC and PTOC.
        found: u32,
        /// What its pins are made for.
        expected: u32,
    },
    /// The right device is on its channel, with other process data: another firmware.
    OtherSizes {
        /// What it exchanges.
        found: ProcessDataSizes,
        /// What its pins are made for.
        expected: ProcessDataSizes,
    },
    /// The port never finished a command.
    PortStuck,
    /// The application switched its port off.
    Stopped,
    /// The application asked for a restart.
    Requested,
}

impl OfflineReason {
    /// Why a remote that reports these faults goes offline; `None` without a fault.
    ///
    /// All of them alike: a remote with a fault does not take outputs over, and every transfer
    /// feeds its watchdog, so that what was on stays on while it is talked to (FACTS 1.5).
    pub fn of_faults(faults: RemoteFaults) -> Option<Self> {
        let voltage = RemoteFaults::LOW_VOLTAGE.union(RemoteFaults::HIGH_VOLTAGE);
        if faults.is_empty() {
            None
        } else if faults.contains(RemoteFaults::ILLEGAL_MODE) {
            Some(Self::IllegalMode)
        } else if faults.contains(RemoteFaults::WATCHDOG) {
            // After a loss of power its software mode is another one, and with it the meaning of
            // its data.
            Some(Self::Watchdog)
        } else if faults.intersects(voltage) {
            Some(Self::FieldPower(faults))
        } else {
            Some(Self::Reported(faults))
        }
    }

    /// Whether what answers is not what was expected: more important than why it went.
    pub(super) const fn is_about_identity(&self) -> bool {
        matches!(
            self,
            Self::AnotherDevice { .. } | Self::OtherTables { .. } | Self::OtherSizes { .. }
        )
    }
}

impl fmt::Display for OfflineReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Absent => f.write_str("it was absent at the start; plug it in"),
            Self::TooManyFailures(failure) => {
                write!(f, "too many failed transfers, the last: {failure}")
            }
            Self::NotRunning(cs) => write!(f, "its channel does not run: {cs}"),
            Self::Watchdog => f.write_str(
                "its watchdog has bitten or its power was off; it is restarted in its mode",
            ),
            Self::IllegalMode => f.write_str("it does not know its software mode any more"),
            Self::FieldPower(faults) => write!(f, "{faults}: check its field power"),
            Self::Reported(faults) => write!(
                f,
                "it reported {faults}; check its loads and its supply, then re-arm it"
            ),
            Self::DidNotStart(cs) => write!(f, "it did not start: {cs}"),
            Self::AnotherDevice { name, unit_number } => write!(
                f,
                "another device answers ({}, unit number {unit_number:#010X}); it is not taken \
                 over: plug the right one in, or build the driver anew",
                crate::discovery::RemoteName::from_register(*name)
            ),
            Self::OtherTables { found, expected } => write!(
                f,
                "its tables (GTOC and PTOC) are at {found:08X}, expected {expected:08X}: it has \
                 another firmware; build the driver anew with it plugged in"
            ),
            Self::OtherSizes { found, expected } => write!(
                f,
                "its process data is RX {}, TX {} bytes, expected RX {}, TX {}: it has another \
                 firmware; build the driver anew with it plugged in",
                found.rx, found.tx, expected.rx, expected.tx
            ),
            Self::PortStuck => f.write_str("the port never finished a command"),
            Self::Stopped => f.write_str("its port is switched off"),
            Self::Requested => f.write_str("the application asked for a restart"),
        }
    }
}
