//! A simulated Ethernet board behind a network on virtual time.

use std::collections::{BTreeMap, VecDeque};

use mesa_hal::bus::{Instant, LinkError};
use mesa_hal::transport::udp::{PacketLink, UdpBus, UdpConfig};
use mesa_hal_sim::devices::find;
use mesa_hal_sim::{BoardConfig, SimBoard, SimFpga};

/// Time on the wire in each direction.
pub const WIRE: u64 = 20_000;

/// The network's effect on each packet at its time: returns a delay for each arrival of the packet.
pub type Fate = Box<dyn FnMut(u64, &[u8]) -> Vec<u64>>;

/// A bus to a simulated board behind a good network.
pub fn bus(fpga: SimFpga) -> UdpBus<SimLink> {
    connect(SimLink::new(fpga))
}

pub fn connect(link: SimLink) -> UdpBus<SimLink> {
    UdpBus::new(link, UdpConfig::default()).expect("the board answers")
}

/// A network that delivers nothing.
pub fn cut() -> Fate {
    Box::new(|_, _| vec![])
}

/// A network that delivers everything once and in time.
pub fn good() -> Fate {
    Box::new(|_, _| vec![WIRE])
}

/// True if a packet begins with a request number (`82D11C00`): such packets are answered, writes of
/// the cycle are not.
pub fn is_request(packet: &[u8]) -> bool {
    packet.starts_with(&[0x82, 0xD1, 0x1C, 0x00])
}

/// True if a packet writes registers of the FPGA: LBP16 commands with bit 15 set, of space 0.
fn writes(packet: &[u8]) -> bool {
    let mut rest = packet;
    while let [low, high, tail @ ..] = rest {
        let command = u16::from_le_bytes([*low, *high]);
        let (is_write, space) = (command & 0x8000 != 0, command >> 10 & 7);
        if is_write && space == 0 {
            return true;
        }
        let address = if command & 0x4000 == 0 { 0 } else { 2 };
        let data = usize::from(command & 0x7F) << (command >> 8 & 3);
        let skipped = address + if is_write { data } else { 0 };
        rest = tail.get(skipped..).unwrap_or_default();
    }
    false
}

/// Volts at the first terminal of the analog remote on channel 1.
pub fn volts(bus: &mut UdpBus<SimLink>) -> f64 {
    let remote = bus.link().board.gateware_mut().remote(0, 1);
    let device = remote.and_then(find).expect("a device");
    device.world().analog_output(0).expect("an analog output")
}

/// The history of one packet of the host.
#[derive(Clone, Debug, Default)]
pub struct Sent {
    pub at: u64,
    /// Times at which the board executed it.
    pub executed: Vec<u64>,
    /// For each reply that arrived at the host: its time, and the execution that caused it.
    pub replies: Vec<(u64, u64)>,
    pub is_request: bool,
    /// The packet writes registers of the FPGA.
    pub is_write: bool,
    pub bytes: usize,
}

/// A packet in flight: its number in the journal, the execution that it replies to, its bytes.
type Packet = (usize, u64, Vec<u8>);
type Packets = BTreeMap<(u64, u64), Packet>;

/// A link to a simulated board. Every packet arrives once, after [`WIRE`], unless configured
/// otherwise.
pub struct SimLink {
    pub board: SimBoard<SimFpga>,
    pub to_board: Fate,
    pub to_host: Fate,
    /// The host has no route to the board.
    pub is_unreachable: bool,
    /// All packets sent, with their history.
    pub journal: Vec<Sent>,
    /// Times at which the whole board loses its configuration, and the durations.
    pub resets: Vec<(u64, u64)>,
    /// The board has no configuration until this time.
    silent_until: u64,
    now: u64,
    /// Time that the host's clock has missed while the host was stopped.
    missed: u64,
    sent: u64,
    requests: Packets,
    replies: Packets,
    waiting: VecDeque<Vec<u8>>,
}

