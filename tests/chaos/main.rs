//! The chaos machine: arbitrary faults at arbitrary times, checked by an oracle that has access to
//! the simulator's true state.
//!
//! A scenario follows from its seed: a machine, a bus to it, an application with its habits, and
//! one to three faults. The promises to be kept are in `docs/faults.md`. `CHAOS_SCENARIOS` is the
//! number of scenarios, `CHAOS_SEED` the first seed; a failure is printed with its seed and its
//! story, and `CHAOS_SEED=<that> CHAOS_SCENARIOS=1` repeats it exactly. `CHAOS_UNTIL=<promise>`
//! ends with the first scenario that breaks this promise. Without `CHAOS_SEED`, the seeds that have
//! found an error once run as well.

mod application;
#[path = "../common/mod.rs"]
mod common;
mod journal;
mod machine;
mod network;
mod oracle;
mod plan;
mod report;
mod scenario;
mod stage;

use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use plan::Plan;
use report::Report;

/// Number of scenarios without `CHAOS_SCENARIOS`, limited by the time of `cargo test`.
const FEW: u64 = 120;
/// Number of scenarios from which on every kind of fault has to occur.
const MANY: u64 = 5_000;
const THREADS: usize = 2;
/// Seeds that have found an error of the driver, or of the oracle.
const KNOWN: [u64; 34] = [
    1_022_210,
    1_022_005,
    740_144,
    760_286,
    800_223,
    801_360,
    803_780,
    805_161,
    903_041,
    904_254,
    911_724,
    920_930,
    408_637_362_024,
    441_773_812_818,
    484_449_308_038,
    982_217_910_351,
    1_050_550_695_579,
    8_000_000_005_658,
    8_000_000_085_614,
    8_300_000_027_426,
    8_500_000_028_226,
    8_600_000_028_765,
    8_600_000_104_476,
    8_800_000_009_361,
    8_800_000_030_884,
    8_801_000_118_232,
    8_801_000_123_372,
    8_801_000_146_885,
    8_900_000_107_945,
    8_900_000_180_588,
    8_900_000_186_707,
    8_900_000_191_165,
    9_400_000_000_590,
    9_500_000_112_075,
];

fn main() -> ExitCode {
    if !is_asked_for() {
        return ExitCode::SUCCESS;
    }
    let (first, count) = (number("CHAOS_SEED", 1), number("CHAOS_SCENARIOS", FEW));
    let until = std::env::var("CHAOS_UNTIL").ok();
    println!("\nchaos: {count} scenarios from seed {first} on");
    let asked = std::env::var_os("CHAOS_SEED").is_some();
    let known: &[u64] = if asked { &[] } else { &KNOWN };
    let count = count + known.len() as u64;
    std::panic::set_hook(Box::new(|_| {}));
    let report = Mutex::new(Report::default());
    let next = AtomicU64::new(0);
    std::thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                loop {
                    let n = next.fetch_add(1, Ordering::Relaxed);
                    if n >= count {
                        break;
                    }
                    let seed = usize::try_from(n).ok().and_then(|n| known.get(n));
                    let following = n.saturating_sub(known.len() as u64);
                    let seed = seed.copied().unwrap_or(first.wrapping_add(following));
                    let one = Report::of(&Plan::new(seed));
                    if until.as_deref().is_some_and(|promise| one.breaks(promise)) {
                        next.store(count, Ordering::Relaxed);
                    }
                    report.lock().expect("no scenario panics").add(one);
                }
            });
        }
    });
    let report = report.into_inner().expect("no scenario panics");
    let is_good = report.print(count >= MANY);
    if is_good {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

fn number(name: &str, otherwise: u64) -> u64 {
    let text = std::env::var(name).ok();
    text.map_or(otherwise, |text| text.trim().parse().expect("a number"))
}

/// Interprets the arguments that `cargo test` passes to every test program: a list, or filters of
/// test names. This program is one test, called `chaos`.
fn is_asked_for() -> bool {
    let mut filters = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--list" => {
                println!("chaos: test\n\n1 test, 0 benchmarks");
                return false;
            }
            "--ignored" => return false,
            "--skip" => {
                if arguments
                    .next()
                    .is_some_and(|skipped| "chaos".contains(&skipped))
                {
                    return false;
                }
            }
            "--test-threads" | "--format" | "--color" | "--logfile" | "-Z" => {
                arguments.next();
            }
            option if option.starts_with('-') => {}
            filter => filters.push(filter.to_owned()),
        }
    }
    filters.is_empty()
        || filters
            .iter()
            .any(|filter| "chaos".contains(filter.as_str()))
}
