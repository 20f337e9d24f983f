//! Reasons why a remote is offline.

use super::Failure;
use crate::sslbp::RemoteName;
use crate::sslbp::{CsStatus, ProcessDataSizes, RemoteFaults};

/// Reason why a remote is offline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum OfflineReason {
    /// The remote was absent when the driver was started.
    #[error("it was absent at the start; plug it in")]
    Absent,
    /// Too many transfers failed in too short a time.
    #[error("too many failed transfers, the last: {0}")]
    TooManyFailures(Failure),
    /// The channel does not run any more.
    #[error("its channel does not run: {0}")]
    NotRunning(CsStatus),
    /// The watchdog of the remote has bitten or it lost power: it needs a START.
    #[error("its watchdog has bitten or its power was off; it is restarted in its mode")]
    Watchdog,
    /// The remote has lost its software mode.
    #[error("it does not know its software mode any more")]
    IllegalMode,
    /// The field power of the remote is missing, too low or too high.
    #[error("{0}: check its field power")]
    FieldPower(
        #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::flags"))] RemoteFaults,
    ),
    /// The remote reported another fault: over-temperature, over-current, no enable, communication.
    #[error("it reported {0}; check its loads and its supply, then re-arm it")]
    Reported(
        #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::flags"))] RemoteFaults,
    ),
    /// START did not succeed; CS contains its progress.
    #[error("it did not start: {0}")]
    DidNotStart(CsStatus),
    /// Another device is on the channel.
    #[error(
        "another device answers ({name}, unit number {unit_number:#010X}); it is not taken over: \
         plug the right one in, or build the driver anew"
    )]
    AnotherDevice {
        /// The name of the device.
        name: RemoteName,
        /// The unit number of the device.
        unit_number: u32,
    },
    /// The right device is on the channel, with tables in another place: another firmware.
    #[error(
        "its tables (GTOC and PTOC) are at {found:08X}, expected {expected:08X}: it has another \
         firmware; build the driver anew with it plugged in"
    )]
    OtherTables {
        /// Interface register 2 after START: GTOC and PTOC of the device.
        found: u32,
        /// The tables for which the pins are made.
        expected: u32,
    },
    /// The right device is on the channel, with other process data: another firmware.
    #[error(
        "its process data is RX {}, TX {} bytes, expected RX {}, TX {}: it has another firmware; \
         build the driver anew with it plugged in",
        found.rx, found.tx, expected.rx, expected.tx
    )]
    OtherSizes {
        /// The sizes of the device.
        found: ProcessDataSizes,
        /// The sizes for which the pins are made.
        expected: ProcessDataSizes,
    },
    /// The port never finished a command.
    #[error("the port never finished a command")]
    PortStuck,
    /// The application switched the port off.
    #[error("its port is switched off")]
    Stopped,
    /// The application asked for a restart.
    #[error("the application asked for a restart")]
    Requested,
    /// The remote did not answer while everything was safe because of the board, whose lines are
    /// dead when its watchdog has bitten or it was reset. Indicates nothing about the remote.
    #[error("the board does not run, and its lines may be dead with it; re-arm")]
    BoardDown,
}

impl OfflineReason {
    /// The reason for a remote that reports these faults.
    ///
    /// Every fault takes the remote offline: a remote with a fault does not take new outputs, and
    /// every transfer feeds its watchdog, so that outputs that are on stay on while transfers
    /// continue (FACTS 1.5).
    pub(super) fn of_faults(faults: RemoteFaults) -> Self {
        let voltage = RemoteFaults::LOW_VOLTAGE.union(RemoteFaults::HIGH_VOLTAGE);
        if faults.contains(RemoteFaults::ILLEGAL_MODE) {
            Self::IllegalMode
        } else if faults.contains(RemoteFaults::WATCHDOG) {
            // After a loss of power the remote has another software mode, and with it its data has
            // another meaning.
            Self::Watchdog
        } else if faults.intersects(voltage) {
            Self::FieldPower(faults)
        } else {
            Self::Reported(faults)
        }
    }

    /// True for a fault that a START clears.
    pub(super) const fn is_cleared_by_start(&self) -> bool {
        matches!(self, Self::Watchdog | Self::IllegalMode | Self::Reported(_))
    }

    /// True if the application requested it, so that there is no fault.
    pub(super) const fn is_asked_for(&self) -> bool {
        matches!(self, Self::Stopped | Self::Requested)
    }

