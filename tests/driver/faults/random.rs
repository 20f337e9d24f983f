//! Random faults of remotes and cables, and calls in any order: each input is the true one of the
//! time that its age indicates, each output is off or a command given since it was armed,
//! undisturbed remotes are not affected, and no call takes longer than permitted.

use std::time::Duration;

use crate::common::chance::Chance;
use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, fpga, start};
use mesa_hal::bus::{BusErrorKind, Clock};
use mesa_hal::driver::{Driver, FaultPolicy, SerialConfig};
use mesa_hal::hal::{Age, Reading};
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::SimFpga;
use mesa_hal_sim::remote::{Toward, WireFault};

const ALL: [usize; 3] = [FIELD, ANALOG, OUTPUTS];
type Faults = Faulty<SimFpga>;

/// Possible mishaps of a run.
#[derive(Clone, Copy)]
struct Mishaps {
    victims: &'static [usize],
    /// The application sleeps, the bus loses exchanges, the board is loaded again.
    board: bool,
}

/// The true inputs from a time on.
struct Truth {
    since: u64,
    stamp: u32,
}

struct Run {
    machine: Machine<Faults>,
    chance: Chance,
    seed: u64,
    mishaps: Mishaps,
    cycle: u32,
    truths: Vec<Truth>,
    /// For each remote and cycle, true if it was armed when the command of the cycle was written.
    armed: [Vec<bool>; 3],
    /// The newest command seen at each remote's terminals.
    newest: [u32; 3],
    /// Number of cycles with new inputs, and with an output that was on.
    fresh: u32,
    driven: [u32; 3],
    /// Cycle of the last reply that was delayed by about a period or more.
    last_late: u32,
    /// Reads other than those of the cycles, since inputs were new.
    extra_calls: u32,
    /// Steps of all deliberate actions.
    log: Vec<(u32, String)>,
}

impl Run {
    fn new(seed: u64, mishaps: Mishaps) -> Self {
        let policy = FaultPolicy {
            first_backoff: Duration::from_millis(20),
            longest_backoff: Duration::from_millis(300),
            ..FaultPolicy::default()
        };
        let config: SerialConfig = "301".parse().expect("modes");
        let driver = start(Faulty::new(fpga(), seed), |s| {
            s.serial_ports = [(0, config)].into();
            s.fault_policy = policy;
        })
        .expect("the machine is complete");
        Self {
            machine: Machine::with(driver),
            chance: Chance(seed),
            seed,
            mishaps,
            cycle: 0,
            truths: Vec::new(),
            armed: Default::default(),
            newest: [0; 3],
            fresh: 0,
            driven: [0; 3],
            last_late: 0,
            extra_calls: 0,
            log: Vec::new(),
        }
    }

    fn context(&self) -> String {
        let from = self.log.len().saturating_sub(12);
        format!(
            "seed {}, cycle {}, after {:?}",
            self.seed,
            self.cycle,
            &self.log[from..]
        )
    }

    fn cycle(&mut self) {
        self.cycle += 1;
        let _ = self.within(100_000, |driver| driver.read().is_ok());
        self.check_inputs();
        self.set_everything();
        for (channel, armed) in self.armed.iter_mut().enumerate() {
            armed.push(self.machine.is_armed(channel));
        }
        self.besides();
        let _ = self.within(100_000, |driver| driver.write().is_ok());
        self.besides();
        self.machine.pass(Duration::from_millis(1));
        self.check_outputs();
    }

    /// Makes a call, with its limit in nanoseconds.
    fn within<T>(&mut self, limit: u64, call: impl FnOnce(&mut Driver<Faults>) -> T) -> T {
        let begin = self.machine.now();
        let result = call(&mut self.machine.driver);
        let took = self.machine.now() - begin;
        assert!(took <= limit, "{}: {took} ns", self.context());
        result
    }

    /// Makes calls that no cycle needs, when the true inputs have changed since they were read.
    fn besides(&mut self) {
        match self.chance.below(100) {
            0 | 1 => {
                self.extra_calls += 1;
                let _ = self.within(100_000, |driver| driver.read().is_ok());
                self.check_age();
            }
            2 | 3 => {
                // Counted as a cycle without new data.
                self.extra_calls += 1;
                let _ = self.within(100_000, |driver| driver.write().is_ok());
            }
            4 | 5 => {
                let micros = self.chance.below(400);
                let limit = Duration::from_micros(micros);
                let waits = |driver: &mut Driver<Faults>| driver.wait_transfers(limit).is_ok();
                let _ = self.within(micros * 1000 + 10_000, waits);
            }
            _ => {}
        }
    }

    fn readings(&self) -> Vec<Reading<bool>> {
        let pins = self.machine.driver.pins();
        let inputs = self.machine.cards.field.inputs.iter();
        inputs.map(|pair| pins.read(pair.pin)).collect()
    }

