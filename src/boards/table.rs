//! What is known of a remote beforehand: thin data over what it says of itself.

use alloc::vec::Vec;

use super::Terminals;
use crate::discovery::{DataDirection, DataRecord, DataType, RemoteDescriptor, RemoteName};

/// What is known of one element of a remote's process data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementTable {
    /// Its name in the remote.
    pub name: &'static str,
    /// Its width.
    pub bits: u8,
    /// Its type.
    pub data_type: DataType,
    /// Which way it goes.
    pub direction: DataDirection,
    /// Its limits, as the record has them; `None` where they mean nothing.
    pub limits: Option<(f32, f32)>,
    /// Its unit, used where the record names none.
    pub unit: &'static str,
    /// The software modes that have it: bit n for mode n.
    pub modes: u16,
    /// The terminals it is at: by bit for BITS, otherwise those of the whole element.
    pub terminals: &'static [Terminals],
    /// The value its output has when nothing else is said: 0 is off and 0 V.
    pub safe: f64,
}

/// What is known of a kind of remote.
///
/// It names terminals and safe values, and is what the remote's own description is compared with.
/// The remote's description decides (FACTS 8.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemoteTable {
    /// What it is, for people: `7I77 field I/O`.
    pub title: &'static str,
    /// What it calls itself.
    pub name: [u8; 4],
    /// The top byte of its unit number, where cards of one name are told apart by it.
    pub unit_class: Option<u8>,
    /// Its elements, in the order of its PTOC.
    pub elements: &'static [ElementTable],
    /// Where its tables of contents are, for each software mode in which that is known. A remote
    /// that is absent at start is held against it when it is plugged in.
    pub contents: &'static [Contents],
}

/// Where a remote has its tables of contents in a software mode, which differs from firmware to
/// firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contents {
    /// The software mode.
    pub mode: u8,
    /// Address of the PTOC.
    pub ptoc: u16,
    /// Address of the GTOC.
    pub gtoc: u16,
}

impl RemoteTable {
    /// A kind of remote that its name alone tells.
    pub const fn new(
        title: &'static str,
        name: [u8; 4],
        elements: &'static [ElementTable],
    ) -> Self {
        Self {
            title,
            name,
            unit_class: None,
            elements,
            contents: &[],
        }
    }

    /// One part of a card, which has this top byte in its unit number.
    #[must_use]
    pub const fn of_class(self, class: u8) -> Self {
        Self {
            unit_class: Some(class),
            ..self
        }
    }

    /// The element of that name and direction.
    pub fn element(&self, name: &str, direction: DataDirection) -> Option<&ElementTable> {
        self.elements
            .iter()
            .find(|element| element.name == name && element.direction == direction)
    }

    /// The elements of a software mode, in order.
    pub fn of_mode(&self, mode: u8) -> impl Iterator<Item = &ElementTable> {
        let bit = 1_u16.checked_shl(u32::from(mode)).unwrap_or(0);
        self.elements
            .iter()
            .filter(move |element| element.modes & bit != 0)
    }
}

impl RemoteTable {
    /// The tables that are built in.
    pub const KNOWN: [&'static Self; 3] = [
        &super::i7i77::FIELD,
        &super::i7i77::ANALOG,
        &super::i7i72::REMOTE,
    ];

    /// The table for a remote, by name and unit number: the first of `added` and of those that are
    /// built in that fits.
    pub fn for_remote(
        descriptor: &RemoteDescriptor,
        added: &[&'static Self],
    ) -> Option<&'static Self> {
        let mut tables = added.iter().copied().chain(Self::KNOWN);
        tables.find(|table| table.matches(descriptor))
    }

    /// What a remote of this kind says of itself in a software mode; `None` if the table does not
    /// know all of it.
    pub(crate) fn descriptor(&self, mode: u8) -> Option<RemoteDescriptor> {
        let mut process_data = Vec::new();
        for element in self.of_mode(mode) {
            let is_scaled = matches!(element.data_type, DataType::Unsigned | DataType::Signed);
            let (min, max) = match element.limits {
                None if is_scaled => return None,
                limits => limits.unwrap_or_default(),
            };
            process_data.push(DataRecord {
                record_address: 0,
                bits: element.bits,
                data_type: element.data_type,
                direction: element.direction,
                min,
                max,
                address: 0,
                unit: element.unit.into(),
                name: element.name.into(),
            });
        }
        (!process_data.is_empty()).then(|| RemoteDescriptor {
            name: RemoteName(self.name),
            unit_number: u32::from(self.unit_class.unwrap_or(0)) << 24,
            software_mode: mode,
            process_data,
            parameters: Vec::new(),
            modes: Vec::new(),
        })
    }
}

/// Every mode.
pub(super) const ALL_MODES: u16 = u16::MAX;

impl ElementTable {
    const fn new(name: &'static str, bits: u8, direction: DataDirection) -> Self {
        Self {
            name,
            bits,
            data_type: DataType::Bits,
            direction,
            limits: None,
            unit: "",
            modes: ALL_MODES,
            terminals: &[],
            safe: 0.0,
        }
    }

    /// Single bits that are read.
    pub const fn bits_in(name: &'static str, bits: u8) -> Self {
        Self::new(name, bits, DataDirection::Input)
    }

    /// Single bits that are written.
    pub const fn bits_out(name: &'static str, bits: u8) -> Self {
        Self::new(name, bits, DataDirection::Output)
    }

    /// A voltage from 0 to `max` that is read.
    pub const fn volts_in(name: &'static str, bits: u8, max: f32) -> Self {
        Self {
            data_type: DataType::Unsigned,
            limits: Some((0.0, max)),
            unit: "V",
            ..Self::new(name, bits, DataDirection::Input)
        }
    }

    /// A voltage from -`max` to `max` that is written.
    pub const fn volts_out(name: &'static str, bits: u8, max: f32) -> Self {
        Self {
            data_type: DataType::Signed,
            limits: Some((-max, max)),
            unit: "V",
            ..Self::new(name, bits, DataDirection::Output)
        }
    }

    /// A truth value that is written.
    pub const fn switch(name: &'static str) -> Self {
        Self {
            data_type: DataType::Boolean,
            ..Self::new(name, 1, DataDirection::Output)
        }
    }

    /// Bits that mean nothing, in one direction.
    pub const fn pad(bits: u8, direction: DataDirection) -> Self {
        Self {
            data_type: DataType::Pad,
            ..Self::new("", bits, direction)
        }
    }

    /// A counter.
    pub const fn counter(name: &'static str, bits: u8) -> Self {
        Self {
            data_type: DataType::Encoder,
            ..Self::new(name, bits, DataDirection::Input)
        }
    }

    /// At these terminals.
    #[must_use]
    pub const fn at(self, terminals: &'static [Terminals]) -> Self {
        Self { terminals, ..self }
    }

    /// Its limits are the remote's business.
    #[must_use]
    pub const fn with_limits_unknown(self) -> Self {
        Self {
            limits: None,
            ..self
        }
    }

    /// In these software modes only: bit n for mode n.
    #[must_use]
    pub const fn in_modes(self, modes: u16) -> Self {
        Self { modes, ..self }
    }
}
