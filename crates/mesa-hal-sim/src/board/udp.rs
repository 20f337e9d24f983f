//! UDP front end of a simulated board: real clients, real time.

use core::{net::SocketAddrV4, time::Duration};
use std::{
    collections::VecDeque,
    io,
    net::{SocketAddr, UdpSocket},
    time::{Instant, SystemTime},
};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use mesa_wire::lbp16::Operations;

use super::{Endpoint, Gateware, SimBoard, Tap};
use crate::wire::Nanos;

/// Maximum number of packets in flight; further ones are lost.
const MAX_HELD: usize = 256;

/// Maximum number of clients in the list.
const MAX_CLIENTS: usize = 8;

/// Size of the buffer for one datagram: large enough to detect a datagram that is too long.
const BUFFER: usize = 2048;

/// Tolerance by which an event may be handled early: less than the delay of waking up for it.
const SLACK: Nanos = 50_000;

/// Minimum and maximum delay of a late packet.
const LATE: core::ops::Range<Nanos> = 500_000..3_000_000;

/// Faults of the network: probabilities from 0 to 1, for each packet of each direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mishaps {
    /// The packet is lost.
    pub loss: f64,
    /// The packet arrives 0.5 to 3 ms late, after packets that were sent later.
    pub late: f64,
    /// The packet is duplicated.
    pub dup: f64,
    /// Seed of the random numbers: the same seed and the same packets meet the same faults.
    pub seed: u64,
}

/// Packet statistics of one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UdpCounters {
    /// Packets before any fault.
    pub packets: u64,
    /// Bytes of these packets.
    pub bytes: u64,
    /// Lost on purpose.
    pub lost: u64,
    /// Delayed on purpose.
    pub late: u64,
    /// Duplicated on purpose.
    pub duplicate: u64,
}

/// A client of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UdpClient {
    /// Source address of its packets.
    pub address: SocketAddr,
    /// Its packets, before any fault.
    pub packets: u64,
    /// Those of them that write something, to whatever space.
    pub writes: u64,
    /// Arrival of its last packet, in the time of the board.
    pub heard: Nanos,
}

/// A UDP socket in front of a [`SimBoard`], in real time.
///
/// Call [`step`](Self::step) in a loop: each call waits for packets, passes them to the board at
/// their arrival time, and sends replies when they are due. Between packets the board's time
/// advances.
#[derive(Debug)]
pub struct UdpFace {
    socket: UdpSocket,
    start: Instant,
    mishaps: Mishaps,
    dice: Dice,
    held: VecDeque<HeldPacket>,
    received: UdpCounters,
    sent: UdpCounters,
    clients: Vec<UdpClient>,
    reply: Vec<u8>,
    buffer: Box<[u8]>,
    tap: Option<Box<dyn Tap>>,
}

/// A packet in flight.
#[derive(Debug)]
struct HeldPacket {
    due: Nanos,
    peer: SocketAddr,
    is_reply: bool,
    bytes: Vec<u8>,
}