    fn check_inputs(&mut self) {
        let Some((stamp, age)) = self.check_age() else {
            return;
        };
        let cycles = u32::try_from(age.cycles).expect("valid is young");
        let oldest = (self.cycle - 1).saturating_sub(cycles);
        // After a failed transfer the age covers that transfer as well.
        let newest = match cycles {
            0 | 1 => (oldest + self.extra_calls).min(self.cycle - 1),
            _ => self.cycle - 1,
        };
        let possible = oldest..=newest;
        let context = self.context();
        assert!(
            possible.contains(&stamp),
            "{context}: {stamp} of {cycles} cycles ago"
        );
        if cycles == 0 {
            self.extra_calls = 0;
            self.fresh += 1;
        }
    }

    /// Checks that valid inputs are the true ones of the time that their age indicates, or later
    /// ones if they are two cycles old: then a transfer has failed, whose late reply may have been
    /// taken. Returns the cycle in which the inputs got these values, and their age.
    fn check_age(&self) -> Option<(u32, Age)> {
        let readings = self.readings();
        let age = readings[0].age;
        let mut stamp = 0;
        for (n, reading) in readings.iter().enumerate() {
            assert_eq!(reading.age, age);
            stamp |= u32::from(reading.value) << n;
            if !reading.valid {
                return None;
            }
        }
        let now = self.machine.driver.pins().now().as_nanos();
        let at = now - age.time.as_nanos() as u64;
        let truth = self.truths.iter().rposition(|truth| truth.since <= at);
        // The first age counts from the driver's start, which is before the first truth.
        let mut since = self.truths.iter().skip(truth.unwrap_or(0));
        let latest = if age.cycles < 2 { 1 } else { usize::MAX };
        assert!(
            since
                .by_ref()
                .take(latest)
                .any(|truth| truth.stamp == stamp),
            "{}: {stamp} of {:?} ago",
            self.context(),
            age.time
        );
        Some((stamp, age))
    }

    /// Sets inputs and commands of this cycle to its number.
    fn set_everything(&mut self) {
        let stamp = self.cycle;
        let since = self.machine.driver.bus_mut().now().as_nanos();
        self.truths.push(Truth { since, stamp });
        for n in 0..32 {
            let on = stamp >> n & 1 != 0;
            self.machine.device_mut(FIELD).set_input(n, on).unwrap();
        }
        let (field, analog, outputs) = (
            self.machine.cards.field,
            self.machine.cards.analog,
            self.machine.cards.outputs,
        );
        let pins = self.machine.driver.pins_mut();
        for (n, output) in field.outputs.iter().enumerate() {
            pins.set(output.pin, stamp >> n & 1 != 0);
        }
        for (n, output) in outputs.outputs.iter().enumerate() {
            pins.set(output.pin, u64::from(stamp) >> n & 1 != 0);
        }
        let [low, high, ..] = analog.analog_out;
        pins.set(low.volts, f64::from(stamp % 100 + 1) / 12.0);
        pins.set(high.volts, f64::from(stamp / 100 + 1) / 12.0);
        pins.set(analog.analogena.pin, true);
    }

    /// The number of the command at the terminals; 0 when all is off.
    fn at_terminals(&self, channel: usize) -> u32 {
        let world = self.machine.device(channel).world();
        if channel == ANALOG {
            let digits = |n| world.analog_output(n).unwrap_or(0.0) * 12.0;
            let (low, high) = (digits(0).round() as u32, digits(1).round() as u32);
            return if (low, high) == (0, 0) {
                0
            } else {
                assert!(low > 0 && high > 0, "{}", self.context());
                low - 1 + (high - 1) * 100
            };
        }
        let count = if channel == FIELD { 16 } else { 48 };
        let bits = (0..count).map(|n| u64::from(world.output(n) == Some(true)) << n);
        u32::try_from(bits.sum::<u64>()).expect("no other output is on")
    }

    fn check_outputs(&mut self) {
        for channel in ALL {
            let command = self.at_terminals(channel);
            if command == 0 {
                continue;
            }
            let context = self.context();
            let what = format!("{context}: remote {channel} drives command {command}");
            assert!(command <= self.cycle, "{what}");
            assert!(
                self.armed[channel][command as usize - 1],
                "{what}: not armed"
            );
            assert!(command >= self.newest[channel], "{what}: older than before");
            self.newest[channel] = command;
            self.driven[channel] += u32::from(command == self.cycle);
        }
    }

