//! The order in which registers of step generators are written, looked at in every exchange: at the
//! start, in a re-arm, and while the machine runs.

use std::time::Duration;

use mesa_hal::bus::{Access, BusError, Clock, Direction, Instant, RegisterBus};
use mesa_hal::driver::BoardState;
use mesa_hal_sim::{SimFpga, gtag};

use super::{Machine, PERIOD, board, machine_on};
use crate::common::machine::World;

const GENERATORS: usize = 5;
const RATE: u16 = 0x2000;
const STEP_LENGTH: u16 = 0x2500;
const MASTER: u16 = 0x2900;
const DATA_DIRECTION: u16 = 0x1100;
const SOURCE: u16 = 0x1200;
/// Steps per second of the rates that others write: 1,000.
const OLD_RATE: u32 = 42_950;

/// The board, and what was written to it.
#[derive(Debug)]
struct Listened {
    fpga: SimFpga,
    /// Ports and bits of the pins of each generator.
    pins: [[(u16, u32); 2]; GENERATORS],
    rates: [u32; GENERATORS],
    lengths: [u32; GENERATORS],
    master: u32,
    directions: [u32; 4],
    sources: [u32; 4],
    /// Exchanges that were looked at, and outputs of generators that were switched on in them.
    exchanges: u32,
    switched_on: u32,
    wrongs: Vec<String>,
}

impl Listened {
    fn new(fpga: SimFpga) -> Self {
        let firmware = fpga.firmware();
        let width = firmware.port_width as usize;
        let pins = std::array::from_fn(|unit| {
            [0x81, 0x82].map(|pin| {
                let pin = firmware.pin(gtag::STEPGEN, unit as u8, pin);
                let pin = pin.expect("an output");
                ((pin / width) as u16, 1 << (pin % width))
            })
        });
        Self {
            fpga,
            pins,
            rates: [0; GENERATORS],
            lengths: [0; GENERATORS],
            master: 0,
            directions: [0; 4],
            sources: [0; 4],
            exchanges: 0,
            switched_on: 0,
            wrongs: Vec::new(),
        }
    }

    /// Writes a register as the driver or somebody else.
    fn write(&mut self, address: u16, word: u32) {
        self.fpga.write_register(address, word);
        self.note(address, word);
    }

    /// A reset clears everything.
    fn reload(&mut self) {
        self.fpga.reload();
        (self.rates, self.lengths) = ([0; GENERATORS], [0; GENERATORS]);
        (self.master, self.directions, self.sources) = (0, [0; 4], [0; 4]);
    }

    fn is_output(&self, generator: usize) -> bool {
        let is_on = |&(port, bit): &(u16, u32)| {
            let port = usize::from(port);
            self.directions[port] & self.sources[port] & bit != 0
        };
        self.pins[generator].iter().any(is_on)
    }

    /// Follows a register; call it for each word in the order of the writes.
    fn note(&mut self, address: u16, word: u32) {
        let were_outputs: [bool; GENERATORS] = std::array::from_fn(|n| self.is_output(n));
        let place = usize::from(address & 0xFF) / 4;
        match address & 0xFF00 {
            RATE => set(&mut self.rates, place, word),
            STEP_LENGTH => set(&mut self.lengths, place, word & 0x3FFF),
            MASTER => self.master = word,
            DATA_DIRECTION => set(&mut self.directions, place, word),
            SOURCE => set(&mut self.sources, place, word),
            _ => return,
        }
        for (n, was_output) in were_outputs.into_iter().enumerate() {
            let told = format!("generator {n}, {word:#X} to {address:#06X}");
            let may_move = self.master != 0 || self.rates[n] != 0;
            if self.lengths[n] == 0 && may_move {
                self.wrongs.push(format!("{told}: a pulse would not end"));
            }
            if self.is_output(n) && !was_output {
                self.switched_on += 1;
                if self.rates[n] != 0 {
                    self.wrongs.push(format!("{told}: it is driven and moves"));
                }
            }
        }
    }
}

fn set(words: &mut [u32], place: usize, word: u32) {
    if let Some(old) = words.get_mut(place) {
        *old = word;
    }
}

impl RegisterBus for Listened {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.exchanges += 1;
        self.fpga.exchange(accesses, words)?;
        for access in accesses {
            if access.direction == Direction::Write {
                for (address, word) in (access.address..).step_by(4).zip(&words[access.words()]) {
                    self.note(address, *word);
                }
            }
        }
        Ok(())
    }
}

impl Clock for Listened {
    fn now(&mut self) -> Instant {
        Clock::now(&mut self.fpga)
    }

    fn wait(&mut self, duration: Duration) {
        self.fpga.wait(duration);
    }
}

