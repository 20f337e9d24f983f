//! A simulated network and board, on virtual time.

use super::*;
use crate::bus::LinkError;

/// The fate of one packet on its way.
#[derive(Clone, Copy, Debug)]
pub(super) enum Fate {
    Arrives(u64),
    Lost,
    Doubled(u64, u64),
    Cut(u64, usize),
    /// Preceded by a datagram that is longer by this many bytes and ends with the same number.
    AfterLonger(u64, usize),
}

pub(super) const GOOD: Fate = Fate::Arrives(30_000);
pub(super) const GOOD_AT_ONCE: Fate = Fate::Arrives(0);

/// Packets by their arrival, then in the order of sending; a reply with the execution that caused
/// it.
pub(super) type Underway = BTreeMap<(u64, u64), (usize, Vec<u8>)>;

/// One packet that the board executed.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Execution {
    pub write: Option<u16>,
    pub request: Option<u32>,
}

/// A board that answers register reads with a stamp that is never repeated.
#[derive(Debug, Default)]
pub(super) struct Network {
    pub now: u64,
    pub order: u64,
    pub to_board: Underway,
    pub to_host: Underway,
    pub requests: Vec<Fate>,
    pub replies: Vec<Fate>,
    pub registers: BTreeMap<u16, u32>,
    pub scratch: BTreeMap<u16, u16>,
    /// RXUDPCount and TXUDPCount.
    pub received: u16,
    pub sent: u16,
    pub executed: Vec<Vec<u8>>,
    pub executions: Vec<Execution>,
    pub stamp: u32,
    pub refuses: bool,
    /// Results of the sends to come.
    pub refusals: Vec<bool>,
    /// Time that the board waits for its clock, and the time that it reports.
    pub held: u64,
    pub says_us: Option<u16>,
    /// Newest numbers that were passed to the link.
    pub newest: Execution,
    /// For each request the newest write before it.
    pub asked: BTreeMap<u32, Option<u16>>,
    /// The execution that caused the newest reply at the host.
    pub delivered: Option<usize>,
    /// Every receive finds one more foreign datagram of this length.
    pub flooded: Option<usize>,
    /// Period in nanoseconds at which another host sends a packet to the board.
    pub other_host: Option<u64>,
    /// Number of such packets so far.
    pub of_others: u64,
    /// For each request number the values of its first execution and all others.
    pub answers: BTreeMap<u32, Vec<Vec<u32>>>,
}

impl Network {
    fn carry(
        &mut self,
        way: fn(&mut Self) -> &mut Underway,
        fate: Fate,
        execution: usize,
        packet: &[u8],
    ) {
        let now = self.now;
        let mut put = |delay: u64, bytes: &[u8]| {
            self.order += 1;
            let key = (now + delay, self.order);
            way(self).insert(key, (execution, bytes.to_vec()));
        };
        match fate {
            Fate::Lost => {}
            Fate::Arrives(delay) => put(delay, packet),
            Fate::Doubled(first, second) => {
                put(first, packet);
                put(second, packet);
            }
            Fate::Cut(delay, bytes) => put(delay, &packet[..packet.len().saturating_sub(bytes)]),
            Fate::AfterLonger(delay, bytes) => {
                let number = packet.iter().rev().take(4).rev();
                let filling = number.cycle().take(bytes.next_multiple_of(4));
                let longer: Vec<u8> = packet.iter().chain(filling).copied().collect();
                put(delay, &longer);
                put(delay, packet);
            }
        }
    }

    /// Runs all events until `until`; stops at the first reply.
    fn run(&mut self, until: u64) -> Option<(usize, Vec<u8>)> {
        loop {
            let board = self.to_board.first_key_value().map(|(k, _)| k.0);
            let host = self.to_host.first_key_value().map(|(k, _)| k.0);
            let (at, is_host) = match (board, host) {
                (Some(b), Some(h)) if h <= b => (h, true),
                (Some(b), _) => (b, false),
                (None, Some(h)) => (h, true),
                (None, None) => (u64::MAX, false),
            };
            if at > until {
                self.now = self.now.max(until);
                return None;
            }
            self.now = self.now.max(at);
            if is_host {
                return self.to_host.pop_first().map(|(_, packet)| packet);
            }
            let (_, (_, packet)) = self.to_board.pop_first().unwrap();
            let (reply, held) = self.execute(&packet);
            if !reply.is_empty() {
                let fate = self.replies.pop().unwrap_or(GOOD).after(held);
                let execution = self.executions.len() - 1;
                self.carry(|n| &mut n.to_host, fate, execution, &reply);
            }
        }
    }