    fn happen(&mut self) {
        if !self.chance.one_in(40) {
            return;
        }
        let channel = self.chance.of(self.mishaps.victims);
        let now = self.machine.now();
        let what = match self.chance.below(if self.mishaps.board { 15 } else { 10 }) {
            0 => {
                self.machine.cable(channel).unplug();
                "unplug"
            }
            1 | 2 => {
                self.machine.cable(channel).replug();
                self.machine.cable(channel).heal();
                self.machine.device_mut(channel).set_power(now, true);
                "repair"
            }
            3 => {
                self.machine.device_mut(channel).set_power(now, false);
                self.machine.device_mut(channel).set_power(now, true);
                "power cycle"
            }
            4 => {
                self.machine.device_mut(channel).set_power(now, false);
                "power off"
            }
            5 => {
                let volts = self.chance.of(&[0.0, 24.0]);
                let world = self.machine.device_mut(channel);
                let _ = world.set_field_volts(now, volts);
                "field power"
            }
            6..10 => {
                let toward = self
                    .chance
                    .of(&[Toward::Fpga, Toward::Fpga, Toward::Remote]);
                let fault = self.wire_fault();
                if let WireFault::Late(delay) = fault
                    && delay > 800_000
                {
                    // Several replies in a row that are late by a whole period cannot be
                    // distinguished from replies in time: nothing on the wire numbers them.
                    if self.cycle < self.last_late + 10 {
                        return;
                    }
                    self.last_late = self.cycle;
                    self.machine.cable(channel).inject(toward, fault, 1);
                } else if self.chance.one_in(3) {
                    let probability = self.chance.of(&[0.02, 0.2, 0.7, 1.0]);
                    let cable = self.machine.cable(channel);
                    cable.inject_by_chance(toward, fault, probability);
                } else {
                    let bursts = 1 + self.chance.below(3) as u32;
                    self.machine.cable(channel).inject(toward, fault, bursts);
                }
                self.log
                    .push((self.cycle, format!("{channel} {toward:?} {fault:?}")));
                return;
            }
            10 => {
                let millis = 1 + self.chance.below(80);
                self.machine.sleep(millis);
                "sleep"
            }
            11 | 12 => {
                let bus = self.machine.driver.bus_mut();
                let next = bus.exchanges() + self.chance.below(2);
                let fault = self.chance.of(&[
                    Fault::AckedButLost,
                    Fault::Executed(BusErrorKind::Lost),
                    Fault::NotExecuted(BusErrorKind::Lost),
                ]);
                bus.fail_at(next, fault);
                "bus"
            }
            13 => {
                self.machine.driver.restart((0, channel as u8));
                "restart"
            }
            _ => {
                self.machine.driver.bus_mut().inner.reload();
                "reload"
            }
        };
        self.log.push((self.cycle, format!("{channel} {what}")));
    }

    fn wire_fault(&mut self) -> WireFault {
        let late = 10_000 + self.chance.below(2_100_000);
        self.chance.of(&[
            WireFault::Lost,
            WireFault::Corrupted,
            WireFault::Short(1),
            WireFault::Long(1),
            WireFault::Long(2),
            WireFault::Break,
            WireFault::Late(60_000),
            WireFault::Late(1_000_000),
            WireFault::Late(late),
        ])
    }

    fn repair_all(&mut self) {
        let now = self.machine.now();
        for channel in ALL {
            self.machine.cable(channel).replug();
            self.machine.cable(channel).heal();
            let device = self.machine.device_mut(channel);
            device.set_power(now, true);
            let _ = device.set_field_volts(now, 24.0);
        }
        self.machine.driver.bus_mut().heal();
    }
}

fn run(seed: u64, cycles: u32, mishaps: Mishaps) -> Run {
    let mut run = Run::new(seed, mishaps);
    for _ in 0..cycles {
        run.happen();
        run.cycle();
        if run.chance.one_in(30) {
            let _ = run.within(200_000, |driver| driver.rearm().is_ok());
        }
        for channel in ALL {
            if !mishaps.board && !mishaps.victims.contains(&channel) && run.cycle > 3 {
                let context = run.context();
                assert!(run.machine.is_armed(channel), "{context}: {channel}");
                assert_ne!(run.at_terminals(channel), 0, "{context}: {channel}");
            }
        }
    }
    run.repair_all();
    for n in 0..3000 {
        run.cycle();
        if n % 50 == 0 {
            let _ = run.machine.driver.rearm();
        }
    }
    let states = ALL.map(|channel| run.machine.status(channel).state);
    let board = run.machine.driver.board_state();
    let context = format!("{}: {board:?}, {states:?}", run.context());
    for channel in ALL {
        assert!(run.machine.is_valid(channel), "{context}: {channel}");
        assert_eq!(run.at_terminals(channel), run.cycle, "{context}: {channel}");
    }
    let states = run.machine.driver.statistics();
    println!(
        "seed {seed}: {} cycles, {} with new inputs, {:?} driven, {states:?}",
        run.cycle, run.fresh, run.driven
    );
    run
}

#[test]
fn other_remotes_stay_armed_and_driven_under_any_fault_of_one() {
    for victims in [&[FIELD][..], &[ANALOG], &[OUTPUTS]] {
        for seed in 1..=4 {
            let mishaps = Mishaps {
                victims,
                board: false,
            };
            run(seed, 4000, mishaps);
        }
    }
}

#[test]
fn no_pin_is_wrong_under_any_fault_of_remotes_and_board() {
    for seed in 10..=25 {
        let mishaps = Mishaps {
            victims: &ALL,
            board: true,
        };
        run(seed, 4000, mishaps);
    }
}
