//! A simulated machine in this program: no socket, no thread, and a clock of its own.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use mesa_hal::bus::{
    Access, BusError, BusStatistics, Clock, Direction, HostClock, Instant, LinkError, RegisterBus,
};
use mesa_hal::transport::udp::PacketLink;
use mesa_hal_sim::wire::Nanos;
use mesa_hal_sim::{DEFAULT_ACCESS_COST, SimBoard, SimFpga};

/// Time of a packet on the wire, in each direction.
const WIRE: Nanos = 20_000;

/// Maximum lag of a paced machine that is made up for; what is more than that is dropped.
const MAX_LAG: Nanos = 50_000_000;

/// Longest pause of this program that passes for the machine as well, on the host's clock.
const PAUSE: Nanos = 20_000_000;

/// How the time of a simulated machine passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Passage {
    /// Virtual time: it passes with exchanges and waits only, and takes no longer than their
    /// computation.
    #[default]
    Virtual,
    /// Virtual time that does not run ahead of the host's clock, for a person who watches. On a
    /// busy host it lags, and no packet is late.
    Paced,
    /// The host's clock: the lateness of this program is real. Pauses of more than 20 ms are not
    /// the machine's, whose remotes would take them for a broken cable.
    Host,
}

/// A simulated machine. Clones are the same machine.
#[derive(Clone, Debug)]
pub struct Simulated(Arc<Mutex<World>>);

/// The board, and its time.
#[derive(Debug)]
struct World {
    board: SimBoard<SimFpga>,
    passage: Passage,
    /// The time of the host side. The board may be ahead, while it waits inside a packet.
    now: Nanos,
    host: HostClock,
    /// What the host's clock is ahead of a paced machine, and stays so.
    dropped: Nanos,
    /// What the time of the host side is ahead of the board's, and stays so.
    paused: Nanos,
}

impl Simulated {
    /// A machine after power-up, on virtual time.
    pub fn new(board: SimBoard<SimFpga>) -> Self {
        Self(Arc::new(Mutex::new(World {
            board,
            passage: Passage::default(),
            now: 0,
            host: HostClock::new(),
            dropped: 0,
            paused: 0,
        })))
    }

    /// Changes how its time passes from now on.
    pub fn set_passage(&self, passage: Passage) {
        let mut world = lock(&self.0);
        world.passage = passage;
        let host = world.host_time();
        world.now = world.now.max(host);
    }

    /// A new bus to it, as a board on the PCI bus.
    pub fn on_pci(&self) -> EmbeddedPci {
        EmbeddedPci {
            world: Arc::clone(&self.0),
            exchanges: 0,
        }
    }

    /// A new link to it.
    pub fn link(&self) -> SimulatedLink {
        SimulatedLink {
            world: Arc::clone(&self.0),
            replies: VecDeque::new(),
        }
    }
}

fn lock(world: &Mutex<World>) -> MutexGuard<'_, World> {
    // A world is whole between two calls.
    world.lock().unwrap_or_else(PoisonError::into_inner)
}

impl World {
    /// The host's clock, less what was dropped.
    fn host_time(&self) -> Nanos {
        let host = self.host.read().as_nanos();
        host.saturating_sub(self.dropped)
    }

    fn now(&mut self) -> Nanos {
        if self.passage == Passage::Host {
            let now = self.now.max(self.host_time());
            if now - self.now > PAUSE {
                self.paused += now - self.now;
            }
            self.now = now;
        }
        self.now
    }

    /// Makes an access on the PCI bus.
    fn access(&mut self, direction: Direction, address: u16, word: &mut u32) {
        let done = self.now() + DEFAULT_ACCESS_COST;
        self.wait_until(done, false);
        let now = self.now() - self.paused;
        self.board.advance_to(now);
        match direction {
            Direction::Read => *word = self.board.read_on_pci(address),
            Direction::Write => self.board.write_on_pci(address, *word),
        }
    }

    /// Returns when it is `until`; on the host's clock without using a CPU if `is_sleeping`.
    fn wait_until(&mut self, until: Nanos, is_sleeping: bool) {
        let from = self.now();
        let left = Duration::from_nanos(until.saturating_sub(from));
        match self.passage {
            Passage::Virtual => {}
            Passage::Paced => self.pace(until),
            Passage::Host if is_sleeping => std::thread::sleep(left),
            Passage::Host => self.host.wait(left),
        }
        self.now = from.max(until);
    }

    /// Waits until the host's clock has reached `until`.
    fn pace(&mut self, until: Nanos) {
        let host = self.host_time();
        if host < until {
            std::thread::sleep(Duration::from_nanos(until - host));
        } else if host - until > MAX_LAG {
            self.dropped += host - until;
        }
    }
}

/// A link to a [`Simulated`] machine. Every packet arrives once, after 20 us.
#[derive(Debug)]
pub struct SimulatedLink {
    world: Arc<Mutex<World>>,
    /// When each reply arrives, and its bytes. The board executes one packet after the other.
    replies: VecDeque<(Nanos, Vec<u8>)>,
}

impl PacketLink for SimulatedLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let mut world = lock(&self.world);
        let arrives = world.now() - world.paused + WIRE;
        let mut reply = Vec::new();
        if let Some(leaves) = world.board.handle_packet(arrives, packet, &mut reply) {
            let arrives = leaves + WIRE + world.paused;
            self.replies.push_back((arrives, reply));
        }
        Ok(())
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        let mut world = lock(&self.world);
        let deadline = deadline.as_nanos();
        let next = self.replies.front();
        let arrives = next.map_or(Nanos::MAX, |(arrives, _)| *arrives);
        world.wait_until(arrives.min(deadline), false);
        if arrives > world.now() {
            return Ok(None);
        }
        Ok(self.replies.pop_front().map(|(_, reply)| {
            let taken = buffer.iter_mut().zip(&reply);
            taken.map(|(to, from)| *to = *from).count()
        }))
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(lock(&self.world).now())
    }

    fn sleep_until(&mut self, deadline: Instant) {
        lock(&self.world).wait_until(deadline.as_nanos(), false);
    }

    fn sleep(&mut self, duration: Duration) {
        let mut world = lock(&self.world);
        let until = Instant::from_nanos(world.now()).after(duration);
        world.wait_until(until.as_nanos(), true);
    }
}

/// The registers of a [`Simulated`] machine on the PCI bus: no packets, and 600 ns for an access.
#[derive(Debug)]
pub struct EmbeddedPci {
    world: Arc<Mutex<World>>,
    exchanges: u64,
}

impl RegisterBus for EmbeddedPci {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        accesses
            .iter()
            .try_for_each(|access| access.check(words.len()))?;
        self.exchanges += 1;
        let mut world = lock(&self.world);
        for access in accesses {
            let targets = words.get_mut(access.words()).unwrap_or_default();
            for (word, address) in targets.iter_mut().zip((access.address..).step_by(4)) {
                world.access(access.direction, address, word);
            }
        }
        Ok(())
    }

    fn statistics(&self) -> BusStatistics {
        BusStatistics::of_exchanges(self.exchanges)
    }
}

impl Clock for EmbeddedPci {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(lock(&self.world).now())
    }

    fn wait(&mut self, duration: Duration) {
        let mut world = lock(&self.world);
        let until = Instant::from_nanos(world.now()).after(duration);
        world.wait_until(until.as_nanos(), false);
    }

    fn sleep(&mut self, duration: Duration) {
        let mut world = lock(&self.world);
        let until = Instant::from_nanos(world.now()).after(duration);
        world.wait_until(until.as_nanos(), true);
    }
}

#[cfg(test)]
mod tests;
