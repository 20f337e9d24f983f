//! Any calls of a bus over UDP, on a network that loses, repeats, delays, cuts and forges replies:
//! the calls end, and unless a reply was forged, a word that is read is the board's answer to that
//! request.

#![no_main]

use std::collections::VecDeque;
use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use mesa_hal::bus::{Access, Clock, Instant, LinkError, RegisterBus};
use mesa_hal::transport::udp::{PacketLink, UdpBus, UdpConfig};
use mesa_hal_sim::{BoardConfig, Gateware, SimBoard};

/// Time on the wire, in ns.
const WIRE: u64 = 20_000;

/// Registers of which each read returns another number.
#[derive(Default)]
struct Stamps(u32);

impl Gateware for Stamps {
    fn advance_to(&mut self, _: u64) {}

    fn read_register(&mut self, _: u16) -> u32 {
        self.0 += 1;
        self.0
    }

    fn write_register(&mut self, _: u16, _: u32) {}

    fn wait_for_timer(&mut self, _: u8, _: u64) -> Option<u64> {
        None
    }

    fn reconfigure(&mut self) {}
}

/// The input, byte by byte.
#[derive(Default)]
struct Input(VecDeque<u8>);

impl Input {
    fn byte(&mut self) -> u8 {
        self.0.pop_front().unwrap_or(0)
    }

    fn bytes(&mut self) -> Vec<u8> {
        let len = usize::from(self.byte()).min(self.0.len());
        self.0.drain(..len).collect()
    }
}

/// A simulated board, and the network between.
struct Link {
    board: SimBoard<Stamps>,
    now: u64,
    replies: VecDeque<Vec<u8>>,
    /// A reply that comes with the next one.
    late: Vec<Vec<u8>>,
    input: Input,
    is_forged: bool,
}

impl Link {
    fn new() -> Self {
        Self {
            board: SimBoard::new(BoardConfig::new("7I92"), Stamps::default()),
            now: 0,
            replies: VecDeque::new(),
            late: Vec::new(),
            input: Input::default(),
            is_forged: false,
        }
    }

    fn deliver(&mut self, mut reply: Vec<u8>) {
        match self.input.byte() % 8 {
            1 => {}
            2 => self.replies.extend([reply.clone(), reply]),
            3 => self.late.push(reply),
            4 => {
                reply.truncate(self.input.byte().into());
                self.replies.push_back(reply);
            }
            5 => {
                let forged = self.input.bytes();
                self.replies.extend([forged, reply]);
                self.is_forged = true;
            }
            6 => {
                let (at, bits) = (usize::from(self.input.byte()), self.input.byte());
                reply
                    .iter_mut()
                    .skip(at)
                    .take(1)
                    .for_each(|byte| *byte ^= bits);
                self.replies.push_back(reply);
                self.is_forged = true;
            }
            _ => {
                self.replies.extend(self.late.drain(..));
                self.replies.push_back(reply);
            }
        }
    }
}

impl PacketLink for Link {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let mut reply = Vec::new();
        let at = self.board.time().max(self.now) + WIRE;
        if self.board.handle_packet(at, packet, &mut reply).is_some() {
            self.deliver(reply);
        }
        Ok(())
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        let Some(reply) = self.replies.pop_front() else {
            self.sleep_until(deadline);
            return Ok(None);
        };
        self.now += WIRE;
        let len = reply.len().min(buffer.len());
        buffer[..len].copy_from_slice(&reply[..len]);
        Ok(Some(len))
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.now)
    }

    fn sleep_until(&mut self, deadline: Instant) {
        self.now = self.now.max(deadline.as_nanos());
    }
}

fuzz_target!(|data: &[u8]| {
    let mut bus = UdpBus::new(Link::new(), UdpConfig::default()).expect("a good network so far");
    let read = [Access::read(0x1000, 0, 1)];
    let write = [Access::write(0x2000, 0, 1)];
    let reading = bus.prepare(&read, None).expect("a list");
    let writing = bus.prepare(&write, None).expect("a list");
    bus.link().input.0 = data.iter().copied().collect();
    while !bus.link().input.0.is_empty() {
        let before = bus.link().board.gateware().0;
        let mut words = [0];
        let step = bus.link().input.byte() % 6;
        let is_good = match step {
            0 | 1 => bus.run(&reading, &mut words).is_ok(),
            2 => bus.exchange(&read, &mut words).is_ok(),
            3 => bus.run(&writing, &mut words).is_ok(),
            4 => bus.exchange(&write, &mut words).is_ok(),
            _ => {
                let micros = u64::from(bus.link().input.byte()) * 20;
                bus.wait(Duration::from_micros(micros));
                continue;
            }
        };
        let after = bus.link().board.gateware().0;
        if step <= 2 && is_good && !bus.link().is_forged {
            let own = before + 1..=after;
            assert!(own.contains(&words[0]), "{words:?} is not in {own:?}");
        }
    }
});
