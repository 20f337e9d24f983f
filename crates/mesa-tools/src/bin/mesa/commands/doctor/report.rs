//! `mesa doctor --report`: data of a real board that settles what the documents list as not
//! confirmed.

use std::collections::BTreeMap;

use mesa_hal::RemoteId;
use mesa_hal::bus::{Access, RegisterBus};
use mesa_hal::ethernet::{EthernetBoard, Identity};
use mesa_hal::lbp16::Space;
use mesa_hal::runner::Stop;
use mesa_pci::PciDevice;
use mesa_tools::inventory::{self, ChannelContent, Inventory, InventoryData};
use serde::Serialize;

use super::pci::PciFacts;
use crate::board::bus::Bus;
use crate::ui::context::Failure;

/// All data of the report.
#[derive(Debug, Serialize)]
pub struct HardwareReport {
    mesa: &'static str,
    address: String,
    /// Of a board on Ethernet.
    #[serde(skip_serializing_if = "Option::is_none")]
    identity: Option<Identity>,
    /// Of a board on the PCI bus.
    #[serde(skip_serializing_if = "Option::is_none")]
    pci: Option<PciFacts>,
    memory: Vec<Memory>,
    remotes: Vec<Remote>,
    questions: Vec<Question>,
}

/// Contents of registers.
#[derive(Debug, Serialize)]
struct Memory {
    space: u8,
    address: u16,
    values: Vec<u32>,
}

/// A remote's own description of its process data.
#[derive(Debug, Serialize)]
struct Remote {
    port: u8,
    channel: u8,
    name: String,
    unit_number: String,
    software_mode: u8,
    records: Vec<InventoryData>,
}

/// A question that no manual answers.
#[derive(Debug, Serialize)]
struct Question {
    /// Place of the question in the documents.
    stands_in: &'static str,
    not_confirmed: &'static str,
    /// Data that settles the question.
    decided_by: &'static str,
    /// Data found; empty if the card is not there.
    found: Vec<String>,
}

/// Data that settles a question about a card. Selected by the card's name, the top byte of its unit
/// number if that matters, the software mode, and the prefix of the records' names.
struct Decider {
    stands_in: &'static str,
    not_confirmed: &'static str,
    decided_by: &'static str,
    card: &'static str,
    class: Option<u32>,
    mode: u8,
    records: &'static str,
}

/// Questions about cards that `docs/gateware.md` lists as not confirmed.
const DECIDERS: [Decider; 3] = [
    Decider {
        stands_in: "FACTS 8.2",
        not_confirmed: "the 8 bits of the counters Enc0 and Enc1 of a 7I77's field I/O",
        decided_by: "bits of the records Enc0 and Enc1 in software mode 3",
        card: "7I77",
        class: Some(0x12),
        mode: 3,
        records: "Enc",
    },
    Decider {
        stands_in: "FACTS 8.3",
        not_confirmed: "type and limits of the analog outputs of a 7I77",
        decided_by: "data type, minimum and maximum of the records AnalogOut0 to AnalogOut5",
        card: "7I77",
        class: Some(0x11),
        mode: 0,
        records: "AnalogOut",
    },
    Decider {
        stands_in: "FACTS 8.4",
        not_confirmed: "the scale of a 7I72's FieldVoltage",
        decided_by: "bits, minimum and maximum of the record FieldVoltage in software mode 1",
        card: "7I72",
        class: None,
        mode: 1,
        records: "FieldVoltage",
    },
];

