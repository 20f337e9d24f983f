//! `index-enable` ends by a true latch and by nothing else, whatever the network does to the writes
//! of the control word: each zero is compared with the position of the index on the simulated
//! shaft.

use crate::common::machine::start;
use std::time::Duration;

use crate::common::chance::Chance;
use crate::common::ethernet::{Fate, SimLink, WIRE};
use mesa_hal::bus::Clock;
use mesa_hal::driver::Driver;
use mesa_hal::modules::encoder::{EncoderPins, Encoders};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal_sim::{Motor, MotorConfig, SimFpga, machines};

const PERIOD: Duration = Duration::from_millis(1);
const PER_TURN: u32 = 500;
/// Tolerance of a latch around the beginning of the index: its width, and a count that arrives
/// together with it.
const WIDTH: i64 = 2;

type Machine = Driver<UdpBus<SimLink>>;

fn motor(per_turn: u32) -> Motor {
    let config = MotorConfig {
        counts_per_unit: 1.0,
        counts_per_revolution: per_turn,
        ..MotorConfig::default()
    };
    Motor::new(config).unwrap()
}

/// The fate of a packet: one in `n` is lost, one late, one duplicated.
fn fates(seed: u64, n: u64) -> Fate {
    let mut chance = Chance(seed);
    Box::new(move |_, _| {
        let late = WIRE + chance.below(3 * PERIOD.as_nanos() as u64);
        match chance.below(n) {
            0 => vec![],
            1 => vec![late],
            2 => vec![WIRE, late],
            _ => vec![WIRE],
        }
    })
}

fn machine(per_turn: u32) -> Machine {
    let fpga = machines::six_axes_7i97(motor(per_turn));
    let link = SimLink::new(fpga);
    let config = UdpConfig {
        cycle_deadline: PERIOD * 3 / 5,
        ..UdpConfig::default()
    };
    let bus = UdpBus::new(link, config).expect("the board answers");
    start(bus, |s| {
        s.period = PERIOD;
        s.bus_error_limit = 1000;
        s.watchdog = Some(Duration::from_millis(500));
    })
    .expect("the machine is complete")
}

/// A shaft that is turned by hand, and the request of its application.
struct Shaft {
    pins: EncoderPins,
    /// Position of the shaft when the index was requested.
    asked_at: Option<i64>,
    zeroes: u32,
}

impl Shaft {
    /// Zero of the encoder, in counts of the shaft.
    fn zero(&self, driver: &Machine) -> i64 {
        let pins = driver.pins();
        let raw = pins.read(self.pins.counter.rawcounts).value;
        i64::from(raw.wrapping_sub(pins.read(self.pins.counter.count).value))
    }

    /// After a read: if the request has ended, its zero must be one that the shaft has.
    fn check(&mut self, driver: &Machine, shaft: i64, told: &str) {
        let Some(asked_at) = self.asked_at else {
            return;
        };
        if driver.pins().read(self.pins.counter.index_enable).value {
            return;
        }
        let zero = self.zero(driver);
        let off = zero.rem_euclid(i64::from(PER_TURN));
        let off = off.min(i64::from(PER_TURN) - off);
        assert!(off <= WIDTH, "{told}: zero at {zero}, {off} from an index");
        let passed = asked_at.min(shaft) - WIDTH..=asked_at.max(shaft) + WIDTH;
        assert!(
            passed.contains(&zero),
            "{told}: zero at {zero}, which was not passed since the request, {passed:?}"
        );
        self.asked_at = None;
        self.zeroes += 1;
    }
}

fn fpga(driver: &mut Machine) -> &mut SimFpga {
    driver.bus_mut().link().board.gateware_mut()
}

fn counts(driver: &mut Machine, axis: usize) -> i64 {
    fpga(driver)
        .motor(axis)
        .map_or(0, |m| m.counts().floor() as i64)
}

