//! Machines for the benches, and a bus without cost.

#![allow(
    clippy::missing_panics_doc,
    reason = "a bench ends where its machine cannot be made"
)]

use std::time::Duration;

use mesa_hal::Settings;
use mesa_hal::bus::{
    Access, AccessList, BusError, Clock, Direction, Hold, Instant, ListForm, RegisterBus, Reply,
};
use mesa_hal::driver::Driver;
use mesa_hal_sim::devices::FieldIo;
use mesa_hal_sim::wire::{Burst, Nanos, RemoteEnd};
use mesa_hal_sim::{SimFpga, SimPinDescriptor, gtag, machines};

/// A 7I92 with a 7I77 and a 7I72.
pub fn three_remotes() -> SimFpga {
    machines::i7i92_with_cards()
}

/// Ports of eight channels with this many field I/O cards.
pub fn field_cards(count: usize) -> SimFpga {
    let ports = vec![8u8; count.div_ceil(8)];
    let mut fpga = SimFpga::new(machines::firmware_serial(&ports));
    for n in 0..count {
        let card = Probe {
            remote: Box::new(FieldIo::i7i77().expect("7I77")),
            frame: 0,
        };
        fpga.plug(n / 8, n % 8, Some(Box::new(card)));
    }
    fpga
}

/// Firmware of a 7I92 with a 7I76 on each of its connectors, or on the first only: five step
/// generators for each, and no remotes.
pub fn step_generators(cards: u8) -> SimFpga {
    let mut firmware = machines::firmware_7i92_7i76();
    let first = firmware.pins.iter().take(10).copied();
    let second: Vec<_> = first
        .map(|pin| SimPinDescriptor {
            unit: pin.unit + 5,
            ..pin
        })
        .collect();
    let more = second.into_iter().take(10 * usize::from(cards - 1));
    let connector = firmware.pins.iter_mut().skip(17);
    connector.zip(more).for_each(|(pin, more)| *pin = more);
    let module = firmware.module_mut(gtag::STEPGEN);
    module.expect("step generators").instances = 5 * cards;
    SimFpga::new(firmware)
}

/// Wraps a remote, and records the start of the last frame to it.
#[derive(Debug)]
struct Probe {
    remote: Box<dyn RemoteEnd>,
    frame: Nanos,
}

impl RemoteEnd for Probe {
    fn advance(&mut self, now: Nanos) {
        self.remote.advance(now);
    }

    fn receive(&mut self, burst: &Burst) {
        self.frame = burst.start;
        self.remote.receive(burst);
    }

    fn transmit(&mut self) -> Option<Burst> {
        self.remote.transmit()
    }

    fn inner(&self) -> Option<&dyn RemoteEnd> {
        Some(&*self.remote)
    }

    fn inner_mut(&mut self) -> Option<&mut dyn RemoteEnd> {
        Some(&mut *self.remote)
    }
}

/// Delay of the gateware from the write of DOIT to the first bit of the frame to each of this
/// number of field I/O cards: the earliest and the latest, in nanoseconds of virtual time.
pub fn from_doit_to_frames(count: usize) -> (Nanos, Nanos) {
    let mut driver =
        Driver::start(field_cards(count), Settings::default()).expect("the machine is complete");
    let mut written = 0;
    for _ in 0..5 {
        let _ = driver.read().expect("read");
        driver.write().expect("write");
        written = driver.bus().now();
        driver.bus_mut().wait(Duration::from_millis(1));
    }
    let frames = (0..count).map(|n| {
        let probe = driver.bus_mut().device::<Probe>(n / 8, n % 8);
        probe.expect("it is plugged in").frame - written
    });
    let frames: Vec<Nanos> = frames.collect();
    let first = frames.iter().min().copied().unwrap_or_default();
    (first, frames.into_iter().max().unwrap_or_default())
}

/// A simulated board that, once frozen, answers every read with its last answer, which leaves the
/// cost of the driver.
#[derive(Debug)]
pub struct Frozen {
    sim: SimFpga,
    answers: Vec<Vec<u32>>,
    /// Addresses of the words of the answers.
    addresses: Vec<Vec<u16>>,
    stands_still: bool,
    /// Time since it was frozen, in nanoseconds: half a period for each exchange.
    passed: u64,
    /// The words of the last write, if they are to be kept.
    pub written: Option<Vec<u32>>,
}

