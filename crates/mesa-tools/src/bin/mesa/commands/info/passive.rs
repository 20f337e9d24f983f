//! `mesa info --passive`: what can be known of a board that another program drives.

use std::fmt::{self, Display, Formatter};

use mesa_hal::ethernet::EthernetBoard;
use mesa_tools::inventory::InventoryEthernet;
use mesa_tools::passive::{PassiveInventory, Value, Watched};
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
    let mut watched = Watched::new(bus).map_err(|error| look::failed(found.address, &error))?;
    let inventory = PassiveInventory::take(&mut watched, ethernet)
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
        print_values(f, &inventory.values)?;
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

/// Pins at terminals, and registers that no pin shows.
fn print_values(f: &mut Formatter<'_>, values: &[Value]) -> fmt::Result {
    let is_opposite = |name: &str| name.ends_with("-not") || name.ends_with("_not");
    let is_listed = |value: &&Value| {
        value.value.as_bool().is_none() || !value.place.is_empty() && !is_opposite(&value.name)
    };
    let listed: Vec<_> = values.iter().filter(is_listed).collect();
    let widths = listed.iter().map(|value| value.name.len());
    let width = widths.max().unwrap_or(0);
    writeln!(f, "\nPins and registers, as the board shows them")?;
    listed.into_iter().try_for_each(|value| {
        let line = format!("  {:<width$}  {value:<12}  {}", value.name, value.place);
        writeln!(f, "{}", line.trim_end())
    })
}
