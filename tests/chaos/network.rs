//! The two buses from the host to the simulated board: embedded, and Ethernet. Both can be
//! abandoned by a process that was killed.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use mesa_hal::bus::{
    Access, BusError, BusErrorKind, BusStatistics, Clock, Instant, LinkError, RegisterBus,
};
use mesa_hal::transport::udp::{PacketLink, UdpBus};
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::{BoardConfig, FaultKind, SimBoard, SimFpga, Stepper, machines};

use super::machine::{CLOCK_LOW, nominal};
use super::plan::Stranger;
use crate::common::chance::Chance;
use crate::common::ethernet::{SimLink, WIRE, is_request};

/// The simulated board, which outlives every process that uses it.
#[derive(Clone, Debug)]
pub enum Sim {
    Embedded(Rc<RefCell<SimFpga>>),
    Network(Rc<RefCell<Network>>),
}

impl Sim {
    pub fn now(&self) -> u64 {
        match self {
            Self::Embedded(fpga) => SimFpga::now(&fpga.borrow()),
            Self::Network(network) => network.borrow().link.time(),
        }
    }

    /// True while the FPGA has no configuration.
    pub fn is_in_reset(&self) -> bool {
        match self {
            Self::Embedded(fpga) => fpga.borrow().is_in_reset(),
            Self::Network(network) => network.borrow().link.is_silent(),
        }
    }

    /// True while the board's first LED is lit.
    pub fn is_lit(&self) -> bool {
        match self {
            Self::Embedded(fpga) => fpga.borrow().leds().is_lit(0),
            Self::Network(network) => network.borrow().link.board.gateware().leds().is_lit(0),
        }
    }

    /// The stepper motors, and the time of their board: it is ahead of the network's while the
    /// board executes a packet.
    pub fn steppers(&self) -> (Vec<Stepper>, u64) {
        self.on(|fpga| {
            let axes = 0..fpga.axes();
            let motors = axes.filter_map(|axis| fpga.stepper(axis).copied());
            (motors.collect(), SimFpga::now(fpga))
        })
    }

    /// The result of `of` for the simulated FPGA.
    pub fn on<T>(&self, of: impl FnOnce(&mut SimFpga) -> T) -> T {
        match self {
            Self::Embedded(fpga) => of(&mut fpga.borrow_mut()),
            Self::Network(network) => of(network.borrow_mut().link.board.gateware_mut()),
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
                let link = &mut network.borrow_mut().link;
                let until = link.time() + time;
                link.run(until, false);
            }
        }
    }
}

impl Sim {
    /// Replaces the firmware, or the board by another one with the same firmware; with `own`,
    /// restores the machine's own.
    pub fn exchange(&self, stranger: Stranger, own: bool) {
        match (stranger, self) {
            (Stranger::Firmware, Self::Embedded(fpga)) => {
                other_firmware(&mut fpga.borrow_mut(), own);
            }
            (Stranger::Firmware, Self::Network(network)) => {
                let mut network = network.borrow_mut();
                other_firmware(network.link.board.gateware_mut(), own);
            }
            (Stranger::Board, Self::Network(network)) => network.borrow_mut().other_board(own),
            (Stranger::None, _) | (Stranger::Board, Self::Embedded(_)) => {}
        }
    }
}

/// The IDROM contains another clock frequency.
fn other_firmware(fpga: &mut SimFpga, own: bool) {
    let clock = nominal(fpga.firmware().clock_low);
    fpga.override_rom(CLOCK_LOW, if own { clock } else { clock / 2 });
    fpga.reload();
}

/// Control of the bus faults of a host.
pub trait Host: RegisterBus + Clock + Sized {
    /// Makes exchanges fail from now on, the first of them after `skip`.
    fn fail(&mut self, kind: FaultKind, skip: u64, count: u64);
    fn heal(&mut self);
}

impl Host for Faulty<Direct> {
    fn fail(&mut self, kind: FaultKind, skip: u64, count: u64) {
        let fault = match kind {
            FaultKind::BusNotExecuted => Fault::NotExecuted(BusErrorKind::Lost),
            FaultKind::BusNoReply => Fault::Executed(BusErrorKind::Late),
            _ => Fault::AckedButLost,
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
        self.link().network.borrow_mut().heal();
    }
}

/// The link of a process to its board. After the process was killed, nothing that its remains send
/// arrives.
#[derive(Clone, Debug, Default)]
pub struct Life {
    dead: Rc<Cell<bool>>,
    /// The time that the remains see.
    ghost: Rc<Cell<u64>>,
    /// Time for which the host stops in its next exchange, and true if before the board receives
    /// it.
    pause: Rc<Cell<(u64, bool)>>,
}

impl Life {
    pub fn kill(&self, now: u64) {
        self.dead.set(true);
        self.ghost.set(now);
    }