impl UdpFace {
    /// Opens the socket; the board's time begins now. Port 0 takes any free port.
    pub fn bind(address: SocketAddrV4, mishaps: Mishaps) -> io::Result<Self> {
        let socket = UdpSocket::bind(address)?;
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            start: Instant::now(),
            mishaps,
            dice: Dice(mishaps.seed),
            held: VecDeque::new(),
            received: UdpCounters::default(),
            sent: UdpCounters::default(),
            clients: Vec::with_capacity(MAX_CLIENTS),
            reply: Vec::with_capacity(BUFFER),
            buffer: vec![0; BUFFER].into_boxed_slice(),
            tap: None,
        })
    }

    /// The present faults of the network.
    pub fn mishaps(&self) -> Mishaps {
        self.mishaps
    }

    /// Changes the faults from now on. A new seed restarts the random numbers.
    pub fn set_mishaps(&mut self, mishaps: Mishaps) {
        if mishaps.seed != self.mishaps.seed {
            self.dice = Dice(mishaps.seed);
        }
        self.mishaps = mishaps;
    }

    /// Sets a tap that sees all packets: requests as they arrive, before any fault, and replies as
    /// they leave.
    pub fn set_tap(&mut self, tap: Option<Box<dyn Tap>>) {
        self.tap = tap;
    }

    /// The address of the socket.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// The time of the board according to the clock.
    pub fn now(&self) -> Nanos {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(Nanos::MAX)
    }

    /// Requests, before faults.
    pub fn received(&self) -> UdpCounters {
        self.received
    }

    /// Replies, before faults.
    pub fn sent(&self) -> UdpCounters {
        self.sent
    }

    /// Clients of the board: the last eight from which a packet arrived, in no order.
    pub fn clients(&self) -> &[UdpClient] {
        &self.clients
    }

    /// Waits at most `patience` for an event, and handles it. The board's time is then up to date.
    pub fn step<G: Gateware>(
        &mut self,
        board: &mut SimBoard<G>,
        patience: Duration,
    ) -> io::Result<()> {
        let limit = self.now() + u64::try_from(patience.as_nanos()).unwrap_or(Nanos::MAX / 2);
        let busy = self.is_busy(board);
        let until = self.next_event(limit, busy.then(|| board.time()));
        let ready = self.wait(until, !busy)?;
        self.deliver_held(board);
        if ready {
            self.receive(board)?;
        } else {
            board.advance_to(self.now());
        }
        Ok(())
    }

    /// Time of the next event, `limit` at the latest. Due requests wait while the board is busy, up
    /// to `busy_until`.
    fn next_event(&self, limit: Nanos, busy_until: Option<Nanos>) -> Nanos {
        let due = self.held.iter();
        let due = due.filter(|held| held.is_reply || busy_until.is_none());
        let next = due.map(|held| held.due).chain(busy_until).min();
        next.map_or(limit, |next| next.min(limit))
    }

    /// True if the board still works on a packet: the next ones wait in the socket.
    fn is_busy<G: Gateware>(&self, board: &SimBoard<G>) -> bool {
        board.time() > self.now() + SLACK
    }

    /// Waits for a datagram; `false` on a timeout at `until`, or if no datagram is `wanted`.
    fn wait(&self, until: Nanos, wanted: bool) -> io::Result<bool> {
        let left = until.saturating_sub(self.now());
        let timeout = Timespec {
            tv_sec: (left / 1_000_000_000) as i64,
            tv_nsec: (left % 1_000_000_000) as i64,
        };
        let mut fds = [PollFd::new(&self.socket, PollFlags::IN)];
        let fds = if wanted { &mut fds[..] } else { &mut [] };
        match poll(fds, Some(&timeout)) {
            Ok(count) => Ok(count > 0),
            Err(rustix::io::Errno::INTR) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Takes the datagrams in the socket, as long as the board is not busy.
    fn receive<G: Gateware>(&mut self, board: &mut SimBoard<G>) -> io::Result<()> {
        loop {
            if self.is_busy(board) {
                return Ok(());
            }
            let now = self.now();
            let (len, peer) = match self.socket.recv_from(&mut self.buffer) {
                Ok(received) => received,
                Err(error) if is_nothing(&error) => return Ok(()),
                Err(error) => return Err(error),
            };
            let mut buffer = core::mem::take(&mut self.buffer);
            let request = buffer.get_mut(..len).unwrap_or_default();
            self.show(board.config().mac, request, peer, false);
            self.heard(now, peer, is_write(request));
            for delay in self.fate(len, false).into_iter().flatten() {
                if delay == 0 {
                    self.run(board, now, request, peer);
                } else {
                    self.hold(now + delay, peer, false, request);
                }
            }
            self.buffer = buffer;
        }
    }

    /// Updates the list of clients for a packet from `peer`; a new client replaces the one that was
    /// silent for the longest time.
    fn heard(&mut self, now: Nanos, peer: SocketAddr, is_write: bool) {
        let writes = u64::from(is_write);
        let client = UdpClient {
            address: peer,
            packets: 1,
            writes,
            heard: now,
        };
        let mut known = self.clients.iter_mut();
        if let Some(known) = known.find(|known| known.address == peer) {
            known.packets += 1;
            known.writes += writes;
            known.heard = now;
        } else if self.clients.len() < MAX_CLIENTS {
            self.clients.push(client);
        } else if let Some(oldest) = self.clients.iter_mut().min_by_key(|known| known.heard) {
            *oldest = client;
        }
    }

    /// Passes a request to the board and sends the reply.
    fn run<G: Gateware>(
        &mut self,
        board: &mut SimBoard<G>,
        now: Nanos,
        request: &[u8],
        peer: SocketAddr,
    ) {
        let mut reply = core::mem::take(&mut self.reply);
        if let Some(due) = board.handle_packet(now, request, &mut reply) {
            for delay in self.fate(reply.len(), true).into_iter().flatten() {
                let due = due + delay;
                if due <= self.now() + SLACK {
                    self.send(board.config().mac, &reply, peer);
                } else {
                    self.hold(due, peer, true, &reply);
                }
            }
        }
        self.reply = reply;
    }

    /// Sends due replies and runs due requests.
    fn deliver_held<G: Gateware>(&mut self, board: &mut SimBoard<G>) {
        let now = self.now();
        let mut index = 0;
        while let Some(held) = self.held.get(index) {
            let waits = held.due > now || (!held.is_reply && self.is_busy(board));
            if waits {
                index += 1;
                continue;
            }
            let Some(held) = self.held.remove(index) else {
                return;
            };
            if held.is_reply {
                self.send(board.config().mac, &held.bytes, held.peer);
            } else {
                self.run(board, now, &held.bytes, held.peer);
            }
        }
    }

    fn hold(&mut self, due: Nanos, peer: SocketAddr, is_reply: bool, bytes: &[u8]) {
        if self.held.len() < MAX_HELD {
            self.held.push_back(HeldPacket {
                due,
                peer,
                is_reply,
                bytes: bytes.to_vec(),
            });
        }
    }

    /// Sends a reply. A failure is ignored, like a loss on the wire: the client's socket may be
    /// gone.
    fn send(&mut self, mac: [u8; 6], reply: &[u8], peer: SocketAddr) {
        let _ = self.socket.send_to(reply, peer);
        self.show(mac, reply, peer, true);
    }

    /// Passes a packet to the tap, if there is one.
    fn show(&mut self, mac: [u8; 6], payload: &[u8], peer: SocketAddr, is_reply: bool) {
        let Some(tap) = &mut self.tap else {
            return;
        };
        let (Ok(SocketAddr::V4(own)), SocketAddr::V4(peer)) = (self.socket.local_addr(), peer)
        else {
            return;
        };
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let board = Endpoint { mac, address: own };
        let host = Endpoint::unknown(peer);
        let (from, to) = if is_reply {
            (board, host)
        } else {
            (host, board)
        };
        tap.packet(now.unwrap_or_default(), from, to, payload);
    }

    /// Counts a packet and draws its delivery times: the first, and that of a duplicate.
    fn fate(&mut self, len: usize, is_reply: bool) -> [Option<Nanos>; 2] {
        let Mishaps {
            loss, late, dup, ..
        } = self.mishaps;
        let is_lost = self.dice.hit(loss);
        let is_late = self.dice.hit(late);
        let is_duplicate = self.dice.hit(dup);
        let delay = self.dice.between(LATE);
        let counters = if is_reply {
            &mut self.sent
        } else {
            &mut self.received
        };
        counters.packets += 1;
        counters.bytes += len as u64;
        if is_lost {
            counters.lost += 1;
            return [None; 2];
        }
        counters.late += u64::from(is_late);
        counters.duplicate += u64::from(is_duplicate);
        let delay = if is_late { delay } else { 0 };
        [Some(delay), is_duplicate.then_some(delay)]
    }
}

/// True if a packet contains a command that writes. Commands behind one that cannot be parsed are
/// not executed.
fn is_write(request: &[u8]) -> bool {
    let mut operations = Operations::new(request).map_while(Result::ok);
    operations.any(|operation| operation.command.write)
}

fn is_nothing(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionRefused, Interrupted, WouldBlock};
    // A client that closed its socket before its reply arrived causes a refusal.
    matches!(error.kind(), WouldBlock | Interrupted | ConnectionRefused)
}

/// SplitMix64: small, seeded, sufficient for random faults.
#[derive(Debug)]
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    fn hit(&mut self, probability: f64) -> bool {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64 <= probability && probability > 0.0
    }

    fn between(&mut self, range: core::ops::Range<Nanos>) -> Nanos {
        range.start + self.next() % (range.end - range.start).max(1)
    }
}

#[cfg(test)]
mod tests;