impl Frozen {
    /// A bus to this board.
    pub fn new(sim: SimFpga) -> Self {
        Self {
            sim,
            answers: Vec::new(),
            addresses: Vec::new(),
            stands_still: false,
            passed: 0,
            written: None,
        }
    }

    /// Changes what a register answers from now on.
    pub fn set_answer(&mut self, register: u16, word: u32) {
        for (answer, addresses) in self.answers.iter_mut().zip(&self.addresses) {
            let words = answer.iter_mut().zip(addresses);
            words
                .filter(|(_, address)| **address == register)
                .for_each(|(answer, _)| *answer = word);
        }
    }
}

impl RegisterBus for Frozen {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.sim.exchange(accesses, words)
    }

    fn prepare(&mut self, accesses: &[Access], _: Option<Hold>) -> Result<AccessList, BusError> {
        self.answers.push(Vec::new());
        let addresses = accesses.iter().flat_map(|access| {
            let words = access.words().len();
            (access.address..).step_by(4).take(words)
        });
        self.addresses.push(addresses.collect());
        Ok(AccessList::encoded(Answers {
            accesses: accesses.into(),
            place: self.answers.len() - 1,
        }))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        let list: &Answers = list.form().expect("a list of this bus");
        let reads = list
            .accesses
            .first()
            .is_some_and(|access| access.direction == Direction::Read);
        if !self.stands_still {
            self.sim.exchange(&list.accesses, words)?;
            if reads {
                self.answers[list.place] = words.to_vec();
            }
            return Ok(Reply::CERTAIN);
        }
        self.passed += 500_000;
        if reads {
            let answers = &self.answers[list.place];
            for access in &list.accesses {
                let place = access.words();
                // A list of the shutdown has no answer yet.
                if let Some(answer) = answers.get(place.clone()) {
                    words[place].copy_from_slice(answer);
                }
            }
        } else if let Some(written) = &mut self.written {
            written.clear();
            let accesses = list.accesses.iter();
            written.extend(accesses.flat_map(|access| &words[access.words()]));
        }
        Ok(Reply::CERTAIN)
    }
}

/// A list, and the place of its answer.
#[derive(Debug)]
pub struct Answers {
    accesses: Box<[Access]>,
    place: usize,
}

impl ListForm for Answers {
    fn accesses(&self) -> &[Access] {
        &self.accesses
    }
}

impl Clock for Frozen {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.sim.now() + self.passed)
    }

    fn wait(&mut self, duration: Duration) {
        if !self.stands_still {
            self.sim.wait(duration);
        }
    }
}

/// A driver of field I/O cards in the middle of its cycles, whose bus no longer has a cost.
pub fn frozen_driver(count: usize) -> Driver<Frozen> {
    frozen(field_cards(count), count)
}

/// Number of cycles after which all writes of the start are done: during the first ones the phase
/// of the DPLL is set.
const SETTLED: usize = 300;

/// A driver of a board with `count` remotes in the middle of its cycles, whose bus no longer has a
/// cost.
pub fn frozen(board: SimFpga, count: usize) -> Driver<Frozen> {
    frozen_with(board, count, Settings::default())
}

/// The same with settings.
pub fn frozen_with(board: SimFpga, count: usize, settings: Settings) -> Driver<Frozen> {
    let bus = Frozen::new(board);
    let mut driver = Driver::start(bus, settings).expect("the machine is complete");
    for _ in 0..SETTLED {
        let _ = driver.read().expect("read");
        driver.write().expect("write");
        driver.bus_mut().wait(Duration::from_millis(1));
    }
    let report = driver.read().expect("read");
    assert_eq!(report.good as usize, count, "{report:?}");
    driver.write().expect("write");
    driver.bus_mut().stands_still = true;
    driver
}

/// Number of registers of process data that a cycle transfers.
pub fn process_data_words<B: RegisterBus + Clock>(driver: &Driver<B>) -> usize {
    let remotes = driver
        .ports()
        .iter()
        .flat_map(mesa_hal::driver::SerialPort::remotes);
    remotes
        .map(|remote| {
            let bytes = [remote.started.input_bytes(), remote.started.sizes.tx];
            let words = bytes.map(|bytes| usize::from(bytes.div_ceil(4)));
            words.iter().sum::<usize>()
        })
        .sum()
}