    /// Stops the host in the middle of its next exchange.
    pub fn pause(&self, time: u64, before: bool) {
        self.pause.set((time, before));
    }

    /// Time for which the host stops now, before the board receives the exchange or after.
    fn take_pause(&self, before: bool) -> u64 {
        match self.pause.get() {
            (time, is_before) if is_before == before => {
                self.pause.take();
                time
            }
            _ => 0,
        }
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
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        if self.life.is_over() {
            return Err(BusError::NotStarted);
        }
        let mut fpga = self.fpga.borrow_mut();
        let before = SimFpga::now(&fpga) + self.life.take_pause(true);
        fpga.advance_to(before);
        let done = fpga.exchange(accesses, words);
        let until = SimFpga::now(&fpga) + self.life.take_pause(false);
        fpga.advance_to(until);
        done
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

/// A fault of the network, with its time span.
#[derive(Clone, Copy, Debug)]
pub struct Bad {
    pub kind: FaultKind,
    pub from: u64,
    pub until: u64,
    /// Affects one packet of this number.
    pub one_in: u64,
    /// The longest delay.
    pub delay: u64,
}

/// A simulated board behind a network that has faults.
#[derive(Debug)]
pub struct Network {
    pub link: SimLink,
    weather: Rc<RefCell<Weather>>,
}

impl Network {
    pub fn new(board: SimBoard<SimFpga>, seed: u64) -> Self {
        let weather = Rc::new(RefCell::new(Weather {
            faults: Vec::new(),
            chance: Chance(seed),
        }));
        let mut link = SimLink::to(board);
        let way = |to_board| {
            let weather = Rc::clone(&weather);
            Box::new(move |now, _: &[u8]| weather.borrow_mut().fate(now, to_board))
        };
        (link.to_board, link.to_host) = (way(true), way(false));
        Self { link, weather }
    }

    pub fn add(&mut self, fault: Bad) {
        self.weather.borrow_mut().faults.push(fault);
    }

    /// Replaces the board by another one of the same kind, with the same firmware and the same
    /// remotes at its connectors; with `own`, restores the machine's own.
    fn other_board(&mut self, own: bool) {
        let board = &mut self.link.board;
        let mut config = BoardConfig::new("");
        config.clone_from(board.config());
        config.mac[5] = if own { 0x97 } else { 0x98 };
        let now = board.time();
        let nothing = SimFpga::new(machines::firmware_serial(&[1]));
        let fpga = std::mem::replace(board.gateware_mut(), nothing);
        *board = SimBoard::new(config, fpga);
        board.advance_to(now);
        board.reset_for(0);
    }

    pub fn heal(&mut self) {
        self.weather.borrow_mut().faults.clear();
    }
}

/// Effects of the network on packets.
#[derive(Debug)]
struct Weather {
    faults: Vec<Bad>,
    chance: Chance,
}

impl Weather {
    /// The fate of a packet: the delays with which it arrives.
    fn fate(&mut self, now: u64, to_board: bool) -> Vec<u64> {
        let Self { faults, chance } = self;
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
        first.into_iter().chain(second).collect()
    }
}

#[derive(Debug)]
pub struct ChaosLink {
    pub network: Rc<RefCell<Network>>,
    pub life: Life,
}

impl PacketLink for ChaosLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        if self.life.is_over() {
            return Err(LinkError::Unreachable);
        }
        let link = &mut self.network.borrow_mut().link;
        let until = link.time() + self.life.take_pause(true);
        link.run(until, false);
        let done = link.send(packet);
        // A read waits for its reply at this point.
        if !is_request(packet) {
            let until = link.time() + self.life.take_pause(false);
            link.run(until, false);
        }
        done
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
        let link = &mut self.network.borrow_mut().link;
        let until = link.time() + self.life.take_pause(false);
        link.run(until, false);
        link.receive(buffer, deadline)
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(if self.life.is_over() {
            self.life.ghost.get()
        } else {
            self.network.borrow().link.time()
        })
    }

    fn sleep_until(&mut self, deadline: Instant) {
        if self.life.is_over() {
            self.life.ghost_until(deadline.as_nanos());
        } else {
            self.network.borrow_mut().link.sleep_until(deadline);
        }
    }
}
