//! The two ways from the host to the simulated board: an embedded bus, and Ethernet. Both can be
//! left behind by a process that was killed.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use mesa_hal::bus::{
    Access, AccessList, BusErrorKind, BusStatistics, Clock, Hold, Instant, RegisterBus, Reply,
};
use mesa_hal::sim::{FaultKind, SimBoard, SimError, SimFpga};
use mesa_hal::transport::udp::{Link, LinkError, UdpBus};
use mesa_hal::transport::{Fault, Faulty};

use crate::common::chance::Chance;

/// Time on the wire in each direction.
pub const WIRE: u64 = 20_000;

/// The simulated board, which outlives every process that talks to it.
#[derive(Clone, Debug)]
pub enum Sim {
    Embedded(Rc<RefCell<SimFpga>>),
    Network(Rc<RefCell<Network>>),
}

impl Sim {
    pub fn now(&self) -> u64 {
        match self {
            Self::Embedded(fpga) => SimFpga::now(&fpga.borrow()),
            Self::Network(network) => network.borrow().now,
        }
    }

    pub fn pass(&self, time: u64) {
        match self {
            Self::Embedded(fpga) => {
                let mut fpga = fpga.borrow_mut();
                let until = SimFpga::now(&fpga) + time;
                fpga.advance_to(until);
            }
            Self::Network(network) => {
                let until = network.borrow().now + time;
                network.borrow_mut().run(until, false);
            }
        }
    }
}

/// What a host does about a bus that fails.
pub trait Host: RegisterBus + Clock + Sized {
    /// Lets exchanges fail from now on, the first of them after `skip`.
    fn fail(&mut self, kind: FaultKind, skip: u64, count: u64);
    fn heal(&mut self);
}

impl Host for Faulty<Direct> {
    fn fail(&mut self, kind: FaultKind, skip: u64, count: u64) {
        let fault = match kind {
            FaultKind::BusNotExecuted => Fault::NotExecuted(BusErrorKind::Lost),
            FaultKind::BusNoReply => Fault::Executed(BusErrorKind::Late),
            _ => Fault::SilentWrite,
        };
        let first = self.exchanges() + skip;
        for number in first..first + count {
            self.fail_at(number, fault);
        }
    }

    fn heal(&mut self) {
        Self::heal(self);
    }
}

impl Host for UdpBus<ChaosLink> {
    fn fail(&mut self, _: FaultKind, _: u64, _: u64) {}

    fn heal(&mut self) {
        self.link().network.borrow_mut().faults.clear();
    }
}

/// A process's way to its board. After it was killed, nothing that its remains do gets there.
#[derive(Clone, Debug, Default)]
pub struct Life {
    dead: Rc<Cell<bool>>,
    /// The time that the remains see.
    ghost: Rc<Cell<u64>>,
}

impl Life {
    pub fn kill(&self, now: u64) {
        self.dead.set(true);
        self.ghost.set(now);
    }

    fn is_over(&self) -> bool {
        self.dead.get()
    }

    fn ghost_until(&self, until: u64) {
        self.ghost.set(self.ghost.get().max(until));
    }
}

/// An embedded bus.
#[derive(Debug)]
pub struct Direct {
    pub fpga: Rc<RefCell<SimFpga>>,
    pub life: Life,
}

impl RegisterBus for Direct {
    type Error = SimError;
    type List = AccessList;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), SimError> {
        if self.life.is_over() {
            return Err(SimError::Misaligned { address: 1 });
        }
        self.fpga.borrow_mut().exchange(accesses, words)
    }

    fn prepare(&mut self, accesses: &[Access], _: Option<Hold>) -> Result<AccessList, SimError> {
        Ok(AccessList::new(accesses))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, SimError> {
        self.exchange(list.accesses(), words)?;
        Ok(Reply::CERTAIN)
    }

    fn statistics(&self) -> BusStatistics {
        RegisterBus::statistics(&*self.fpga.borrow())
    }
}

impl Clock for Direct {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(if self.life.is_over() {
            self.life.ghost.get()
        } else {
            SimFpga::now(&self.fpga.borrow())
        })
    }

    fn wait(&mut self, duration: Duration) {
        if self.life.is_over() {
            let until = self.life.ghost.get() + duration.as_nanos() as u64;
            self.life.ghost_until(until);
        } else {
            self.fpga.borrow_mut().wait(duration);
        }
    }
}

/// A fault of the network while it lasts.
#[derive(Clone, Copy, Debug)]
pub struct Bad {
    pub kind: FaultKind,
    pub from: u64,
    pub until: u64,
    /// It strikes one packet of so many.
    pub one_in: u64,
    /// The longest delay.
    pub delay: u64,
}

