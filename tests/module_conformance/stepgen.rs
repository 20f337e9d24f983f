//! The step generators, with the modules around them: I/O ports, watchdog, DPLL, an encoder.

use std::collections::BTreeSet;

use mesa_hal_sim::wire::Nanos;
use mesa_hal_sim::{SimFirmware, SimModuleDescriptor, SimPinDescriptor, gtag, machines};

use crate::Replay;
use crate::bench::{Bench, FpgaBench};
use crate::common::recording::{Outcome, Recording};
use crate::register::Register;
use crate::runner::{self, Rules};
use crate::transcript::{Event, Level, Transcript};

/// Everything exact, to the clock: edges, levels and registers; the tolerances of the recordings'
/// `index.txt` are not used. In addition, the rising edges of STEP, counted by DIR, are the change
/// of the accumulator in whole steps, wherever all of them are pulses of step and direction.
pub const REPLAY: Replay = replay;

const CLOCK: Nanos = 10;

/// Time from which the dividers of the recorded FPGA ran before time 0 of its file, as the first
/// step of the DPLL's prescaler shows in all files that use it. Step generators have no divider
/// that runs before it is written.
const CONFIGURED: Nanos = 1_000;

/// Largest difference of the encoders' time stamps: the period of the multiplexer, in units of two
/// clocks, and one for rounding.
const STAMPS: u32 = 13 + 1;

/// Outputs of the DPLL.
const TIMERS: [&str; 5] = ["REF", "TIMER1", "TIMER2", "TIMER3", "TIMER4"];

/// First pin of the second port of 17, where tables and encoders are in the bench.
const SECOND_PORT: usize = 17;

fn replay(transcript: &Transcript) -> Outcome {
    let mut bench = StepgenBench::new(firmware(transcript));
    let rules = Rules {
        skip: |entry| matches!(entry.event, Event::Read { register, .. } if is_encoder(register)),
        ..Rules::default()
    };
    let mut outcome = runner::replay(transcript, &mut bench, rules);
    compare_encoders(transcript, &bench.encoders, &mut outcome);
    bench.compare_counts(transcript, &mut outcome);
    outcome
}

fn is_encoder(register: Register) -> bool {
    register.kind.gtag == gtag::MUXED_ENCODER
}

/// Compares the words of encoders: counts exactly, time stamps within the period of the
/// multiplexer, whose phase is not known.
fn compare_encoders(transcript: &Transcript, words: &[u32], outcome: &mut Outcome) {
    let reads = transcript
        .entries
        .iter()
        .filter_map(|entry| match &entry.event {
            Event::Read { register, word } if is_encoder(*register) => {
                Some((entry.line, word.value))
            }
            _ => None,
        });
    for ((line, recorded), &simulated) in reads.zip(words) {
        let stamps = (recorded >> 16).abs_diff(simulated >> 16);
        let same = recorded as u16 == simulated as u16 && stamps <= STAMPS;
        outcome.compare(same, line, || {
            let [recorded, simulated] = [recorded, simulated].map(|word| format!("{word:#010X}"));
            (recorded, simulated)
        });
    }
}

/// The firmware on which a file was recorded, as its first line names it; 7I76 on a 7I92 with a
/// DPLL is the usual one.
fn firmware(transcript: &Transcript) -> SimFirmware {
    let head = transcript.comments.first().map_or("", String::as_str);
    let drives = |name: &str| {
        let mut events = transcript.entries.iter().map(|entry| &entry.event);
        events.any(|event| matches!(event, Event::Drive { pin, .. } if pin.starts_with(name)))
    };
    let has_dpll = !head.contains("without DPLL") && !head.contains("no DPLL");
    let mut firmware = if head.contains("index firmware") || drives("INDEX") {
        firmware_with_index()
    } else if head.contains("7I97 + 7I76") {
        firmware_7i97()
    } else if has_dpll {
        firmware_7i76()
    } else {
        firmware_7i77_7i76()
    };
    if !has_dpll {
        firmware.modules.retain(|module| module.gtag != gtag::DPLL);
    }
    firmware
}

/// Modules that were built, in their order.
fn keep_modules(firmware: &mut SimFirmware, tags: &[u8]) {
    firmware
        .modules
        .retain(|module| tags.contains(&module.gtag));
}

fn firmware_7i76() -> SimFirmware {
    let mut firmware = machines::firmware_7i92_7i76();
    let tags = [gtag::DPLL, gtag::WATCHDOG, gtag::IO_PORT, gtag::STEPGEN];
    keep_modules(&mut firmware, &tags);
    for (number, signal) in (0x83..=0x86).enumerate() {
        let pin = &mut firmware.pins[SECOND_PORT + TIMERS.len() + number];
        *pin = SimPinDescriptor::new(gtag::STEPGEN, 4, signal);
    }
    firmware
}

