//! Traversal of the tables of one remote.

use super::{
    DataRecord, DataType, PackingPlan, Problem, ProblemKind, RemoteDescriptor, RemoteTable, Table,
    hal_name,
    record::{Reader, Record},
};
use crate::lbp::RemoteLink;
use crate::sslbp::{ProcessDataSizes, StartedRemote};
use alloc::{string::String, vec::Vec};

/// Largest number of entries of a table of contents.
const ENTRIES: u16 = 255;

/// Tables available to discovery, and a bound on its accesses to one remote.
#[derive(Clone, Copy, Debug)]
pub struct DiscoveryOptions<'a> {
    /// Tables for remotes without a description of their own: see
    /// [`has_discovery`](RemoteTable::has_discovery).
    pub tables: &'a [&'static RemoteTable],
    /// Largest number of accesses to a remote's memory.
    pub accesses: u32,
}

impl Default for DiscoveryOptions<'_> {
    /// No tables, 4096 accesses.
    fn default() -> Self {
        Self {
            tables: &[],
            accesses: 4096,
        }
    }
}

/// Results of discovery of a remote, with the problems encountered.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Discovery {
    /// Result of START. Sizes that are missing there for a 7I64 are taken from its table.
    pub started: StartedRemote,
    /// The description; after a problem, as much of it as was read.
    pub descriptor: RemoteDescriptor,
    /// Layout of its process data, or the first problem that makes it doubtful.
    pub plan: Result<PackingPlan, Problem>,
    /// All problems.
    pub problems: Vec<Problem>,
    /// The last access that failed, if any.
    pub read_error: Option<String>,
    /// Number of accesses to the remote's memory.
    pub accesses: u32,
}

impl Discovery {
    /// Adds a problem.
    pub(super) fn note(&mut self, table: Table, record: u16, kind: ProblemKind) {
        let gave_up = |kind: &ProblemKind| matches!(kind, ProblemKind::GaveUp { .. });
        let same = |noted: &Problem| noted.table == table && gave_up(&noted.kind);
        // After giving up, every further record would add the same problem.
        if gave_up(&kind) && self.problems.iter().any(same) {
            return;
        }
        let problem = Problem {
            name: self.started.name,
            unit_number: self.started.unit_number,
            table,
            record,
            kind,
        };
        if self.plan.is_ok() && problem.affects_process_data() {
            self.plan = Err(problem.clone());
        }
        self.problems.push(problem);
    }

    /// Notes a name of two elements of the process data, or of two parameters, unless the process
    /// data is doubtful already.
    fn check_names(&mut self) {
        if self.plan.is_err() {
            return;
        }
        let RemoteDescriptor {
            process_data,
            parameters,
            ..
        } = &self.descriptor;
        // A count in two parts has one name, and padding has no pins.
        let is_named = |record: &&DataRecord| {
            !matches!(record.data_type, DataType::Pad | DataType::EncoderLow)
        };
        let twice = |records: &[DataRecord]| {
            let mut names = Vec::new();
            let mut all = records.iter().filter(is_named);
            all.find_map(|record| {
                let name = hal_name(&record.name);
                if names.contains(&name) {
                    return Some(name);
                }
                names.push(name);
                None
            })
        };
        let (elements, parameters) = (twice(process_data), twice(parameters));
        if let Some(name) = elements {
            let kind = ProblemKind::EqualNames { name };
            self.note(Table::Process, self.started.ptoc, kind);
        }
        if let Some(name) = parameters {
            let kind = ProblemKind::EqualNames { name };
            self.note(Table::Global, self.started.gtoc, kind);
        }
    }

    /// Computes the layout of the process data, unless a problem has made it doubtful.
    fn lay_out(&mut self, registers: u8) {
        if self.plan.is_err() {
            return;
        }
        let plan = match PackingPlan::new(&self.descriptor, registers) {
            Ok(plan) => plan,
            Err(problem) => return self.note(problem.table, problem.record, problem.kind),
        };
        let started = &mut self.started;
        // The gateware knows the sizes of a 7I64 itself (FACTS 4.7), and may report them for a
        // normal START only, which is then checked against the plan.
        let is_untold = (started.name, started.ptoc) == (StartedRemote::NAME_7I64, 0)
            && started.sizes == ProcessDataSizes::default();
        if is_untold {
            started.sizes = plan.sizes(started.has_fault_byte());
        }
        // The transferred sizes must match the tables. Tables that cannot be at the addresses that
        // the remote reports read as zeros.
        let (rx, tx) = (started.input_bytes(), started.sizes.tx);
        let (plan_rx, plan_tx) = (plan.input_bytes(), plan.output_bytes());
        if (u32::from(rx), u32::from(tx)) == (plan_rx, plan_tx) {
            self.plan = Ok(plan);
            return;
        }
        let kind = ProblemKind::Sizes {
            rx,
            tx,
            plan_rx,
            plan_tx,
        };
        self.note(Table::Process, self.started.ptoc, kind);
    }
}

