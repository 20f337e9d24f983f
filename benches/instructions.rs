//! Number of instructions of the driver for one cycle: `read` and `write`, on a bus that answers
//! from memory, with six analog outputs, where present, that change in every cycle.
//!
//! The program runs itself under callgrind, which counts only inside [`counted_cycle`]. Prints a
//! line for each machine: `three` is a 7I92 with a 7I77 (field I/O and analog) and a 7I72, a number
//! is that many field I/O cards. A second line has the registers that a cycle reads and writes,
//! which decide its cost on the PCI bus. Then for a 7I92 with five and with ten step generators,
//! which follow a moving command: the cycle, and what each generator adds to that of the same
//! firmware without them. Counts do not depend on the machine or on its load.

#![allow(clippy::print_stdout, clippy::print_stderr)]

use std::env;
use std::process::{Command, ExitCode, Stdio};

use cycle_support::{Frozen, field_cards, frozen, frozen_with, step_generators, three_remotes};
use mesa_hal::bus::AccessList;
use mesa_hal::driver::Driver;
use mesa_hal::hostmot2::Gtag;
use mesa_hal::modules::stepgen::{StepgenPins, Stepgens};
use mesa_hal::{Output, Settings};

/// The argument with which the program runs cycles to be counted, before the name of a machine.
const COUNTED: &str = "--cycles-of";
const MACHINES: [&str; 5] = ["three", "1", "2", "8", "32"];
/// Machines with step generators, followed by their number: used, and left out.
const STEPPING: &str = "stepping-";
const STANDING: &str = "standing-";
/// The most instructions of a step generator in a cycle, with all its pins: more is a failure.
const MOST: u64 = 660;
/// Number of cycles that are counted.
const CYCLES: u64 = 200;

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().collect();
    if let Some(at) = arguments.iter().position(|argument| argument == COUNTED) {
        run(arguments.get(at + 1).map_or("", String::as_str));
        return ExitCode::SUCCESS;
    }
    let valgrind = Command::new("valgrind").arg("--version").output();
    if !valgrind.is_ok_and(|output| output.status.success()) {
        eprintln!(
            "instructions are counted by valgrind, which is not installed: apt-get install valgrind"
        );
        // In CI nothing may be missing.
        let is_ci = env::var_os("CI").is_some_and(|ci| ci == "true");
        return if is_ci {
            ExitCode::FAILURE
        } else {
            ExitCode::SUCCESS
        };
    }
    for machine in MACHINES {
        match count(machine) {
            Ok(instructions) => {
                println!("{machine}: {} instructions", thousands(instructions));
                let (reads, writes) = accesses(machine);
                println!("{machine}: {reads} reads and {writes} writes on the bus");
            }
            Err(output) => {
                eprintln!("{machine}: callgrind counted nothing:\n{output}");
                return ExitCode::FAILURE;
            }
        }
    }
    for generators in [5, 10] {
        match count_generators(generators) {
            Ok((cycle, each)) => {
                println!(
                    "{generators} step generators: {} instructions, {each} a generator",
                    thousands(cycle)
                );
                if each > MOST {
                    eprintln!("more than {MOST} a generator");
                    return ExitCode::FAILURE;
                }
            }
            Err(output) => {
                eprintln!("{generators} step generators: callgrind counted nothing:\n{output}");
                return ExitCode::FAILURE;
            }
        }
    }
    ExitCode::SUCCESS
}

/// Registers that a cycle of a machine reads and writes.
fn accesses(machine: &str) -> (u32, u32) {
    let driver = start(machine);
    let lists = driver.lists();
    let count = |list: &AccessList| {
        let accesses = list.as_ref().iter();
        accesses.map(|access| u32::from(access.count)).sum()
    };
    (count(lists.read), count(lists.write))
}

/// A machine that answers from memory.
fn start(machine: &str) -> Driver<Frozen> {
    match machine {
        "three" => frozen(three_remotes(), 3),
        count => {
            let count = count.parse().expect("a number of field I/O cards");
            frozen(field_cards(count), count)
        }
    }
}

/// Instructions of one cycle with step generators, and those of each generator.
fn count_generators(generators: u64) -> Result<(u64, u64), String> {
    let with = count(&format!("{STEPPING}{generators}"))?;
    let without = count(&format!("{STANDING}{generators}"))?;
    Ok((with, with.saturating_sub(without).div_ceil(generators)))
}

/// Instructions of one cycle of a machine; the output of callgrind if it contains no count.
fn count(machine: &str) -> Result<u64, String> {
    let itself = env::current_exe().map_err(|error| error.to_string())?;
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .args([
            "--collect-atstart=no",
            "--toggle-collect=instructions::counted_cycle*",
        ])
        .arg(itself)
        .args([COUNTED, machine])
        .stdout(Stdio::null())
        .output()
        .map_err(|error| error.to_string())?;
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    // `==123== Collected : 3640200`
    let collected = text
        .lines()
        .find_map(|line| line.split_once("Collected :"))
        .and_then(|(_, number)| number.trim().parse::<u64>().ok());
    match collected {
        Some(collected) if output.status.success() && collected > 0 => Ok(collected / CYCLES),
        _ => Err(text),
    }
}

