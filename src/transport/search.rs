//! Search for boards at many addresses in parallel.

use core::time::Duration;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::time::Instant;

use rustix::event::{PollFd, PollFlags};

use super::udp::poll_for;
use crate::ethernet::Identity;

/// Number of addresses that are asked at the same time.
pub const MAX_PARALLEL: usize = 128;

/// Requests to each address: the first packet may be lost while the MAC address behind it is
/// resolved.
const TRIES: u32 = 2;

/// The result of asking one address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AddressResult {
    /// The address.
    pub address: SocketAddrV4,
    /// The board there, or the reason why none was found.
    pub found: Result<Identity, Silence>,
}

/// Reason why no board was found at an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum Silence {
    /// No reply within the time.
    #[error("no answer")]
    Nothing,
    /// A host exists there, but no program listens at the port.
    #[error("a host is there, and no program listens at this port")]
    Refused,
    /// A reply arrived that no board sends.
    #[error("the reply is not from a Mesa board")]
    Foreign,
    /// The firewall of this computer blocks packets to the address. LinuxCNC's driver sets this up
    /// for the interface of its board, with the chain `hm2-eth-rules-output`.
    #[error("the firewall of this computer blocks packets to this address")]
    Blocked,
    /// The operating system cannot send there.
    #[error("the operating system cannot send there: {0}")]
    Unreachable(ErrorKind),
}

/// Asks each address whether a board is there, twice within `patience`, [`MAX_PARALLEL`] of them at
/// a time, in their order. Writes nothing to the boards.
///
/// Takes `patience` for each [`MAX_PARALLEL`] addresses, or less where all have answered.
///
/// # Errors
/// The operating system provides no sockets.
pub fn ask(addresses: &[SocketAddrV4], patience: Duration) -> io::Result<Vec<AddressResult>> {
    let question = Identity::question();
    let patience = patience.checked_div(TRIES).unwrap_or_default();
    let mut all = Vec::with_capacity(addresses.len());
    for batch in addresses.chunks(MAX_PARALLEL) {
        let mut asking = batch
            .iter()
            .map(|&address| AddressRequest::new(address))
            .collect::<io::Result<Vec<_>>>()?;
        for _ in 0..TRIES {
            for one in &mut asking {
                one.send(&question);
            }
            receive(&mut asking, patience)?;
        }
        all.extend(asking.into_iter().map(AddressRequest::result));
    }
    Ok(all)
}

/// An address that is being asked.
struct AddressRequest {
    address: SocketAddrV4,
    socket: UdpSocket,
    found: Option<Result<Identity, Silence>>,
}

impl AddressRequest {
    fn new(address: SocketAddrV4) -> io::Result<Self> {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        socket.set_nonblocking(true)?;
        // Connected: the kernel drops packets of other senders and reports a refusal.
        let found = socket.connect(address).err().map(failed);
        Ok(Self {
            address,
            socket,
            found,
        })
    }

    fn send(&mut self, question: &[u8]) {
        // An address with a result is not asked again: the first answer counts.
        if self.found.is_none() {
            self.found = self.socket.send(question).err().and_then(lasting);
        }
    }

    /// Receives one datagram and records the result.
    fn receive(&mut self) {
        // One byte more than an answer, so that a longer datagram is detected.
        let mut buffer = [0; Identity::ANSWER + 1];
        match self.socket.recv(&mut buffer) {
            Ok(length) => {
                let answer = buffer.first_chunk().filter(|_| length == Identity::ANSWER);
                let identity = answer.and_then(|answer| Identity::parse(answer).ok());
                self.found = Some(identity.ok_or(Silence::Foreign));
            }
            Err(error) => self.found = lasting(error),
        }
    }

    fn result(self) -> AddressResult {
        AddressResult {
            address: self.address,
            found: self.found.unwrap_or(Err(Silence::Nothing)),
        }
    }
}

/// The result of an address after a socket error; `None` if the error may pass.
fn lasting(error: io::Error) -> Option<Result<Identity, Silence>> {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::Interrupted => None,
        _ => Some(failed(error)),
    }
}

#[expect(clippy::needless_pass_by_value, reason = "for `map`")]
fn failed(error: io::Error) -> Result<Identity, Silence> {
    Err(match error.kind() {
        ErrorKind::ConnectionRefused => Silence::Refused,
        ErrorKind::PermissionDenied => Silence::Blocked,
        kind => Silence::Unreachable(kind),
    })
}

/// Receives until all have answered or `patience` has elapsed.
fn receive(asking: &mut [AddressRequest], patience: Duration) -> io::Result<()> {
    let start = Instant::now();
    loop {
        let left = patience.saturating_sub(start.elapsed());
        let mut waiting: Vec<_> = asking
            .iter_mut()
            .filter(|one| one.found.is_none())
            .collect();
        if waiting.is_empty() || left.is_zero() {
            return Ok(());
        }
        let polled = waiting
            .iter()
            .map(|one| PollFd::new(&one.socket, PollFlags::IN));
        let mut polled: Vec<_> = polled.collect();
        poll_for(&mut polled, left)?;
        let came: Vec<bool> = polled.iter().map(|fd| !fd.revents().is_empty()).collect();
        drop(polled);
        for (one, _) in waiting.iter_mut().zip(came).filter(|(_, came)| *came) {
            one.receive();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Duration = Duration::from_millis(200);

    fn address(socket: &UdpSocket) -> SocketAddrV4 {
        let port = socket.local_addr().unwrap().port();
        SocketAddrV4::new(Ipv4Addr::LOCALHOST, port)
    }

    #[test]
    fn silent_refusing_and_foreign_addresses_are_distinguished() {
        let bind = || UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let (silent, foreign, gone) = (bind(), bind(), bind());
        let addresses = [&silent, &foreign, &gone].map(address);
        drop(gone);
        let answering = std::thread::spawn(move || {
            let mut buffer = [0; 64];
            let (_, from) = foreign.recv_from(&mut buffer).unwrap();
            foreign.send_to(b"?", from).unwrap();
        });
        let asked = ask(&addresses, PATIENCE).unwrap();
        answering.join().unwrap();
        let found: Vec<_> = asked.into_iter().map(|asked| asked.found).collect();
        let expected = [Silence::Nothing, Silence::Foreign, Silence::Refused].map(Err);
        assert_eq!(found, expected);
    }

    #[test]
    fn addresses_beyond_one_batch_are_returned_in_order() {
        let port = 9; // no program listens there
        let hosts = (1..=200).map(|n| SocketAddrV4::new(Ipv4Addr::new(127, 92, 0, n), port));
        let hosts: Vec<_> = hosts.collect();
        let asked = ask(&hosts, PATIENCE).unwrap();
        let addresses: Vec<_> = asked.iter().map(|asked| asked.address).collect();
        assert_eq!(addresses, hosts);
    }
}
