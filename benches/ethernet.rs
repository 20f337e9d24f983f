//! Cost of the Ethernet bus: building and parsing packets, and a whole cycle on loopback.
//!
//! The cycle is that of a 7I97 with three remotes. On loopback it is measured beside a bare
//! exchange of packets of the same size through the same kind of socket, so that the ratio shows
//! the cost of the bus; bytes and packets of a cycle are printed.

#![allow(missing_docs, reason = "the macros of criterion write public items")]

use core::ops::Range;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use mesa_hal::bus::{Access, Instant, RegisterBus};
use mesa_hal::bus::{AccessList, LinkError};
use mesa_hal::lbp16::registers::control;
use mesa_hal::lbp16::{Operations, RequestBuilder, Space};
use mesa_hal::transport::udp::{PacketLink, UdpBus, UdpConfig};

/// Reads of one cycle: watchdog, ports, encoders, inputs, one serial port with three channels.
const READS: [(u16, u16); 10] = [
    (0x0D00, 1),
    (0x1000, 3),
    (0x3600, 6),
    (0x8200, 1),
    (0x8400, 1),
    (0x5B00, 1),
    (0x5C00, 1),
    (0x5D00, 3),
    (0x5E00, 3),
    (0x5F00, 1),
];
/// Writes of one cycle: watchdog, ports, analog outputs, SSR, remotes, DOIT.
const WRITES: [(u16, u16); 8] = [
    (0x0E00, 1),
    (0x1000, 3),
    (0x4100, 6),
    (0x4500, 1),
    (0x7D00, 1),
    (0x5E00, 3),
    (0x5F00, 3),
    (0x5B00, 1),
];

struct Cycle {
    read: AccessList,
    write: AccessList,
    words: [u32; 64],
}

impl Cycle {
    fn new<L: PacketLink>(bus: &mut UdpBus<L>) -> Self {
        let mut first = 0;
        let mut place = |list: &[(u16, u16)], access: fn(u16, u16, u16) -> Access| {
            let accesses = list.iter().map(|&(address, count)| {
                let placed = access(address, first, count);
                first += count;
                placed
            });
            accesses.collect::<Vec<_>>()
        };
        let reads = place(&READS, Access::read);
        let writes = place(&WRITES, Access::write);
        Self {
            read: bus
                .prepare(&reads, None)
                .expect("the reads fit into a packet"),
            write: bus
                .prepare(&writes, None)
                .expect("the writes fit into a packet"),
            words: [0; 64],
        }
    }

    fn run<L: PacketLink>(&mut self, bus: &mut UdpBus<L>) -> bool {
        let read = bus.run(&self.read, &mut self.words);
        let write = bus.run(&self.write, &mut self.words);
        read.is_ok() && write.is_ok()
    }
}

/// A board that executes nothing, but answers every request with the right bytes.
#[derive(Debug, Default)]
struct Responder {
    scratch: [u8; 32],
    /// Packets received and sent.
    counts: [u16; 2],
    reply: Vec<u8>,
}

impl Responder {
    fn answer(&mut self, request: &[u8]) -> &[u8] {
        self.reply.clear();
        let [received, sent] = &mut self.counts;
        *received = received.wrapping_add(1);
        for operation in Operations::new(request).flatten() {
            let address = operation.address.expect("the bus uses no address pointers");
            let start = usize::from(address) % 32;
            let len = operation.command.data_len();
            let scratch = self.scratch.get_mut(start..start + len);
            match (operation.command.space, operation.command.write, scratch) {
                (Space::Timer, true, Some(scratch)) => scratch.copy_from_slice(operation.data),
                (Space::Timer, false, Some(scratch)) => self.reply.extend_from_slice(scratch),
                (Space::Control, false, _) if start == usize::from(control::RX_UDP) => {
                    let counts = [*received, 0, 0, *sent].map(u16::to_le_bytes);
                    self.reply.extend(counts.iter().flatten().take(len));
                }
                (_, false, _) => self.reply.resize(self.reply.len() + len, 0x5A),
                _ => {}
            }
        }
        *sent = sent.wrapping_add(u16::from(!self.reply.is_empty()));
        &self.reply
    }
}

/// A network without cost: the responder, called directly.
#[derive(Debug, Default)]
struct Direct {
    responder: Responder,
    waiting: Vec<u8>,
    now: u64,
}

