//! The set-up of a board, ready to be written within the cycle: all of it, in one exchange, or
//! nothing that enables what another part protects.
//!
//! What drives a pin is its direction, or its open-drain bit (FACTS 12.2). They protect all the
//! rest: while they are 0, every other setting can be written alone, late or twice, and nothing is
//! driven. They are written in two ways only: with the whole set-up, or, where the application
//! changes them, with all that belongs to their port and between two looks at the evidence.

use alloc::vec::Vec;

use super::SetupList;
use super::evidence::Evidence;
use crate::bus::{Access, RegisterBus, Reply};
use crate::hostmot2::{IoPorts, PortSetup, Watchdog, WatchdogTime};

/// The set-up of a board.
#[derive(Debug)]
pub(super) struct SetUp {
    whole: Words,
    /// How many words of it are read.
    reads: usize,
    quiesce: Words,
    gates: Vec<Gate>,
}

/// Its lists, as the bus runs them.
#[derive(Debug)]
pub(super) struct SetUpLists<L> {
    whole: L,
    quiesce: L,
    gates: Vec<L>,
}

/// After so many reads no older write is under way any more.
const HORIZON: u8 = 100;

/// A list with its words.
#[derive(Debug)]
struct Words {
    accesses: Vec<Access>,
    words: Vec<u32>,
}

/// What drives the pins of a port.
#[derive(Debug)]
struct Gate {
    list: Words,
    addresses: [u16; 2],
    /// As they are in the board; `None` if that is not certain.
    current: Option<[u32; 2]>,
    /// So many reads more an older change may come late.
    unsettled: u8,
    wanted: PortSetup,
}

impl SetUp {
    /// Prepares `list`, which was written to the board just now, to be written again.
    pub fn prepare<B: RegisterBus>(
        bus: &mut B,
        list: &SetupList,
        evidence: &Evidence,
        places: &IoPorts,
        watchdog: &Watchdog,
        ports: &[PortSetup],
    ) -> Result<(Self, SetUpLists<B::List>), B::Error> {
        let mut list = list.clone();
        // If the board was reset in the middle of it, the time is lost again, and the watchdog bites.
        list.push(watchdog.reset, Watchdog::PET);
        let mut whole = list.to_words(evidence.registers());
        // Not the time of the cycle: see the module `evidence`.
        whole.change(watchdog.time, WatchdogTime::LONGEST.0);
        let mut quiesce = SetupList::default();
        places.make_inputs(&mut quiesce);
        let gates = (0u8..).zip(ports).filter_map(|(port, setup)| {
            let addresses = [
                places.direction.address(port)?,
                places.open_drain.address(port)?,
            ];
            let mut list = SetupList::default();
            places.route(&mut list, port, setup);
            places.drive(&mut list, port, setup);
            list.push(watchdog.reset, Watchdog::PET);
            Some((list, addresses, setup))
        });
        let gates = gates.map(|(list, addresses, setup)| Gate {
            list: list.to_words([].into_iter()),
            addresses,
            current: Some([setup.direction, setup.open_drain]),
            unsettled: 0,
            wanted: *setup,
        });
        let this = Self {
            reads: evidence.registers().count(),
            quiesce: quiesce.to_words([].into_iter()),
            whole,
            gates: gates.collect(),
        };
        let mut prepare = |list: &Words| bus.prepare(&list.accesses, None);
        let lists = SetUpLists {
            whole: prepare(&this.whole)?,
            quiesce: prepare(&this.quiesce)?,
            gates: this
                .gates
                .iter()
                .map(|gate| prepare(&gate.list))
                .collect::<Result<_, _>>()?,
        };
        Ok((this, lists))
    }

    /// Takes over a setting that was changed since: the last write of its register. Those before
    /// it, which keep the board safe on the way, stay.
    ///
    /// # Real time
    /// Grows with the number of writes; no allocation.
    pub fn change(&mut self, address: u16, word: u32) {
        self.whole.change(address, word);
    }

    /// What a port is to be: takes effect with [`open_gates`](Self::open_gates) if a pin is to be
    /// driven that was not, or the other way round.
    pub fn want(&mut self, port: usize, setup: PortSetup) {
        let Some(gate) = self.gates.get_mut(port) else {
            return;
        };
        let before = core::mem::replace(&mut gate.wanted, setup);
        if before.direction == setup.direction && before.open_drain == setup.open_drain {
            return;
        }
        let [direction, open_drain] = gate.addresses;
        self.whole.change(direction, setup.direction);
        self.whole.change(open_drain, setup.open_drain);
    }

