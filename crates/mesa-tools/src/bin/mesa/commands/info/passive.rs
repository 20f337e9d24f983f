//! `mesa info --passive`: what can be known of a board that another program drives.

use std::fmt::{self, Display, Formatter};

use mesa_hal::ethernet::EthernetBoard;
use mesa_tools::inventory::InventoryEthernet;
use mesa_tools::passive::{PassiveInventory, PassivePort};
use serde::Serialize;

use super::text::{print_ethernet, print_firmware, print_verdict};
use crate::board::look;
use crate::board::target::Found;
use crate::ui::context::{Context, Ending, Failure};

/// Inventory of a board that another program drives: `info_passive` in the schema.
#[derive(Debug, Serialize)]
#[serde(transparent)]
struct Seen(PassiveInventory);

pub fn run(found: &Found, context: &Context) -> Result<Ending, Failure> {
    let mut bus = found.look()?;
    let ethernet = InventoryEthernet::read(&mut EthernetBoard::new(&mut bus))
        .map_err(|error| look::failed(found.address, &error))?;
    let inventory = PassiveInventory::take(&mut bus, ethernet)
        .map_err(|error| look::failed(found.address, &error))?;
    context.print(&Seen(inventory))?;
    Ok(context.ending())
}

impl Display for Seen {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let inventory = &self.0;
        print_verdict(f, &inventory.judgement(), &inventory.findings)?;
        print_ethernet(f, &inventory.ethernet)?;
        print_firmware(f, &inventory.firmware)?;
        let mut ports = inventory.serial_ports.iter();
        ports.try_for_each(|port| print_port(f, port))?;
        writeln!(f, "\nNot known without a command to the board:")?;
        for unknown in &inventory.unknown {
            writeln!(f, "  {unknown}")?;
        }
        let look = inventory.look;
        writeln!(
            f,
            "\n{} read, none of them written; {} not answered",
            mesa_tools::Counted(look.packets, "packet"),
            look.lost
        )
    }
}

fn print_port(f: &mut Formatter<'_>, port: &PassivePort) -> fmt::Result {
    writeln!(
        f,
        "\nSmart serial port {}, as its registers show it",
        port.port
    )?;
    for channel in &port.channels {
        writeln!(f, "  Channel {}: {}", channel.channel, channel.state)?;
        let words = channel.interfaces.iter();
        let words: Vec<_> = words.map(|word| format!("{word:08X}")).collect();
        writeln!(f, "    last data from it: {}", words.join(" "))?;
    }
    Ok(())
}
