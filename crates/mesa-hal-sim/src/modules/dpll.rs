//! HM2DPLL: a timer that follows the host's cycle.

mod phase_loop;

use mesa_wire::bus::Direction;

use super::{Configuration, Settles, SimModule};
use crate::fpga::Fabric;
use crate::wire::Nanos;
use phase_loop::{DDS_SIZE, PhaseLoop};

const BASE_RATE: u8 = 0;
const PHASE: u8 = 1;
const CONTROL_0: u8 = 2;
const CONTROL_1: u8 = 3;
const TIMERS_12: u8 = 4;
const TIMERS_34: u8 = 5;
const SYNC: u8 = 6;

const SECOND: u128 = 1_000_000_000;

/// The DPLL. FACTS 12.4, 13.8.
///
/// A phase accumulator turns once per period. Each access to the sync register marks the host's
/// cycle and latches the phase: the phase error, positive if the host is late. From then on a part
/// of the error is subtracted from the rate, through a limit, a filter and an integrator.
///
/// The reference rises at phase 0. A timer adds its register to the phase, in 1/65536 of a period,
/// so that it rises by that time **before** the reference.
///
/// The simulation is exact to the clock, and its cost is proportional to the steps of its filter
/// rather than to clocks.
#[derive(Clone, Copy, Debug)]
pub struct SimDpll {
    clock: u32,
    phase_loop: PhaseLoop,
}

impl SimModule for SimDpll {
    fn read(&mut self, fabric: &Fabric, register: u8, _: u8) -> u32 {
        let now = fabric.now();
        self.phase_loop.run_to(self.next_clock(now));
        let registers = &self.phase_loop;
        match register {
            BASE_RATE => registers.base_rate,
            PHASE => registers.phase(),
            CONTROL_0 => registers.control_0(),
            CONTROL_1 => u32::from(registers.filter_prescale) << 16 | DDS_SIZE,
            TIMERS_12 => pair(registers.timers, 0),
            TIMERS_34 => pair(registers.timers, 2),
            SYNC => {
                let phase = registers.phase();
                self.sync(now);
                phase
            }
            _ => 0,
        }
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, _: u8, value: u32) {
        let now = fabric.now();
        if register == SYNC {
            return self.sync(now);
        }
        self.clock_edge(now);
        let registers = &mut self.phase_loop;
        let [one, two, three, four] = &mut registers.timers;
        let (low, high) = (value as u16, (value >> 16) as u16);
        match register {
            BASE_RATE => registers.base_rate = value,
            PHASE => registers.set_phase(value),
            CONTROL_0 => registers.set_control_0(value),
            CONTROL_1 => registers.filter_prescale = high,
            TIMERS_12 => (*one, *two) = (low, high),
            TIMERS_34 => (*three, *four) = (low, high),
            _ => {}
        }
    }

    fn reload(&mut self, configuration: &Configuration<'_>) {
        *self = Self::new(configuration);
    }

    /// Edges of its timers before an access latch other modules by its registers of before.
    fn settles(&self, _: Direction) -> Settles {
        Settles::World
    }
}

impl SimDpll {
    pub(super) fn new(configuration: &Configuration<'_>) -> Self {
        Self {
            clock: configuration.clock(),
            phase_loop: PhaseLoop::default(),
        }
    }

    /// The period in nanoseconds that the base rate and the prescale give, if the DPLL runs. The
    /// correction of the loop makes it shorter or longer.
    pub fn period(&self) -> Option<f64> {
        let (base_rate, prescale) = (self.phase_loop.base_rate, self.phase_loop.clocks_per_step());
        let rate = f64::from(base_rate) * f64::from(self.clock);
        let span = libm::ldexp(prescale as f64, DDS_SIZE as i32);
        (base_rate != 0).then(|| span / rate * 1e9)
    }

    /// The next rising edge after `now` of the reference (0) or of a timer (1 to 4), if the DPLL
    /// runs and its registers stay unchanged.
    pub fn next_edge(&self, now: Nanos, timer: u8) -> Option<Nanos> {
        let (at, rises) = self.next_change(now, timer)?;
        if rises {
            return Some(at);
        }
        let (at, rises) = self.next_change(at, timer)?;
        rises.then_some(at)
    }

    /// Time after `now` at which the reference (0) or a timer (1 to 4) next changes; the flag is
    /// true if it rises then.
    pub fn next_change(&self, now: Nanos, timer: u8) -> Option<(Nanos, bool)> {
        let mut ahead = self.phase_loop;
        ahead.run_to(self.clocks_passed(now));
        let (clock, rises) = ahead.next_change(timer)?;
        Some((self.time_of(clock), rises))
    }

    /// The level of the reference (0) or of a timer (1 to 4) at `now`.
    pub fn level(&self, now: Nanos, timer: u8) -> Option<bool> {
        let mut ahead = self.phase_loop;
        ahead.run_to(self.clocks_passed(now));
        ahead.level(timer)
    }

    fn sync(&mut self, now: Nanos) {
        self.phase_loop.run_to(self.next_clock(now));
        let phase = self.phase_loop.phase();
        self.clock_edge(now);
        self.phase_loop.phase_error = phase as i32;
    }

    /// Advances past the clock edge after `now`, at which a write shows.
    fn clock_edge(&mut self, now: Nanos) {
        self.phase_loop.run_to(self.next_clock(now) + 1);
    }

    /// The number of the first clock edge that is not before `now`.
    fn next_clock(&self, now: Nanos) -> u64 {
        let clocks = u128::from(now) * u128::from(self.clock);
        clocks.div_ceil(SECOND) as u64
    }

    /// Number of clock edges up to `now`, the one at 0 included.
    fn clocks_passed(&self, now: Nanos) -> u64 {
        (u128::from(now) * u128::from(self.clock) / SECOND) as u64 + 1
    }

    /// Time of the clock edge with this number.
    fn time_of(&self, clock: u64) -> Nanos {
        (u128::from(clock) * SECOND).div_ceil(u128::from(self.clock)) as Nanos
    }
}

/// The register that holds the timer `first` and the one after it.
fn pair(timers: [u16; 4], first: usize) -> u32 {
    let word = |timer: usize| timers.get(timer).copied().map_or(0, u32::from);
    word(first + 1) << 16 | word(first)
}
