//! Tables of known remotes: data that supplements a remote's own description.

use alloc::{
    format,
    string::{String, ToString},
    vec::Vec,
};

use super::{DataDirection, DataRecord, DataType, RemoteDescriptor};
use crate::hal::{Place, Terminals};
use crate::sslbp::RemoteName;

/// Table entry for one element of a remote's process data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementTable {
    /// Its name in the remote.
    pub name: &'static str,
    /// Its width.
    pub bits: u8,
    /// Its type.
    pub data_type: DataType,
    /// Its direction.
    pub direction: DataDirection,
    /// Its limits as in the record; `None` if they have no meaning.
    pub limits: Option<(f32, f32)>,
    /// Its unit, used if the record contains none.
    pub unit: &'static str,
    /// The software modes that contain it: bit n for mode n.
    pub modes: u16,
    /// Its terminals.
    pub terminals: &'static [Terminals],
    /// Number of its item at these terminals. `None`: all of them, or one for each bit of BITS.
    pub number: Option<u16>,
    /// The value of the output when nothing else is set: 0 is off and 0 V.
    pub safe: f64,
    /// The element that must be on for the output to reach the terminal; empty without one.
    pub enabled_by: &'static str,
}

/// Table of a kind of remote.
///
/// Contains terminals and safe values, and serves for comparison with the remote's own description.
/// If the remote has one, its own description takes precedence (FACTS 8.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemoteTable {
    /// Readable title: `7I77 field I/O`.
    pub title: &'static str,
    /// The remote's own name.
    pub name: [u8; 4],
    /// The top byte of its unit number, for cards of one name that are distinguished by it.
    pub unit_class: Option<u8>,
    /// True if it describes itself. If not, this table is its description.
    pub has_discovery: bool,
    /// Its elements, in the order of its PTOC.
    pub elements: &'static [ElementTable],
    /// Addresses of its tables of contents, for each software mode in which they are known. A
    /// remote that is absent at start is checked against them when it is plugged in.
    pub contents: &'static [TableAddresses],
}

/// Addresses of a remote's tables of contents in a software mode; they differ between firmware
/// versions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableAddresses {
    /// The software mode.
    pub mode: u8,
    /// Address of the PTOC.
    pub ptoc: u16,
    /// Address of the GTOC.
    pub gtoc: u16,
}

impl RemoteTable {
    /// A kind of remote that is identified by its name alone.
    pub const fn new(
        title: &'static str,
        name: [u8; 4],
        elements: &'static [ElementTable],
    ) -> Self {
        Self {
            title,
            name,
            unit_class: None,
            has_discovery: true,
            elements,
            contents: &[],
        }
    }

    /// A part of a card, with this top byte in its unit number.
    #[must_use]
    pub const fn of_class(self, class: u8) -> Self {
        Self {
            unit_class: Some(class),
            ..self
        }
    }

    /// True if a remote is of this kind, by its name and unit number.
    pub fn matches(&self, descriptor: &RemoteDescriptor) -> bool {
        let is_class = |class| descriptor.unit_number >> 24 == u32::from(class);
        self.name == descriptor.name.0 && self.unit_class.is_none_or(is_class)
    }

    /// The element with that name and direction.
    pub fn element(&self, name: &str, direction: DataDirection) -> Option<&ElementTable> {
        let mut elements = self.elements.iter();
        elements.find(|element| element.name == name && element.direction == direction)
    }

    /// The elements of a software mode, in order.
    fn of_mode(&self, mode: u8) -> impl Iterator<Item = &ElementTable> {
        let bit = 1_u16.checked_shl(u32::from(mode)).unwrap_or(0);
        self.elements
            .iter()
            .filter(move |element| element.modes & bit != 0)
    }

    /// Descriptor of a remote of this kind in a software mode; `None` if the table is incomplete
    /// for that mode.
    pub(crate) fn descriptor(&self, mode: u8) -> Option<RemoteDescriptor> {
        let process_data: Option<Vec<_>> = self.of_mode(mode).map(ElementTable::record).collect();
        Some(RemoteDescriptor {
            name: RemoteName(self.name),
            unit_number: u32::from(self.unit_class.unwrap_or(0)) << 24,
            software_mode: mode,
            process_data: process_data.filter(|records| !records.is_empty())?,
            ..RemoteDescriptor::default()
        })
    }

