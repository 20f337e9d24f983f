//! The bus of all commands: to a board on Ethernet or on the PCI bus, real or simulated.

use std::time::Duration;

use mesa_hal::bus::{BusError, BusErrorKind, BusLayer, ClockedBus};
use mesa_hal::ethernet::Lbp16Board;
use mesa_hal::transport::udp::UdpBus;
use mesa_pci::PciBus;

use crate::board::link::BoardLink;
use crate::machine::embedded::EmbeddedPci;

/// The bus of all commands.
#[derive(Debug)]
pub enum Bus {
    /// A board on Ethernet.
    Ethernet(Box<UdpBus<BoardLink>>),
    /// A board on the PCI bus.
    Pci(Box<PciBus>),
    /// A simulated board on the PCI bus, in this program.
    Embedded(EmbeddedPci),
}

/// A request for the Ethernet side of a board that has none.
const NO_ETHERNET: BusError = BusError::custom(
    BusErrorKind::Invalid,
    "a board on the PCI bus has no Ethernet side: no IP address, no packets, no EEPROM of its own",
);

impl Bus {
    /// True for a board that has a network side.
    pub const fn is_on_ethernet(&self) -> bool {
        matches!(self, Self::Ethernet(_))
    }

    /// Fails if another host drives the board. On the PCI bus the lock of the board is the
    /// evidence.
    pub fn check_alone(&mut self) -> Result<(), BusError> {
        match self {
            Self::Ethernet(bus) => bus.check_alone(),
            Self::Pci(_) | Self::Embedded(_) => Ok(()),
        }
    }

    /// Socket options that this host did not allow.
    pub fn refused(&mut self) -> &[&'static str] {
        match self {
            Self::Ethernet(bus) => bus.link().refused(),
            Self::Pci(_) | Self::Embedded(_) => &[],
        }
    }
}

impl BusLayer for Bus {
    type Inner = dyn ClockedBus;

    fn inner(&self) -> &Self::Inner {
        match self {
            Self::Ethernet(bus) => &**bus,
            Self::Pci(bus) => &**bus,
            Self::Embedded(bus) => bus,
        }
    }

    fn inner_mut(&mut self) -> &mut Self::Inner {
        match self {
            Self::Ethernet(bus) => &mut **bus,
            Self::Pci(bus) => &mut **bus,
            Self::Embedded(bus) => bus,
        }
    }
}

/// The Ethernet side; an error on a board that has none.
impl Lbp16Board for Bus {
    fn run_commands(
        &mut self,
        commands: &[u8],
        reply: &mut [u8],
        deadline: Duration,
    ) -> Result<(), BusError> {
        match self {
            Self::Ethernet(bus) => bus.run_commands(commands, reply, deadline),
            Self::Pci(_) | Self::Embedded(_) => Err(NO_ETHERNET),
        }
    }

    fn send(&mut self, commands: &[u8]) -> Result<(), BusError> {
        match self {
            Self::Ethernet(bus) => bus.send(commands),
            Self::Pci(_) | Self::Embedded(_) => Err(NO_ETHERNET),
        }
    }
}
