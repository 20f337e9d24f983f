//! Bursts of lost packets of many lengths and phases: afterwards every input follows again, or is
//! not valid.

use std::cell::Cell;
use std::rc::Rc;

use crate::common::chance::Chance;
use crate::common::ethernet::{Fate, SimLink, WIRE, bus};
use mesa_hal::boards::I7i77Field;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{BoardState, Driver, Settings};
use mesa_hal::hal::{Input, Pins};
use mesa_hal::transport::udp::UdpBus;
use mesa_hal_sim::devices::find_mut;
use mesa_hal_sim::{Motor, SimFpga, machines};

const MILLI: u64 = 1_000_000;

/// Time spans in which packets to the board and to the host are lost.
type Burst = Rc<Cell<[(u64, u64); 2]>>;

struct Rig {
    driver: Driver<UdpBus<SimLink>>,
    burst: Burst,
    bits: Vec<Input<bool>>,
    gpio: Vec<usize>,
    counts: Vec<Input<i32>>,
}

fn fate(burst: &Burst, way: usize) -> Fate {
    let burst = Rc::clone(burst);
    Box::new(move |now, _| {
        let (from, until) = burst.get()[way];
        if (from..until).contains(&now) {
            vec![]
        } else {
            vec![WIRE]
        }
    })
}

impl Rig {
    fn new(fpga: SimFpga, has_remotes: bool) -> Self {
        let mut settings = Settings::default();
        if !has_remotes {
            let none = "xxxxxxxx".parse().expect("no channels");
            settings.serial_ports = [(0, none)].into();
        }
        let mut driver = Driver::start(bus(fpga), settings).expect("the board answers");
        let burst = Burst::default();
        let link = driver.bus_mut().link();
        (link.to_board, link.to_host) = (fate(&burst, 0), fate(&burst, 1));
        let pins = driver.pins();
        let name = |pin: &str| format!("{}.{pin}", driver.name());
        let mut bits = Vec::new();
        for n in 0..16 {
            for stem in ["inmux.00", "inm.00"] {
                bits.extend(pins.input(&name(&format!("{stem}.input-{n:02}"))));
                bits.extend(pins.input(&name(&format!("{stem}.raw-input-{n:02}"))));
            }
        }
        assert_eq!(bits.len(), 32, "isolated inputs");
        let is_free = |n: &usize| {
            let is_output = name(&format!("gpio.{n:03}.is_output"));
            pins.parameter::<bool>(&is_output).is_ok()
        };
        let gpio: Vec<_> = (0..68).filter(is_free).collect();
        assert!(gpio.len() > 3, "{gpio:?}");
        bits.extend(gpio.iter().map(|n| {
            let input = pins.input(&name(&format!("gpio.{n:03}.in")));
            input.expect("a pin that is an input")
        }));
        if has_remotes {
            let field: I7i77Field = driver.attach((0, 0)).expect("field I/O");
            bits.extend(field.inputs.iter().map(|input| input.pin));
        }
        let count = |n| pins.input(&name(&format!("encoder.{n:02}.rawcounts")));
        let counts = (0..6).map(|n| count(n).expect("an encoder")).collect();
        Self {
            driver,
            burst,
            bits,
            gpio,
            counts,
        }
    }

    fn fpga(&mut self) -> &mut SimFpga {
        self.driver.bus_mut().link().board.gateware_mut()
    }

    /// Sets all inputs to this level, and turns all encoders in this direction.
    fn set(&mut self, on: bool) {
        let gpio = self.gpio.clone();
        let fpga = self.fpga();
        for input in 0..16 {
            fpga.set_input(input, on);
        }
        for pin in gpio {
            fpga.drive_pin(pin, Some(on));
        }
        for axis in 0..6 {
            let motor = fpga.motor(axis).expect("an axis");
            motor.turn_by_hand(Some(if on { 20.0 } else { -20.0 }));
        }
        if let Some(device) = fpga.remote_mut(0, 0).and_then(find_mut) {
            for n in 0..32 {
                device.set_input(n, on).expect("an input");
            }
        }
    }