impl SimLink {
    pub fn new(fpga: SimFpga) -> Self {
        let name = fpga.firmware().board;
        let name = std::str::from_utf8(&name[4..]).expect("MESA and a name");
        Self::to(SimBoard::new(BoardConfig::new(name), fpga))
    }

    pub fn to(board: SimBoard<SimFpga>) -> Self {
        Self {
            board,
            to_board: good(),
            to_host: good(),
            is_unreachable: false,
            journal: Vec::new(),
            resets: Vec::new(),
            silent_until: 0,
            now: 0,
            missed: 0,
            sent: 0,
            requests: BTreeMap::new(),
            replies: BTreeMap::new(),
            waiting: VecDeque::new(),
        }
    }

    pub fn time(&self) -> u64 {
        self.now
    }

    /// True while the board has no configuration.
    pub fn is_silent(&self) -> bool {
        self.now < self.silent_until
    }

    /// Stops the host and its clock, as a suspended virtual machine.
    pub fn stop_host(&mut self, nanos: u64) {
        self.run(self.now + nanos, false);
        self.missed += nanos;
    }

    /// A new process has a new socket: packets on their way to the old one are lost.
    pub fn new_socket(&mut self) {
        self.waiting.clear();
        self.replies.clear();
    }

    /// Runs all events up to `until`; packets that have arrived at the host wait there.
    pub fn run(&mut self, until: u64, stop_at_reply: bool) {
        while !stop_at_reply || self.waiting.is_empty() {
            let first =
                |packets: &Packets| packets.first_key_value().map_or(u64::MAX, |(k, _)| k.0);
            let reset = self.resets.iter().map(|(at, _)| *at).min();
            let reset = reset.unwrap_or(u64::MAX);
            let (request, reply) = (first(&self.requests), first(&self.replies));
            let next = request.min(reply).min(reset);
            if next > until {
                self.now = self.now.max(until);
                self.board.advance_to(self.now);
                return;
            }
            self.now = self.now.max(next);
            if next == reset {
                self.reset(next);
            } else if next == reply {
                self.reply();
            } else {
                self.request();
            }
        }
    }

    fn reset(&mut self, at: u64) {
        self.resets.retain(|(due, time)| {
            let is_due = *due == at;
            if is_due {
                self.board.advance_to(at);
                self.board.reset_for(*time);
                self.silent_until = at + *time;
            }
            !is_due
        });
    }

    fn reply(&mut self) {
        if let Some(((at, _), (number, executed, bytes))) = self.replies.pop_first() {
            self.journal[number].replies.push((at, executed));
            self.waiting.push_back(bytes);
        }
    }

    fn request(&mut self) {
        let Some(((at, _), (number, _, packet))) = self.requests.pop_first() else {
            return;
        };
        let mut answer = Vec::new();
        let leaves = self.board.handle_packet(at, &packet, &mut answer);
        let executed = self.board.time();
        self.journal[number].executed.push(executed);
        if let Some(leaves) = leaves {
            for delay in (self.to_host)(at, &answer) {
                self.sent += 1;
                let reply = (number, executed, answer.clone());
                self.replies.insert((leaves + delay, self.sent), reply);
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

impl PacketLink for SimLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        if self.is_unreachable {
            return Err(LinkError::Unreachable);
        }
        let number = self.journal.len();
        self.journal.push(Sent {
            at: self.now,
            is_request: is_request(packet),
            is_write: writes(packet),
            bytes: packet.len(),
            ..Sent::default()
        });
        for delay in (self.to_board)(self.now, packet) {
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
        self.run(deadline.as_nanos() + self.missed, true);
        let Some(packet) = self.waiting.pop_front() else {
            return Ok(None);
        };
        buffer[..packet.len()].copy_from_slice(&packet);
        Ok(Some(packet.len()))
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.now - self.missed)
    }

    fn sleep_until(&mut self, deadline: Instant) {
        self.run(deadline.as_nanos() + self.missed, false);
    }
}
