//! Memory image and data layout, built from a description.

use super::description::Working;
use super::{Description, DescriptionError, Record};
use crate::remote::{ParameterPlace, SimMemory, SimRemoteConfig, WorkingCopy};
use mesa_wire::lbp::{Capabilities, DiscoveryReply};

/// Address of the first value in memory.
const VALUES: u16 = 0x0010;
/// Address of the first record in memory. Everything from here on is write-protected.
const RECORDS: u16 = 0x0400;
const END: u16 = 0x8000;
/// Maximum number of bytes of process data in each direction, fault byte and CRC excluded.
const MAX_DATA: usize = 30;

/// The parameter that holds the software revision.
const REVISION: &str = "SwRevision";

/// Duration of an EEPROM access that writes.
const EEPROM_WRITE_TIME: u64 = 4_000_000;

/// A value in the remote's memory.
#[derive(Clone, Debug, PartialEq)]
pub struct SimElement {
    /// Its record.
    pub record: Record,
    /// Address of its value.
    pub address: u16,
}

/// Addresses of the values in the memory of a remote, and the process data of each mode.
#[derive(Clone, Debug, Default)]
pub struct SimLayout {
    elements: Vec<SimElement>,
    modes: Vec<(u8, Vec<usize>)>,
    parameters: Vec<SimElement>,
    hidden: Vec<(String, u16)>,
    pub(super) clear_faults: Option<(u8, u8)>,
}

impl SimLayout {
    /// All process data of all modes, in the order of the description.
    pub fn elements(&self) -> &[SimElement] {
        &self.elements
    }

    /// The parameters.
    pub fn parameters(&self) -> &[SimElement] {
        &self.parameters
    }

    /// Process data of `mode`, in order.
    pub fn mode(&self, mode: u8) -> impl Iterator<Item = &SimElement> {
        let order = self.modes.iter().find(|(index, _)| *index == mode);
        let order = order.map_or(&[][..], |(_, order)| order.as_slice());
        order.iter().filter_map(|&index| self.elements.get(index))
    }

    /// Address of a value in memory: process data, a parameter or a working copy.
    pub fn address(&self, name: &str) -> Option<u16> {
        let elements = self.elements.iter().chain(&self.parameters);
        let element = elements
            .filter(|element| element.record.name == name)
            .map(|element| element.address);
        let hidden = self.hidden.iter().filter(|(hidden, _)| hidden == name);
        element.chain(hidden.map(|&(_, address)| address)).next()
    }

    /// Packs the inputs of `mode` out of memory.
    pub fn pack(&self, mode: u8, memory: &SimMemory, data: &mut [u8]) {
        let mut at = 0;
        for element in self.mode(mode).filter(|e| e.record.is_input()) {
            for bit in 0..u16::from(element.record.bits) {
                let byte = memory.byte(element.address.wrapping_add(bit / 8));
                if let Some(to) = data.get_mut(at / 8) {
                    *to |= (byte >> (bit % 8) & 1) << (at % 8);
                }
                at += 1;
            }
        }
    }

    /// Unpacks the outputs of `mode` into memory.
    pub fn unpack(&self, mode: u8, memory: &mut SimMemory, data: &[u8]) {
        let mut at = 0;
        for element in self.mode(mode).filter(|e| e.record.is_output()) {
            let mut value = 0;
            for bit in 0..u16::from(element.record.bits) {
                let from = data.get(at / 8).copied().unwrap_or_default();
                value |= (from >> (at % 8) & 1) << (bit % 8);
                at += 1;
                if bit % 8 == 7 || bit + 1 == u16::from(element.record.bits) {
                    memory.set_byte(element.address.wrapping_add(bit / 8), value);
                    value = 0;
                }
            }
        }
    }

    /// Sets all outputs in memory to zero.
    pub fn clear_outputs(&self, memory: &mut SimMemory) {
        for element in self.elements.iter().filter(|e| e.record.is_output()) {
            for offset in 0..element.record.bytes() as u16 {
                memory.set_byte(element.address.wrapping_add(offset), 0);
            }
        }
    }
}

/// Builds the configuration of a [`SimRemote`](crate::remote::SimRemote), and its layout.
pub fn build(description: &Description) -> Result<(SimRemoteConfig, SimLayout), DescriptionError> {
    Builder::default().build(description)
}

#[derive(Default)]
struct Builder {
    image: SimMemory,
    layout: SimLayout,
    next_value: u16,
    next_record: u16,
}

