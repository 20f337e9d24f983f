//! Words of the manuals for RPD and WPD: values of a remote that are no records of parameters, and
//! other spellings of those that are.

use super::{Cabinet, CabinetError, RemotePlace};
use mesa_hal::discovery::{DataDirection, DataRecord, RemoteDescriptor};
use mesa_hal::lbp::{AccessSize, LocalLocation, RemoteAccess};
use mesa_hal::modules::serial::WATCHDOG_PARAMETER;

/// The manuals' other word for [`WATCHDOG_PARAMETER`].
const NVWATCHDOGTIME: &str = "nvwatchdogtime";

/// Bits of one access.
const PIECES: [AccessSize; 4] = [
    AccessSize::Double,
    AccessSize::Long,
    AccessSize::Word,
    AccessSize::Byte,
];

/// The parameter with a name: that of its record in any case, or the manuals' word for it.
///
/// Manual: 7I77, "FIELD I/O PARAMETERS" and "RPD, WPD, AND UFLBP".
pub fn parameter_named<'a>(descriptor: &'a RemoteDescriptor, name: &str) -> Option<&'a DataRecord> {
    let other = || {
        let is_word = name.eq_ignore_ascii_case(NVWATCHDOGTIME);
        is_word.then(|| descriptor.parameter(WATCHDOG_PARAMETER))?
    };
    descriptor.parameter(name).or_else(other)
}

/// A value of a remote that is no record of a parameter, but that the manuals' RPD and WPD know by
/// name.
///
/// Manual: 7I77, "RPD, WPD, AND UFLBP", "LOCAL LBP READ COMMANDS"; FACTS 1.3.
#[derive(Clone, Debug, PartialEq)]
pub enum ManualWord {
    /// FAULT: the fault byte. Writing 0 clears the faults.
    Fault,
    /// STATUS: the status of LBP. Writing 0 clears it.
    Status,
    /// OUTPUT: the digital outputs in the remote's memory. A write drives them, unless a fault is
    /// set.
    Output(DataRecord),
}

impl ManualWord {
    /// The words that apply to a remote: none to one without tables.
    pub fn of(descriptor: &RemoteDescriptor) -> Vec<Self> {
        if descriptor.parameters.is_empty() {
            return Vec::new();
        }
        let output = descriptor.process_data.iter().find(|record| {
            let bits = record.bits;
            record.is_named("output")
                && record.direction != DataDirection::Input
                && (8..=64).contains(&bits)
                && bits % 8 == 0
        });
        let output = output.cloned().map(Self::Output);
        [Self::Fault, Self::Status]
            .into_iter()
            .chain(output)
            .collect()
    }

    /// The word with this name, in any case, if it applies to the remote.
    pub fn find(descriptor: &RemoteDescriptor, name: &str) -> Option<Self> {
        let mut words = Self::of(descriptor).into_iter();
        words.find(|word| word.name().eq_ignore_ascii_case(name))
    }

    /// The word, as in the manuals.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Fault => "FAULT",
            Self::Status => "STATUS",
            Self::Output(_) => "OUTPUT",
        }
    }

    /// Width of the value.
    pub const fn bits(&self) -> u8 {
        match self {
            Self::Fault | Self::Status => 8,
            Self::Output(record) => record.bits,
        }
    }

    /// The highest value that can be written: 0 where a write only clears.
    pub const fn highest(&self) -> u64 {
        match self {
            Self::Fault | Self::Status => 0,
            Self::Output(record) => u64::MAX >> 64_u8.saturating_sub(record.bits),
        }
    }

    /// Reads the value.
    ///
    /// # Errors
    /// An access failed.
    pub fn read<C: Cabinet>(
        &self,
        cabinet: &mut C,
        place: RemotePlace,
    ) -> Result<u64, CabinetError> {
        match self {
            Self::Fault => local(cabinet, place, LocalLocation::FAULTS),
            Self::Status => local(cabinet, place, LocalLocation::STATUS),
            Self::Output(record) => pieces(record).try_fold(0, |value, (at, size)| {
                let address = record.address.wrapping_add(u16::from(at / 8));
                let piece = cabinet.exchange(place, RemoteAccess::Read { address, size })?;
                Ok(value | (piece & size.mask()) << at)
            }),
        }
    }

    /// Writes a value up to [`highest`](Self::highest).
    ///
    /// # Errors
    /// An access failed.
    pub fn write<C: Cabinet>(
        &self,
        cabinet: &mut C,
        place: RemotePlace,
        value: u64,
    ) -> Result<(), CabinetError> {
        match self {
            Self::Fault => {
                let clear = RemoteAccess::WriteLocal(LocalLocation::CLEAR_FAULTS, 0xFF);
                cabinet.exchange(place, clear).map(drop)
            }
            Self::Status => {
                let clear = RemoteAccess::WriteLocal(LocalLocation::STATUS, 0);
                cabinet.exchange(place, clear).map(drop)
            }
            Self::Output(record) => pieces(record).try_for_each(|(at, size)| {
                let write = RemoteAccess::Write {
                    address: record.address.wrapping_add(u16::from(at / 8)),
                    size,
                    value: value >> at & size.mask(),
                };
                cabinet.exchange(place, write).map(drop)
            }),
        }
    }
}

fn local<C: Cabinet>(
    cabinet: &mut C,
    place: RemotePlace,
    location: LocalLocation,
) -> Result<u64, CabinetError> {
    let read = cabinet.exchange(place, RemoteAccess::ReadLocal(location));
    read.map(|value| value & 0xFF)
}

/// Accesses that reach exactly the bytes of an element: first bit and size. One access may be wider
/// than the element, and reach into the next one.
fn pieces(record: &DataRecord) -> impl Iterator<Item = (u8, AccessSize)> {
    let (bits, mut at) = (record.bits, 0_u8);
    core::iter::from_fn(move || {
        let left = bits.saturating_sub(at);
        let size = PIECES.into_iter().find(|size| size.bytes() * 8 <= left)?;
        let first = at;
        at = at.saturating_add(size.bytes() * 8);
        Some((first, size))
    })
}
