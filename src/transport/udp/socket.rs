//! A UDP socket of the operating system.

use core::time::Duration;
use std::{
    io,
    net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket},
};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::sockopt::{Ipv4PathMtuDiscovery, set_ip_mtu_discover};
use rustix::net::{self, RecvFlags, SendFlags};
use socket2::{Domain, Protocol, Socket, Type};

use super::PacketLink;
use crate::bus::{Clock, HostClock, Instant, LinkError, SPIN};

/// A UDP socket for a single board.
///
/// The socket is connected, so the kernel drops datagrams of other senders and reports a refusal.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    /// Socket options that shorten or steady the round trip and that this host did not allow, by
    /// the names that system administrators know.
    pub refused: Vec<&'static str>,
    clock: HostClock,
}

/// Time that the kernel may poll the device, in microseconds.
const BUSY_POLL: u32 = 50;
/// The highest priority that an ordinary user may set.
const PRIORITY: u32 = 6;

impl UdpLink {
    /// Opens a socket to the board at `address`, LBP16 port 27181 unless another is given.
    ///
    /// Nothing is sent: a missing board shows in the first exchange.
    pub fn connect(address: SocketAddrV4) -> Result<Self, LinkError> {
        let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
        let any = SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0));
        socket.bind(&any.into())?;
        socket.connect(&SocketAddr::from(address).into())?;
        socket.set_nonblocking(true)?;
        // None of the options needs root; a host that does not know or allow one works without it.
        let is_whole = set_ip_mtu_discover(&socket, Ipv4PathMtuDiscovery::DO).is_ok();
        let options = [
            // Polls the network device instead of waiting for its interrupt.
            SocketOption {
                name: "SO_BUSY_POLL",
                is_set: socket.set_busy_poll(BUSY_POLL).is_ok(),
            },
            // In the queue of the network device.
            SocketOption {
                name: "SO_PRIORITY",
                is_set: socket.set_priority(PRIORITY).is_ok(),
            },
            // Datagrams are never fragmented; boards do not reassemble.
            SocketOption {
                name: "IP_MTU_DISCOVER",
                is_set: is_whole,
            },
        ];
        Ok(Self {
            refused: refused(options),
            socket: socket.into(),
            clock: HostClock::new(),
        })
    }

    /// Blocks until a datagram arrives or `left` is nearly over; has the nanosecond resolution of
    /// the kernel, unlike a socket's own timeout, which is rounded up to kernel ticks.
    fn wait_readable(&self, left: Duration) -> io::Result<()> {
        if left < SPIN {
            core::hint::spin_loop();
            return Ok(());
        }
        let mut fds = [PollFd::new(&self.socket, PollFlags::IN)];
        poll_for(&mut fds, left.saturating_sub(SPIN))
    }
}

/// Blocks until one of `fds` is ready, `time` has elapsed, or a signal arrives.
pub(in crate::transport) fn poll_for(fds: &mut [PollFd<'_>], time: Duration) -> io::Result<()> {
    let timeout = Timespec {
        tv_sec: time.as_secs() as _,
        tv_nsec: time.subsec_nanos() as _,
    };
    match poll(fds, Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(errno) => Err(errno.into()),
    }
}

/// A socket option that the link asks for.
#[derive(Clone, Copy, Debug)]
struct SocketOption {
    name: &'static str,
    /// The host allowed it.
    is_set: bool,
}

/// The names of the options that were not set.
fn refused(options: [SocketOption; 3]) -> Vec<&'static str> {
    let refused = options.iter().filter(|option| !option.is_set);
    refused.map(|option| option.name).collect()
}

/// The cycle enters the kernel directly: send and recv of the C library are cancellation points, at
/// which LinuxCNC's realtime environment ends a thread by unwinding through this crate's frames.
impl PacketLink for UdpLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let sent = net::send(&self.socket, packet, SendFlags::NOSIGNAL);
        sent.map_err(io::Error::from)?;
        Ok(())
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        loop {
            // The time is read before the last check of the socket, so that no datagram that
            // arrived in time is missed.
            let left = deadline.since(self.clock.read());
            match net::recv(&self.socket, &mut *buffer, RecvFlags::empty()) {
                Ok((_, length)) => return Ok(Some(length)),
                Err(Errno::WOULDBLOCK | Errno::INTR) => {}
                Err(error) => return Err(io::Error::from(error).into()),
            }
            if left.is_zero() {
                return Ok(None);
            }
            self.wait_readable(left)?;
        }
    }

    fn now(&mut self) -> Instant {
        self.clock.read()
    }

    fn sleep_until(&mut self, deadline: Instant) {
        self.clock.sleep_until(deadline);
    }

    fn sleep(&mut self, duration: Duration) {
        Clock::sleep(&mut self.clock, duration);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn option_that_the_host_does_not_allow_is_named_and_no_other() {
        let options = [("ONE", false), ("TWO", true), ("THREE", false)];
        let options = options.map(|(name, is_set)| SocketOption { name, is_set });
        assert_eq!(refused(options), ["ONE", "THREE"]);
        let allowed = options.map(|option| SocketOption {
            is_set: true,
            ..option
        });
        assert!(refused(allowed).is_empty());
    }

    #[test]
    fn receive_ends_at_its_deadline_or_with_a_datagram() {
        let board = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let SocketAddr::V4(address) = board.local_addr().unwrap() else {
            panic!("an IPv4 socket");
        };
        let mut link = UdpLink::connect(address).unwrap();
        let deadline = link.now().after(Duration::from_micros(300));
        assert_eq!(link.receive(&mut [0; 8], deadline).unwrap(), None);
        assert!(link.now() >= deadline);
        link.send(b"ping").unwrap();
        let mut buffer = [0; 8];
        let (length, from) = board.recv_from(&mut buffer).unwrap();
        board.send_to(&buffer[..length], from).unwrap();
        let deadline = link.now().after(Duration::from_secs(5));
        assert_eq!(link.receive(&mut buffer, deadline).unwrap(), Some(4));
    }
}