    fn cycles(&mut self, count: usize) {
        for _ in 0..count {
            let _ = self.driver.read();
            let _ = self.driver.write();
            let bus = self.driver.bus_mut();
            let rest = MILLI - bus.now().as_nanos() % MILLI;
            bus.wait(core::time::Duration::from_nanos(rest));
        }
    }

    fn valid_counts(&self) -> Vec<Option<i32>> {
        let reading = |pin: &Input<i32>| self.driver.pins().read(*pin);
        let readings = self.counts.iter().map(reading);
        readings
            .map(|reading| reading.valid.then_some(reading.value))
            .collect()
    }

    /// Toggles all inputs and checks that they follow; returns the number of valid ones.
    fn all_move(&mut self, told: &str) -> usize {
        let mut valid = 0;
        for on in [true, false, true] {
            self.set(on);
            self.cycles(40);
            let before = self.valid_counts();
            self.cycles(10);
            let pins: &Pins = self.driver.pins();
            valid = 0;
            for bit in &self.bits {
                let reading = pins.read(*bit);
                let name = &pins.info(*bit).expect("its own").name;
                assert!(
                    !reading.valid || reading.value == on,
                    "{told}: {name} is valid and not {on}"
                );
                valid += usize::from(reading.valid);
            }
            for (n, (before, now)) in before.iter().zip(self.valid_counts()).enumerate() {
                if let (Some(before), Some(now)) = (before, now) {
                    let moved = now.wrapping_sub(*before);
                    assert!(moved.abs() > 50, "{told}: encoder {n} moved by {moved}");
                    valid += 1;
                }
            }
        }
        valid
    }

    fn suffers(&mut self, chance: &mut Chance, seed: u64) {
        let now = self.driver.bus_mut().now().as_nanos();
        let from = now + chance.below(3 * MILLI);
        let longest = chance.of(&[2, 8, 30, 400]);
        let until = from + MILLI / 20 + chance.below(longest * MILLI);
        let none = (0, 0);
        let (to_board, to_host) = chance.of(&[(true, true), (true, false), (false, true)]);
        let burst = [
            if to_board { (from, until) } else { none },
            if to_host { (from, until) } else { none },
        ];
        self.burst.set(burst);
        // All inputs change their level in the middle of the burst.
        self.set(chance.one_in(2));
        let cycles = (until - now).div_ceil(MILLI) as usize + 2;
        self.cycles(cycles);
        let told = format!("seed {seed}, {} us lost, {burst:?}", (until - from) / 1000);
        let is_running = self.driver.board_state() == BoardState::Running;
        let valid = self.all_move(&told);
        let all = self.bits.len() + self.counts.len();
        if is_running && longest <= 2 {
            assert_eq!(valid, all, "{told}");
        }
        // Once re-armed, everything works, whatever was lost.
        let _ = self.driver.rearm().expect("the network is well");
        self.cycles(300);
        assert_eq!(self.all_move(&told), all, "{told}");
    }
}

fn every_input_moves_again(
    fpga: impl Fn() -> SimFpga,
    has_remotes: bool,
    seeds: std::ops::Range<u64>,
) {
    let mut rig = Rig::new(fpga(), has_remotes);
    rig.set(false);
    rig.cycles(50);
    for seed in seeds {
        rig.suffers(&mut Chance(seed), seed);
    }
}

#[test]
fn inputs_of_7i97_and_remotes_move_or_are_invalid_after_a_burst() {
    every_input_moves_again(|| machines::six_axes_7i97(Motor::default()), true, 1..61);
}

#[test]
fn unmultiplexed_inputs_move_or_are_invalid_after_a_burst() {
    let fpga = || {
        let mut fpga = machines::i7i97_inm_outm(1);
        machines::wire_7i97(&mut fpga, |_| Motor::default());
        fpga
    };
    every_input_moves_again(fpga, false, 101..141);
}
