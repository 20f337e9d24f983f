//! The bus on a network and a board of the test's own, on virtual time.

mod posted;
mod sequences;

use super::*;
use crate::bus::{BusError, BusErrorKind};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// What becomes of one packet on its way.
#[derive(Clone, Copy, Debug)]
enum Fate {
    Arrives(u64),
    Lost,
    Doubled(u64, u64),
    Cut(u64, usize),
}

const GOOD: Fate = Fate::Arrives(30_000);
const GOOD_AT_ONCE: Fate = Fate::Arrives(0);

/// Packets by their arrival, then in the order they were sent; a reply with the execution that it
/// is of.
type Underway = BTreeMap<(u64, u64), (usize, Vec<u8>)>;

/// One packet that the board executed.
#[derive(Clone, Copy, Debug, Default)]
struct Execution {
    write: Option<u16>,
    request: Option<u32>,
}

/// A board that answers register reads with a stamp that never comes twice.
#[derive(Debug, Default)]
struct Network {
    now: u64,
    order: u64,
    to_board: Underway,
    to_host: Underway,
    requests: Vec<Fate>,
    replies: Vec<Fate>,
    registers: BTreeMap<u16, u32>,
    scratch: BTreeMap<u16, u16>,
    /// RXUDPCount and TXUDPCount.
    received: u16,
    sent: u16,
    executed: Vec<Vec<u8>>,
    executions: Vec<Execution>,
    stamp: u32,
    refuses: bool,
    /// What becomes of the sends to come.
    refusals: Vec<bool>,
    /// How long the board waits for its clock, and what it says of that.
    held: u64,
    says_us: Option<u16>,
    /// Newest numbers that were given to the link.
    newest: Execution,
    /// For each request the newest write before it.
    asked: BTreeMap<u32, Option<u16>>,
    /// The execution that the newest reply at the host is of.
    delivered: Option<usize>,
    /// There is always one more datagram, of somebody else.
    flooded: bool,
    /// For each request number the values of its first execution and all others.
    answers: BTreeMap<u32, Vec<Vec<u32>>>,
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
        }
    }

    /// Lets everything happen that happens until `until`; stops at the first reply.
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

    /// The reply, and how long the board waits before it sends it.
    fn execute(&mut self, packet: &[u8]) -> (Vec<u8>, u64) {
        self.executed.push(packet.to_vec());
        self.executions.push(numbers(packet));
        let mut held = 0;
        self.received = self.received.wrapping_add(1);
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
fn numbers(packet: &[u8]) -> Execution {
    let mut found = Execution::default();
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
                (4, 0x1C, &[a, b, c, d]) => {
                    found.request = Some(u32::from_le_bytes([a, b, c, d]));
                }
                _ => {}
            }
        }
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
        }
    }
}

impl Link for Network {
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
        if self.flooded {
            self.now += 1_000;
            buffer[..20].fill(0xEE);
            return Ok(Some(20));
        }
        let Some((execution, packet)) = self.run(deadline.as_nanos()) else {
            return Ok(None);
        };
        self.delivered = Some(execution);
        buffer[..packet.len()].copy_from_slice(&packet);
        Ok(Some(packet.len()))
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.now)
    }

    fn sleep_until(&mut self, deadline: Instant) {
        // What comes meanwhile waits in the socket.
        let mut waiting = Vec::new();
        while let Some(packet) = self.run(deadline.as_nanos()) {
            waiting.push(packet);
        }
        for (execution, packet) in waiting {
            self.carry(|n| &mut n.to_host, GOOD_AT_ONCE, execution, &packet);
        }
    }
}

fn bus() -> UdpBus<Network> {
    UdpBus::new(Network::default(), UdpConfig::default()).unwrap()
}

const MS: Duration = Duration::from_millis(1);

/// One cycle: the last word is the stamp that the board gave to the read of 0x1000.
struct Cycle {
    read: Prepared,
    write: Prepared,
}

impl Cycle {
    fn new(bus: &mut UdpBus<Network>) -> Self {
        Self {
            read: bus.prepare(&[Access::read(0x1000, 0, 2)]).unwrap(),
            write: bus.prepare(&[Access::write(0x2000, 2, 1)]).unwrap(),
        }
    }
}