/// Formats a number with a comma before each group of three digits.
fn thousands(number: u64) -> String {
    if number < 1000 {
        return number.to_string();
    }
    format!("{},{:03}", thousands(number / 1000), number % 1000)
}

/// Runs a machine for the number of cycles that are counted.
fn run(machine: &str) {
    if let Some(generators) = machine.strip_prefix(STEPPING) {
        return step(generators, Settings::default());
    }
    if let Some(generators) = machine.strip_prefix(STANDING) {
        let instances = [(Gtag::STEPGEN, 0)].into();
        return step(
            generators,
            Settings {
                instances,
                ..Settings::default()
            },
        );
    }
    let mut driver = start(machine);
    let analog: Vec<Output<f64>> = (0..6)
        .filter_map(|n| {
            let name = format!("hm2_7i92.0.7i77.0.1.analogout{n}");
            driver.pins().output(&name).ok()
        })
        .collect();
    assert_eq!(analog.len(), if machine == "three" { 6 } else { 0 });
    let set = |driver: &mut Driver<Frozen>, round: u64| {
        for (n, &output) in analog.iter().enumerate() {
            let volts = ((round + n as u64) % 20) as f64 - 9.5;
            driver.pins_mut().set(output, volts);
        }
    };
    let remotes: u32 = machine.parse().unwrap_or(3);
    driver.bus_mut().written = Some(Vec::new());
    let mut written = |round| {
        set(&mut driver, round);
        assert_eq!(cycle(&mut driver), remotes, "the remotes answer");
        driver.bus_mut().written.clone()
    };
    assert_eq!(
        written(1) != written(2),
        !analog.is_empty(),
        "outputs arrive"
    );
    driver.bus_mut().written = None;
    for round in 0..CYCLES {
        set(&mut driver, round);
        assert_eq!(counted_cycle(&mut driver), remotes);
    }
}

/// Runs a machine whose step generators, if the settings leave any, follow a command that
/// accelerates and brakes. Each is where the command was a period ago.
fn step(generators: &str, settings: Settings) {
    let generators: u8 = generators.parse().expect("a number of step generators");
    let is_used = settings.instances.is_empty();
    let mut driver = frozen_with(step_generators(generators / 5), 0, settings);
    let module = driver.modules::<Stepgens>().next();
    let pins: Vec<StepgenPins> = module.map_or_else(Vec::new, |module| module.pins().collect());
    assert_eq!(pins.len(), usize::from(generators) * usize::from(is_used));
    let to = driver.pins_mut();
    for pins in &pins {
        to.set_param(pins.position_scale, SCALE).expect("a scale");
        to.set_param(pins.steplen, 2_000).expect("a time");
        to.set_param(pins.stepspace, 2_000).expect("a time");
        to.set_param(pins.maxaccel, 30.0).expect("a limit");
        to.set(pins.enable, true);
    }
    let mut before = 0.0;
    for round in 0..SETTLING + CYCLES {
        for (register, pins) in (0x2100..).step_by(4).zip(&pins) {
            let accumulator = (before * SCALE * 65_536.0) as i64;
            driver.bus_mut().set_answer(register, accumulator as u32);
            driver.pins_mut().set(pins.position_cmd, wave(round));
        }
        before = wave(round);
        if round < SETTLING {
            assert_eq!(cycle(&mut driver), 0);
        } else {
            assert_eq!(counted_cycle(&mut driver), 0);
        }
    }
    // They have followed all the time, and move.
    for pins in &pins {
        assert!(driver.pins().read(pins.velocity_fb).value.abs() > 0.1);
        assert!(driver.pins().read(pins.position_lag).value.abs() < 0.01);
    }
}

const SCALE: f64 = 1_000.0;
/// Cycles until a generator has its times and follows its command.
const SETTLING: u64 = 100;

/// A command that moves at up to 2 units/s, with at most 20 units/s².
fn wave(round: u64) -> f64 {
    0.2 * (1.0 - (round as f64 * 0.01).cos())
}

/// The function whose instructions are counted.
#[inline(never)]
fn counted_cycle(driver: &mut Driver<Frozen>) -> u32 {
    cycle(driver)
}

/// Runs a cycle; returns the number of remotes with new, valid data.
fn cycle(driver: &mut Driver<Frozen>) -> u32 {
    let report = driver.read().expect("the bus always answers");
    assert!(report.is_good(), "{report:?}");
    driver.write().expect("the bus always answers");
    report.good
}