impl PacketLink for Direct {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let reply = self.responder.answer(packet);
        self.waiting.clear();
        self.waiting.extend_from_slice(reply);
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], _: Instant) -> Result<Option<usize>, LinkError> {
        let len = self.waiting.len();
        buffer[..len].copy_from_slice(&self.waiting);
        Ok((len > 0).then_some(len))
    }

    fn now(&mut self) -> Instant {
        self.now += 1;
        Instant::from_nanos(self.now)
    }

    fn sleep_until(&mut self, deadline: Instant) {
        self.now = deadline.as_nanos();
    }
}

/// The request of the reads, without the numbers of the bus; returns the position of each read in
/// the reply.
fn encode() -> [Range<usize>; READS.len()] {
    let mut request = RequestBuilder::default();
    READS.map(|(address, count)| {
        let count = u8::try_from(count).expect("short runs");
        let read = request.read(Space::HostMot2, address, count);
        read.expect("a count that a command can have")
    })
}

fn decode(reply: &[u8], places: &[Range<usize>]) -> u32 {
    places.iter().fold(0, |sum, place| {
        let (words, _) = reply[place.clone()].as_chunks();
        let words = words.iter().copied().map(u32::from_le_bytes);
        words.fold(sum, u32::wrapping_add)
    })
}

fn packets(criterion: &mut Criterion) {
    let mut bus = UdpBus::new(Direct::default(), UdpConfig::default()).expect("it answers");
    let mut cycle = Cycle::new(&mut bus);
    assert!(cycle.run(&mut bus));
    let before = bus.statistics();
    assert!(cycle.run(&mut bus));
    let after = bus.statistics();
    println!(
        "a cycle: {} packets out, {} bytes out, 1 packet in, {} bytes in",
        after.exchanges - before.exchanges,
        after.bytes_sent - before.bytes_sent,
        after.bytes_received - before.bytes_received,
    );
    let mut group = criterion.benchmark_group("packets");
    group.bench_function("encode, match and decode a cycle", |bencher| {
        bencher.iter(|| cycle.run(&mut bus));
    });
    group.bench_function("encode the request alone", |bencher| {
        bencher.iter(encode);
    });
    let places = encode();
    let reply = vec![0x5A; places.iter().map(ExactSizeIterator::len).sum()];
    group.bench_function("decode the reply alone", |bencher| {
        bencher.iter(|| decode(&reply, &places));
    });
    let mut responder = Responder::default();
    let request = [0x85, 0x42, 0x00, 0x04];
    group.bench_function("answer one request (the responder's share)", |bencher| {
        bencher.iter(|| responder.answer(&request).len());
    });
    group.finish();
}

/// Answers on loopback until the process ends.
fn serve(mut answer: impl FnMut(&[u8]) -> Vec<u8> + Send + 'static) -> SocketAddrV4 {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("loopback is there");
    let SocketAddr::V4(address) = socket.local_addr().expect("it is bound") else {
        unreachable!("an IPv4 socket has an IPv4 address")
    };
    std::thread::spawn(move || {
        let mut buffer = [0; 2048];
        while let Ok((len, from)) = socket.recv_from(&mut buffer) {
            let reply = answer(&buffer[..len]);
            if !reply.is_empty() {
                let _ = socket.send_to(&reply, from);
            }
        }
    });
    address
}

fn loopback(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("loopback");
    group.measurement_time(Duration::from_secs(3));

    let address = serve(|request| {
        let reply = if request.len() > 60 { 0 } else { 92 };
        vec![0; reply]
    });
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("loopback is there");
    socket.connect(address).expect("loopback is there");
    group.bench_function("bare packets of the same size", |bencher| {
        let mut buffer = [0; 2048];
        bencher.iter(|| {
            socket.send(&[0; 56]).expect("loopback is there");
            let received = socket.recv(&mut buffer).expect("the responder answers");
            socket.send(&[0; 120]).expect("loopback is there");
            received
        });
    });

    let mut responder = Responder::default();
    let address = serve(move |request| responder.answer(request).to_vec());
    let config = UdpConfig {
        cycle_deadline: Duration::from_millis(50),
        ..UdpConfig::default()
    };
    let mut bus = UdpBus::connect(address, config).expect("the responder answers");
    let mut cycle = Cycle::new(&mut bus);
    group.bench_function("the same through the bus", |bencher| {
        bencher.iter(|| cycle.run(&mut bus));
    });
    println!("{:?}", bus.statistics());
    group.finish();
}

criterion_group!(benches, packets, loopback);
criterion_main!(benches);
