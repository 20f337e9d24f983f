//! The parameters of all remotes at once: read, kept in a file, compared, and put back.

use core::convert::Infallible;
use core::error::Error;
use std::collections::BTreeMap;

use mesa_hal::RemoteId;
use mesa_hal::boards::AttachError;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::discovery::RemoteDescriptor;
use mesa_hal::driver::{Board, DriverError};
use mesa_hal::hal::{AnyValue, HalType};
use mesa_hal::remote::ParameterError;

/// Remotes in setup mode, whose parameters can be read and written: those of a [`Board`] after
/// [`discover`](Board::discover), or the one on a serial port
/// ([`SerialCabinet`](super::SerialCabinet)).
pub trait Cabinet {
    /// Why a parameter was not read or written.
    type Error: Error + 'static;

    /// What is there, with its place.
    fn remotes(&self) -> Vec<(RemotePlace, RemoteDescriptor)>;

    /// Reads a parameter: its bits, right-justified.
    ///
    /// # Errors
    /// The remote does not have it, or an access failed.
    fn read(&mut self, place: RemotePlace, name: &str) -> Result<u64, Self::Error>;

    /// Writes a parameter, and reads it back.
    ///
    /// # Errors
    /// The remote does not have it, can not take the value, or an access failed.
    fn write(&mut self, place: RemotePlace, name: &str, value: AnyValue)
    -> Result<(), Self::Error>;
}

/// Where a remote is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RemotePlace {
    /// On a channel of a board's serial port.
    Channel(RemoteId),
    /// On a serial port of the host.
    Serial,
}

impl core::fmt::Display for RemotePlace {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Channel(RemoteId { port, channel }) => write!(f, "{port}.{channel}"),
            Self::Serial => f.write_str("serial"),
        }
    }
}

impl<B: RegisterBus + Clock> Cabinet for Board<B> {
    type Error = DriverError<B::Error>;

    fn remotes(&self) -> Vec<(RemotePlace, RemoteDescriptor)> {
        let there = Board::remotes(self).filter(|(_, remote)| !remote.is_absent);
        there
            .map(|(id, remote)| (RemotePlace::Channel(id), remote.descriptor.clone()))
            .collect()
    }

    fn read(&mut self, place: RemotePlace, name: &str) -> Result<u64, Self::Error> {
        Ok(self.read_remote_parameter(on_board(place)?, name)?.raw)
    }

    fn write(
        &mut self,
        place: RemotePlace,
        name: &str,
        value: AnyValue,
    ) -> Result<(), Self::Error> {
        self.write_remote_parameter(on_board(place)?, name, value)
    }
}

fn on_board<E: mesa_hal::bus::BusError>(place: RemotePlace) -> Result<RemoteId, DriverError<E>> {
    match place {
        RemotePlace::Channel(id) => Ok(id),
        RemotePlace::Serial => Err(DriverError::Attach(AttachError::NoRemote {
            remote: RemoteId::new(0, 0),
            expected: "remote",
        })),
    }
}

/// What the remotes of a cabinet keep in non-volatile memory.
///
/// Only that: what is lost without power is not worth keeping, and may drive something.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct SavedCabinet {
    /// Version of this format: 1.
    pub format: u32,
    /// The remotes.
    pub remotes: Vec<SavedRemote>,
}

/// What a remote keeps in non-volatile memory.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct SavedRemote {
    /// Where it was: `PORT.CHANNEL`, or `serial`.
    pub place: String,
    /// Its name, for example `7I77`.
    pub card: String,
    /// Its unit number.
    pub unit_number: u32,
    /// Its non-volatile parameters that can be written, by name.
    pub parameters: BTreeMap<String, SavedValue>,
}

/// The value of a parameter as LinuxCNC has it: without its scale.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(untagged))]
pub enum SavedValue {
    /// A whole number, or a truth value as 0 or 1.
    Whole(i64),
    /// A whole number above 2^63.
    Wide(u64),
    /// A real number.
    Real(f64),
}