impl Builder {
    fn build(
        mut self,
        description: &Description,
    ) -> Result<(SimRemoteConfig, SimLayout), DescriptionError> {
        self.next_value = VALUES;
        self.next_record = RECORDS;
        self.place_values(description)?;
        let mut config = SimRemoteConfig {
            name: description.name,
            unit_number: description.unit,
            hardware_mode: description.hardware.0,
            software_revision: description.revision,
            capabilities: Capabilities::CRC | Capabilities::EEPROM | Capabilities::FLASH,
            eeprom_write_time: EEPROM_WRITE_TIME,
            no_discovery: description.no_discovery,
            no_fault_byte: description.no_fault_byte,
            ignores_modes: description.no_discovery,
            initial_mode: description.modes.iter().map(|m| m.index).min().unwrap_or(0),
            ..SimRemoteConfig::default()
        };
        self.place_records(description, &mut config)?;
        self.link(description, &mut config)?;
        self.layout.clear_faults = description.clear_faults;
        self.image.protect(RECORDS..self.next_record);
        config.image = self.image;
        Ok((config, self.layout))
    }

    /// Assigns an address to each value, the same in all modes, and factory values to parameters.
    fn place_values(&mut self, description: &Description) -> Result<(), DescriptionError> {
        for mode in &description.modes {
            let mut order = Vec::new();
            for record in &mode.data {
                let known = &mut self.layout.elements;
                let same = known.iter().position(|e| e.record.name == record.name);
                let index = match same {
                    Some(index) if order.contains(&index) => None,
                    same => same,
                };
                let address = match index.and_then(|index| known.get(index)) {
                    Some(e) if e.record == *record => {
                        order.extend(index);
                        continue;
                    }
                    Some(e) if is_part(record, &e.record) => e.address,
                    Some(_) => return Err(DescriptionError::Conflict),
                    None => allocate(&mut self.next_value, record.bytes())?,
                };
                order.push(known.len());
                known.push(SimElement {
                    record: record.clone(),
                    address,
                });
            }
            self.layout.modes.push((mode.index, order));
        }
        for parameter in &description.parameters {
            let record = &parameter.record;
            let address = allocate(&mut self.next_value, record.bytes())?;
            let is_unit = description.unit_number.as_ref() == Some(&record.name);
            let value = if is_unit {
                description.unit.into()
            } else {
                parameter.value
            };
            self.image.set_word(address, record.bytes(), value);
            self.layout.parameters.push(SimElement {
                record: record.clone(),
                address,
            });
        }
        Ok(())
    }

    fn place_records(
        &mut self,
        description: &Description,
        config: &mut SimRemoteConfig,
    ) -> Result<(), DescriptionError> {
        if description.no_discovery {
            for mode in &description.modes {
                self.set_mode(config, mode.index, 0, 0)?;
            }
            return Ok(());
        }
        let elements = self.layout.elements.clone();
        let data = self.data_records(&elements)?;
        let (index, name) = &description.hardware;
        let hardware = self.mode_record(*index, 0, name)?;
        let mut software = Vec::new();
        for mode in &description.modes {
            software.push(self.mode_record(mode.index, 1, &mode.name)?);
        }
        let parameters = self.layout.parameters.clone();
        let parameters = self.data_records(&parameters)?;
        // FACTS 7.2: all records of the device, process data of all modes too.
        let global = [&data[..], &[hardware], &software, &parameters, &[0]].concat();
        let gtoc = self.table(&global)?;
        let orders = self.layout.modes.clone();
        for ((index, order), &own) in orders.iter().zip(&software) {
            let records = order.iter();
            let records = records.filter_map(|&element| data.get(element).copied());
            let table: Vec<u16> = records.chain([hardware, own, 0]).collect();
            let ptoc = self.table(&table)?;
            self.set_mode(config, *index, ptoc, gtoc)?;
        }
        Ok(())
    }

    fn set_mode(
        &self,
        config: &mut SimRemoteConfig,
        mode: u8,
        ptoc: u16,
        gtoc: u16,
    ) -> Result<(), DescriptionError> {
        let bytes = |wanted: fn(&Record) -> bool| {
            let records = self.layout.mode(mode).map(|element| &element.record);
            let bits = records.filter(|record| wanted(record));
            bits.map(|record| usize::from(record.bits))
                .sum::<usize>()
                .div_ceil(8)
        };
        let (rx, tx) = (bytes(Record::is_input), bytes(Record::is_output));
        if rx > MAX_DATA || tx > MAX_DATA {
            return Err(DescriptionError::TooMuchData { mode });
        }
        if let Some(slot) = config.modes.get_mut(usize::from(mode)) {
            *slot = Some(DiscoveryReply {
                rx_size: rx as u8 + u8::from(!config.no_fault_byte),
                tx_size: tx as u8,
                ptoc,
                gtoc,
            });
        }
        Ok(())
    }

