//! Head of a report: when and on what the check was done.

use std::fmt::{self, Display};
use std::time::SystemTime;

use mesa_hal::Driver;
use mesa_hal::ethernet::Identity;
use serde::Serialize;

use crate::board::bus::Bus;
use crate::ui::stamp;

/// Date of a check, and what identifies the machine.
#[derive(Clone, Debug, Serialize)]
pub struct Head {
    /// Begin of the check, in UTC, as in ISO 8601.
    date: String,
    address: String,
    /// Name of the board.
    board: String,
    /// `None` on the PCI bus.
    #[serde(skip_serializing_if = "Option::is_none")]
    mac: Option<String>,
    /// Name of the board that the FPGA's firmware is for.
    firmware: String,
    /// Version of the Ethernet side's firmware.
    #[serde(skip_serializing_if = "Option::is_none")]
    ethernet_firmware: Option<u16>,
    units: Vec<RemoteUnit>,
}

/// A remote that takes part.
#[derive(Clone, Debug, Serialize)]
struct RemoteUnit {
    /// `PORT.CHANNEL`.
    place: String,
    card: String,
    unit_number: u32,
}

impl Head {
    /// The head for a check that begins now.
    pub fn new(address: &impl Display, identity: Option<&Identity>, driver: &Driver<Bus>) -> Self {
        let units = driver.ports().iter().flat_map(|port| {
            let number = port.layout().instance;
            port.remotes().map(move |remote| RemoteUnit {
                place: format!("{number}.{}", remote.started.channel.index()),
                card: remote.descriptor.name.to_string(),
                unit_number: remote.started.unit_number,
            })
        });
        let name = driver.firmware().idrom.board().to_uppercase();
        Self {
            date: stamp::utc(SystemTime::now()),
            address: address.to_string(),
            board: identity.map_or_else(|| name.clone(), |identity| identity.card.clone()),
            mac: identity.map(|identity| identity.mac.to_string()),
            firmware: driver.firmware().idrom.board_name.clone(),
            ethernet_firmware: identity.map(|identity| identity.firmware_version),
            units: units.collect(),
        }
    }
}

impl Display for Head {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            date,
            address,
            board,
            mac,
            firmware,
            ethernet_firmware,
            units,
        } = self;
        writeln!(f, "Wiring of {address}, checked from {date} on")?;
        write!(f, "Board     {board}")?;
        if let Some(mac) = mac {
            write!(f, ", MAC {mac}")?;
        }
        write!(f, "\nFirmware  {firmware}")?;
        if let Some(version) = ethernet_firmware {
            write!(f, ", Ethernet firmware {version}")?;
        }
        writeln!(f)?;
        for RemoteUnit {
            place,
            card,
            unit_number,
        } in units
        {
            writeln!(
                f,
                "Remote    {place} {card}, unit number 0x{unit_number:08X}"
            )?;
        }
        Ok(())
    }
}
