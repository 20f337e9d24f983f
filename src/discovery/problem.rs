//! What can be wrong with what a remote tells about itself.

use super::{DataDirection, ModeSet, RemoteName};
use core::fmt;
use thiserror::Error;

/// Something that a remote tells about itself and that can not be right.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub struct Problem {
    /// The remote's name.
    pub name: RemoteName,
    /// The remote's unit number.
    pub unit_number: u32,
    /// The table that leads there.
    pub table: Table,
    /// Address of the record; of the table itself, where there is no record.
    pub record: u16,
    /// What is wrong.
    pub kind: ProblemKind,
}

impl Problem {
    /// Whether the layout of the process data is in doubt. Such a remote must not run: its pins
    /// would show, or set, the wrong bits.
    pub const fn affects_process_data(&self) -> bool {
        matches!(self.table, Table::Process)
            && !matches!(
                self.kind,
                ProblemKind::UnknownDataType { .. }
                    | ProblemKind::StringTooLong { .. }
                    // Limits say how values are scaled, and nothing of where they are.
                    | ProblemKind::LimitsNotFinite { .. }
            )
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} (unit number {:#010X}), {} record at {:#06X}: {}",
            self.name, self.unit_number, self.table, self.record, self.kind
        )
    }
}

/// A table of contents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Table {
    /// PTOC: the process data of the software mode that the remote was started in.
    Process,
    /// GTOC: everything that the remote has.
    Global,
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Process => "PTOC",
            Self::Global => "GTOC",
        })
    }
}