fn firmware_7i97() -> SimFirmware {
    let mut firmware = machines::firmware_7i97_7i76();
    // After configuration the bench's multiplexer runs at the rate of the sources.
    firmware.mux_rate = 11;
    firmware
}

fn firmware_7i77_7i76() -> SimFirmware {
    let mut firmware = firmware_7i76();
    keep_modules(
        &mut firmware,
        &[gtag::WATCHDOG, gtag::IO_PORT, gtag::STEPGEN],
    );
    set_version(&mut firmware, 2);
    firmware.pins.rotate_right(SECOND_PORT);
    // Their descriptors are in the ROM, before those of the generators; their pins are plain I/O.
    let others = machines::firmware_7i92_7i77();
    let encoders = [gtag::MUXED_ENCODER, gtag::MUX_SELECT];
    let encoders = encoders.into_iter().filter_map(|tag| others.module(tag));
    firmware.modules.splice(2..2, encoders.copied());
    firmware
}

/// Two generators with index, and one probe for all.
fn firmware_with_index() -> SimFirmware {
    let mut firmware = firmware_7i76();
    set_version(&mut firmware, 0xC2);
    if let Some(module) = firmware.module_mut(gtag::STEPGEN) {
        module.instances = 2;
    }
    firmware.pins.fill(SimPinDescriptor::gpio());
    for (pin, (unit, signal)) in firmware.pins.iter_mut().zip([
        (0, 0x82),
        (0, 0x81),
        (1, 0x82),
        (1, 0x81),
        (0, 0x09),
        (1, 0x09),
        (0x80, 0x0A),
    ]) {
        *pin = SimPinDescriptor::new(gtag::STEPGEN, unit, signal);
    }
    firmware
}

fn set_version(firmware: &mut SimFirmware, version: u8) {
    if let Some(module) = firmware.module_mut(gtag::STEPGEN) {
        *module = SimModuleDescriptor { version, ..*module };
    }
}

/// A simulated FPGA whose step pins are counted.
struct StepgenBench {
    inner: FpgaBench,
    counters: Vec<StepCounter>,
    /// Lines of the encoders, and the words read from them.
    lines: [bool; 3],
    encoders: Vec<u32>,
}

/// Counter at the pins of a generator: rising edges of STEP by the level of DIR.
#[derive(Clone, Copy, Debug, Default)]
struct StepCounter {
    step: usize,
    dir: usize,
    level: bool,
    count: i64,
}

impl StepgenBench {
    fn new(firmware: SimFirmware) -> Self {
        let generators = firmware
            .module(gtag::STEPGEN)
            .map_or(0, |module| module.instances);
        let pin = |unit, pin| firmware.pin(gtag::STEPGEN, unit, pin).unwrap_or(usize::MAX);
        let counters = (0..generators).map(|unit| StepCounter {
            step: pin(unit, 0x81),
            dir: pin(unit, 0x82),
            ..StepCounter::default()
        });
        let mut bench = Self {
            counters: counters.collect(),
            inner: FpgaBench::new(firmware),
            lines: [true; 3],
            encoders: Vec::new(),
        };
        bench.advance(0);
        bench
    }

    fn count(&mut self) {
        let fpga = &self.inner.fpga;
        for counter in &mut self.counters {
            let level = fpga.driven_level(counter.step) == Some(true);
            if level && !counter.level {
                let is_down = fpga.driven_level(counter.dir) == Some(true);
                counter.count += if is_down { -1 } else { 1 };
            }
            counter.level = level;
        }
    }

    /// Compares the counted steps with the accumulators after the end of the file, at rate 0: a
    /// step begins one clock after the accumulator has crossed.
    fn compare_counts(&mut self, transcript: &Transcript, outcome: &mut Outcome) {
        let units = counted_units(transcript);
        let Some(last) = transcript.entries.last() else {
            return;
        };
        for &unit in &units {
            let rate = format!("SG_RATE[{unit}]");
            let stopped = Register::parse(&rate).and_then(|register| self.write(register, 0));
            if let Err(reason) = stopped {
                outcome.fail(last.line, rate, reason);
            }
        }
        for clock in 1..4 {
            self.advance(last.time + CLOCK * clock);
        }
        for unit in units {
            let generators = self.inner.fpga.stepgen();
            let accum = generators.and_then(|steps| steps.accumulator(unit.into()));
            let accumulated = accum.map(|accum| i64::from(accum as i32 >> 16));
            let counted = self.counters.get(usize::from(unit)).map(|one| one.count);
            outcome.compare(
                counted.map(|count| count as i16) == accumulated.map(|count| count as i16),
                last.line,
                || {
                    (
                        format!("steps of generator {unit} on its pins: {counted:?}"),
                        format!("in its accumulator: {accumulated:?}"),
                    )
                },
            );
        }
    }
}

