//! Is the remote what it should be?

use alloc::vec::Vec;

use super::{ElementTable, RemoteTable};
use crate::discovery::{DataRecord, DataType, RemoteDescriptor, RemoteName};

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

/// Checks what is given of name, top byte of the unit number, and unit number.
pub(crate) fn check_identity(
    descriptor: &RemoteDescriptor,
    (name, class, unit_number): (Option<RemoteName>, Option<u8>, Option<u32>),
) -> Result<(), IdentityError> {
    let actual = descriptor.name;
    if let Some(expected) = name.filter(|&expected| expected != actual) {
        return Err(IdentityError::Name { expected, actual });
    }
    let (name, actual) = (actual, descriptor.unit_number);
    if let Some(expected) = class.filter(|&expected| u32::from(expected) != actual >> 24) {
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

/// What a part of a card is called, by the top byte of its unit number. FACTS 8.1.
fn part(name: RemoteName, class: u8) -> &'static str {
    let mut tables = RemoteTable::KNOWN.into_iter();
    tables
        .find(|table| table.name == name.0 && table.unit_class == Some(class))
        .map_or("another part of the card", |table| table.title)
}

/// A point in which a remote's description differs from the built-in table.
///
/// The remote is believed; this is for people to look at.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Difference {
    /// The table has an element for this mode, and the remote has not.
    Missing {
        /// Its name.
        element: &'static str,
    },
    /// The remote has an element that the table does not know in this mode.
    Unexpected {
        /// The place of its record in the descriptor's `process_data`.
        record: usize,
    },
    /// The elements come in another order.
    Order {
        /// The element that is not where the table has it.
        element: &'static str,
        /// Its place among the elements that are not pads, by the table.
        expected: usize,
        /// And in the remote.
        actual: usize,
    },
    /// Another width.
    Bits {
        /// Which element.
        element: &'static str,
        /// By the table.
        expected: u8,
        /// In the remote.
        actual: u8,
    },
    /// Another type.
    Type {
        /// Which element.
        element: &'static str,
        /// By the table.
        expected: DataType,
        /// In the remote.
        actual: DataType,
    },
    /// Other limits.
    Limits {
        /// Which element.
        element: &'static str,
        /// By the table.
        expected: (f32, f32),
        /// In the remote.
        actual: (f32, f32),
    },
}

impl RemoteTable {
    /// Checks name, the unit number's class and, if one is given, the unit number itself.
    pub fn identify(
        &self,
        descriptor: &RemoteDescriptor,
        unit_number: Option<u32>,
    ) -> Result<(), IdentityError> {
        let name = Some(RemoteName(self.name));
        check_identity(descriptor, (name, self.unit_class, unit_number))
    }

    /// Checks that it is not another kind of card, or another part of it. A unit number that
    /// belongs to no part that is known passes, because an owner can set it: the pins decide.
    pub(crate) fn require(&self, descriptor: &RemoteDescriptor) -> Result<(), IdentityError> {
        let class = (descriptor.unit_number >> 24) as u8;
        let is_named = |table: &&Self| table.name == self.name;
        let mut parts = Self::KNOWN.into_iter().filter(is_named).peekable();
        let is_odd =
            parts.peek().is_some() && parts.all(|part| part.unit_class.is_some_and(|c| c != class));
        match self.identify(descriptor, None) {
            Err(IdentityError::Class { .. }) if is_odd => Ok(()),
            other => other,
        }
    }

    /// Whether a remote is of this kind.
    pub fn matches(&self, descriptor: &RemoteDescriptor) -> bool {
        self.identify(descriptor, None).is_ok()
    }

    /// Where a remote's description differs from this table, in the mode it was started in.
    pub fn differences(&self, descriptor: &RemoteDescriptor) -> Vec<Difference> {
        let mut found = Vec::new();
        let records = || {
            descriptor
                .process_data
                .iter()
                .enumerate()
                .filter(|(_, record)| record.data_type != DataType::Pad)
        };
        let known = || {
            self.of_mode(descriptor.software_mode)
                .filter(|element| element.data_type != DataType::Pad)
        };
        for (expected, element) in known().enumerate() {
            let place = records().position(|(_, record)| is(element, record));
            match place.and_then(|place| records().nth(place).map(|(_, r)| (place, r))) {
                None => found.push(Difference::Missing {
                    element: element.name,
                }),
                Some((actual, record)) => {
                    if actual != expected {
                        found.push(Difference::Order {
                            element: element.name,
                            expected,
                            actual,
                        });
                    }
                    compare(element, record, &mut found);
                }
            }
        }
        found.extend(
            records()
                .filter(|(_, record)| !known().any(|element| is(element, record)))
                .map(|(record, _)| Difference::Unexpected { record }),
        );
        found
    }
}

fn is(element: &ElementTable, record: &DataRecord) -> bool {
    record.name == element.name && record.direction == element.direction
}

// Limits are compared as the device wrote them: nothing was computed.
#[allow(clippy::float_cmp)]
fn compare(element: &ElementTable, record: &DataRecord, found: &mut Vec<Difference>) {
    if record.bits != element.bits {
        found.push(Difference::Bits {
            element: element.name,
            expected: element.bits,
            actual: record.bits,
        });
    }
    if record.data_type != element.data_type {
        found.push(Difference::Type {
            element: element.name,
            expected: element.data_type,
            actual: record.data_type,
        });
    }
    let actual = (record.min, record.max);
    if let Some(expected) = element.limits.filter(|&expected| expected != actual) {
        found.push(Difference::Limits {
            element: element.name,
            expected,
            actual,
        });
    }
}

impl core::fmt::Display for Difference {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Missing { element } => write!(f, "it has no {element}"),
            Self::Unexpected { record } => {
                write!(
                    f,
                    "element {record} of its process data is not in the table"
                )
            }
            Self::Order {
                element,
                expected,
                actual,
            } => write!(f, "{element} is element {actual}, by the table {expected}"),
            Self::Bits {
                element,
                expected,
                actual,
            } => write!(f, "{element} has {actual} bits, by the table {expected}"),
            Self::Type {
                element,
                expected,
                actual,
            } => write!(f, "{element} is {actual:?}, by the table {expected:?}"),
            Self::Limits {
                element,
                expected: (min, max),
                actual: (least, most),
            } => write!(
                f,
                "{element} goes from {least} to {most}, by the table from {min} to {max}"
            ),
        }
    }
}