    /// Sets working copies, and the addresses of watchdog time, unit number, baud rate and
    /// revision.
    fn link(
        &mut self,
        description: &Description,
        config: &mut SimRemoteConfig,
    ) -> Result<(), DescriptionError> {
        for working in &description.working {
            let copy = self.working_copy(working, description)?;
            config.working_copies.push(copy);
        }
        let find = |name: &Option<String>| match name {
            None => Ok(None),
            Some(name) => match self.layout.address(name) {
                None => Err(DescriptionError::UnknownName),
                address => Ok(address),
            },
        };
        config.watchdog_address = find(&description.watchdog)?;
        config.unit_address = find(&description.unit_number)?;
        config.baud_address = find(&description.baud_rate)?;
        let mut parameters = self.layout.parameters.iter();
        let revision = parameters.find(|parameter| parameter.record.name == REVISION);
        config.revision_place = revision.map(|parameter| ParameterPlace {
            address: parameter.address,
            bytes: parameter.record.bytes() as u16,
        });
        // Read without EC, a non-volatile parameter has its value at power-up.
        for parameter in &self.layout.parameters {
            if parameter.record.is_nonvolatile() {
                config.working_copies.push(WorkingCopy {
                    from: parameter.address,
                    to: parameter.address,
                    bytes: parameter.record.bytes() as u16,
                });
            }
        }
        Ok(())
    }

    /// Gives a working copy its memory and sets the value of both; for the unit number, that of the
    /// description.
    fn working_copy(
        &mut self,
        working: &Working,
        description: &Description,
    ) -> Result<WorkingCopy, DescriptionError> {
        let bytes = usize::from(working.bits).div_ceil(8);
        let find = |layout: &SimLayout, name: &str| {
            let parameter = layout.parameters.iter().find(|p| p.record.name == name);
            parameter.map(|p| (p.address, p.record.bytes()))
        };
        let from = find(&self.layout, &working.from);
        let (from, size) = from.ok_or(DescriptionError::UnknownName)?;
        let to = if let Some((address, _)) = find(&self.layout, &working.name) {
            address
        } else {
            let address = allocate(&mut self.next_value, bytes)?;
            self.layout.hidden.push((working.name.clone(), address));
            address
        };
        let is_unit = description.unit_number.as_ref() == Some(&working.name);
        let value = if is_unit {
            description.unit.into()
        } else {
            self.image.word(from, size)
        };
        self.image.set_word(from, size, value);
        self.image.set_word(to, bytes, value);
        Ok(WorkingCopy {
            from,
            to,
            bytes: bytes.min(size) as u16,
        })
    }

    fn data_records(&mut self, elements: &[SimElement]) -> Result<Vec<u16>, DescriptionError> {
        let mut addresses = Vec::new();
        for SimElement { record, address } in elements {
            let mut bytes = vec![0xA0, record.bits, record.kind, record.direction];
            bytes.extend(record.min.to_le_bytes());
            bytes.extend(record.max.to_le_bytes());
            bytes.extend(address.to_le_bytes());
            bytes.extend(record.unit.bytes());
            bytes.push(0);
            bytes.extend(record.name.bytes());
            bytes.push(0);
            addresses.push(self.write(&bytes)?);
        }
        Ok(addresses)
    }

    fn mode_record(&mut self, index: u8, kind: u8, name: &str) -> Result<u16, DescriptionError> {
        let mut bytes = vec![0xB0, index, kind, 0];
        bytes.extend(name.bytes());
        bytes.push(0);
        self.write(&bytes)
    }

    fn table(&mut self, pointers: &[u16]) -> Result<u16, DescriptionError> {
        let bytes: Vec<u8> = pointers.iter().flat_map(|p| p.to_le_bytes()).collect();
        self.write(&bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<u16, DescriptionError> {
        let address = self.next_record;
        let end = usize::from(address) + bytes.len();
        if end > usize::from(END) {
            return Err(DescriptionError::TooManyRecords);
        }
        self.image.load(address, bytes);
        self.next_record = end as u16;
        Ok(address)
    }
}

/// True if `record` is the low bits of `whole` under the same name.
fn is_part(record: &Record, whole: &Record) -> bool {
    let as_wide = Record {
        bits: whole.bits,
        ..record.clone()
    };
    record.bits < whole.bits && as_wide == *whole
}

/// Allocates the next free address for a value, a multiple of four.
fn allocate(next: &mut u16, bytes: usize) -> Result<u16, DescriptionError> {
    let address = *next;
    let end = usize::from(address) + bytes.next_multiple_of(4);
    if end > usize::from(RECORDS) {
        return Err(DescriptionError::TooManyRecords);
    }
    *next = end as u16;
    Ok(address)
}
