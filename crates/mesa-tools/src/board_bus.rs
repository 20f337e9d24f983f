//! The error of a bus to a board on either interface.

use mesa_hal::bus::{BusAdvice, BusError, BusErrorKind};
use mesa_hal::transport::udp::UdpError;
use mesa_pci::PciError;

/// An error of a bus to a board on Ethernet or on the PCI bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BoardBusError {
    /// Of a board on Ethernet.
    #[error(transparent)]
    Ethernet(#[from] UdpError),
    /// Of a board on the PCI bus.
    #[error(transparent)]
    Pci(#[from] PciError),
    /// The request is for the Ethernet side of a board, which one on the PCI bus does not have.
    #[error(
        "a board on the PCI bus has no Ethernet side: no IP address, no packets, no EEPROM of its own"
    )]
    NoEthernet,
}

impl BusError for BoardBusError {
    fn kind(&self) -> BusErrorKind {
        match self {
            Self::Ethernet(error) => error.kind(),
            Self::Pci(error) => error.kind(),
            Self::NoEthernet => BusErrorKind::Invalid,
        }
    }

    fn advice(&self) -> Option<BusAdvice> {
        match self {
            Self::Ethernet(error) => BusError::advice(error),
            Self::Pci(error) => BusError::advice(error),
            Self::NoEthernet => None,
        }
    }
}

impl BoardBusError {
    /// The next step, if there is one.
    pub fn advice(&self) -> Option<mesa_hal::Advice> {
        BusError::advice(self).map(mesa_hal::Advice::Bus)
    }
}
