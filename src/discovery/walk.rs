//! Walking the tables of one remote.

use super::{
    DataRecord, DiscoveryLimits, Flow, Problem, ProblemKind, RemoteDescriptor, RemoteMemory,
    RemoteName, Table, built_in,
    reader::Reader,
    record::{self, Record, problem_of},
};
use crate::sslbp::{Layout, ProcessDataSizes, ReplyFormat, StartedRemote};
use alloc::vec::Vec;

/// What START told about a remote: where discovery begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RemoteIdentity {
    /// Its name.
    pub name: RemoteName,
    /// Its unit number.
    pub unit_number: u32,
    /// The software mode it was started in.
    pub software_mode: u8,
    /// Process table of contents; 0 without discovery.
    pub ptoc: u16,
    /// Global table of contents; 0 without discovery.
    pub gtoc: u16,
    /// Its process data sizes.
    pub sizes: ProcessDataSizes,
    /// Bits that the interface registers hold in each direction: 96 or 224.
    pub register_bits: u16,
    /// Where its data begins in a reply.
    pub reply_format: ReplyFormat,
}

impl RemoteIdentity {
    /// Of a remote that was started on a port with `layout`.
    pub fn new(remote: &StartedRemote, layout: &Layout) -> Self {
        Self {
            name: remote.name,
            unit_number: remote.unit_number,
            software_mode: remote.software_mode,
            ptoc: remote.ptoc,
            gtoc: remote.gtoc,
            sizes: remote.sizes,
            register_bits: layout.process_data_bits(),
            reply_format: remote.reply_format(),
        }
    }

    /// Bytes that are transferred in one direction.
    fn bytes(&self, flow: Flow) -> u8 {
        match (flow, self.reply_format) {
            (Flow::Input, ReplyFormat::FaultByteFirst) => self.sizes.rx.saturating_sub(1),
            (Flow::Input, ReplyFormat::DataOnly) => self.sizes.rx,
            (Flow::Output, _) => self.sizes.tx,
        }
    }
}

/// Where a descriptor comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Source {
    /// From the remote itself.
    Remote,
    /// From a built-in table, because the remote does not support discovery.
    BuiltIn,
}

/// What discovery found out, and what it could not.
#[derive(Clone, Debug, PartialEq)]
pub struct Discovered<E> {
    /// What was found; after a problem, as much of it as was found.
    pub descriptor: RemoteDescriptor,
    /// Where it comes from.
    pub source: Source,
    /// What is wrong with it.
    pub problems: Vec<Problem>,
    /// The last access that failed, if one has.
    pub read_error: Option<E>,
    /// Accesses to the remote's memory that it took.
    pub accesses: u32,
}

impl<E> Discovered<E> {
    /// Whether the process data can be used: see [`Problem::affects_process_data`].
    pub fn process_data_is_sound(&self) -> bool {
        !self.problems.iter().any(Problem::affects_process_data)
    }
}

/// Finds out what a remote is, from its own tables, or from a built-in table if it has none.
///
/// Never fails as a whole: what is wrong is in the result, and the rest of the tables is read all
/// the same. Bounded by `limits` whatever the remote answers.
///
/// Manual: 7I77, "DISCOVERY SEQUENCE"; FACTS 7.
pub fn discover<M: RemoteMemory>(
    memory: &mut M,
    identity: &RemoteIdentity,
    limits: DiscoveryLimits,
) -> Discovered<M::Error> {
    let mut walk = Walk::new(Reader::new(memory, limits), *identity);
    if identity.ptoc == 0 {
        walk.use_built_in();
    } else {
        walk.walk_process();
    }
    if identity.gtoc != 0 {
        walk.walk_global();
    }
    walk.finish()
}

struct Walk<'m, M: RemoteMemory> {
    reader: Reader<'m, M>,
    identity: RemoteIdentity,
    descriptor: RemoteDescriptor,
    source: Source,
    problems: Vec<Problem>,
    /// Records that were read, or tried.
    seen: Vec<u16>,
    input_bits: u32,
    output_bits: u32,
}

impl<'m, M: RemoteMemory> Walk<'m, M> {
    fn new(reader: Reader<'m, M>, identity: RemoteIdentity) -> Self {
        Self {
            reader,
            identity,
            descriptor: RemoteDescriptor {
                name: identity.name,
                unit_number: identity.unit_number,
                software_mode: identity.software_mode,
                process_data: Vec::new(),
                parameters: Vec::new(),
                modes: Vec::new(),
            },
            source: Source::Remote,
            problems: Vec::new(),
            seen: Vec::new(),
            input_bits: 0,
            output_bits: 0,
        }
    }

    fn finish(self) -> Discovered<M::Error> {
        Discovered {
            descriptor: self.descriptor,
            source: self.source,
            problems: self.problems,
            accesses: self.reader.accesses(),
            read_error: self.reader.into_error(),
        }
    }

    fn note(&mut self, table: Table, record: u16, kind: ProblemKind) {
        let gave_up = |kind| matches!(kind, ProblemKind::GaveUp { .. });
        let same = |noted: &Problem| noted.table == table && gave_up(noted.kind);
        if gave_up(kind) && self.problems.iter().any(same) {
            // Every further record would say the same.
            return;
        }
        self.problems.push(Problem {
            name: self.identity.name,
            unit_number: self.identity.unit_number,
            table,
            record,
            kind,
        });
    }