/// What is wrong with a record or a table.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ProblemKind {
    /// A read failed.
    #[error(
        "reading {address:#06X} failed; what lies behind it is missing. Check the cable, then \
         start again"
    )]
    ReadFailed {
        /// Where.
        address: u16,
    },
    /// Too many reads, or too many of them failed.
    #[error(
        "discovery gave up after {accesses} accesses; the remote's tables are damaged, or its \
         cable is"
    )]
    GaveUp {
        /// Accesses until then.
        accesses: u32,
    },
    /// The remote has no tables, and this crate has none for its name.
    #[error(
        "it does not support discovery, and there is no built-in table for its name; leave the channel out"
    )]
    NoDiscovery,
    /// A kind of remote that is known, but not what its process data means.
    #[error(
        "it is not supported: it has no discovery, and what its process data means is not known; leave the channel out (x)"
    )]
    NotSupported,
    /// A built-in table exists, but its sizes are not what the remote says.
    #[error(
        "it does not support discovery, and its sizes (RX {rx}, TX {tx}) are not those of the \
         built-in table (RX {table_rx}, TX {table_tx}), which was therefore not used; update its firmware"
    )]
    OtherSizes {
        /// RXSize of the remote.
        rx: u8,
        /// TXSize of the remote.
        tx: u8,
        /// RXSize of the table.
        table_rx: u8,
        /// TXSize of the table.
        table_tx: u8,
    },
    /// The remote does not have the software mode that was asked for, and is in another.
    #[error(
        "software mode {mode} is not one of this remote's modes ({known}); start it in one of these"
    )]
    IllegalSoftwareMode {
        /// What was asked for.
        mode: u8,
        /// The software modes it tells of.
        known: ModeSet,
    },
    /// The remote transfers process data, and lists none.
    #[error(
        "it lists no process data, but transfers {rx} bytes of it in and {tx} out; switch the remote's power off and on"
    )]
    NoProcessData {
        /// Bytes from the remote.
        rx: u8,
        /// Bytes to the remote.
        tx: u8,
    },
    /// A table has no end within the limits.
    #[error(
        "the table has no end within {entries} entries; the remote's firmware is damaged, update it"
    )]
    TableWithoutEnd {
        /// Entries until then.
        entries: u16,
    },
    /// A table lists a record twice: a loop, or a damaged table.
    #[error("entry {entry} of the table points to it again")]
    RepeatedEntry {
        /// The later entry, counted from 0.
        entry: u16,
    },
    /// Neither A0 nor B0.
    #[error("its type is {found:#04X}, expected A0 (data) or B0 (mode)")]
    UnknownRecordType {
        /// What is there.
        found: u8,
    },
    /// The record runs over the end of the address space.
    #[error("it does not end before the end of the address space")]
    PastEnd,
    /// A string has no end within the limits.
    #[error("its {field} has no end within {characters} characters")]
    StringWithoutEnd {
        /// Which string.
        field: StringField,
        /// Characters until then.
        characters: u16,
    },
    /// A string is longer than what is kept.
    #[error("its {field} has {characters} characters, of which {kept} are kept")]
    StringTooLong {
        /// Which string.
        field: StringField,
        /// Its length.
        characters: u16,
        /// How many are kept.
        kept: u16,
    },
    /// A direction that the manuals do not list.
    #[error("its direction is {found:#04X}, expected 00 (input), 40 (both) or 80 (output)")]
    IllegalDirection {
        /// What is there.
        found: u8,
    },
    /// A data type that this crate does not know.
    #[error("its data type {found:#04X} is not known; its bits are kept as they are")]
    UnknownDataType {
        /// What is there.
        found: u8,
    },
    /// An element without bits.
    #[error("it has no bits")]
    NoBits,
    /// One part of a count in two parts stands alone.
    #[error(
        "it is one part of a count, and the other part does not follow; choose another software mode"
    )]
    HalfCount,
    /// A number with more bits than a number can have.
    #[error("it is a number of {bits} bits, at most {limit} are possible")]
    TooManyBits {
        /// What is there.
        bits: u8,
        /// The most.
        limit: u8,
    },
    /// A floating-point number that is neither single nor double.
    #[error("it is a floating-point number of {bits} bits, expected 32 or 64")]
    FloatSize {
        /// What is there.
        bits: u8,
    },
    /// Limits of a scaled number that are not finite. Floating-point numbers need none: there,
    /// infinite limits are no problem.
    #[error(
        "its limits {min} to {max} are not finite; its pins have a full scale of 1 instead, so check its scale"
    )]
    LimitsNotFinite {
        /// Minimum.
        min: f32,
        /// Maximum.
        max: f32,
    },
    /// Limits in the wrong order.
    #[error("its minimum {min} is larger than its maximum {max}")]
    LimitsReversed {
        /// Minimum.
        min: f32,
        /// Maximum.
        max: f32,
    },
    /// Process data that does not fit into the interface registers.
    #[error(
        "with it the {direction} process data has {bits} bits, but the interface registers hold \
         {limit}"
    )]
    RegistersTooSmall {
        /// Which way.
        direction: Flow,
        /// Bits so far.
        bits: u32,
        /// Bits of the interface registers.
        limit: u16,
    },
    /// Process data that does not fit into what is transferred.
    #[error(
        "with it the {direction} process data has {bits} bits, but only {limit} are transferred \
         ({bytes} bytes)"
    )]
    TransferTooSmall {
        /// Which way.
        direction: Flow,
        /// Bits so far.
        bits: u32,
        /// Bits of the transfer.
        limit: u16,
        /// Bytes of the transfer.
        bytes: u8,
    },
}

/// One of the strings of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StringField {
    /// The unit.
    Unit,
    /// The name.
    Name,
}

impl fmt::Display for StringField {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unit => "unit",
            Self::Name => "name",
        })
    }
}

/// One of the two streams of process data, seen from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Flow {
    /// From the remote.
    Input,
    /// To the remote.
    Output,
}

impl Flow {
    /// Whether an element that goes in `direction` is part of this stream.
    pub const fn has(self, direction: DataDirection) -> bool {
        match self {
            Self::Input => direction.is_input(),
            Self::Output => direction.is_output(),
        }
    }
}

impl fmt::Display for Flow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Input => "input",
            Self::Output => "output",
        })
    }
}
