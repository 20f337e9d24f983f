//! Is the remote what it should be?

use super::{i7i64, i7i72, i7i77};
use crate::discovery::{RemoteDescriptor, RemoteName, RemoteTable};

/// The tables of remotes that are built in.
pub const REMOTES: [&RemoteTable; 4] = [
    &i7i77::FIELD,
    &i7i77::ANALOG,
    &i7i72::REMOTE,
    &i7i64::REMOTE,
];

/// A remote that is not the one asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentityError {
    /// Another kind of card.
    #[error("a {actual} answers where a {expected} was expected (are the cables swapped?)")]
    Name {
        /// What was expected.
        expected: RemoteName,
        /// What answers.
        actual: RemoteName,
    },
    /// Another part of a card whose parts share a name, told apart by the unit number's top byte.
    #[error(
        "the {name} with unit number {actual:#010x} is {}, and {} was expected here: the channels are swapped; exchange them in the configuration, or the card's cables",
        part(*name, (*actual >> 24) as u8),
        part(*name, *expected)
    )]
    Class {
        /// Its name.
        name: RemoteName,
        /// The top byte expected.
        expected: u8,
        /// The unit number it has.
        actual: u32,
    },
    /// Another card of the same kind.
    #[error(
        "{name} has unit number {actual:#010x}, and {expected:#010x} was expected (see the label on the card)"
    )]
    Unit {
        /// Its name.
        name: RemoteName,
        /// The unit number expected.
        expected: u32,
        /// The unit number it has.
        actual: u32,
    },
}

/// Checks that a remote is of a kind, and has a unit number, as far as they are given.
pub(crate) fn check_identity(
    descriptor: &RemoteDescriptor,
    kind: Option<&RemoteTable>,
    unit_number: Option<u32>,
) -> Result<(), IdentityError> {
    let (name, actual) = (descriptor.name, descriptor.unit_number);
    if let Some(kind) = kind.filter(|kind| kind.name != name.0) {
        return Err(IdentityError::Name {
            expected: RemoteName(kind.name),
            actual: name,
        });
    }
    if let Some(expected) = kind.and_then(|kind| kind.unit_class)
        && u32::from(expected) != actual >> 24
    {
        return Err(IdentityError::Class {
            name,
            expected,
            actual,
        });
    }
    match unit_number.filter(|&expected| expected != actual) {
        Some(expected) => Err(IdentityError::Unit {
            name,
            expected,
            actual,
        }),
        None => Ok(()),
    }
}

/// Checks that it is not another kind of card, or another part of it. A unit number that belongs to
/// no part that is known passes, because an owner can set it: the pins decide.
pub(super) fn require(
    table: &RemoteTable,
    descriptor: &RemoteDescriptor,
) -> Result<(), IdentityError> {
    let mut parts = REMOTES.iter().filter(|known| known.name == table.name);
    match check_identity(descriptor, Some(table), None) {
        Err(IdentityError::Class { .. })
            if parts.clone().next().is_some() && !parts.any(|part| part.matches(descriptor)) =>
        {
            Ok(())
        }
        other => other,
    }
}

/// What a part of a card is called, by the top byte of its unit number. FACTS 8.1.
fn part(name: RemoteName, class: u8) -> &'static str {
    let mut tables = REMOTES.into_iter();
    tables
        .find(|table| table.name == name.0 && table.unit_class == Some(class))
        .map_or("another part of the card", |table| table.title)
}
