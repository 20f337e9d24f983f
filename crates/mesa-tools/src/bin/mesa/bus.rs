//! The bus of all commands: to a board on Ethernet or on the PCI bus, real or simulated.

use std::time::Duration;

use mesa_hal::bus::{
    Access, AccessList, BoardIdentity, BusError, BusErrorKind, BusStatistics, Clock, Effort, Hold,
    Instant, RegisterBus, Reply,
};
use mesa_hal::ethernet::Lbp16Board;
use mesa_hal::transport::udp::UdpBus;
use mesa_pci::PciBus;

use crate::link::BoardLink;
use crate::simulated::EmbeddedPci;

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

/// Calls a function of the bus inside.
macro_rules! with {
    ($this:expr, $bus:ident => $call:expr) => {
        match $this {
            Bus::Ethernet($bus) => $call,
            Bus::Pci($bus) => $call,
            Bus::Embedded($bus) => $call,
        }
    };
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

    /// Fails if another host drives the board. On the PCI bus the lock of the board is the evidence.
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

impl RegisterBus for Bus {
    fn can_hold(&self) -> bool {
        with!(self, bus => bus.can_hold())
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        with!(self, bus => bus.exchange(accesses, words))
    }

    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<AccessList, BusError> {
        with!(self, bus => bus.prepare(accesses, hold))
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), BusError> {
        with!(self, bus => bus.start(list, words))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        with!(self, bus => bus.finish(list, words))
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        with!(self, bus => bus.write_all(accesses, words))
    }

    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        with!(self, bus => bus.set_cycle(period, deadline));
    }

    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, BusError> {
        with!(self, bus => bus.board(effort))
    }

    fn statistics(&self) -> BusStatistics {
        with!(self, bus => bus.statistics())
    }
}

impl Clock for Bus {
    fn now(&mut self) -> Instant {
        with!(self, bus => bus.now())
    }

    fn wait(&mut self, duration: Duration) {
        with!(self, bus => bus.wait(duration));
    }

    fn sleep(&mut self, duration: Duration) {
        with!(self, bus => bus.sleep(duration));
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