/// Discovers a remote from its own tables, or from a known one if it has none. The remote is on a
/// port with 3 or 7 interface `registers` for each channel.
///
/// Never fails as a whole: problems are part of the result, and the rest of the tables is still
/// read. Bounded by `options`, whatever the remote answers.
///
/// Manual: 7I77, "DISCOVERY SEQUENCE"; FACTS 7.
pub fn discover<M: RemoteLink>(
    memory: &mut M,
    started: &StartedRemote,
    registers: u8,
    options: &DiscoveryOptions<'_>,
) -> Discovery {
    let mut found = Discovery {
        started: *started,
        descriptor: RemoteDescriptor {
            name: started.name,
            unit_number: started.unit_number,
            software_mode: started.software_mode,
            ..RemoteDescriptor::default()
        },
        plan: Ok(PackingPlan::default()),
        problems: Vec::new(),
        read_error: None,
        accesses: 0,
    };
    let mut reader = Reader::new(memory, options.accesses);
    if started.ptoc == 0 {
        found.use_known(options.tables, started.is_bare());
    } else {
        found.walk(&mut reader, Table::Process, started.ptoc);
    }
    if started.gtoc != 0 {
        found.walk(&mut reader, Table::Global, started.gtoc);
    }
    found.lay_out(registers);
    found.check_names();
    found.accesses = reader.accesses;
    found.read_error = reader.error;
    found
}

impl Discovery {
    fn use_known(&mut self, tables: &[&RemoteTable], is_bare: bool) {
        let descriptor = &mut self.descriptor;
        let mut tables = tables.iter().filter(|table| !table.has_discovery);
        let table = tables.find(|table| table.matches(descriptor));
        match table.and_then(|table| table.descriptor(descriptor.software_mode)) {
            Some(known) => descriptor.process_data = known.process_data,
            None if is_bare => self.note(Table::Process, 0, ProblemKind::InBootloader),
            None => self.note(Table::Process, 0, ProblemKind::NoTables),
        }
    }

    fn walk<M: RemoteLink>(&mut self, reader: &mut Reader<'_, M>, table: Table, pointer: u16) {
        for address in self.entries(reader, table, pointer) {
            if reader.seen.contains(&address) {
                continue;
            }
            reader.seen.push(address);
            let record = reader.record(address);
            for kind in core::mem::take(&mut reader.notes) {
                self.note(table, address, kind);
            }
            let descriptor = &mut self.descriptor;
            match record {
                Ok(Record::Mode(record)) => descriptor.modes.push(record),
                Ok(Record::Data(record)) if table == Table::Process => {
                    descriptor.process_data.push(record);
                }
                Ok(Record::Data(record)) if self.is_process_data(&record) => {}
                Ok(Record::Data(record)) => self.descriptor.parameters.push(record),
                Err(kind) => self.note(table, address, kind),
            }
        }
    }

    /// The entries of a table, each once, up to its end or the first problem.
    fn entries<M: RemoteLink>(
        &mut self,
        reader: &mut Reader<'_, M>,
        table: Table,
        pointer: u16,
    ) -> Vec<u16> {
        let mut entries = Vec::new();
        for entry in 0..=ENTRIES {
            let kind = match reader.word(pointer, 2 * entry) {
                Ok(0) => break,
                Ok(_) if entry == ENTRIES => ProblemKind::TableWithoutEnd { entries: entry },
                Ok(word) if entries.contains(&word) => {
                    self.note(table, word, ProblemKind::RepeatedEntry { entry });
                    continue;
                }
                Ok(word) => {
                    entries.push(word);
                    continue;
                }
                Err(ProblemKind::PastEnd) => ProblemKind::TableWithoutEnd { entries: entry },
                Err(kind) => kind,
            };
            self.note(table, pointer, kind);
            break;
        }
        entries
    }

    /// True for process data that a remote lists in the GTOC by a separate record, as some do.
    /// FACTS 7.2.
    fn is_process_data(&self, record: &DataRecord) -> bool {
        let mut elements = self.descriptor.process_data.iter();
        record.address != 0 && elements.any(|element| element.address == record.address)
    }
}
