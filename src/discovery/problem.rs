//! Defects in a remote's description of itself.

use crate::advice::{self, Advice, MesaError};
use crate::sslbp::RemoteName;
use alloc::{
    string::{String, ToString},
    vec::Vec,
};
use core::fmt;
use thiserror::Error;

/// A defect in a remote's description of itself.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{name} (unit number {unit_number:#010X}), {table} record at {record:#06X}: {kind}")]
#[non_exhaustive]
pub struct Problem {
    /// The remote's name.
    pub name: RemoteName,
    /// The remote's unit number.
    pub unit_number: u32,
    /// The table that contains the record.
    pub table: Table,
    /// Address of the record; of the table itself if no record is concerned.
    pub record: u16,
    /// Kind of defect.
    pub kind: ProblemKind,
}

impl MesaError for Problem {
    fn advice(&self) -> Option<Advice> {
        self.kind.advice()
    }
}

impl Problem {
    /// True if the defect makes the layout of the process data doubtful. Such a remote must not
    /// run: its pins would show, or set, the wrong bits.
    pub(super) const fn affects_process_data(&self) -> bool {
        matches!(self.table, Table::Process) && !matches!(self.kind, ProblemKind::Odd { .. })
    }
}

/// A table of contents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Table {
    /// PTOC: the process data of the software mode in which the remote was started.
    Process,
    /// GTOC: everything that the remote contains.
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

/// Kind of defect of a record or a table.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ProblemKind {
    /// A read failed.
    #[error("reading {address:#06X} failed; the rest of the table is missing")]
    ReadFailed {
        /// Address of the read.
        address: u16,
    },
    /// Too many reads were needed, or too many of them failed.
    #[error(
        "discovery was stopped after {accesses} accesses: the remote's tables or its cable are damaged"
    )]
    GaveUp {
        /// Number of accesses until then.
        accesses: u32,
    },
    /// The remote has no tables, and this crate has no table for its name.
    #[error(
        "the remote is not supported: it has no discovery, and no complete table of its process data is \
         known"
    )]
    NoTables,
    /// The remote reports only its name, and this crate has no table for that.
    #[error("the remote is in its bootloader, without a complete program")]
    InBootloader,
    /// The remote does not have the requested software mode, and is in another one.
    #[error(
        "software mode {mode} is not one of this remote's modes ({})",
        list(.known)
    )]
    IllegalSoftwareMode {
        /// The requested mode.
        mode: u8,
        /// The software modes that it lists.
        known: Vec<u8>,
    },
    /// The transferred process data does not match the remote's tables.
    #[error(
        "the remote transfers {rx} bytes of process data in and {tx} out, but its tables describe {plan_rx} \
         and {plan_tx}"
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
    /// The process data does not fit into the interface registers.
    #[error(
        "with it the {direction} process data has {bits} bits, but the interface registers hold \
         {limit}"
    )]
    RegistersTooSmall {
        /// `input` or `output`.
        direction: &'static str,
        /// Bits up to this element.
        bits: u32,
        /// Bits of the interface registers.
        limit: u32,
    },
    /// A table has no end within the limits.
    #[error("the table has no end within {entries} entries")]
    TableWithoutEnd {
        /// Number of entries until then.
        entries: u16,
    },
    /// A table lists a record twice: a loop, or a damaged table.
    #[error("entry {entry} of the table points to it again")]
    RepeatedEntry {
        /// The later entry, counted from 0.
        entry: u16,
    },
    /// A record contains an impossible value.
    #[error("its {field} is {found}, expected {expected}")]
    Illegal {
        /// Field of the record.
        field: &'static str,
        /// Value found.
        found: String,
        /// Possible values.
        expected: &'static str,
    },
    /// A record contains an odd value that does not affect the layout of the process data.
    #[error("its {what}")]
    Odd {
        /// The oddity, and its effect.
        what: String,
        /// The next step, if there is one.
        advice: Option<Advice>,
    },
    /// The record extends beyond the end of the address space.
    #[error("the record does not end before the end of the address space")]
    PastEnd,
    /// Two elements have the same name, so that their pins would have, too.
    #[error("two of its elements are named {name}")]
    EqualNames {
        /// The name, as in LinuxCNC.
        name: String,
    },
    /// A count in two parts lacks one of them.
    #[error("the record is one part of a count, and the other part does not follow")]
    HalfCount,
}

impl MesaError for ProblemKind {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::ReadFailed { .. } => Some(advice::CHECK_CABLE_AND_RESTART),
            Self::NoTables => Some(advice::ADD_TABLE),
            Self::InBootloader => Some(advice::FINISH_UPDATE),
            Self::IllegalSoftwareMode { .. } => Some(advice::CHOOSE_LISTED_MODE),
            Self::Sizes { .. } => Some(advice::POWER_CYCLE_OR_UPDATE),
            Self::TableWithoutEnd { .. } | Self::EqualNames { .. } => Some(advice::UPDATE_REMOTE),
            Self::Odd { advice, .. } => *advice,
            Self::HalfCount => Some(advice::CHOOSE_MODE),
            Self::GaveUp { .. }
            | Self::RegistersTooSmall { .. }
            | Self::RepeatedEntry { .. }
            | Self::Illegal { .. }
            | Self::PastEnd => None,
        }
    }
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
        return "it lists none".into();
    }
    let mut modes = modes.to_vec();
    modes.sort_unstable();
    let modes: Vec<String> = modes.iter().map(ToString::to_string).collect();
    modes.join(", ")
}
