//! What is known of a remote beforehand: thin data over what it says of itself.

use super::Terminals;
use crate::discovery::{DataDirection, DataType, RemoteDescriptor};

/// A screw terminal and what the manual calls it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terminal {
    /// Connector and pin, for example `TB8 pin 3`.
    pub place: &'static str,
    /// The manual's name, for example `INPUT2`.
    pub signal: &'static str,
}

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
}

impl RemoteTable {
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

    /// The built-in table for a remote, by name and unit number.
    pub fn for_remote(descriptor: &RemoteDescriptor) -> Option<&'static Self> {
        Self::KNOWN
            .into_iter()
            .find(|table| table.matches(descriptor))
    }
}

/// Every mode.
pub(super) const ALL_MODES: u16 = u16::MAX;

impl ElementTable {
    pub(super) const fn bits(name: &'static str, bits: u8, direction: DataDirection) -> Self {
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

    pub(super) const fn volts_in(name: &'static str, bits: u8, max: f32) -> Self {
        Self {
            data_type: DataType::Unsigned,
            limits: Some((0.0, max)),
            unit: "V",
            ..Self::bits(name, bits, DataDirection::Input)
        }
    }

    pub(super) const fn volts_out(name: &'static str, bits: u8, max: f32) -> Self {
        Self {
            data_type: DataType::Signed,
            limits: Some((-max, max)),
            unit: "V",
            ..Self::bits(name, bits, DataDirection::Output)
        }
    }

    pub(super) const fn switch(name: &'static str) -> Self {
        Self {
            data_type: DataType::Boolean,
            ..Self::bits(name, 1, DataDirection::Output)
        }
    }

    pub(super) const fn counter(name: &'static str, bits: u8) -> Self {
        Self {
            data_type: DataType::Encoder,
            ..Self::bits(name, bits, DataDirection::Input)
        }
    }

    pub(super) const fn at(self, terminals: &'static [Terminals]) -> Self {
        Self { terminals, ..self }
    }

    pub(super) const fn with_limits_unknown(self) -> Self {
        Self {
            limits: None,
            ..self
        }
    }

    pub(super) const fn in_modes(self, modes: u16) -> Self {
        Self { modes, ..self }
    }
}

/// Terminals written as `"TB8 pin 1" INPUT0, ...`.
macro_rules! terminals {
    ($($place:literal $signal:literal),* $(,)?) => {
        &[$($crate::boards::Terminal { place: $place, signal: $signal }),*]
    };
}
pub(super) use terminals;
