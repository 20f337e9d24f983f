//! A port whose COMMAND never becomes 0 is freed, and the command after that is not lost: for 0.2
//! us after COMMAND reads 0 one would be (FACTS 11.15). On PCI, the fastest bus that boards have,
//! and on a bus that takes no time.

use std::time::Duration;

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, World, fpga};
use mesa_hal::bus::{Access, BusError, Clock, Direction, Instant, RegisterBus};
use mesa_hal_sim::{BoardConfig, SimBoard, SimFpga, SimPciBus};

const COMMAND: u16 = 0x5B00;
/// Frees a port that is stuck.
const FREE: u32 = 0x08FF;
/// A word that COMMAND ignores.
const IGNORED: u32 = 1 << 31;
/// Least time between COMMAND = 0 and the next command, in nanoseconds.
const GAP: u64 = 500;

/// A bus that records the accesses to COMMAND, with their times in nanoseconds.
#[derive(Debug)]
struct Recorded<B> {
    inner: B,
    accesses: Vec<(u64, Direction, u32)>,
}

impl<B: RegisterBus + Clock> RegisterBus for Recorded<B> {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        for access in accesses {
            for (address, place) in (access.address..).step_by(4).zip(access.words()) {
                let single = Access::new(access.direction, address, place as u16, 1);
                self.inner.exchange(&[single], words)?;
                if address == COMMAND {
                    let at = self.inner.now().as_nanos();
                    self.accesses.push((at, access.direction, words[place]));
                }
            }
        }
        Ok(())
    }
}

impl<B: Clock> Clock for Recorded<B> {
    fn now(&mut self) -> Instant {
        self.inner.now()
    }

    fn wait(&mut self, duration: Duration) {
        self.inner.wait(duration);
    }
}

impl<B: World> World for Recorded<B> {
    fn fpga(&mut self) -> &mut SimFpga {
        self.inner.fpga()
    }
}

/// The shortest time from a COMMAND that reads 0 after it was freed to the next command, and the
/// number of times that it was freed.
fn shortest_gap(accesses: &[(u64, Direction, u32)]) -> (u64, usize) {
    let (mut shortest, mut freed, mut cleared) = (u64::MAX, 0, None);
    let mut is_freeing = false;
    for &(at, direction, word) in accesses {
        match (direction, word) {
            (Direction::Write, FREE) => (is_freeing, freed, cleared) = (true, freed + 1, None),
            (Direction::Read, 0) if is_freeing => cleared = cleared.or(Some(at)),
            (Direction::Write, word) if is_freeing && word & IGNORED == 0 => {
                let cleared = cleared.expect("nothing is written before it reads 0");
                shortest = shortest.min(at - cleared);
                is_freeing = false;
            }
            _ => {}
        }
    }
    (shortest, freed)
}

fn is_freed_in_time<B: World>(bus: impl Fn() -> B, is_stopped: bool) {
    // Phases of the port's firmware, which needs a few instructions for each step.
    for phase in (0..4_000).step_by(170) {
        let recorded = Recorded {
            inner: bus(),
            accesses: Vec::new(),
        };
        let mut machine: Machine<Recorded<B>> = Machine::on(recorded, |_| {});
        machine.cycles(20);
        machine.pass_nanos(phase);
        machine.driver.bus_mut().accesses.clear();
        machine.fpga().write_register(COMMAND, 0x3000);
        let told = format!("phase {phase} ns, stopped {is_stopped}");
        let accesses = if is_stopped {
            machine.cycles(1);
            let (bus, stopped) = machine.driver.shutdown();
            stopped.unwrap_or_else(|error| panic!("{told}: {error}"));
            bus.accesses
        } else {
            let all = [FIELD, ANALOG, OUTPUTS];
            let comes_back = |machine: &mut Machine<Recorded<B>>| {
                let statistics = machine.driver.ports()[0].statistics();
                statistics.stuck > 0 && all.iter().all(|&channel| machine.is_running(channel))
            };
            machine.until(2_000, comes_back);
            std::mem::take(&mut machine.driver.bus_mut().accesses)
        };
        let (gap, freed) = shortest_gap(&accesses);
        assert_eq!(freed, 1, "{told}");
        assert!(gap >= GAP, "{told}: {gap} ns");
    }
}

fn pci() -> SimPciBus {
    SimPciBus::new(SimBoard::new(BoardConfig::new("5I25"), fpga()))
}

fn in_no_time() -> SimFpga {
    let mut fpga = fpga();
    fpga.set_access_cost(1);
    fpga
}

#[test]
fn command_after_a_stuck_port_is_not_lost_on_pci() {
    is_freed_in_time(pci, false);
    is_freed_in_time(pci, true);
}

#[test]
fn command_after_a_stuck_port_is_not_lost_on_a_bus_without_time() {
    is_freed_in_time(in_no_time, false);
    is_freed_in_time(in_no_time, true);
}
