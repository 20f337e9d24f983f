//! Inventory of one remote: its descriptor, parameters and faults.

use super::{
    InventoryData, InventoryElement, InventoryMode, InventoryParameter, InventoryRemote,
    InventoryTerminal,
};
use crate::advice::{told, with_advice};
use mesa_hal::advice;
use mesa_hal::boards::REMOTES;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::discovery::{
    DataDirection, DataRecord, Discovery, ModeRecord, ModeType, RemoteTable,
};
use mesa_hal::lbp::{RemoteFaults, RemoteLink, RemoteLinkError};
use mesa_hal::sslbp::{LocalLocation, Port, PortLink, RemoteAccess};

/// Reads the parameters and faults of a discovered remote.
pub(super) fn take_remote<B: RegisterBus + Clock>(
    bus: &mut B,
    port: &mut Port,
    found: Discovery,
) -> InventoryRemote {
    let descriptor = found.descriptor;
    let channel = found.started.channel;
    let mut memory = PortLink { port, bus, channel };
    let table = REMOTES.into_iter().find(|table| table.matches(&descriptor));
    let mut problems: Vec<String> = found.problems.iter().map(|problem| told(problem)).collect();
    let check = Some(advice::CHECK_CABLE_OR_ADDRESS);
    problems.extend(found.read_error.map(|error| with_advice(error, check)));
    let faults = if found.started.ptoc == 0 {
        // Remotes older than discovery do not have this location.
        Ok((0, 0))
    } else {
        faults_of(&mut memory)
    };
    let (faults, faults_before) = faults.unwrap_or_else(|error| {
        problems.push(told(&error));
        (0, 0)
    });
    let parameters = descriptor.parameters.iter();
    let parameters = parameters
        .map(|record| parameter(record, &mut memory))
        .collect();
    let process_data = descriptor.process_data.iter();
    let differences = table.map(|table| table.differences(&descriptor));
    InventoryRemote {
        name: descriptor.name,
        known_as: table.map(|table| table.title),
        unit_number: descriptor.unit_number,
        in_setup_position: false,
        software_mode: descriptor.software_mode,
        rx_size: found.started.sizes.rx,
        tx_size: found.started.sizes.tx,
        built_in_table: found.started.ptoc == 0,
        faults: words(RemoteFaults::from_bits_retain(faults)),
        faults_before: words(RemoteFaults::from_bits_retain(faults_before)),
        modes: descriptor.modes.iter().map(mode).collect(),
        process_data: process_data.map(|record| element(record, table)).collect(),
        parameters,
        differences: differences.unwrap_or_default(),
        problems,
        memory_accesses: found.accesses,
    }
}

fn mode(record: &ModeRecord) -> InventoryMode {
    InventoryMode {
        index: record.index,
        set_by: match record.mode_type {
            ModeType::Hardware => "hardware",
            ModeType::Software => "software",
            ModeType::Other(_) => "other",
        },
        name: record.name.clone(),
    }
}

/// The faults that are present now, and those that the remote kept from before. Latched faults stay
/// until cleared, so they are cleared between two reads.
fn faults_of<M: RemoteLink>(memory: &mut M) -> Result<(u8, u8), RemoteLinkError> {
    let read = RemoteAccess::ReadLocal(LocalLocation::FAULTS);
    let kept = memory.access(None, read)? as u8;
    let clear = RemoteAccess::WriteLocal(LocalLocation::CLEAR_FAULTS, 0xFF);
    memory.access(None, clear)?;
    let now = memory.access(None, read)? as u8;
    Ok((now, kept & !now))
}

/// Each fault as text.
fn words(faults: RemoteFaults) -> Vec<String> {
    let bits = (0..8)
        .map(|bit| 1 << bit)
        .filter(|bit| faults.bits() & bit != 0);
    bits.map(|bit| RemoteFaults::from_bits_retain(bit).to_string())
        .collect()
}

fn parameter<B: RegisterBus + Clock>(
    record: &DataRecord,
    memory: &mut PortLink<'_, B>,
) -> InventoryParameter {
    let read = record.read_parameter(memory);
    let error = read.as_ref().err();
    let value = read.as_ref().ok();
    InventoryParameter {
        data: record.into(),
        value: value.map(|value| value.value),
        raw: value.map(|value| value.raw),
        error: error.map(|error| told(error)),
    }
}

fn element(record: &DataRecord, table: Option<&RemoteTable>) -> InventoryElement {
    let known = table.and_then(|table| table.element(&record.name, record.direction));
    let places = known.iter().flat_map(|known| known.places(None));
    InventoryElement {
        data: record.into(),
        terminals: places
            .map(|at| InventoryTerminal {
                place: at.terminal,
                signal: at.signal,
            })
            .collect(),
    }
}

impl From<&DataRecord> for InventoryData {
    fn from(record: &DataRecord) -> Self {
        Self {
            name: record.name.clone(),
            bits: record.bits,
            data_type: format!("{:?}", record.data_type),
            nonvolatile: record.data_type.is_nonvolatile(),
            direction: match record.direction {
                DataDirection::Input => "input",
                DataDirection::Output => "output",
                DataDirection::Bidirectional => "bidirectional",
            },
            min: record.min,
            max: record.max,
            unit: record.unit.clone(),
            address: record.address,
        }
    }
}