    fn use_built_in(&mut self) {
        match built_in::process_data(&self.identity) {
            Ok(process_data) => {
                self.source = Source::BuiltIn;
                self.descriptor.process_data = process_data;
            }
            Err(kind) => self.note(Table::Process, 0, kind),
        }
    }

    fn walk_process(&mut self) {
        let table = Table::Process;
        for address in self.entries(table, self.identity.ptoc) {
            match self.record(table, address) {
                Some(Record::Data(record)) => {
                    self.check_sizes(&record);
                    self.descriptor.process_data.push(record);
                }
                Some(Record::Mode(record)) => self.descriptor.modes.push(record),
                None => {}
            }
        }
        self.check_not_empty();
    }

    /// Tables that can not be where the remote says they are read as zeros.
    fn check_not_empty(&mut self) {
        let rx = self.identity.bytes(Flow::Input);
        let tx = self.identity.bytes(Flow::Output);
        let is_explained = self.problems.iter().any(|p| p.table == Table::Process);
        if self.descriptor.process_data.is_empty() && (rx, tx) != (0, 0) && !is_explained {
            let kind = ProblemKind::NoProcessData { rx, tx };
            self.note(Table::Process, self.identity.ptoc, kind);
        }
    }

    fn walk_global(&mut self) {
        let table = Table::Global;
        for address in self.entries(table, self.identity.gtoc) {
            if self.seen.contains(&address) {
                continue;
            }
            match self.record(table, address) {
                Some(Record::Data(record)) if self.is_process_data(&record) => {}
                Some(Record::Data(record)) => self.descriptor.parameters.push(record),
                Some(Record::Mode(record)) => self.descriptor.modes.push(record),
                None => {}
            }
        }
    }

    /// Some remotes list process data in the GTOC by a record of its own. FACTS 7.2.
    fn is_process_data(&self, record: &DataRecord) -> bool {
        record.address != 0
            && self
                .descriptor
                .process_data
                .iter()
                .any(|element| element.address == record.address)
    }

    /// The entries of a table, each once, until its end or the first problem.
    fn entries(&mut self, table: Table, pointer: u16) -> Vec<u16> {
        let limit = self.reader.limits().entries;
        let mut entries = Vec::new();
        for entry in 0..=limit {
            let word = match self.word(pointer, entry) {
                Ok(0) => return entries,
                Ok(word) => word,
                Err(kind) => {
                    self.note(table, pointer, kind);
                    return entries;
                }
            };
            if entry == limit {
                break;
            }
            if entries.contains(&word) {
                self.note(table, word, ProblemKind::RepeatedEntry { entry });
            } else {
                entries.push(word);
            }
        }
        let without_end = ProblemKind::TableWithoutEnd { entries: limit };
        self.note(table, pointer, without_end);
        entries
    }

    fn word(&mut self, pointer: u16, entry: u16) -> Result<u16, ProblemKind> {
        let low = entry
            .checked_mul(2)
            .and_then(|offset| pointer.checked_add(offset));
        let (Some(low), Some(high)) = (low, low.and_then(|low| low.checked_add(1))) else {
            return Err(ProblemKind::TableWithoutEnd { entries: entry });
        };
        let mut byte = |address| {
            let byte = self.reader.byte(address);
            byte.map_err(|unreadable| problem_of(unreadable, self.reader.accesses()))
        };
        Ok(u16::from_le_bytes([byte(low)?, byte(high)?]))
    }

    /// The record at `address`; its problems are noted.
    fn record(&mut self, table: Table, address: u16) -> Option<Record> {
        self.seen.push(address);
        let mut notes = Vec::new();
        let result = record::read(&mut self.reader, address, &mut |kind| notes.push(kind));
        for kind in notes {
            self.note(table, address, kind);
        }
        result.map_err(|kind| self.note(table, address, kind)).ok()
    }

    /// Adds an element to the process data and checks that it still fits, each direction by
    /// itself; says so once, at the element where it no longer does.
    fn check_sizes(&mut self, record: &DataRecord) {
        for flow in [Flow::Input, Flow::Output] {
            if !flow.has(record.direction) {
                continue;
            }
            let total = match flow {
                Flow::Input => &mut self.input_bits,
                Flow::Output => &mut self.output_bits,
            };
            let before = *total;
            *total += u32::from(record.bits);
            let bits = *total;
            if let Some(kind) = self.first_excess(flow, before, bits) {
                self.note(Table::Process, record.record_address, kind);
            }
        }
    }

    fn first_excess(&self, flow: Flow, before: u32, bits: u32) -> Option<ProblemKind> {
        let crosses = |limit: u16| before <= u32::from(limit) && bits > u32::from(limit);
        let direction = flow;
        let limit = self.identity.register_bits;
        if crosses(limit) {
            return Some(ProblemKind::RegistersTooSmall {
                direction,
                bits,
                limit,
            });
        }
        let bytes = self.identity.bytes(flow);
        let limit = u16::from(bytes) * 8;
        crosses(limit).then_some(ProblemKind::TransferTooSmall {
            direction,
            bits,
            limit,
            bytes,
        })
    }
}