    /// Differences between a remote's description and this table, in the mode in which it was
    /// started, in words: in the place (among the elements that are not pads), width, type or
    /// limits of an element. The remote's description is used; a difference is for the user to
    /// check.
    pub fn differences(&self, descriptor: &RemoteDescriptor) -> Vec<String> {
        let is_pad = |data_type| data_type == DataType::Pad;
        let records = descriptor.process_data.iter();
        let records: Vec<_> = records.filter(|r| !is_pad(r.data_type)).collect();
        let known = self.of_mode(descriptor.software_mode);
        let known: Vec<_> = known.filter(|e| !is_pad(e.data_type)).collect();
        let mut found = Vec::new();
        let mut compare = |element: &str, what: &str, [expected, actual]: [String; 2]| {
            if expected != actual {
                found.push(format!(
                    "{element}: {what} {actual}, by the table {expected}"
                ));
            }
        };
        let text = |place: Option<usize>| place.map_or("none".into(), |place| place.to_string());
        for (expected, element) in known.iter().enumerate() {
            let name = element.name;
            let place = records.iter().position(|record| element.is(record));
            compare(name, "place", [Some(expected), place].map(text));
            let Some(record) = place.and_then(|place| records.get(place)) else {
                continue;
            };
            let bits = [element.bits, record.bits];
            compare(name, "width", bits.map(|bits| bits.to_string()));
            let types = [element.data_type, record.data_type];
            compare(
                name,
                "type",
                types.map(|data_type| format!("{data_type:?}")),
            );
            // Limits that the table does not contain are taken from the record.
            let of_record = (record.min, record.max);
            let limits = [element.limits.unwrap_or(of_record), of_record];
            compare(
                name,
                "limits",
                limits.map(|(min, max)| format!("{min} to {max}")),
            );
        }
        for (actual, record) in records.iter().enumerate() {
            if !known.iter().any(|element| element.is(record)) {
                compare(&record.name, "place", [None, Some(actual)].map(text));
            }
        }
        found
    }
}

impl ElementTable {
    /// An element that is read, in all modes, without limits and terminals.
    pub const fn input(name: &'static str, bits: u8, data_type: DataType) -> Self {
        Self {
            name,
            bits,
            data_type,
            direction: DataDirection::Input,
            limits: None,
            unit: "",
            modes: u16::MAX,
            terminals: &[],
            number: None,
            safe: 0.0,
            enabled_by: "",
        }
    }

    /// An element that is written.
    pub const fn output(name: &'static str, bits: u8, data_type: DataType) -> Self {
        Self {
            direction: DataDirection::Output,
            ..Self::input(name, bits, data_type)
        }
    }

    /// A number from `min` to `max` in this unit.
    #[must_use]
    pub const fn range(self, min: f32, max: f32, unit: &'static str) -> Self {
        Self {
            limits: Some((min, max)),
            unit,
            ..self
        }
    }

    /// At these terminals: all of them, or one item for each bit of BITS.
    #[must_use]
    pub const fn at(self, terminals: &'static [Terminals]) -> Self {
        Self { terminals, ..self }
    }

    /// Item `number` at these terminals.
    #[must_use]
    pub const fn nth(self, terminals: &'static [Terminals], number: u16) -> Self {
        Self {
            terminals,
            number: Some(number),
            ..self
        }
    }

    /// An output that reaches its terminal only while this element is on.
    #[must_use]
    pub const fn enabled_by(self, enabled_by: &'static str) -> Self {
        Self { enabled_by, ..self }
    }

    /// In these software modes only: bit n for mode n.
    #[must_use]
    pub const fn in_modes(self, modes: u16) -> Self {
        Self { modes, ..self }
    }

    /// Its terminals, one by one; or those of one of its bits.
    pub fn places(&self, bit: Option<u16>) -> impl Iterator<Item = Place> {
        let number = bit.or(self.number);
        let is_it = move |n| number.is_none_or(|number| number == n);
        Terminals::each(self.terminals).filter_map(move |(n, place)| is_it(n).then_some(place))
    }

    fn is(&self, record: &DataRecord) -> bool {
        (self.name, self.direction) == (&*record.name, record.direction)
    }

    /// Record of a remote with this element; `None` if its limits are required as its scale and are
    /// unknown or not finite.
    fn record(&self) -> Option<DataRecord> {
        let is_scaled = matches!(self.data_type, DataType::Unsigned | DataType::Signed);
        let is_scale = |(min, max): &(f32, f32)| min.is_finite() && max.is_finite();
        let limits = self.limits.filter(|limits| !is_scaled || is_scale(limits));
        if is_scaled && limits.is_none() {
            return None;
        }
        let (min, max) = limits.unwrap_or_default();
        Some(DataRecord {
            record_address: 0,
            bits: self.bits,
            data_type: self.data_type,
            direction: self.direction,
            min,
            max,
            address: 0,
            unit: self.unit.into(),
            name: self.name.into(),
        })
    }
}