impl From<AnyValue> for SavedValue {
    fn from(value: AnyValue) -> Self {
        match value.hal_type {
            HalType::Float => Self::Real(f64::from_bits(value.bits)),
            HalType::S32 | HalType::S64 => Self::Whole(value.bits as i64),
            HalType::Bit | HalType::U32 | HalType::U64 => {
                i64::try_from(value.bits).map_or(Self::Wide(value.bits), Self::Whole)
            }
        }
    }
}

impl From<SavedValue> for AnyValue {
    fn from(value: SavedValue) -> Self {
        match value {
            SavedValue::Whole(value) => value.into(),
            SavedValue::Wide(value) => value.into(),
            SavedValue::Real(value) => value.into(),
        }
    }
}

impl core::fmt::Display for SavedValue {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Whole(value) => value.fmt(f),
            Self::Wide(value) => value.fmt(f),
            Self::Real(value) => value.fmt(f),
        }
    }
}

/// How the remotes of a file are found again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Match {
    /// By name and unit number, wherever they are.
    #[default]
    UnitNumber,
    /// By name and place: for a card that was replaced by another of its kind.
    Place,
}

/// What a file has, and the remotes have not.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// What would be written.
    pub differences: Vec<Difference>,
    /// Parameters that were compared.
    pub compared: usize,
    /// Remotes that are there, and not in the file.
    pub not_in_file: Vec<RemotePlace>,
}

/// A parameter that is not what the file says.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Where the remote is now.
    pub place: RemotePlace,
    /// Its name.
    pub card: String,
    /// The unit number of the remote that is there.
    pub unit_number: u32,
    /// The parameter.
    pub name: String,
    /// What the file says.
    pub saved: SavedValue,
    /// What the remote has.
    pub now: SavedValue,
}

/// Why a file is not for these remotes.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RestoreError<E: Error + 'static> {
    /// An access failed.
    #[error(transparent)]
    Cabinet(#[from] E),
    /// It was written by another version.
    #[error("the file has format {found}, expected 1; restore it with the version that wrote it")]
    Format {
        /// Its format.
        found: u32,
    },
    /// A remote of the file is not there.
    #[error(
        "the file is for a {card} with unit number {unit_number:#010X} (it was on {place}), which is not \
         there; nothing was written. For a card that was replaced by another of its kind, match by place"
    )]
    Missing {
        /// Its name.
        card: String,
        /// Its unit number.
        unit_number: u32,
        /// Where it was.
        place: String,
    },
    /// Two remotes can not be told apart.
    #[error(
        "there are two {card} with unit number {unit_number:#010X}; nothing was written. Match them by \
         place"
    )]
    Ambiguous {
        /// Their name.
        card: String,
        /// Their unit number.
        unit_number: u32,
    },
    /// A parameter is not there, or can not be what the file says.
    #[error("{card} on {place}, parameter {name}: {source}; nothing was written")]
    Parameter {
        /// The remote's name.
        card: String,
        /// Where it is.
        place: RemotePlace,
        /// The parameter.
        name: String,
        /// Why.
        source: ParameterError<Infallible>,
    },
}

impl SavedCabinet {
    /// The version of the format that is written here.
    pub const FORMAT: u32 = 1;

    /// Reads what all remotes keep. A real number that is none is left out: no file can hold it.
    ///
    /// # Errors
    /// An access failed.
    pub fn take<C: Cabinet>(cabinet: &mut C) -> Result<Self, C::Error> {
        let mut remotes = Vec::new();
        for (place, descriptor) in cabinet.remotes() {
            let mut parameters = BTreeMap::new();
            let records = descriptor.parameters.iter();
            for record in records.filter(|record| record.is_kept()) {
                let value = record.typed(cabinet.read(place, &record.name)?);
                if value.is_finite() {
                    parameters.insert(record.name.clone(), value.into());
                }
            }
            remotes.push(SavedRemote {
                place: place.to_string(),
                card: descriptor.name.to_string(),
                unit_number: descriptor.unit_number,
                parameters,
            });
        }
        let format = Self::FORMAT;
        Ok(Self { format, remotes })
    }