/// Six shafts at different speeds, with repeated index requests; returns the number of zeroes.
fn run(seed: u64, cycles: u32, n: u64) -> u32 {
    let mut driver = machine(PER_TURN);
    let mut chance = Chance(seed);
    let encoders = driver
        .modules::<Encoders>()
        .next()
        .expect("encoders")
        .pins()
        .collect::<Vec<_>>();
    let mut shafts: Vec<Shaft> = encoders
        .into_iter()
        .map(|pins| Shaft {
            pins,
            asked_at: None,
            zeroes: 0,
        })
        .collect();
    let _ = driver.read().expect("the network is still good");
    driver.write().expect("the network is still good");
    for axis in 0..shafts.len() {
        let speed = 4_000.0 + 7_000.0 * axis as f64;
        let motor = fpga(&mut driver).motor(axis).expect("an axis");
        motor.turn_by_hand(Some(if axis % 2 == 0 { speed } else { -speed }));
    }
    let link = driver.bus_mut().link();
    link.to_board = fates(seed, n);
    link.to_host = fates(seed ^ 0xABCD, n);
    for cycle in 0..cycles {
        let good = driver.read().is_ok();
        for (axis, shaft) in shafts.iter_mut().enumerate() {
            let now = counts(&mut driver, axis);
            let told = format!("seed {seed}, cycle {cycle}, encoder {axis}");
            if good {
                shaft.check(&driver, now, &told);
            }
            match shaft.asked_at {
                None if chance.one_in(4) => {
                    driver.pins_mut().set(shaft.pins.counter.index_enable, true);
                    shaft.asked_at = Some(now);
                }
                // Withdrawn, and possibly requested again at once.
                Some(_) if chance.one_in(200) => {
                    driver
                        .pins_mut()
                        .set(shaft.pins.counter.index_enable, false);
                    shaft.asked_at = None;
                }
                _ => {}
            }
        }
        let _ = driver.rearm();
        let _ = driver.write();
        let now = driver.bus_mut().now().as_nanos();
        let period = PERIOD.as_nanos() as u64;
        driver
            .bus_mut()
            .wait(Duration::from_nanos(period - now % period));
    }
    shafts.iter().map(|shaft| shaft.zeroes).sum()
}

#[test]
fn no_delayed_duplicate_or_lost_write_makes_a_false_zero() {
    for seed in 1..=12 {
        let zeroes = run(seed, 1_500, 6 + seed);
        println!("seed {seed}: {zeroes} zeroes");
        assert!(zeroes > 60, "seed {seed}: {zeroes} zeroes");
    }
}

/// A shaft that swings over one index only, while another setting changes in every cycle, with
/// which the control words are written again; the application works between read and write.
#[test]
fn index_is_not_missed_while_settings_are_rewritten() {
    for work in [50, 300, 600, 900_u64] {
        let mut driver = machine(PER_TURN);
        let (pins, hires_timestamp) = {
            let encoders = driver.modules::<Encoders>().next().expect("encoders");
            (
                encoders.pins().next().expect("one"),
                encoders.hires_timestamp(),
            )
        };
        let _ = driver.read().expect("the board is there");
        driver.write().expect("the board is there");
        let mut shaft = Shaft {
            pins,
            asked_at: None,
            zeroes: 0,
        };
        for swing in 0..80_i64 {
            let upwards = swing % 2 == 0;
            // The swings are not synchronous with the cycle.
            driver.bus_mut().wait(Duration::from_micros(137));
            // Always from the same side, so that the latch is at the same count again.
            driver.pins_mut().set(pins.counter.index_enable, upwards);
            shaft.asked_at = upwards.then(|| counts(&mut driver, 0));
            // Back to the start, at another speed for each pair of swings: the index occurs at
            // every time of the period.
            let pair = (swing + 1) / 2;
            let speed = (25_000 + pair * 7_919 % 20_000) as f64;
            for cycle in 0..14_u32 {
                let speed = match cycle {
                    2..12 if swing == 0 => 20_000.0,
                    2..12 if upwards => speed,
                    2..12 => -speed,
                    _ => 0.0,
                };
                let motor = fpga(&mut driver).motor(0).expect("an axis");
                motor.turn_by_hand(Some(speed));
                let _ = driver.read().expect("the board is there");
                let now = counts(&mut driver, 0);
                shaft.check(&driver, now, &format!("work {work} us, swing {swing}"));
                driver.bus_mut().wait(Duration::from_micros(work));
                driver
                    .pins_mut()
                    .set(hires_timestamp, cycle.is_multiple_of(2));
                driver.write().expect("the board is there");
                driver
                    .bus_mut()
                    .wait(PERIOD.saturating_sub(Duration::from_micros(work)));
            }
            // The first begins at the index.
            let is_missed = shaft.asked_at.take().is_some();
            assert!(
                swing == 0 || !is_missed,
                "work {work} us, swing {swing}: missed"
            );
        }
        assert!(shaft.zeroes >= 39, "{}", shaft.zeroes);
    }
}