impl World for Listened {
    fn fpga(&mut self) -> &mut SimFpga {
        &mut self.fpga
    }
}

#[track_caller]
fn assert_right(machine: &mut Machine<Listened>) {
    assert_eq!(machine.driver.bus_mut().wrongs, [""; 0]);
}

fn moved(machine: &mut Machine<Listened>, target: f64) {
    machine.driver.pins_mut().set(machine.pins.enable, true);
    for _ in 0..1_000 {
        machine.cycle(target);
    }
    assert!((machine.position() - target).abs() < 1e-4);
    assert_right(machine);
}

/// Also on a board that another program has left running.
#[test]
fn pulse_length_is_set_whenever_generators_run_during_start() {
    for is_left_running in [false, true] {
        let (fpga, axis) = board();
        let mut bus = Listened::new(fpga);
        if is_left_running {
            for (address, n) in (0..).step_by(4).zip(0..GENERATORS) {
                bus.write(STEP_LENGTH + address, 100 + n as u32);
                bus.write(RATE + address, OLD_RATE);
            }
            bus.write(MASTER, u32::MAX);
        }
        let mut machine = machine_on(bus, axis);
        assert_right(&mut machine);
        let bus = machine.driver.bus_mut();
        assert_eq!(
            (bus.master, bus.switched_on as usize),
            (u32::MAX, GENERATORS)
        );
        assert!(bus.exchanges > 5, "{}", bus.exchanges);
        assert_eq!(machine.motor().commanded(), 0, "{is_left_running}");
        moved(&mut machine, 1.0);
    }
}

#[test]
fn changed_pulse_length_is_never_0_while_generators_run() {
    let (fpga, axis) = board();
    let mut machine = machine_on(Listened::new(fpga), axis);
    for (target, length) in [(0.5, 0), (-0.5, 1), (0.3, 50_000), (-0.3, u32::MAX)] {
        let pins = machine.pins;
        let set = machine.driver.pins_mut().set_param(pins.steplen, length);
        set.expect("a time");
        moved(&mut machine, target);
    }
}

/// A packet of before the bite is executed after the rate was made 0, and before the re-arm.
#[test]
fn late_rate_is_0_before_any_generator_pin_is_driven_on_rearm() {
    for is_reset in [false, true] {
        for generator in 0..GENERATORS {
            let (fpga, axis) = board();
            let mut machine = machine_on(Listened::new(fpga), axis);
            for _ in 0..40 {
                machine.cycle(100.0);
            }
            assert!(machine.motor().velocity() > 0.5);
            if is_reset {
                machine.driver.bus_mut().reload();
            } else {
                machine.driver.bus_mut().wait(PERIOD * 40);
            }
            let before = machine.motor().commanded();
            for _ in 0..5 {
                assert_ne!(machine.cycle(100.0), BoardState::Running);
            }
            let bus = machine.driver.bus_mut();
            assert_eq!(bus.rates, [0; GENERATORS]);
            if is_reset {
                // What a late set-up would leave: else a pulse has no length.
                for place in 0..GENERATORS {
                    bus.write(STEP_LENGTH + 4 * place as u16, 250);
                }
                bus.write(MASTER, u32::MAX);
            }
            bus.write(RATE + 4 * generator as u16, OLD_RATE);
            (bus.directions, bus.sources, bus.switched_on) = Default::default();
            bus.wait(PERIOD);
            let _ = machine.driver.rearm().expect("it answers");
            assert_eq!(machine.driver.bus_mut().switched_on as usize, GENERATORS);
            assert_right(&mut machine);
            for _ in 0..20 {
                machine.driver.read().map(drop).expect("it answers");
                machine.driver.write().expect("it answers");
                machine.driver.bus_mut().wait(PERIOD);
            }
            // Pins that are released and driven again make an edge each.
            let moved = machine.motor().commanded() - before;
            assert!(moved.abs() <= 2, "{moved}");
        }
    }
}

/// What the listener is for.
#[test]
fn wrong_write_order_is_detected() {
    let heard = |writes: &[(u16, u32)]| {
        let mut bus = Listened::new(board().0);
        for (address, word) in writes {
            bus.write(*address, *word);
        }
        bus.wrongs.len()
    };
    let on = [(SOURCE, u32::MAX), (DATA_DIRECTION, u32::MAX)];
    let (length, rate) = ((STEP_LENGTH, 250), (RATE, OLD_RATE));
    assert_eq!(heard(&[length, rate, on[0], on[1]]), 1, "driven");
    assert_eq!(heard(&[length, on[0], on[1], rate]), 0, "commanded");
    assert_eq!(heard(&[rate, (RATE, 0), length]), 1, "no length");
    assert_eq!(heard(&[length, (MASTER, 1)]), GENERATORS - 1, "no length");
}
