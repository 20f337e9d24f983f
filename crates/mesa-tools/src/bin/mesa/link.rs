//! The link to the board of a command: a UDP socket, or a simulated machine in this program.

use std::time::Duration;

use mesa_hal::bus::Instant;
use mesa_hal::transport::udp::{PacketLink, SocketError, UdpLink};

use crate::simulated::SimulatedLink;

/// A link to a board.
#[derive(Debug)]
pub enum BoardLink {
    Socket(UdpLink),
    Simulated(SimulatedLink),
}

impl BoardLink {
    /// Socket options that this host did not allow; none on a simulated machine.
    pub fn refused(&self) -> &[&'static str] {
        match self {
            Self::Socket(link) => &link.refused,
            Self::Simulated(_) => &[],
        }
    }
}

impl PacketLink for BoardLink {
    type Error = SocketError;

    fn send(&mut self, packet: &[u8]) -> Result<(), SocketError> {
        match self {
            Self::Socket(link) => link.send(packet),
            Self::Simulated(link) => link.send(packet),
        }
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, SocketError> {
        match self {
            Self::Socket(link) => link.receive(buffer, deadline),
            Self::Simulated(link) => link.receive(buffer, deadline),
        }
    }

    fn now(&mut self) -> Instant {
        match self {
            Self::Socket(link) => link.now(),
            Self::Simulated(link) => link.now(),
        }
    }

    fn sleep_until(&mut self, deadline: Instant) {
        match self {
            Self::Socket(link) => link.sleep_until(deadline),
            Self::Simulated(link) => link.sleep_until(deadline),
        }
    }

    fn sleep(&mut self, duration: Duration) {
        match self {
            Self::Socket(link) => link.sleep(duration),
            Self::Simulated(link) => link.sleep(duration),
        }
    }
}
