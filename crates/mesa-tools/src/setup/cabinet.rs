//! Parameters of all remotes together: reading, saving, comparing and restoring.

mod serial;
mod value;

use std::collections::BTreeMap;

use super::{CabinetError, advice};
use mesa_hal::RemoteId;
use mesa_hal::boards::AttachError;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::discovery::RemoteDescriptor;
use mesa_hal::driver::{Configured, DriverError};
use mesa_hal::hal::AnyValue;
use mesa_hal::lbp::RemoteAccess;
use mesa_hal::remote::ParameterError;
use mesa_hal::{Advice, MesaError};

pub use serial::SerialCabinet;
pub use value::{SavedValue, parse_value};

/// Remotes in setup mode with readable and writable parameters: those of a
/// [`Configured`] board, or the one on a serial port
/// ([`SerialCabinet`](super::SerialCabinet)).
pub trait Cabinet {
    /// Returns the remotes with their places.
    fn remotes(&self) -> Vec<CabinetRemote>;

    /// Reads a parameter: its bits, right-justified.
    ///
    /// # Errors
    /// The remote does not have the parameter, or an access failed.
    fn read(&mut self, place: RemotePlace, name: &str) -> Result<u64, CabinetError>;

    /// Writes a parameter, and reads it back.
    ///
    /// # Errors
    /// The remote does not have the parameter, cannot take the value, or an access failed.
    fn write(
        &mut self,
        place: RemotePlace,
        name: &str,
        value: AnyValue,
    ) -> Result<(), CabinetError>;

    /// Accesses the memory of a remote, or one of its local locations.
    ///
    /// # Errors
    /// The access failed.
    fn exchange(&mut self, place: RemotePlace, access: RemoteAccess) -> Result<u64, CabinetError>;
}

/// A remote in setup mode.
#[derive(Clone, Debug, PartialEq)]
pub struct CabinetRemote {
    /// Place of the remote.
    pub place: RemotePlace,
    /// Its identity, and the records of its parameters.
    pub descriptor: RemoteDescriptor,
}

/// Place of a remote.
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

#[cfg(feature = "serde")]
impl serde::Serialize for RemotePlace {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<B: RegisterBus + Clock> Cabinet for Configured<B> {
    fn remotes(&self) -> Vec<CabinetRemote> {
        let there = Configured::remotes(self).filter(|(_, remote)| !remote.is_absent());
        let remotes = there.map(|(id, remote)| CabinetRemote {
            place: RemotePlace::Channel(id),
            descriptor: remote.descriptor.clone(),
        });
        remotes.collect()
    }

    fn read(&mut self, place: RemotePlace, name: &str) -> Result<u64, CabinetError> {
        Ok(self.read_remote_parameter(on_board(place)?, name)?.raw)
    }

    fn write(
        &mut self,
        place: RemotePlace,
        name: &str,
        value: AnyValue,
    ) -> Result<(), CabinetError> {
        Ok(self.write_remote_parameter(on_board(place)?, name, value)?)
    }

    fn exchange(&mut self, place: RemotePlace, access: RemoteAccess) -> Result<u64, CabinetError> {
        Ok(self.access_remote(on_board(place)?, access)?)
    }
}

fn on_board(place: RemotePlace) -> Result<RemoteId, DriverError> {
    match place {
        RemotePlace::Channel(id) => Ok(id),
        RemotePlace::Serial => Err(DriverError::Attach(AttachError::NoRemote {
            remote: RemoteId::new(0, 0),
            expected: "remote",
        })),
    }
}

/// Non-volatile parameters of a cabinet's remotes.
///
/// Volatile ones are not saved: they are lost without power anyway, and may drive something.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct SavedCabinet {
    /// Version of this format: 1.
    pub format: u32,
    /// Origin of the file, for people; not read. `None` in older files.
    #[cfg_attr(feature = "serde", serde(default))]
    pub origin: Option<SavedOrigin>,
    /// The remotes.
    pub remotes: Vec<SavedRemote>,
}

