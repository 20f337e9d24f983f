//! Writes that the network delivers late, or twice: the rates in them are old. The truth is the
//! pulses that arrive at the motor.

use std::cell::Cell;
use std::rc::Rc;

use mesa_hal::bus::Clock;
use mesa_hal::transport::udp::UdpBus;

use super::{Machine, PERIOD, SCALE, board, machine_on};
use crate::common::chance::Chance;
use crate::common::ethernet::{self, SimLink, WIRE, is_request};

const MICRO: u64 = 1_000;
const MILLI: u64 = 1_000_000;
/// Cycles until no packet of the set-up is in flight any more.
const SETTLED: u32 = 110;
/// The most by which a write of the random network is late.
const LATEST: u64 = 3 * MILLI;

type Networked = Machine<UdpBus<SimLink>>;

/// The machine at the end of a network that asks how to deliver each write: delays of its arrivals.
fn networked(mut deliver: impl FnMut() -> Vec<u64> + 'static) -> Networked {
    let (fpga, axis) = board();
    let mut machine = machine_on(ethernet::bus(fpga), axis);
    for _ in 0..SETTLED {
        machine.cycle(0.0);
    }
    machine.driver.bus_mut().link().to_board = Box::new(move |_, packet| {
        if is_request(packet) {
            return vec![WIRE];
        }
        deliver().into_iter().map(|late| WIRE + late).collect()
    });
    machine
}

fn steps(machine: &mut Networked) -> i64 {
    machine.motor().commanded()
}

/// Waits for the next whole period.
fn rest(machine: &mut Networked) {
    let bus = machine.driver.bus_mut();
    let period = PERIOD.as_nanos() as u64;
    let rest = period - bus.now().as_nanos() % period;
    bus.wait(std::time::Duration::from_nanos(rest));
}

/// One period at a speed, or off.
fn cycle(machine: &mut Networked, speed: Option<f64>) {
    let _ = machine.driver.read();
    let (pins, to) = (machine.pins, machine.driver.pins_mut());
    to.set(pins.control_type, true);
    to.set(pins.enable, speed.is_some());
    to.set(pins.velocity_cmd, speed.unwrap_or(0.0));
    machine.driver.write().expect("the bus is well");
    rest(machine);
}

/// The position, as the steps that the motor has made: a good read has it.
#[track_caller]
fn assert_known(machine: &mut Networked, zero: i64) {
    let _ = machine.driver.read().expect("a good read");
    let pins = machine.driver.pins();
    let shown = pins.read(machine.pins.counts);
    assert!(shown.valid);
    assert!(!pins.read(machine.pins.position_unsure).value);
    assert_eq!(i64::from(shown.value), steps(machine) - zero);
}

/// The last write of a motion arrives again, or for the first time, when the generator has been
/// stopped: it moves until the next write, and no longer.
#[test]
fn old_rate_acts_until_next_write_and_next_read_has_position() {
    for speed in [8.0, -8.0] {
        for (late, is_doubled) in [
            (300 * MICRO, true),
            (1_300 * MICRO, true),
            (2_700 * MICRO, true),
            (300 * MICRO, false),
            (1_300 * MICRO, false),
            (2_700 * MICRO, false),
        ] {
            let next = Rc::new(Cell::new(false));
            let asked = Rc::clone(&next);
            let mut machine = networked(move || match (asked.take(), is_doubled) {
                (false, _) => vec![0],
                (true, true) => vec![0, late],
                (true, false) => vec![late],
            });
            let zero = steps(&mut machine);
            for _ in 0..100 {
                cycle(&mut machine, Some(speed));
            }
            next.set(true);
            cycle(&mut machine, Some(speed));
            let mut before = steps(&mut machine);
            let mut moved = Vec::new();
            for _ in 0..8 {
                cycle(&mut machine, None);
                let now = steps(&mut machine);
                moved.push((now - before).abs());
                before = now;
            }
            let told = format!("{speed}, {late} ns late, twice: {is_doubled}: {moved:?}");
            // Until the write of the next period, with a step that has waited, and one on the way
            // of the write that stops it.
            let a_period = (speed.abs() * SCALE * PERIOD.as_secs_f64()) as i64;
            let old: i64 = moved.iter().sum();
            assert!(old <= a_period + 2, "{told}");
            assert!(
                late < MILLI || old >= 2,
                "the old rate was in force: {told}"
            );
            assert_eq!(moved[4..].iter().sum::<i64>(), 0, "{told}");
            assert_known(&mut machine, zero);
        }
    }
}

/// Runs to and fro with stops, on a network that holds back and doubles writes.
fn wander(seed: u64) {
    let mut network = Chance(seed);
    let mut machine = networked(move || {
        let late = |chance: &mut Chance| {
            if chance.one_in(6) {
                100 * MICRO + chance.below(LATEST - 100 * MICRO)
            } else {
                0
            }
        };
        let mut arrivals = vec![late(&mut network)];
        if network.one_in(6) {
            arrivals.push(100 * MICRO + network.below(LATEST - 100 * MICRO));
        }
        arrivals
    });
    let zero = steps(&mut machine);
    let (pins, to) = (machine.pins, machine.driver.pins_mut());
    // Each write can have another rate.
    to.set_param(pins.maxaccel, 0.0).expect("no limit");
    let (mut chance, mut speed, mut before) = (Chance(seed ^ 0x5EED), None, zero);
    // The rates of the last writes: one of them is in force.
    let mut written = std::collections::VecDeque::from([0.0_f64; 8]);
    let (mut moved_at_old_rate, mut worst) = (0, 0.0_f64);
    for period in 0..1_500 {
        if chance.one_in(4) {
            let values = [None, None, Some(5.0), Some(-5.0), Some(0.4), Some(-2.0)];
            speed = chance.of(&values);
        }
        let _ = machine.driver.read().expect("requests arrive");
        // The position of a read, within the time of its packets and a pulse that waits.
        let pins = machine.driver.pins();
        assert!(!pins.read(machine.pins.position_unsure).value, "{seed}");
        let shown = pins.read(machine.pins.position_fb).value * SCALE;
        let off = (steps(&mut machine) - zero) as f64 - shown;
        worst = worst.max(off.abs());
        let (pins, to) = (machine.pins, machine.driver.pins_mut());
        to.set(pins.control_type, true);
        to.set(pins.enable, speed.is_some());
        to.set(pins.velocity_cmd, speed.unwrap_or(0.0));
        machine.driver.write().expect("requests arrive");
        let rate = machine.driver.pins().read(machine.pins.velocity_fb).value;
        written.push_front(rate.abs());
        written.pop_back();
        rest(&mut machine);
        let now = steps(&mut machine);
        let moved = (now - before).abs();
        before = now;
        let fastest = written.iter().copied().fold(0.0, f64::max);
        let most = (fastest * SCALE * PERIOD.as_secs_f64()) as i64 + 2;
        assert!(
            moved <= most,
            "{seed}, period {period}: {moved} steps of {most}"
        );
        moved_at_old_rate += u32::from(moved > 1 && written[0] == 0.0);
    }
    assert!(worst < 1.5, "{seed}: {worst}");
    assert!(moved_at_old_rate >= 5, "{seed}: {moved_at_old_rate}");
    machine.driver.bus_mut().link().to_board = ethernet::good();
    for _ in 0..6 {
        cycle(&mut machine, None);
    }
    assert_known(&mut machine, zero);
}

#[test]
fn position_matches_the_motor_with_late_and_duplicate_writes() {
    for seed in 1..=6 {
        wander(seed);
    }
}