/// Reads the data; neither the board nor a remote stores anything. Without `remotes`, the remotes
/// are left alone.
pub fn gather(
    bus: &mut Bus,
    address: String,
    device: Option<&PciDevice>,
    stop: &Stop,
    remotes: bool,
) -> Result<HardwareReport, Failure> {
    let mut identity = None;
    let mut memory = Vec::new();
    let mut spaces = vec![
        (Space::HostMot2, 0x0100, 4),
        // The IDROM, up to the watchdog.
        (Space::HostMot2, 0x0400, 512),
    ];
    if bus.is_on_ethernet() {
        identity = Some(EthernetBoard::new(bus).identity()?);
        spaces.extend([
            (Space::Eeprom, 0, 64),
            (Space::Control, 0, 16),
            (Space::ReadOnly, 0, 16),
        ]);
    }
    for (space, address, count) in spaces {
        let values = if bus.is_on_ethernet() {
            EthernetBoard::new(bus).peek(space, address, count)?
        } else {
            let mut words = vec![0; usize::from(count)];
            bus.exchange(&[Access::read(address, 0, count)], &mut words)?;
            words
        };
        memory.push(Memory {
            space: space as u8,
            address,
            values,
        });
    }
    let pci = device.map(|device| PciFacts::gather(bus, device));
    let pci = pci.transpose()?;
    let inventories = if remotes {
        inventories(bus, stop)?
    } else {
        Vec::new()
    };
    let remotes: Vec<Remote> = inventories.iter().flat_map(Remote::all).collect();
    let mut questions: Vec<Question> = DECIDERS
        .iter()
        .map(|decider| decider.question(&remotes))
        .collect();
    questions.extend(identity.as_ref().map(|identity| Question {
        stands_in: "ethernet::AddressSource",
        not_confirmed: "which bits of the jumpers' word are which jumper",
        decided_by: "that word, beside the jumpers as they are set and the address that it answers at",
        found: vec![format!("0x{:04X} at {address}", identity.jumpers)],
    }));
    let answers = pci.iter().flat_map(PciFacts::answers);
    questions.extend(
        answers.map(|(stands_in, not_confirmed, decided_by, found)| Question {
            stands_in,
            not_confirmed,
            decided_by,
            found: Some(found)
                .filter(|found| !found.is_empty())
                .into_iter()
                .collect(),
        }),
    );
    Ok(HardwareReport {
        mesa: env!("CARGO_PKG_VERSION"),
        address,
        identity,
        pci,
        memory,
        remotes,
        questions,
    })
}

impl HardwareReport {
    /// Number of answered questions, and of all.
    pub fn answered(&self) -> (usize, usize) {
        let answered = self.questions.iter().filter(|one| !one.found.is_empty());
        (answered.count(), self.questions.len())
    }
}

/// Inventories in software mode 0 and, if needed, in the modes that settle a question.
fn inventories(bus: &mut Bus, stop: &Stop) -> Result<Vec<Inventory>, Failure> {
    let mut take = |modes: &BTreeMap<RemoteId, u8>| {
        let taken = inventory::take(bus, None, modes, || stop.signal().is_none());
        taken.map_err(Failure::from)
    };
    let first = take(&BTreeMap::new())?;
    let wanted = |remote: Remote| {
        let mut deciders = DECIDERS.iter();
        let decider = deciders.find(|decider| decider.mode > 0 && decider.is_for(&remote));
        decider.map(|decider| (RemoteId::new(remote.port, remote.channel), decider.mode))
    };
    let modes: BTreeMap<_, _> = Remote::all(&first).filter_map(wanted).collect();
    let mut all = vec![first];
    if !modes.is_empty() {
        all.push(take(&modes)?);
    }
    Ok(all)
}

impl Remote {
    fn all(inventory: &Inventory) -> impl Iterator<Item = Self> {
        inventory.serial_ports.iter().flat_map(|port| {
            port.channels.iter().filter_map(|channel| {
                let ChannelContent::Remote(remote) = &channel.found else {
                    return None;
                };
                let records = remote.process_data.iter();
                Some(Self {
                    port: port.port,
                    channel: channel.channel,
                    name: remote.name.to_string(),
                    unit_number: format!("0x{:08X}", remote.unit_number),
                    software_mode: remote.software_mode,
                    records: records.map(|element| element.data.clone()).collect(),
                })
            })
        })
    }
}

impl Decider {
    fn is_for(&self, remote: &Remote) -> bool {
        let class = |class: u32| remote.unit_number.starts_with(&format!("0x{class:02X}"));
        remote.name.starts_with(self.card) && self.class.is_none_or(class)
    }

    fn question(&self, remotes: &[Remote]) -> Question {
        let its = remotes.iter().filter(|remote| self.is_for(remote));
        let its = its.filter(|remote| remote.software_mode == self.mode);
        let records = its.flat_map(|remote| &remote.records);
        let records = records.filter(|record| record.name.starts_with(self.records));
        let found = records.map(|record| {
            let InventoryData {
                name,
                bits,
                data_type,
                min,
                max,
                unit,
                ..
            } = record;
            format!("{name}: {data_type}, {bits} bits, {min} to {max} {unit}")
        });
        Question {
            stands_in: self.stands_in,
            not_confirmed: self.not_confirmed,
            decided_by: self.decided_by,
            found: found.collect(),
        }
    }
}
