//! `mesa info`: identity, counters, memory, firmware, modules, pins, serial ports, and their
//! remotes with modes, process data and parameters.

mod passive;
mod text;

pub use text::limits;

use std::collections::BTreeMap;

use clap::Args;
use mesa_hal::MesaError;
use mesa_hal::RemoteId;
use mesa_hal::ethernet::EthernetBoard;
use mesa_tools::inventory::{self, Inventory, InventoryEthernet};
use serde::Serialize;

use crate::board::modes::Modes;
use crate::board::target::{self, Target};
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::output::complain;
use mesa_tools::advice::told;

const AFTER_HELP: &str = "\
Stops the serial ports and turns all pins into inputs: on a running machine use --passive. A board
that another program drives is left alone without it. SIGINT (Ctrl-C) and SIGTERM end the command
between two ports, and leave the ports stopped.

Examples:
  mesa info --addr 10.10.10.10 --mode 0.0=2
  mesa info --addr 10.10.10.10 --passive";

/// Show the inventory of a board and its remotes
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Info {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
    /// Look at a running machine: read what can be read beside LinuxCNC or another program that
    /// drives the board. Writes nothing; remotes are not asked
    #[arg(long, conflicts_with = "modes")]
    passive: bool,
}

/// Inventory of the board.
#[derive(Debug, Serialize)]
#[serde(transparent)]
struct Found(Inventory);

impl Info {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let found = self.target.find(context)?;
        if self.passive {
            return passive::run(&found, context);
        }
        let modes = self.modes.by_remote();
        let mut inventory = Found(take(&found, &self.modes, context)?);
        let wrong = inventory.check_modes(&modes);
        if context.stop.signal().is_none() {
            let findings = &mut inventory.0.findings;
            // A remote that runs in another mode already has a finding of its own.
            let is_said = findings.iter().any(|text| text.contains("software mode"));
            let unsaid = wrong.iter().filter(|_| !is_said);
            findings.extend(unsaid.cloned());
        }
        context.print(&inventory)?;
        if let Some(signal) = context.stop.signal() {
            complain(format_args!(
                "mesa: ended by {signal}; the inventory is not complete"
            ));
        } else if !wrong.is_empty() {
            return Err(Failure::refused(wrong.join("\n")));
        }
        Ok(context.ending())
    }
}

/// Takes the inventory of a board; without the ports that are left when a signal comes.
pub fn take(found: &target::Found, modes: &Modes, context: &Context) -> Result<Inventory, Failure> {
    let mut bus = found.open()?;
    let at = |error: &dyn MesaError| {
        Failure::of(error, format_args!("{}: {}", found.address, told(error)))
    };
    let ethernet = bus
        .is_on_ethernet()
        .then(|| InventoryEthernet::read(&mut EthernetBoard::new(&mut bus)));
    let ethernet = ethernet.transpose().map_err(|e| at(&e))?;
    let goes_on = || context.stop.signal().is_none();
    let inventory = inventory::take(&mut bus, ethernet, &modes.by_remote(), goes_on);
    inventory.map_err(|e| at(&e))
}

impl Found {
    /// Errors for remotes that do not run in the requested mode, or do not have it.
    fn check_modes(&self, modes: &BTreeMap<RemoteId, u8>) -> Vec<String> {
        let modes = modes.iter();
        modes
            .filter_map(|(&id, &mode)| self.check_mode(id, mode))
            .collect()
    }

    fn check_mode(&self, id: RemoteId, mode: u8) -> Option<String> {
        let mut remotes = self.0.remotes();
        let Some((label, remote)) = remotes.find(|&(found, _)| found == id) else {
            return Some(format!("{id}: nothing started in software mode {mode}"));
        };
        let modes = remote.modes.iter();
        let known: Vec<_> = modes.filter(|known| known.set_by == "software").collect();
        if known.is_empty() || known.iter().any(|known| known.index == mode) {
            return None;
        }
        let texts = known
            .iter()
            .map(|known| format!("{} ({})", known.index, known.name));
        Some(format!(
            "{label} has no software mode {mode}; it has {}; ask for one of these",
            texts.collect::<Vec<_>>().join(", ")
        ))
    }
}
