//! A simulated Ethernet board behind a network on virtual time.

use std::collections::BTreeMap;

use mesa_hal::bus::Instant;
use mesa_hal::sim::{BoardConfig, SimBoard, SimFpga};
use mesa_hal::transport::udp::{Link, LinkError};

/// Time on the wire in each direction.
pub const WIRE: u64 = 20_000;

/// What the network does to each packet; returns how often and with what delays it arrives.
pub type Fate = Box<dyn FnMut(&[u8]) -> Vec<u64>>;

/// Requests that are answered begin with their number (`82D11C00`); writes of the cycle do not.
pub fn is_request(packet: &[u8]) -> bool {
    packet.starts_with(&[0x82, 0xD1, 0x1C, 0x00])
}

/// What became of one packet of the host.
#[derive(Clone, Debug, Default)]
pub struct Sent {
    pub at: u64,
    /// When the board executed it: the time it was done.
    pub executed: Vec<u64>,
    /// For each reply that came to the host: when, and which execution it is from.
    pub replies: Vec<(u64, u64)>,
    pub is_request: bool,
    pub bytes: usize,
}

/// A packet under way: its number in the journal, the execution it is the reply of, its bytes.
type Packet = (usize, u64, Vec<u8>);

/// A link to a simulated board. Every packet arrives once, after [`WIRE`], unless told otherwise.
pub struct SimLink {
    pub board: SimBoard<SimFpga>,
    pub to_board: Fate,
    pub to_host: Fate,
    /// The host has no way to the board.
    pub is_unreachable: bool,
    /// Everything that was sent, and what became of it.
    pub journal: Vec<Sent>,
    now: u64,
    sent: u64,
    requests: BTreeMap<(u64, u64), Packet>,
    replies: BTreeMap<(u64, u64), Packet>,
    waiting: Vec<Vec<u8>>,
}

impl SimLink {
    pub fn new(config: BoardConfig, fpga: SimFpga) -> Self {
        Self {
            board: SimBoard::new(config, fpga),
            to_board: Box::new(|_| vec![WIRE]),
            to_host: Box::new(|_| vec![WIRE]),
            is_unreachable: false,
            journal: Vec::new(),
            now: 0,
            sent: 0,
            requests: BTreeMap::new(),
            replies: BTreeMap::new(),
            waiting: Vec::new(),
        }
    }

    /// Everything up to `until`; the packets that have arrived at the host wait there.
    fn run(&mut self, until: u64, stop_at_reply: bool) {
        loop {
            if stop_at_reply && !self.waiting.is_empty() {
                return;
            }
            let request = self.requests.first_key_value().map(|(key, _)| *key);
            let reply = self.replies.first_key_value().map(|(key, _)| *key);
            match (request, reply) {
                (request, Some(reply))
                    if reply.0 <= until && request.is_none_or(|r| reply <= r) =>
                {
                    self.now = self.now.max(reply.0);
                    if let Some((number, executed, bytes)) = self.replies.remove(&reply) {
                        self.journal[number].replies.push((reply.0, executed));
                        self.waiting.push(bytes);
                    }
                }
                (Some(request), _) if request.0 <= until => {
                    self.now = self.now.max(request.0);
                    let (number, _, packet) = self.requests.remove(&request).unwrap_or_default();
                    let mut answer = Vec::new();
                    let leaves = self.board.handle_packet(request.0, &packet, &mut answer);
                    let executed = self.board.time();
                    self.journal[number].executed.push(executed);
                    if let Some(at) = leaves {
                        for delay in (self.to_host)(&answer) {
                            self.sent += 1;
                            let reply = (number, executed, answer.clone());
                            self.replies.insert((at + delay, self.sent), reply);
                        }
                    }
                }
                _ => {
                    self.now = self.now.max(until);
                    self.board.advance_to(self.now);
                    return;
                }
            }
        }
    }
}

impl std::fmt::Debug for SimLink {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimLink")
            .field("now", &self.now)
            .finish_non_exhaustive()
    }
}

impl Link for SimLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        if self.is_unreachable {
            return Err(LinkError::Unreachable);
        }
        let number = self.journal.len();
        self.journal.push(Sent {
            at: self.now,
            is_request: is_request(packet),
            bytes: packet.len(),
            ..Sent::default()
        });
        for delay in (self.to_board)(packet) {
            self.sent += 1;
            let key = (self.now + delay, self.sent);
            self.requests.insert(key, (number, 0, packet.to_vec()));
        }
        Ok(())
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        self.run(deadline.as_nanos(), true);
        if self.waiting.is_empty() {
            return Ok(None);
        }
        let packet = self.waiting.remove(0);
        buffer[..packet.len()].copy_from_slice(&packet);
        Ok(Some(packet.len()))
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.now)
    }

    fn sleep_until(&mut self, deadline: Instant) {
        self.run(deadline.as_nanos(), false);
    }
}