    /// True if another device answers than expected, which is more important than why the remote
    /// went offline.
    pub(super) const fn is_about_identity(&self) -> bool {
        matches!(
            self,
            Self::AnotherDevice { .. } | Self::OtherTables { .. } | Self::OtherSizes { .. }
        )
    }
}

/// Conversion to numbers, which other threads can take without a lock.
impl OfflineReason {
    /// A number for the variant, from 0 on, and two for its fields.
    pub(crate) fn to_words(self) -> (u8, u32, u32) {
        let sizes = |sizes: ProcessDataSizes| u32::from_le_bytes([sizes.rx, sizes.tx, 0, 0]);
        match self {
            Self::Absent => (0, 0, 0),
            Self::TooManyFailures(failure) => (1, failure as u32, 0),
            Self::NotRunning(cs) => (2, cs.0, 0),
            Self::Watchdog => (3, 0, 0),
            Self::IllegalMode => (4, 0, 0),
            Self::FieldPower(faults) => (5, faults.bits().into(), 0),
            Self::Reported(faults) => (6, faults.bits().into(), 0),
            Self::DidNotStart(cs) => (7, cs.0, 0),
            Self::AnotherDevice { name, unit_number } => {
                (8, u32::from_le_bytes(name.0), unit_number)
            }
            Self::OtherTables { found, expected } => (9, found, expected),
            Self::OtherSizes { found, expected } => (10, sizes(found), sizes(expected)),
            Self::PortStuck => (11, 0, 0),
            Self::Stopped => (12, 0, 0),
            Self::Requested => (13, 0, 0),
            Self::BoardDown => (14, 0, 0),
        }
    }

    /// The reason for numbers from [`to_words`](Self::to_words).
    pub(crate) fn from_words((number, one, other): (u8, u32, u32)) -> Option<Self> {
        let faults = RemoteFaults::from_bits_retain(one as u8);
        let sizes = |word: u32| {
            let [rx, tx, ..] = word.to_le_bytes();
            ProcessDataSizes { rx, tx }
        };
        Some(match number {
            0 => Self::Absent,
            1 => Self::TooManyFailures(*Failure::ALL.get(one as usize)?),
            2 => Self::NotRunning(CsStatus(one)),
            3 => Self::Watchdog,
            4 => Self::IllegalMode,
            5 => Self::FieldPower(faults),
            6 => Self::Reported(faults),
            7 => Self::DidNotStart(CsStatus(one)),
            8 => Self::AnotherDevice {
                name: RemoteName::from_register(one),
                unit_number: other,
            },
            9 => Self::OtherTables {
                found: one,
                expected: other,
            },
            10 => Self::OtherSizes {
                found: sizes(one),
                expected: sizes(other),
            },
            11 => Self::PortStuck,
            12 => Self::Stopped,
            13 => Self::Requested,
            14 => Self::BoardDown,
            _ => return None,
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use alloc::vec::Vec;

    /// One reason of each variant, with these fields.
    pub(crate) fn every_reason(one: u32, other: u32) -> Vec<OfflineReason> {
        let numbers = 0..=u8::MAX;
        let reasons = numbers.map_while(|number| OfflineReason::from_words((number, one, other)));
        reasons.collect()
    }

    #[test]
    fn every_reason_comes_back_from_its_numbers() {
        let reasons = every_reason(7, 0xFEDC_0904);
        assert_eq!(reasons.len(), 15);
        for (number, reason) in (0..).zip(reasons) {
            let words = reason.to_words();
            assert_eq!(words.0, number, "{reason:?}");
            assert_eq!(OfflineReason::from_words(words), Some(reason));
        }
        let sizes = |rx, tx| ProcessDataSizes { rx, tx };
        for reason in [
            OfflineReason::OtherSizes {
                found: sizes(1, 255),
                expected: sizes(9, 4),
            },
            OfflineReason::AnotherDevice {
                name: RemoteName(*b"7I72"),
                unit_number: 0x1234_5678,
            },
            OfflineReason::OtherTables {
                found: 0xFEDC_BA98,
                expected: 1,
            },
        ] {
            assert_eq!(OfflineReason::from_words(reason.to_words()), Some(reason));
        }
        for failure in Failure::ALL {
            let reason = OfflineReason::TooManyFailures(failure);
            assert_eq!(OfflineReason::from_words(reason.to_words()), Some(reason));
        }
        let unknown = Failure::ALL.len() as u32;
        assert_eq!(OfflineReason::from_words((1, unknown, 0)), None);
    }
}
