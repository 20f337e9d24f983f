//! Reasons why a remote is offline.

use crate::advice::{self, Advice, MesaError};
use crate::packed::{packed_enum, packed_word};
use crate::sslbp::{
    ComState, CsStatus, Failure, ProcessDataSizes, RemoteFaults, RemoteIdentity, RemoteName,
    StartProblem,
};

packed_enum! {
/// Reason why a remote is offline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum OfflineReason {
    /// The remote was absent when the driver was started.
    #[error("absent at the start")]
    Absent,
    /// Too many transfers failed in too short a time.
    #[error("too many failed transfers, the last: {0}")]
    TooManyFailures(Failure),
    /// The channel does not run any more.
    #[error("the port has stopped the channel ({0})")]
    NotRunning(CsStatus),
    /// The watchdog of the remote has bitten or it lost power: it needs a START.
    #[error("the remote's watchdog has bitten, or its power was off")]
    Watchdog,
    /// The remote has lost its software mode.
    #[error("the remote has lost its software mode")]
    IllegalMode,
    /// The field power of the remote is missing, too low or too high.
    #[error("{0}")]
    FieldPower(
        #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::flags"))] RemoteFaults,
    ),
    /// The remote reported another fault: over-temperature, over-current, no enable, communication.
    #[error("the remote reports {0}")]
    Reported(
        #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::flags"))] RemoteFaults,
    ),
    /// START did not succeed; CS contains its progress.
    #[error("the remote does not start: {}", StartProblem(*.0))]
    DidNotStart(CsStatus),
    /// Another device is on the channel.
    #[error("another card answers: {found}, expected {expected}")]
    AnotherDevice {
        /// The device that answers.
        found: RemoteIdentity,
        /// The remote.
        expected: RemoteIdentity,
    },
    /// The right device is on the channel, with tables in another place: another firmware.
    #[error(
        "the remote's tables (GTOC and PTOC) are at {found:08X}, expected {expected:08X}: it has another \
         firmware"
    )]
    OtherTables {
        /// Interface register 2 after START: GTOC and PTOC of the device.
        found: u32,
        /// The tables for which the pins are made.
        expected: u32,
    },
    /// The right device is on the channel, with other process data: another firmware.
    #[error(
        "the remote's process data is RX {}, TX {} bytes, expected RX {}, TX {}: it has another firmware",
        found.rx, found.tx, expected.rx, expected.tx
    )]
    OtherSizes {
        /// The sizes of the device.
        found: ProcessDataSizes,
        /// The sizes for which the pins are made.
        expected: ProcessDataSizes,
    },
    /// The port never finished a command.
    #[error("the port has not finished a command")]
    PortStuck,
    /// The application switched the port off.
    #[error("the port is switched off")]
    Stopped,
    /// The application asked for a restart.
    #[error("the application has requested a restart")]
    Requested,
    /// The remote did not answer while everything was safe because of the board, whose lines are
    /// dead when its watchdog has bitten or it was reset. Indicates nothing about the remote.
    #[error("the board does not run")]
    BoardDown,
}
}

impl MesaError for OfflineReason {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Absent => Some(advice::PLUG_IN),
            Self::FieldPower(_) => Some(advice::CHECK_FIELD_POWER),
            Self::Reported(_) => Some(advice::CHECK_LOADS),
            Self::AnotherDevice { .. } => Some(advice::PLUG_IN_OR_REBUILD),
            Self::OtherTables { .. } | Self::OtherSizes { .. } => Some(advice::REBUILD_WITH_REMOTE),
            Self::BoardDown => Some(advice::REARM),
            Self::TooManyFailures(failure) => failure.advice(),
            Self::NotRunning(_)
            | Self::Watchdog
            | Self::IllegalMode
            | Self::DidNotStart(_)
            | Self::PortStuck
            | Self::Stopped
            | Self::Requested => None,
        }
    }
}