/// The generators of which all steps are pulses on driven pins: type 0, pins that are set up once
/// and are not inverted, a pulse length before a rate, and an accumulator that is not written.
fn counted_units(transcript: &Transcript) -> Vec<u8> {
    let (mut units, mut long, mut excluded) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
    let mut is_set_up = true;
    for entry in &transcript.entries {
        let Event::Write { register, value } = &entry.event else {
            continue;
        };
        let unit = register.index;
        match register.kind.name {
            "SG_RATE" if !long.contains(&unit) => _ = excluded.insert(unit),
            "SG_RATE" => _ = units.insert(unit),
            "SG_STEPLEN" if value % 0x4000 == 0 => _ = excluded.insert(unit),
            "SG_STEPLEN" => _ = long.insert(unit),
            "SG_MODE" if value & 7 != 0 => _ = excluded.insert(unit),
            "SG_ACCUM" => _ = excluded.insert(unit),
            "PORT_INV" | "PORT_OD" | "WD_TIME" => is_set_up = false,
            "PORT_ALT" | "PORT_DIR" => is_set_up &= units.is_empty(),
            _ => {}
        }
    }
    units.retain(|unit| is_set_up && !excluded.contains(unit));
    units.into_iter().collect()
}

impl Bench for StepgenBench {
    fn inner(&mut self) -> &mut FpgaBench {
        &mut self.inner
    }

    /// Advances in steps that leave out no clock, and counts.
    fn advance(&mut self, to: Nanos) {
        let to = to + CONFIGURED;
        while self.inner.fpga.now() < to {
            let next = (self.inner.fpga.now() / CLOCK + 1) * CLOCK;
            self.inner.fpga.advance_to(next.min(to));
            // Brings the generators up to date, so that no level is computed from far behind.
            let _ = self.inner.fpga.stepgen();
            self.count();
        }
    }

    fn read(&mut self, register: Register) -> Result<u32, String> {
        let word = Bench::read(self.inner(), register)?;
        if is_encoder(register) {
            self.encoders.push(word);
        }
        Ok(word)
    }

    fn write(&mut self, register: Register, value: u32) -> Result<(), String> {
        let inner = self.inner();
        Bench::write(inner, register, value)?;
        self.count();
        Ok(())
    }

    fn pin(&mut self, pin: &str) -> Result<Level, String> {
        let Some(output) = TIMERS.iter().position(|&name| name == pin) else {
            return self.inner.pin(pin);
        };
        let fpga = &self.inner.fpga;
        let dpll = fpga.dpll();
        let level = dpll.and_then(|dpll| dpll.level(fpga.now(), output as u8));
        match level {
            Some(true) => Ok(Level::High),
            Some(false) => Ok(Level::Low),
            None => Err("the firmware has no DPLL".to_owned()),
        }
    }

    /// A pin of the FPGA, or a line of the encoders that share the first three.
    fn drive(&mut self, pin: &str, level: Level) -> Result<(), String> {
        let line = ["A01", "B01", "Z01"].iter().position(|&line| line == pin);
        let Some(line) = line else {
            return self.inner.drive(pin, level);
        };
        self.lines[line] = level != Level::Low;
        let (now, lines) = (self.inner.fpga.now(), self.lines);
        let encoders = self.inner.fpga.encoders().ok_or("no encoders")?;
        for encoder in 0..2 {
            encoders.set_lines(now, encoder, lines);
        }
        Ok(())
    }
}

#[test]
fn steps_are_counted_in_every_file_whose_pins_show_all_of_them() {
    let names = [
        "sg05_rates",
        "sg07_extremes",
        "sg15_saturate",
        "sg17_dirsetup",
        "sg19_reverse",
        "sg21_zero",
        "sg35_latency",
        "sg38_master",
        "sg39_dpll",
        "sg42_mix",
        "sg47_servo",
        "sg49_servo500",
    ];
    for name in names {
        let transcript = Transcript::own(crate::DIRECTORY, name);
        assert!(!counted_units(&transcript).is_empty(), "{name}");
    }
    for name in [
        "sg01_reset",
        "sg02_reset",
        "sg11_accwrite",
        "sg27_table",
        "sg33_wd",
    ] {
        let transcript = Transcript::own(crate::DIRECTORY, name);
        assert!(counted_units(&transcript).is_empty(), "{name}");
    }
}