    /// Compares with what is there. Writes nothing.
    ///
    /// # Errors
    /// [`RestoreError`]: the file is not for these remotes, or an access failed.
    pub fn compare<C: Cabinet>(
        &self,
        cabinet: &mut C,
        by: Match,
    ) -> Result<Comparison, RestoreError<C::Error>> {
        if self.format != Self::FORMAT {
            let found = self.format;
            return Err(RestoreError::Format { found });
        }
        let there = cabinet.remotes();
        let mut comparison = Comparison {
            differences: Vec::new(),
            compared: 0,
            not_in_file: there.iter().map(|&(place, _)| place).collect(),
        };
        for saved in &self.remotes {
            let (place, descriptor) = saved.find(&there, by)?;
            comparison.not_in_file.retain(|&other| other != place);
            for (name, &value) in &saved.parameters {
                comparison.compared += 1;
                let now = saved.now(cabinet, (place, descriptor), name, value)?;
                if now != value {
                    comparison.differences.push(Difference {
                        place,
                        card: saved.card.clone(),
                        unit_number: descriptor.unit_number,
                        name: name.clone(),
                        saved: value,
                        now,
                    });
                }
            }
        }
        Ok(comparison)
    }
}

impl Difference {
    /// Writes what the file says, and reads it back.
    ///
    /// # Errors
    /// The remote does not take it, or an access failed.
    pub fn restore<C: Cabinet>(&self, cabinet: &mut C) -> Result<(), C::Error> {
        cabinet.write(self.place, &self.name, self.saved.into())
    }
}

impl SavedRemote {
    fn find<'a, E: Error>(
        &self,
        there: &'a [(RemotePlace, RemoteDescriptor)],
        by: Match,
    ) -> Result<(RemotePlace, &'a RemoteDescriptor), RestoreError<E>> {
        let is_it = |(place, descriptor): &&(RemotePlace, RemoteDescriptor)| {
            let is_there = match by {
                Match::UnitNumber => descriptor.unit_number == self.unit_number,
                Match::Place => place.to_string() == self.place,
            };
            is_there && descriptor.name.to_string() == self.card
        };
        let mut found = there.iter().filter(is_it);
        let (card, unit_number) = (self.card.clone(), self.unit_number);
        match (found.next(), found.next()) {
            (Some((place, descriptor)), None) => Ok((*place, descriptor)),
            (Some(_), Some(_)) => Err(RestoreError::Ambiguous { card, unit_number }),
            (None, _) => Err(RestoreError::Missing {
                card,
                unit_number,
                place: self.place.clone(),
            }),
        }
    }

    /// What a parameter is now, if the remote has it and can take what the file says.
    fn now<C: Cabinet>(
        &self,
        cabinet: &mut C,
        (place, descriptor): (RemotePlace, &RemoteDescriptor),
        name: &str,
        value: SavedValue,
    ) -> Result<SavedValue, RestoreError<C::Error>> {
        let record = descriptor.parameter(name);
        let record = record.filter(|record| record.is_readable());
        let result = record
            .ok_or(ParameterError::Unknown)
            .and_then(|record| record.raw_of(value.into()).map(|_| record));
        let record = result.map_err(|source| RestoreError::Parameter {
            card: self.card.clone(),
            place,
            name: name.to_string(),
            source,
        })?;
        let raw = cabinet.read(place, name)?;
        let now = SavedValue::from(record.typed(raw));
        // A file may have 50.0 for 50, and -1 for what has no sign is refused above.
        let is_same = record.raw_of::<Infallible>(value.into()) == Ok(raw);
        Ok(if is_same { value } else { now })
    }
}

/// A number as people write it: decimal, hexadecimal after `0x`, or real.
///
/// # Errors
/// Gives the text back if it is no number.
pub fn parse_value(text: &str) -> Result<AnyValue, &str> {
    let hex = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let whole = match hex {
        Some(hex) => u64::from_str_radix(hex, 16).ok(),
        None => text.parse().ok(),
    };
    let signed = || text.parse::<i64>().ok().map(AnyValue::from);
    let real = || text.parse::<f64>().ok().filter(|real| real.is_finite());
    whole
        .map(AnyValue::from)
        .or_else(signed)
        .or_else(|| real().map(AnyValue::from))
        .ok_or(text)
}

#[cfg(test)]
mod tests;
