//! The link to the board of a command: a UDP socket, or a simulated machine in this program.

use std::time::Duration;

use mesa_hal::bus::Instant;
use mesa_hal::runner::Stop;
use mesa_hal::transport::udp::{PacketLink, SocketError, UdpLink};

use crate::simulated::SimulatedLink;

/// Time of silence after a signal that a command allows for its orderly end. What it drove is off
/// without it as well: nothing feeds the board's watchdog while no reply comes.
const PATIENCE: Duration = Duration::from_millis(500);

/// Longest wait for a reply when that time is over. A board answers in less.
const HASTE: Duration = Duration::from_millis(2);

/// Longest wait for a signal to be noticed.
const NOTICE: Duration = Duration::from_millis(100);

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
    /// The signals that end the command; `None` if it finishes what it has begun.
    stop: Option<Stop>,
    /// Time waited in vain since a signal came.
    silence: Duration,
}

impl SocketLink {
    pub const fn new(socket: UdpLink, stop: Option<Stop>) -> Self {
        Self {
            socket,
            stop,
            silence: Duration::ZERO,
        }
    }

    fn is_ending(&self) -> bool {
        self.stop
            .as_ref()
            .is_some_and(|stop| stop.signal().is_some())
    }

    /// Receives a datagram. A board that is silent after a signal is soon waited for no longer than
    /// it needs for an answer, so that a step of many exchanges ends soon as well.
    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, SocketError> {
        loop {
            let begun = self.socket.now();
            let until = deadline.min(begun.after(longest_wait(self.silence)));
            let received = self.socket.receive(buffer, until)?;
            if received.is_some() {
                return Ok(received);
            }
            if self.is_ending() {
                self.silence += self.socket.now().since(begun);
            }
            if until == deadline || self.silence >= PATIENCE {
                return Ok(None);
            }
        }
    }
}

/// Longest wait at a time, after this time of silence since a signal.
const fn longest_wait(silence: Duration) -> Duration {
    if silence.as_nanos() < PATIENCE.as_nanos() {
        NOTICE
    } else {
        HASTE
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
    type Error = SocketError;

    fn send(&mut self, packet: &[u8]) -> Result<(), SocketError> {
        match self {
            Self::Socket(link) => link.socket.send(packet),
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

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, SocketAddr, UdpSocket};

    use super::*;

    #[test]
    fn a_silent_board_is_waited_for_in_full_unless_a_signal_came() {
        let silent = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("loopback is there");
        let Ok(SocketAddr::V4(address)) = silent.local_addr() else {
            panic!("an IPv4 socket");
        };
        let link = UdpLink::connect(address).expect("loopback is there");
        let mut link = SocketLink::new(link, None);
        let mut buffer = [0; 8];
        let deadline = link.socket.now().after(NOTICE * 2);
        assert_eq!(link.receive(&mut buffer, deadline), Ok(None));
        assert!(link.socket.now() >= deadline);
        // The silence after a signal.
        link.silence = PATIENCE;
        let hour = link.socket.now().after(Duration::from_secs(3600));
        assert_eq!(link.receive(&mut buffer, hour), Ok(None));
        assert!(link.socket.now() < hour);
    }
}