#[test]
fn neighbours_share_a_command_and_the_packet_is_as_short_as_it_can_be() {
    let mut bus = bus();
    let accesses = [
        Access::read(0x5D00, 3, 2),
        Access::read(0x5D08, 0, 1),
        Access::read(0x3500, 5, 6),
    ];
    let list = bus.prepare(&accesses).unwrap();
    let mut words = [0; 11];
    bus.exchange_prepared(&list, &mut words).unwrap();
    assert_eq!(words, [3, 0, 0, 1, 2, 4, 5, 6, 7, 8, 9]);
    // number 8, two commands of 4, count of packets 4, numbers read back 4
    assert_eq!(bus.link().executed.last().unwrap().len(), 24);
}

#[test]
fn a_block_of_more_than_127_registers_takes_a_second_command() {
    let mut bus = bus();
    let list = bus.prepare(&[Access::read(0x0400, 0, 256)]).unwrap();
    let mut words = [0; 256];
    bus.exchange_prepared(&list, &mut words).unwrap();
    assert!(words.iter().zip(1..).all(|(&word, stamp)| word == stamp));
    assert_eq!(bus.link().executed.last().unwrap().len(), 8 + 3 * 4 + 8);
}

#[test]
fn lists_that_fit_no_packet_or_no_buffer_are_refused_when_they_are_prepared_or_run() {
    let mut bus = bus();
    let error = bus.prepare(&[Access::read(0, 0, 400)]).unwrap_err();
    assert!(
        matches!(
            error,
            UdpError::TooLong {
                what: "reply",
                bytes: 1624,
                ..
            }
        ),
        "{error}"
    );
    assert!(bus.prepare(&[Access::read(2, 0, 1)]).is_err());
    assert!(bus.prepare(&[Access::read(0xFFFC, 0, 2)]).is_err());
    let error = bus
        .exchange(&[Access::read(0, 1, 2)], &mut [0; 2])
        .unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Invalid);
}

#[test]
fn a_lost_reply_is_an_error_that_says_so_and_the_words_stay() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    bus.link().replies = vec![Fate::Lost];
    let mut words = [7; 3];
    let error = bus.exchange_prepared(&cycle.read, &mut words).unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Lost);
    assert!(error.to_string().contains("800µs"), "{error}");
    assert_eq!(words, [7; 3]);
    assert_eq!(bus.statistics().lost, 1);
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
}

#[test]
fn a_flood_of_datagrams_does_not_keep_an_exchange_beyond_its_deadline() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    bus.link().flooded = true;
    let started = bus.now();
    let error = bus.exchange_prepared(&cycle.read, &mut [0; 3]).unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Lost);
    let deadline = UdpConfig::default().cycle_deadline;
    let waited = bus.now().since(started);
    assert!(waited <= deadline + MS / 10, "{waited:?}");
    bus.link().flooded = false;
    bus.exchange_prepared(&cycle.read, &mut [0; 3]).unwrap();
}

#[test]
fn a_late_reply_is_counted_late_and_never_taken_by_the_next_request() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    bus.link().replies = vec![Fate::Arrives(900_000)];
    let mut words = [0; 3];
    bus.exchange_prepared(&cycle.read, &mut words).unwrap_err();
    assert_eq!((bus.statistics().lost, bus.statistics().late), (1, 0));
    bus.wait(MS);
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    assert_eq!(words, [3, 4, 0], "the second answer of the board");
    assert_eq!((bus.statistics().lost, bus.statistics().late), (0, 1));
}

#[test]
fn a_doubled_reply_is_counted_and_taken_once() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    bus.link().replies = vec![Fate::Doubled(10_000, 20_000)];
    let mut words = [0; 3];
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    assert_eq!(words, [3, 4, 0]);
    assert_eq!(bus.statistics().duplicate, 1);
}

#[test]
fn only_stale_replies_until_the_deadline_is_an_error_of_its_own() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    bus.link().replies = vec![Fate::Lost, Fate::Doubled(10_000, 900_000)];
    let mut words = [0; 3];
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    let error = bus.exchange_prepared(&cycle.read, &mut words).unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Lost);
    bus.link().replies = vec![Fate::Lost];
    let error = bus.exchange_prepared(&cycle.read, &mut words).unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Stale);
}