    /// The directions of all ports, as the application wants them.
    pub fn directions(&self) -> impl Iterator<Item = u32> + '_ {
        self.gates.iter().map(|gate| gate.wanted.direction)
    }

    /// Writes all of it; what the evidence is then.
    ///
    /// # Real time
    /// One exchange. No allocation.
    pub fn run<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        lists: &SetUpLists<B::List>,
    ) -> Result<(Reply, &[u32]), B::Error> {
        let reply = bus.run(&lists.whole, &mut self.whole.words)?;
        for gate in &mut self.gates {
            gate.current = Some(gate.wanted_words());
        }
        let writes = self.whole.words.len().saturating_sub(self.reads);
        Ok((reply, self.whole.words.get(writes..).unwrap_or_default()))
    }

    /// Makes all pins inputs.
    ///
    /// # Real time
    /// One exchange. No allocation.
    pub fn quiesce<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        lists: &SetUpLists<B::List>,
    ) -> Result<(), B::Error> {
        bus.run(&lists.quiesce, &mut self.quiesce.words).map(|_| ())
    }

    /// The first port whose pins are to be driven otherwise than they are for certain, with the
    /// outputs that it has before and after, and those after.
    pub fn changed(&self) -> Option<(usize, u32, u32)> {
        let changed = |gate: &Gate| gate.current != Some(gate.wanted_words());
        let port = self.gates.iter().position(changed)?;
        let gate = self.gates.get(port)?;
        let after = gate.wanted.direction;
        let before = gate.current.map_or(0, |[direction, _]| direction);
        Some((port, before & after, after))
    }

    /// Writes what drives the pins of a port, after all that belongs to them. `feed`: the watchdog
    /// is restarted at once, which bites on a board that was reset.
    ///
    /// # Real time
    /// One exchange. No allocation.
    pub fn open_gate<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        lists: &SetUpLists<B::List>,
        port: usize,
        feed: bool,
    ) -> Result<(), B::Error> {
        let (Some(gate), Some(list)) = (self.gates.get_mut(port), lists.gates.get(port)) else {
            return Ok(());
        };
        let PortSetup {
            data,
            direction,
            alternate_source,
            open_drain,
            invert,
        } = gate.wanted;
        let words = [data, invert, alternate_source, direction, open_drain];
        gate.unsettled = HORIZON;
        let pet = if feed { Watchdog::PET } else { 0 };
        let words = words.into_iter().chain([pet]);
        for (place, word) in gate.list.words.iter_mut().zip(words) {
            *place = word;
        }
        bus.run(list, &mut gate.list.words).map(|_| ())
    }

    /// The port's pins are driven as wanted.
    pub fn gate_is_open(&mut self, port: usize) {
        if let Some(gate) = self.gates.get_mut(port) {
            gate.current = Some(gate.wanted_words());
        }
    }

    /// The board was heard: whether it is certain that no older write was executed. If not, what
    /// was changed lately is written again.
    pub fn confirm(&mut self, is_certain: bool) {
        for gate in &mut self.gates {
            if gate.unsettled > 0 && !is_certain {
                gate.current = None;
            }
            gate.unsettled = gate.unsettled.saturating_sub(1);
        }
    }
}

impl Gate {
    fn wanted_words(&self) -> [u32; 2] {
        [self.wanted.direction, self.wanted.open_drain]
    }
}

impl Words {
    fn change(&mut self, address: u16, word: u32) {
        let place = self.accesses.iter().rposition(|access| {
            access.address == address && access.direction == crate::bus::Direction::Write
        });
        if let Some(old) = place.and_then(|place| self.words.get_mut(place)) {
            *old = word;
        }
    }
}

impl SetupList {
    /// One exchange with all writes in order, and reads of `registers` after them.
    fn to_words(&self, registers: impl Iterator<Item = u16>) -> Words {
        let (mut accesses, mut words) = self.to_accesses();
        for address in registers {
            accesses.push(Access::read(address, words.len() as u16, 1));
            words.push(0);
        }
        Words { accesses, words }
    }
}