type Packets = BTreeMap<(u64, u64), Vec<u8>>;

/// A simulated board behind a network on virtual time.
#[derive(Debug)]
pub struct Network {
    pub board: SimBoard<SimFpga>,
    pub faults: Vec<Bad>,
    /// When the whole board loses its configuration, and for how long.
    pub resets: Vec<(u64, u64)>,
    chance: Chance,
    now: u64,
    sent: u64,
    requests: Packets,
    replies: Packets,
    waiting: VecDeque<Vec<u8>>,
}

impl Network {
    pub fn new(board: SimBoard<SimFpga>, seed: u64) -> Self {
        Self {
            board,
            faults: Vec::new(),
            resets: Vec::new(),
            chance: Chance(seed),
            now: 0,
            sent: 0,
            requests: Packets::new(),
            replies: Packets::new(),
            waiting: VecDeque::new(),
        }
    }

    /// A new process has a new socket: what is on its way to the old one goes nowhere.
    pub fn new_socket(&mut self) {
        self.waiting.clear();
        self.replies.clear();
    }

    /// What becomes of a packet: the delays with which it arrives.
    fn fate(&mut self, to_board: bool) -> [Option<u64>; 2] {
        let now = self.now;
        let Self { faults, chance, .. } = self;
        let mut first = Some(WIRE);
        let mut second = None;
        for bad in faults
            .iter()
            .filter(|bad| (bad.from..bad.until).contains(&now))
        {
            if !chance.one_in(bad.one_in) {
                continue;
            }
            let delay = WIRE + chance.below(bad.delay.max(1));
            match bad.kind {
                FaultKind::NetworkLostRequest if to_board => first = None,
                FaultKind::NetworkLostReply if !to_board => first = None,
                FaultKind::NetworkDown => (first, second) = (None, None),
                FaultKind::NetworkLate => first = first.map(|_| delay),
                FaultKind::NetworkDuplicate => second = first.map(|_| delay),
                _ => {}
            }
        }
        [first, second]
    }

    /// Everything up to `until`; the packets that have arrived at the host wait there.
    pub fn run(&mut self, until: u64, stop_at_reply: bool) {
        loop {
            if stop_at_reply && !self.waiting.is_empty() {
                return;
            }
            let first =
                |packets: &Packets| packets.first_key_value().map_or(u64::MAX, |(k, _)| k.0);
            let reset = self
                .resets
                .iter()
                .map(|(at, _)| *at)
                .min()
                .unwrap_or(u64::MAX);
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
                let packet = self.replies.pop_first();
                self.waiting.extend(packet.map(|(_, bytes)| bytes));
            } else if let Some((_, packet)) = self.requests.pop_first() {
                let mut answer = Vec::new();
                let leaves = self.board.handle_packet(self.now, &packet, &mut answer);
                if let Some(at) = leaves {
                    for delay in self.fate(false).into_iter().flatten() {
                        self.sent += 1;
                        self.replies.insert((at + delay, self.sent), answer.clone());
                    }
                }
            }
        }
    }

    fn reset(&mut self, at: u64) {
        self.resets.retain(|(due, time)| {
            let is_due = *due == at;
            if is_due {
                self.board.advance_to(at);
                self.board.reset_for(*time);
            }
            !is_due
        });
    }
}

#[derive(Debug)]
pub struct ChaosLink {
    pub network: Rc<RefCell<Network>>,
    pub life: Life,
}

impl Link for ChaosLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        if self.life.is_over() {
            return Err(LinkError::Unreachable);
        }
        let mut network = self.network.borrow_mut();
        for delay in network.fate(true).into_iter().flatten() {
            network.sent += 1;
            let key = (network.now + delay, network.sent);
            network.requests.insert(key, packet.to_vec());
        }
        Ok(())
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        if self.life.is_over() {
            self.life.ghost_until(deadline.as_nanos());
            return Ok(None);
        }
        let mut network = self.network.borrow_mut();
        network.run(deadline.as_nanos(), true);
        let Some(packet) = network.waiting.pop_front() else {
            return Ok(None);
        };
        buffer[..packet.len()].copy_from_slice(&packet);
        Ok(Some(packet.len()))
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(if self.life.is_over() {
            self.life.ghost.get()
        } else {
            self.network.borrow().now
        })
    }

    fn sleep_until(&mut self, deadline: Instant) {
        if self.life.is_over() {
            self.life.ghost_until(deadline.as_nanos());
        } else {
            self.network.borrow_mut().run(deadline.as_nanos(), false);
        }
    }
}
