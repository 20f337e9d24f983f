//! The link to the board of a command: a UDP socket, or a simulated machine in this program.

use std::time::Duration;

use mesa_hal::bus::{Instant, LinkError};
use mesa_hal::transport::udp::{PacketLink, UdpLink};

use crate::machine::embedded::SimulatedLink;
use crate::ui::hurry::{Hurry, Patience};

/// A link to a board.
#[derive(Debug)]
pub enum BoardLink {
    Socket(SocketLink),
    Simulated(SimulatedLink),
}

/// A socket, with the patience of the command that opened it.
#[derive(Debug)]
pub struct SocketLink {
    socket: UdpLink,
    hurry: Hurry,
    patience: Patience,
}

impl SocketLink {
    pub fn new(socket: UdpLink, hurry: Hurry) -> Self {
        Self {
            socket,
            hurry,
            patience: Patience::default(),
        }
    }

    /// Receives a datagram. A board that does not answer after a signal is soon waited for no
    /// longer than it needs for an answer, and at last not at all, so that a step of many exchanges
    /// ends soon as well.
    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        loop {
            let begun = self.socket.now();
            let until = self.patience.until(begun, deadline);
            let received = self.socket.receive(buffer, until)?;
            if received.is_some() {
                return Ok(received);
            }
            let now = self.socket.now();
            let is_over = self.hurry.waited(&mut self.patience, begun, now);
            if until == deadline || is_over {
                return Ok(None);
            }
        }
    }
}

impl BoardLink {
    /// Socket options that this host did not allow; none on a simulated machine.
    pub fn refused(&self) -> &[&'static str] {
        match self {
            Self::Socket(link) => &link.socket.refused,
            Self::Simulated(_) => &[],
        }
    }
}

impl PacketLink for BoardLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        match self {
            Self::Socket(link) => link.socket.send(packet),
            Self::Simulated(link) => link.send(packet),
        }
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        match self {
            Self::Socket(link) => link.receive(buffer, deadline),
            Self::Simulated(link) => link.receive(buffer, deadline),
        }
    }

    fn now(&mut self) -> Instant {
        match self {
            Self::Socket(link) => link.socket.now(),
            Self::Simulated(link) => link.now(),
        }
    }

    fn sleep_until(&mut self, deadline: Instant) {
        match self {
            Self::Socket(link) => link.socket.sleep_until(deadline),
            Self::Simulated(link) => link.sleep_until(deadline),
        }
    }

    fn sleep(&mut self, duration: Duration) {
        match self {
            Self::Socket(link) => link.socket.sleep(duration),
            Self::Simulated(link) => link.sleep(duration),
        }
    }
}
