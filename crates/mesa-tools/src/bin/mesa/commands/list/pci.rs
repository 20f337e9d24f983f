//! `mesa list --pci`: the boards on the PCI bus, without an access to them.

use std::fmt::{self, Display};
use std::path::Path;

use mesa_pci::PciDevice;
use mesa_tools::advice::told;
use serde::Serialize;

use crate::board::address::BoardAddress;
use crate::ui::context::{Context, Ending, Failure};

/// The boards below a root: `list_pci` in the schema.
#[derive(Debug, Serialize)]
struct PciBoards {
    root: String,
    boards: Vec<PciBoardFound>,
}

/// A board.
#[derive(Debug, Serialize)]
struct PciBoardFound {
    address: BoardAddress,
    board: &'static str,
    simulated: bool,
    /// Why it cannot be used as it is, and what to do; `None` if nothing is known against it.
    refused: Option<String>,
}

pub fn run(root: &Path, context: &Context) -> Result<Ending, Failure> {
    let found = mesa_pci::search(root)
        .map_err(|error| Failure::refused(format_args!("{}: {error}", root.display())))?;
    let boards = PciBoards {
        root: root.display().to_string(),
        boards: found.iter().map(PciBoardFound::of).collect(),
    };
    context.print(&boards)?;
    Ok(match context.ending() {
        Ending::Done if boards.boards.is_empty() => Ending::Refused,
        ending => ending,
    })
}

impl PciBoardFound {
    fn of(device: &PciDevice) -> Self {
        let refused = device.check().err();
        Self {
            address: BoardAddress::Pci(device.address()),
            board: device.board().name,
            simulated: device.is_simulated(),
            refused: refused.map(|error| told(&error)),
        }
    }
}

impl Display for PciBoards {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.boards.is_empty() {
            writeln!(f, "no board of Mesa's on the PCI bus below {}", self.root)?;
            return writeln!(
                f,
                "  `lspci -D -d 2718:` lists them as well; one that is missing is not seated or has no power"
            );
        }
        for board in &self.boards {
            let simulated = if board.simulated { ", simulated" } else { "" };
            writeln!(f, "{}  {}{simulated}", board.address, board.board)?;
            if let Some(refused) = &board.refused {
                writeln!(f, "  {refused}")?;
            }
        }
        Ok(())
    }
}
