//! What carries the packets: a UDP socket, or a test's network.

use core::time::Duration;
use std::{
    io::{self, ErrorKind},
    net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket},
};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use socket2::{Domain, Protocol, Socket, Type};

use crate::bus::{HostClock, Instant, SPIN};

/// Carries datagrams to one board and back, and keeps the time.
///
/// [`UdpBus`](super::UdpBus) is generic over it, so that losses, delays and doubles are tested on
/// virtual time.
pub trait Link {
    /// Sends one datagram to the board.
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError>;

    /// The next datagram from the board, or `None` if there is none until `deadline`.
    ///
    /// A datagram longer than `buffer` is cut off; give it room for more than any reply.
    fn receive(&mut self, buffer: &mut [u8], deadline: Instant)
    -> Result<Option<usize>, LinkError>;

    /// The time. Never goes back.
    fn now(&mut self) -> Instant;

    /// Waits until `deadline`.
    fn sleep_until(&mut self, deadline: Instant);
}

impl<L: Link + ?Sized> Link for &mut L {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        (**self).send(packet)
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        (**self).receive(buffer, deadline)
    }

    fn now(&mut self) -> Instant {
        (**self).now()
    }

    fn sleep_until(&mut self, deadline: Instant) {
        (**self).sleep_until(deadline);
    }
}

/// Why a datagram could not be sent or received.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The host answered that nobody listens there.
    #[error("nobody listens at this address and port (a board listens at 27181)")]
    Refused,
    /// There is no route, the network is down, or no host answers at the address.
    #[error("no way to this address: is the network interface up and in the same network?")]
    Unreachable,
    /// Anything else that the operating system reports.
    #[error("the operating system reports: {0}")]
    System(ErrorKind),
}

impl From<io::Error> for LinkError {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            ErrorKind::ConnectionRefused => Self::Refused,
            ErrorKind::HostUnreachable
            | ErrorKind::NetworkUnreachable
            | ErrorKind::NetworkDown
            | ErrorKind::AddrNotAvailable => Self::Unreachable,
            kind => Self::System(kind),
        }
    }
}

/// Socket options that shorten or steady the round trip, and whether this host allowed them.
///
/// None of them needs root; a host that does not know or allow one works without it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SocketOptions {
    /// Polling the network device instead of waiting for its interrupt (`SO_BUSY_POLL`).
    pub busy_poll: bool,
    /// Priority in the queue of the network device (`SO_PRIORITY` 6, the highest without root).
    pub priority: bool,
    /// Datagrams are never fragmented (`IP_MTU_DISCOVER`); boards do not reassemble.
    pub dont_fragment: bool,
}

impl SocketOptions {
    /// Those that this host did not allow, by the names that system administrators know.
    pub fn refused(self) -> impl Iterator<Item = &'static str> {
        let all = [
            (self.busy_poll, "SO_BUSY_POLL"),
            (self.priority, "SO_PRIORITY"),
            (self.dont_fragment, "IP_MTU_DISCOVER"),
        ];
        all.into_iter()
            .filter_map(|(allowed, name)| (!allowed).then_some(name))
    }
}

/// A UDP socket that talks to one board only.
///
/// It is connected, so the kernel keeps datagrams of other senders away and reports a refusal.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    options: SocketOptions,
    clock: HostClock,
}

/// How long the kernel may poll the device, in microseconds.
const BUSY_POLL: u32 = 50;
/// The highest priority that an ordinary user may set.
const PRIORITY: u32 = 6;

impl UdpLink {
    /// Opens a socket to the board at `address`, LBP16 port 27181 unless another is given.
    ///
    /// Nothing is sent: that a board is there shows in the first exchange.
    pub fn connect(address: SocketAddrV4) -> Result<Self, LinkError> {
        let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
        let any = SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0));
        socket.bind(&any.into())?;
        socket.connect(&SocketAddr::from(address).into())?;
        socket.set_nonblocking(true)?;
        let mtu = rustix::net::sockopt::Ipv4PathMtuDiscovery::DO;
        let options = SocketOptions {
            busy_poll: socket.set_busy_poll(BUSY_POLL).is_ok(),
            priority: socket.set_priority(PRIORITY).is_ok(),
            dont_fragment: rustix::net::sockopt::set_ip_mtu_discover(&socket, mtu).is_ok(),
        };
        Ok(Self {
            socket: socket.into(),
            options,
            clock: HostClock::new(),
        })
    }

    /// Which of the helpful socket options this host allowed.
    pub fn options(&self) -> SocketOptions {
        self.options
    }

    /// Blocks until something arrives or `left` is nearly over; exact to the nanosecond that the
    /// kernel is, unlike a socket's own timeout, which is rounded up to kernel ticks.
    fn wait_readable(&self, left: Duration) -> Result<(), LinkError> {
        if left < SPIN {
            core::hint::spin_loop();
            return Ok(());
        }
        let left = left.saturating_sub(SPIN);
        let timeout = Timespec {
            tv_sec: left.as_secs() as _,
            tv_nsec: left.subsec_nanos() as _,
        };
        let mut fds = [PollFd::new(&self.socket, PollFlags::IN)];
        match poll(&mut fds, Some(&timeout)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
            Err(errno) => Err(io::Error::from(errno).into()),
        }
    }
}

impl Link for UdpLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        self.socket.send(packet)?;
        Ok(())
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        loop {
            // The time is taken before the last look, so that nothing that came in time is missed.
            let left = deadline.since(self.clock.read());
            if !left.is_zero() {
                self.wait_readable(left)?;
            }
            match self.socket.recv(buffer) {
                Ok(length) => return Ok(Some(length)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
            if left.is_zero() {
                return Ok(None);
            }
        }
    }

    fn now(&mut self) -> Instant {
        self.clock.read()
    }

    fn sleep_until(&mut self, deadline: Instant) {
        self.clock.sleep_until(deadline);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_that_were_refused_are_named() {
        let options = SocketOptions {
            priority: true,
            ..SocketOptions::default()
        };
        let refused: Vec<_> = options.refused().collect();
        assert_eq!(refused, ["SO_BUSY_POLL", "IP_MTU_DISCOVER"]);
    }

    #[test]
    fn a_receive_ends_at_its_deadline_or_with_a_datagram() {
        let board = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let SocketAddr::V4(address) = board.local_addr().unwrap() else {
            panic!("an IPv4 socket");
        };
        let mut link = UdpLink::connect(address).unwrap();
        let deadline = link.now().after(Duration::from_micros(300));
        assert_eq!(link.receive(&mut [0; 8], deadline), Ok(None));
        assert!(link.now() >= deadline);
        link.send(b"ping").unwrap();
        let mut buffer = [0; 8];
        let (length, from) = board.recv_from(&mut buffer).unwrap();
        board.send_to(&buffer[..length], from).unwrap();
        let deadline = link.now().after(Duration::from_secs(5));
        assert_eq!(link.receive(&mut buffer, deadline), Ok(Some(4)));
    }
}