impl OfflineReason {
    /// The reason for a remote that reports these faults.
    ///
    /// Every fault takes the remote offline: a remote with a fault does not take new outputs, and
    /// every transfer feeds its watchdog, so that outputs that are on stay on while transfers
    /// continue (FACTS 1.5).
    pub(crate) fn of_faults(faults: RemoteFaults) -> Self {
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

    /// The reason for a START that did not succeed, with this CS: a fault that the remote reports
    /// is named as such.
    pub(crate) fn of_failed_start(cs: CsStatus) -> Self {
        if cs.state() == ComState::CheckFaults
            && let reported @ (Self::FieldPower(_) | Self::Reported(_)) =
                Self::of_faults(cs.remote_faults())
        {
            return reported;
        }
        Self::DidNotStart(cs)
    }

    /// True if another device answers than expected, or another firmware of it: no attempt brings
    /// the remote back as long as it is there. It cancels a re-arming.
    pub const fn is_about_identity(&self) -> bool {
        matches!(
            self,
            Self::AnotherDevice { .. } | Self::OtherTables { .. } | Self::OtherSizes { .. }
        )
    }

    /// The present reason of a remote that was offline for the reason `before`, and has not run
    /// since, when this one is found: a restart that fails or is only requested keeps a reason that
    /// it does not contradict.
    pub(crate) fn after(self, before: Self) -> Self {
        match self {
            Self::DidNotStart(_) if matches!(before, Self::Absent | Self::TooManyFailures(_)) => {
                before
            }
            Self::Requested if !matches!(before, Self::BoardDown | Self::Stopped) => before,
            _ => self,
        }
    }

    /// True for a fault that a START clears.
    pub(crate) const fn is_cleared_by_start(&self) -> bool {
        matches!(self, Self::Watchdog | Self::IllegalMode | Self::Reported(_))
    }

    /// True if the application requested it, so that there is no fault.
    pub(crate) const fn is_asked_for(&self) -> bool {
        matches!(self, Self::Stopped | Self::Requested)
    }
}

packed_word!(Failure, |failure| *failure as u64, |number| Self::ALL
    .get(usize::try_from(number).ok()?)
    .copied(),);
packed_word!(CsStatus, |cs| cs.0.into(), |word| Some(Self(word as u32)));
packed_word!(RemoteFaults, |faults| faults.bits().into(), |bits| Some(
    Self::from_bits_retain(bits as u8)
),);
packed_word!(
    RemoteIdentity,
    |id| u64::from(u32::from_le_bytes(id.name.0)) << 32 | u64::from(id.unit_number),
    |word| Some(Self {
        name: RemoteName(((word >> 32) as u32).to_le_bytes()),
        unit_number: word as u32,
    }),
);
packed_word!(
    ProcessDataSizes,
    |sizes| u16::from_le_bytes([sizes.rx, sizes.tx]).into(),
    |word| {
        let [rx, tx] = (word as u16).to_le_bytes();
        Some(Self { rx, tx })
    },
);

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use crate::packed::Packed;
    use crate::packed::tests::{again, every};

    #[test]
    fn every_reason_comes_back_from_its_words() {
        // The fields of a reason differ, so that exchanged fields are not equal.
        for reason in every::<OfflineReason>(&[7, 0xFEDC_0904]) {
            assert_eq!(again(&reason), Some(reason));
        }
        let sizes = |rx, tx| ProcessDataSizes { rx, tx };
        for reason in [
            OfflineReason::OtherSizes {
                found: sizes(1, 255),
                expected: sizes(9, 4),
            },
            OfflineReason::AnotherDevice {
                found: RemoteIdentity {
                    name: RemoteName(*b"7I72"),
                    unit_number: 0x1234_5678,
                },
                expected: RemoteIdentity {
                    name: RemoteName(*b"7I77"),
                    unit_number: 0x1200_0009,
                },
            },
            OfflineReason::OtherTables {
                found: 0xFEDC_BA98,
                expected: 1,
            },
            OfflineReason::NotRunning(CsStatus(u32::MAX)),
            OfflineReason::Reported(RemoteFaults::from_bits_retain(0x81)),
        ] {
            assert_eq!(again(&reason), Some(reason));
        }
        for failure in Failure::ALL {
            let reason = OfflineReason::TooManyFailures(failure);
            assert_eq!(again(&reason), Some(reason));
        }
        let unknown = Failure::ALL.len() as u64;
        assert_eq!(Failure::unpack(&mut core::iter::once(unknown)), None);
    }
}