/// Disturbance of the cycles in which an axis approaches its mark.
#[derive(Clone, Copy, Debug)]
enum Disturbance {
    Nothing,
    LostWrites,
    AnotherSetting,
    AnotherAxis,
}

/// Runs one cycle: all axes turn at `speed` counts per second, every other one in reverse.
fn turn_all(driver: &mut Machine, speed: f64, disturbance: Disturbance, cycle: u32) {
    for axis in 0..6 {
        let speed = if axis % 2 == 0 { speed } else { -speed };
        let motor = fpga(driver).motor(axis).expect("an axis");
        motor.turn_by_hand(Some(speed));
    }
    let _ = driver.read();
    let encoders = driver.modules::<Encoders>().next().expect("encoders");
    let hires_timestamp = encoders.hires_timestamp();
    let last = encoders.pins().last().expect("six");
    match disturbance {
        Disturbance::AnotherSetting => driver
            .pins_mut()
            .set(hires_timestamp, cycle.is_multiple_of(2)),
        Disturbance::AnotherAxis => {
            let pins = driver.pins_mut();
            pins.set(last.counter.index_enable, cycle.is_multiple_of(2));
        }
        Disturbance::LostWrites => {
            // The read is the other packet of the cycle.
            let mut chance = Chance(u64::from(cycle));
            let fate = move |_, _: &[u8]| if chance.one_in(3) { vec![] } else { vec![WIRE] };
            driver.bus_mut().link().to_board = Box::new(fate);
        }
        Disturbance::Nothing => {}
    }
    let _ = driver.write();
    driver.bus_mut().link().to_board = Box::new(|_, _| vec![WIRE]);
    let now = driver.bus_mut().now().as_nanos();
    let period = PERIOD.as_nanos() as u64;
    driver
        .bus_mut()
        .wait(Duration::from_nanos(period - now % period));
}

/// Five axes home simultaneously, move away by more than 16 bits count, and home again in the same
/// direction. Their marks are a million counts apart: nothing but the mark at 0 is near.
#[test]
fn index_is_never_found_65536_counts_from_the_mark() {
    for disturbance in [
        Disturbance::Nothing,
        Disturbance::LostWrites,
        Disturbance::AnotherSetting,
        Disturbance::AnotherAxis,
    ] {
        for forth in [1.0, -1.0] {
            homes_at_the_mark_only(disturbance, forth * 400_000.0);
        }
    }
}

fn homes_at_the_mark_only(disturbance: Disturbance, speed: f64) {
    let mut driver = machine(1_000_000);
    let encoders = driver.modules::<Encoders>().next().expect("encoders");
    let pins: Vec<EncoderPins> = encoders.pins().take(5).collect();
    let quiet = Disturbance::Nothing;
    turn_all(&mut driver, 0.0, quiet, 0);
    // Away from the mark first, and beyond 16 bits of counts after the first time.
    for (round, away) in [(1, 10), (2, 200), (3, 190)] {
        for cycle in 0..away {
            turn_all(&mut driver, -speed, quiet, cycle);
        }
        turn_all(&mut driver, 0.0, quiet, 0);
        for pins in &pins {
            driver.pins_mut().set(pins.counter.index_enable, true);
        }
        turn_all(&mut driver, 0.0, quiet, 0);
        for cycle in 0..away + 10 {
            turn_all(&mut driver, speed, disturbance, cycle);
        }
        turn_all(&mut driver, 0.0, quiet, 0);
        turn_all(&mut driver, 0.0, quiet, 0);
        for (axis, pins) in pins.iter().enumerate() {
            let told = format!("{disturbance:?}, {speed}, round {round}, encoder {axis}");
            let read = driver.pins();
            assert!(!read.read(pins.counter.index_enable).value, "{told}");
            let unsure = pins.counter.count_unsure.expect("it has the pin");
            assert!(!read.read(unsure).value, "{told}");
            let count = i64::from(read.read(pins.counter.count).value);
            let zero = counts(&mut driver, axis) - count;
            assert!(zero.abs() <= WIDTH, "{told}: zero {zero} from the mark");
        }
    }
}