/// Origin of saved parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct SavedOrigin {
    /// Date and time in UTC, as in ISO 8601: `2026-11-26T04:30:00Z`.
    pub date: String,
    /// The board, or the serial port of a single card.
    pub board: String,
    /// Firmware of the board; empty for a single card.
    pub firmware: String,
    /// The remotes: place, name and unit number, as in `0.0 7I77 0x12000001`.
    pub unit_numbers: Vec<String>,
}

/// Non-volatile parameters of a remote.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct SavedRemote {
    /// Place of the remote at the time: `PORT.CHANNEL`, or `serial`.
    pub place: String,
    /// Name of the remote, for example `7I77`.
    pub card: String,
    /// Unit number of the remote.
    pub unit_number: u32,
    /// Non-volatile, writable parameters, by name.
    pub parameters: BTreeMap<String, SavedValue>,
}

/// Assignment of a file's remotes to the present ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RemoteMatch {
    /// By name and unit number, at any place.
    #[default]
    UnitNumber,
    /// By name and place: for a card that was replaced by another of its kind.
    Place,
}

/// Differences between a file and the remotes.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Parameters to write.
    pub differences: Vec<CabinetDifference>,
    /// Number of compared parameters.
    pub compared: usize,
    /// Remotes that are present but not in the file.
    pub not_in_file: Vec<RemotePlace>,
}

/// A parameter whose value differs from the file.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct CabinetDifference {
    /// Present place of the remote.
    pub place: RemotePlace,
    /// Name of the remote.
    pub card: String,
    /// Unit number of the present remote.
    pub unit_number: u32,
    /// Name of the parameter.
    pub name: String,
    /// Value in the file; its name is `file` where it is serialized.
    #[cfg_attr(feature = "serde", serde(rename = "file"))]
    pub saved: SavedValue,
    /// Value in the remote.
    pub now: SavedValue,
}

/// Error of a file that does not fit the remotes.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RestoreError {
    /// An access failed.
    #[error(transparent)]
    Cabinet(#[from] CabinetError),
    /// The file was written by another version.
    #[error("the file has format {found}, expected 1")]
    Format {
        /// Format of the file.
        found: u32,
    },
    /// A remote of the file is missing.
    #[error(
        "the file is for a {card} with unit number {unit_number:#010X} (it was on {place}), which is \
         missing; nothing was written"
    )]
    Missing {
        /// Name of the remote.
        card: String,
        /// Unit number of the remote.
        unit_number: u32,
        /// Place of the remote in the file.
        place: String,
    },
    /// Two remotes cannot be distinguished.
    #[error("two {card} have unit number {unit_number:#010X}; nothing was written")]
    Ambiguous {
        /// Name of the remotes.
        card: String,
        /// Unit number of the remotes.
        unit_number: u32,
    },
    /// A parameter does not exist, or cannot take the file's value.
    #[error("{card} on {place}, parameter {name}: {source}; nothing was written")]
    Parameter {
        /// Name of the remote.
        card: String,
        /// Place of the remote.
        place: RemotePlace,
        /// Name of the parameter.
        name: String,
        /// The cause.
        source: ParameterError,
    },
}

impl MesaError for RestoreError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Parameter { source, .. } => source.advice(),
            Self::Cabinet(error) => error.advice(),
            Self::Format { .. } => Some(advice::RESTORE_BY_WRITER),
            Self::Missing { .. } => Some(advice::MATCH_REPLACED),
            Self::Ambiguous { .. } => Some(advice::MATCH_BY_PLACE),
        }
    }
}

impl SavedCabinet {
    /// Version of the format that this crate writes.
    pub const FORMAT: u32 = 1;