    /// The reply, and the time that the board waits before it sends the reply.
    pub fn execute(&mut self, packet: &[u8]) -> (Vec<u8>, u64) {
        self.executed.push(packet.to_vec());
        self.executions.push(numbers(packet));
        let mut held = 0;
        let of_others = self.other_host.map_or(0, |every| self.now / every);
        let new = of_others - core::mem::replace(&mut self.of_others, of_others);
        self.received = self.received.wrapping_add(1 + new as u16);
        let mut reply = Vec::new();
        let mut words = Vec::new();
        let mut rest = packet;
        while let [low, high, a, b, tail @ ..] = rest {
            let command = u16::from_le_bytes([*low, *high]);
            let address = u16::from_le_bytes([*a, *b]);
            let count = command & 0x7F;
            let size = 1 << (command >> 8 & 3);
            assert_eq!(
                command & 0x6080,
                0x4080,
                "address included, memory, increment"
            );
            rest = tail;
            for n in 0..count {
                let at = address + n * size;
                match (command >> 15, command >> 10 & 7) {
                    (0, 0) => {
                        self.stamp += 1;
                        words.push(self.stamp);
                        reply.extend(self.stamp.to_le_bytes());
                    }
                    (1, 0) => {
                        let (value, tail) = rest.split_at(4);
                        self.registers
                            .insert(at, u32::from_le_bytes(value.try_into().unwrap()));
                        rest = tail;
                    }
                    (0, 4) if at == 0x06 => {
                        let limit = u64::from(self.scratch[&0x04]) * 1000;
                        held = self.held.min(limit);
                        let waited = self.says_us.unwrap_or((held / 1000) as u16);
                        reply.extend(waited.to_le_bytes());
                    }
                    (0, 4) => {
                        reply.extend(self.scratch.get(&at).copied().unwrap_or(0).to_le_bytes());
                    }
                    (1, 4) => {
                        let (value, tail) = rest.split_at(2);
                        self.scratch
                            .insert(at, u16::from_le_bytes(value.try_into().unwrap()));
                        rest = tail;
                    }
                    (0, 6) => {
                        let count = match at {
                            0x0A => self.received,
                            0x10 => self.sent,
                            _ => 0xBAD0,
                        };
                        reply.extend(count.to_le_bytes());
                    }
                    other => panic!("{other:?}"),
                }
            }
        }
        assert!(rest.is_empty(), "{packet:02X?}");
        if let Some(number) = numbers(packet).request {
            self.answers.entry(number).or_default().push(words);
        }
        self.sent = self.sent.wrapping_add(u16::from(!reply.is_empty()));
        (reply, held)
    }
}

/// The numbers that a packet sets.
pub(super) fn numbers(packet: &[u8]) -> Execution {
    let mut found = Execution::default();
    let mut slot = None;
    let mut rest = packet;
    while let [low, high, a, _, tail @ ..] = rest {
        let (count, size) = (usize::from(*low & 0x7F), 1 << (*high & 3));
        let is_write = *high & 0x80 != 0;
        rest = tail;
        if is_write {
            let (data, tail) = rest.split_at(count * size);
            rest = tail;
            match (*high >> 2 & 7, *a, data) {
                (4, 0x1A, [a, b]) => found.write = Some(u16::from_le_bytes([*a, *b])),
                (4, 0x10..0x1A, [a, b]) => slot = Some(u16::from_le_bytes([*a, *b])),
                (4, 0x1C, &[a, b, c, d]) => {
                    found.request = Some(u32::from_le_bytes([a, b, c, d]));
                }
                _ => {}
            }
        }
    }
    if found.request.is_some() {
        // A whole cycle does not set the last-write register.
        found.write = found.write.or(slot);
    }
    found
}

impl Fate {
    fn after(self, held: u64) -> Self {
        match self {
            Self::Arrives(delay) => Self::Arrives(delay + held),
            Self::Lost => Self::Lost,
            Self::Doubled(first, second) => Self::Doubled(first + held, second + held),
            Self::Cut(delay, bytes) => Self::Cut(delay + held, bytes),
            Self::AfterLonger(delay, bytes) => Self::AfterLonger(delay + held, bytes),
        }
    }
}

impl PacketLink for Network {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let numbers = numbers(packet);
        let before = self.newest.write;
        self.newest.write = numbers.write.or(before);
        if let Some(request) = numbers.request {
            self.newest.request = Some(request);
            self.asked.insert(request, self.newest.write);
        }
        if self.refuses || self.refusals.pop().unwrap_or(false) {
            return Err(LinkError::Refused);
        }
        let fate = self.requests.pop().unwrap_or(GOOD);
        self.carry(|n| &mut n.to_board, fate, 0, packet);
        Ok(())
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        if let Some(length) = self.flooded {
            self.now += 1_000;
            buffer[..length].fill(0xEE);
            return Ok(Some(length));
        }
        let Some((execution, packet)) = self.run(deadline.as_nanos()) else {
            return Ok(None);
        };
        self.delivered = Some(execution);
        // As a socket does: bytes that do not fit are cut off.
        let length = packet.len().min(buffer.len());
        buffer[..length].copy_from_slice(&packet[..length]);
        Ok(Some(length))
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.now)
    }

    fn sleep_until(&mut self, deadline: Instant) {
        // Packets that arrive meanwhile wait in the socket.
        let mut waiting = Vec::new();
        while let Some(packet) = self.run(deadline.as_nanos()) {
            waiting.push(packet);
        }
        for (execution, packet) in waiting {
            self.carry(|n| &mut n.to_host, GOOD_AT_ONCE, execution, &packet);
        }
    }
}
