//! What is odd about a remote that runs.

use core::fmt;

use alloc::vec::Vec;

use crate::boards::i7i77;
use crate::discovery::{
    Difference, Discovered, Problem, RemoteDescriptor, RemoteName, RemoteTable,
};
use crate::sslbp::Channel;

/// Something about a remote that a person should look at, though it runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Remark {
    /// The port.
    pub port: u8,
    /// The channel.
    pub channel: Channel,
    /// The remote's name.
    pub name: RemoteName,
    /// What it is.
    pub kind: RemarkKind,
}

/// What is odd about a remote.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum RemarkKind {
    /// It describes itself otherwise than the built-in table of its kind does. Its own description
    /// decides (FACTS 8.5); terminals and ranges of the card's manual may not be true for it.
    Table {
        /// The table.
        title: &'static str,
        /// The difference.
        difference: Difference,
    },
    /// A problem of its tables that leaves the layout of its process data alone.
    Tables(Problem),
    /// It is the analog part of a 7I77, and the next channel has the field I/O: on the card's
    /// connector the field I/O comes first (FACTS 8.1).
    Swapped,
    /// Its name is that of a card whose parts are told apart by the unit number, and its unit number
    /// is none of theirs: it has no terminals and no safe values of its own.
    UnknownPart {
        /// Its unit number.
        unit_number: u32,
    },
}

impl Remark {
    /// Everything that is odd about a remote.
    pub(super) fn on(
        port: u8,
        discovered: &Discovered,
        tables: &[&'static RemoteTable],
        table: Option<&RemoteTable>,
    ) -> Vec<Self> {
        let descriptor = &discovered.descriptor;
        let channel = discovered.started.channel;
        let name = descriptor.name;
        let mut kinds = Vec::new();
        if let Some(table) = table {
            let title = table.title;
            let differences = table.differences(descriptor).into_iter();
            kinds.extend(differences.map(|difference| RemarkKind::Table { title, difference }));
        } else if tables.iter().any(|table| table.name == name.0) {
            let unit_number = descriptor.unit_number;
            kinds.push(RemarkKind::UnknownPart { unit_number });
        }
        kinds.extend(discovered.problems.iter().cloned().map(RemarkKind::Tables));
        let remark = |kind| Self {
            port,
            channel,
            name,
            kind,
        };
        kinds.into_iter().map(remark).collect()
    }
}

/// What is odd about the order of remotes on a port.
pub(super) fn on_order<'a>(
    port: u8,
    remotes: impl Iterator<Item = (Channel, &'a RemoteDescriptor)>,
) -> Vec<Remark> {
    let mut found = Vec::new();
    let mut previous: Option<(Channel, &RemoteDescriptor)> = None;
    for (channel, remote) in remotes {
        if let Some((first, analog)) = previous
            && first.index() + 1 == channel.index()
            && i7i77::ANALOG.matches(analog)
            && i7i77::FIELD.matches(remote)
        {
            found.push(Remark {
                port,
                channel: first,
                name: analog.name,
                kind: RemarkKind::Swapped,
            });
        }
        // The analog part of the card before is none of the next card's.
        let is_second = previous.is_some_and(|(_, field)| i7i77::FIELD.matches(field));
        previous = (!is_second || i7i77::FIELD.matches(remote)).then_some((channel, remote));
    }
    found
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            port,
            channel,
            name,
            kind,
        } = self;
        write!(f, "port {port}, channel {channel}: ")?;
        match kind {
            RemarkKind::Table { title, difference } => write!(
                f,
                "this {name} differs from the {title} that is known: {difference}. The remote is \
                 believed; check terminals and ranges in the manual of its firmware"
            ),
            RemarkKind::Tables(problem) => write!(f, "{problem}"),
            RemarkKind::Swapped => f.write_str(
                "this is the analog part of a 7I77, and the field I/O is on the next channel; a \
                 card's connector has them the other way round: exchange the channels if the card \
                 is plugged to one",
            ),
            RemarkKind::UnknownPart { unit_number } => write!(
                f,
                "a {name} with unit number {unit_number:#010x}, which belongs to no part of the \
                 card that is known; its pins are made from its own description alone"
            ),
        }
    }
}
