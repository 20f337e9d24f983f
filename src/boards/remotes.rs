//! The built-in tables of remotes, and the comparison of a remote with its table.

use alloc::format;

use super::attach::FoundDescription;
use super::{AttachError, Finder, IdentityError, RemoteHandles, i7i64, i7i72, i7i77};
use crate::advice;
use crate::discovery::{RemoteDescriptor, RemoteTable};
use crate::hal::Pins;
use crate::hostmot2::RemoteId;
use crate::sslbp::{RemoteLabel, RemoteName};

/// The built-in tables of remotes.
pub const REMOTES: [&RemoteTable; 4] = [
    &i7i77::FIELD,
    &i7i77::ANALOG,
    &i7i72::REMOTE,
    &i7i64::REMOTE,
];

/// Checks the kind and the unit number of a remote, as far as they are given.
pub(crate) fn check_identity(
    descriptor: &RemoteDescriptor,
    kind: Option<&RemoteTable>,
    unit_number: Option<u32>,
) -> Result<(), IdentityError> {
    let (name, actual) = (descriptor.name, descriptor.unit_number);
    if let Some(kind) = kind.filter(|kind| kind.name != name.0) {
        return Err(IdentityError {
            actual: format!("a {name} answers"),
            expected: format!("a {}", RemoteName(kind.name)),
            advice: advice::CHECK_SWAPPED_CABLES,
        });
    }
    if let Some(kind) = kind.filter(|kind| !kind.matches(descriptor)) {
        let part = REMOTES.iter().find(|table| table.matches(descriptor));
        let part = part.map_or("another part of the card", |table| table.title);
        return Err(IdentityError {
            actual: format!(
                "the {name} with unit number {actual:#010x} is {part}, because the channels are swapped"
            ),
            expected: kind.title.into(),
            advice: advice::EXCHANGE_CHANNELS,
        });
    }
    match unit_number.filter(|&expected| expected != actual) {
        Some(expected) => Err(IdentityError {
            actual: format!("a {name} with unit number {actual:#010x} answers"),
            expected: format!("{expected:#010x}"),
            advice: advice::SEE_LABEL,
        }),
        None => Ok(()),
    }
}

/// Checks that the remote is not another kind of card, or another part of it. A unit number that
/// matches no known part is accepted, because the user can set it: the pins decide.
fn require(table: &RemoteTable, descriptor: &RemoteDescriptor) -> Result<(), IdentityError> {
    let mut parts = REMOTES.iter().filter(|known| known.name == table.name);
    let is_known = parts.clone().next().is_none() || parts.any(|part| part.matches(descriptor));
    let unit_class = table.unit_class.filter(|_| is_known);
    let kind = RemoteTable {
        unit_class,
        ..*table
    };
    check_identity(descriptor, Some(&kind), None)
}

impl RemoteTable {
    /// Finds the handles of a remote of exactly this kind, by its description and the prefix of its
    /// pins.
    pub(crate) fn attach<T: RemoteHandles>(
        pins: &Pins,
        found: FoundDescription<'_>,
        remote: RemoteId,
    ) -> Result<T, AttachError> {
        let (descriptor, prefix) = found.ok_or(AttachError::NoRemote {
            remote,
            expected: T::TABLE.title,
        })?;
        require(T::TABLE, descriptor).map_err(|source| AttachError::Identity {
            remote: RemoteLabel::new(remote, descriptor.name),
            source,
        })?;
        T::find(&Finder::new(pins, prefix, T::TABLE.title))
    }
}