#[test]
fn a_short_reply_is_counted_and_not_taken() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    bus.link().replies = vec![Fate::Cut(10_000, 4)];
    let mut words = [0; 3];
    bus.exchange_prepared(&cycle.read, &mut words).unwrap_err();
    assert_eq!(words, [0; 3]);
    assert_eq!(bus.statistics().short, 1);
}

#[test]
fn a_lost_write_is_said_by_the_next_read_once() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    let mut words = [0, 0, 42];
    bus.exchange_prepared(&cycle.write, &mut words).unwrap();
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    assert_eq!(bus.statistics().lost_writes, 0);
    assert_eq!(bus.link().registers[&0x2000], 42);
    bus.link().requests = vec![Fate::Lost];
    words[2] = 43;
    bus.exchange_prepared(&cycle.write, &mut words).unwrap();
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    assert_eq!(bus.statistics().lost_writes, 1);
    assert_eq!(bus.link().registers[&0x2000], 42);
}

#[test]
fn an_unreachable_board_is_said_after_a_bounded_number_of_tries() {
    let network = Network {
        requests: vec![Fate::Lost; 100],
        ..Network::default()
    };
    let error = UdpBus::new(network, UdpConfig::default()).unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Lost);
    let network = Network {
        refuses: true,
        ..Network::default()
    };
    let error = UdpBus::new(network, UdpConfig::default()).unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Refused);
}

#[test]
fn set_up_repeats_what_was_lost_and_nothing_that_was_executed() {
    for reply_lost in [false, true] {
        let mut bus = bus();
        let before = bus.link().executed.len();
        let fates = vec![GOOD, GOOD, Fate::Lost];
        if reply_lost {
            bus.link().replies = fates;
        } else {
            bus.link().requests = fates;
        }
        let mut words = [1234, 0];
        let list = [Access::write(0x2000, 0, 1), Access::read(0x1000, 1, 1)];
        bus.exchange(&list, &mut words).unwrap();
        assert_ne!(words[1], 0);
        let link = bus.link();
        let writes = link.executed[before..]
            .iter()
            .filter(|packet| packet.windows(4).any(|w| w == 1234_u32.to_le_bytes()));
        assert_eq!(writes.count(), 1, "reply lost: {reply_lost}");
    }
}

fn fate() -> impl Strategy<Value = Fate> {
    let delay = 1_000..2_000_000_u64;
    prop_oneof![
        4 => delay.clone().prop_map(Fate::Arrives),
        1 => Just(Fate::Lost),
        1 => (delay.clone(), delay.clone()).prop_map(|(a, b)| Fate::Doubled(a, b)),
        1 => (delay, 1..40_usize).prop_map(|(a, b)| Fate::Cut(a, b)),
    ]
}

proptest! {
    #[test]
    fn whatever_the_network_does_a_word_is_the_boards_answer_to_this_very_request(
        requests in prop::collection::vec(prop_oneof![2 => Just(GOOD), 1 => fate().prop_filter(
            "a board ignores a cut request", |f| !matches!(f, Fate::Cut(..)))], 1..60),
        replies in prop::collection::vec(prop_oneof![2 => Just(GOOD), 1 => fate()], 1..60),
    ) {
        let mut bus = bus();
        let cycle = Cycle::new(&mut bus);
        let cycles = requests.len() as u64;
        bus.link().requests = requests;
        bus.link().replies = replies;
        let mut good = 0;
        for n in 0..cycles {
            let mut words = [0, 0, n as u32];
            let number = 2 + n as u32;
            if bus.exchange_prepared(&cycle.read, &mut words).is_ok() {
                good += 1;
                let answers = &bus.link().answers[&number];
                prop_assert!(answers.iter().any(|a| a[..] == words[..2]), "{words:?} {answers:?}");
            } else {
                prop_assert_eq!(&words[..2], &[0, 0]);
            }
            bus.wait(MS / 2);
        }
        let counted = bus.statistics();
        // A reply in the socket when its deadline passes is late at once, others when they come.
        prop_assert!(good + counted.lost + counted.late + counted.short >= cycles);
        prop_assert_eq!(counted.exchanges, cycles);
    }
}
