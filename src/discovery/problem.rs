//! What can be wrong with what a remote tells about itself.

use crate::sslbp::RemoteName;
use alloc::{
    string::{String, ToString},
    vec::Vec,
};
use core::fmt;
use thiserror::Error;

/// Something that a remote tells about itself and that can not be right.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{name} (unit number {unit_number:#010X}), {table} record at {record:#06X}: {kind}")]
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
    pub(super) const fn affects_process_data(&self) -> bool {
        matches!(self.table, Table::Process) && !matches!(self.kind, ProblemKind::Odd { .. })
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
#[derive(Clone, Debug, PartialEq, Error)]
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
    /// The remote has no tables, and none is known for its name.
    #[error(
        "it is not supported: it has no discovery, and there is no table of all its process data, with \
         finite limits; leave the channel out (x), or add its table with `has_discovery` false (`Settings::remotes`)"
    )]
    NoTables,
    /// The remote tells nothing but its name, and no table is known for that.
    #[error(
        "it waits in its bootloader, without a whole program: give `mesa update` again, with its jumper \
         in the setup position"
    )]
    InBootloader,
    /// The remote does not have the software mode that was asked for, and is in another.
    #[error(
        "software mode {mode} is not one of this remote's modes ({}); start it in one of these",
        list(.known)
    )]
    IllegalSoftwareMode {
        /// What was asked for.
        mode: u8,
        /// The software modes it tells of.
        known: Vec<u8>,
    },
    /// What the remote transfers is not what its tables describe.
    #[error(
        "it transfers {rx} bytes of process data in and {tx} out, but its tables describe {plan_rx} \
         and {plan_tx}; switch its power off and on, and update its firmware if that does not help"
    )]
    Sizes {
        /// Bytes from the remote.
        rx: u8,
        /// Bytes to the remote.
        tx: u8,
        /// Bytes from the remote by its tables.
        plan_rx: u32,
        /// Bytes to the remote by its tables.
        plan_tx: u32,
    },
    /// Process data that does not fit into the interface registers.
    #[error(
        "with it the {direction} process data has {bits} bits, but the interface registers hold \
         {limit}"
    )]
    RegistersTooSmall {
        /// `input` or `output`.
        direction: &'static str,
        /// Bits so far.
        bits: u32,
        /// Bits of the interface registers.
        limit: u32,
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
    /// Something in a record that can not be.
    #[error("its {field} is {found}, expected {expected}")]
    Illegal {
        /// What of the record.
        field: &'static str,
        /// What is there.
        found: String,
        /// What could be there.
        expected: &'static str,
    },
    /// Something in a record that leaves its place among the process data certain.
    #[error("its {what}")]
    Odd {
        /// What it is, and what is made of it.
        what: String,
    },
    /// The record runs over the end of the address space.
    #[error("it does not end before the end of the address space")]
    PastEnd,
    /// One part of a count in two parts stands alone.
    #[error(
        "it is one part of a count, and the other part does not follow; choose another software mode"
    )]
    HalfCount,
}

impl ProblemKind {
    pub(super) fn illegal(field: &'static str, found: String, expected: &'static str) -> Self {
        Self::Illegal {
            field,
            found,
            expected,
        }
    }
}

fn list(modes: &[u8]) -> String {
    if modes.is_empty() {
        return "it tells of none".into();
    }
    let modes: Vec<String> = modes.iter().map(ToString::to_string).collect();
    modes.join(", ")
}