    /// Reads the non-volatile parameters of all remotes. Omits a real value that is not finite,
    /// because no file can hold it.
    ///
    /// # Errors
    /// An access failed.
    pub fn take<C: Cabinet>(cabinet: &mut C) -> Result<Self, CabinetError> {
        let mut remotes = Vec::new();
        for CabinetRemote { place, descriptor } in cabinet.remotes() {
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
        Ok(Self {
            format: Self::FORMAT,
            origin: None,
            remotes,
        })
    }

    /// The remotes as in [`SavedOrigin::unit_numbers`].
    pub fn unit_numbers(&self) -> Vec<String> {
        let remotes = self.remotes.iter();
        let number = |remote: &SavedRemote| {
            let SavedRemote {
                place,
                card,
                unit_number,
                ..
            } = remote;
            format!("{place} {card} {unit_number:#010X}")
        };
        remotes.map(number).collect()
    }

    /// Compares the file with the present remotes. Writes nothing.
    ///
    /// # Errors
    /// [`RestoreError`]: the file is not for these remotes, or an access failed.
    pub fn compare<C: Cabinet>(
        &self,
        cabinet: &mut C,
        by: RemoteMatch,
    ) -> Result<Comparison, RestoreError> {
        if self.format != Self::FORMAT {
            let found = self.format;
            return Err(RestoreError::Format { found });
        }
        let there = cabinet.remotes();
        let mut comparison = Comparison {
            differences: Vec::new(),
            compared: 0,
            not_in_file: there.iter().map(|remote| remote.place).collect(),
        };
        for saved in &self.remotes {
            let remote = saved.find(&there, by)?;
            comparison
                .not_in_file
                .retain(|&other| other != remote.place);
            for (name, &value) in &saved.parameters {
                comparison.compared += 1;
                let now = saved.now(cabinet, remote, name, value)?;
                if now != value {
                    comparison.differences.push(CabinetDifference {
                        place: remote.place,
                        card: saved.card.clone(),
                        unit_number: remote.descriptor.unit_number,
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

impl core::fmt::Display for CabinetDifference {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self {
            place,
            card,
            unit_number,
            name,
            saved,
            now,
        } = self;
        write!(
            f,
            "{place}  {card} {unit_number:#010X}  {name}: {now} now, {saved} in the file"
        )
    }
}

impl CabinetDifference {
    /// Writes the file's value, and reads it back.
    ///
    /// # Errors
    /// The remote does not take the value, or an access failed.
    pub fn restore<C: Cabinet>(&self, cabinet: &mut C) -> Result<(), CabinetError> {
        cabinet.write(self.place, &self.name, self.saved.into())
    }
}

impl SavedRemote {
    fn find<'a>(
        &self,
        there: &'a [CabinetRemote],
        by: RemoteMatch,
    ) -> Result<&'a CabinetRemote, RestoreError> {
        let is_it = |remote: &&CabinetRemote| {
            let is_there = match by {
                RemoteMatch::UnitNumber => remote.descriptor.unit_number == self.unit_number,
                RemoteMatch::Place => remote.place.to_string() == self.place,
            };
            is_there && remote.descriptor.name.to_string() == self.card
        };
        let mut found = there.iter().filter(is_it);
        let (card, unit_number) = (self.card.clone(), self.unit_number);
        match (found.next(), found.next()) {
            (Some(remote), None) => Ok(remote),
            (Some(_), Some(_)) => Err(RestoreError::Ambiguous { card, unit_number }),
            (None, _) => Err(RestoreError::Missing {
                card,
                unit_number,
                place: self.place.clone(),
            }),
        }
    }

    /// Present value of a parameter, if the remote has it and can take the file's value.
    fn now<C: Cabinet>(
        &self,
        cabinet: &mut C,
        remote: &CabinetRemote,
        name: &str,
        value: SavedValue,
    ) -> Result<SavedValue, RestoreError> {
        let record = remote.descriptor.parameter(name);
        let record = record.filter(|record| record.is_readable());
        let result = record
            .ok_or(ParameterError::Unknown)
            .and_then(|record| record.raw_of(value.into()).map(|_| record));
        let record = result.map_err(|source| RestoreError::Parameter {
            card: self.card.clone(),
            place: remote.place,
            name: name.to_string(),
            source,
        })?;
        let raw = cabinet.read(remote.place, name)?;
        let now = SavedValue::from(record.typed(raw));
        // A file may contain 50.0 for 50; -1 for an unsigned parameter has been refused above.
        let is_same = record.raw_of(value.into()) == Ok(raw);
        Ok(if is_same { value } else { now })
    }
}

#[cfg(test)]
mod tests;
