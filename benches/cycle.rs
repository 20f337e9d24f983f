//! The DOIT cycle: host time of `read` and `write` on a bus without cost, with 1, 2, 8 and 32
//! remotes, and the delay from a `write` to the start of the remotes' frames.
//!
//! The cost must grow in proportion to the words of process data, and not faster: the ratio is
//! printed. The delay from the call of `write` to a frame consists of the host's share (`write ns`,
//! measured), the way to the board (not included), and the gateware's share (`DOIT to frame`,
//! simulated after recordings of it).

#![allow(missing_docs, reason = "the macros of criterion write public items")]

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use cycle_support::{field_cards, from_doit_to_frames, frozen_driver, process_data_words};
use mesa_hal::Settings;
use mesa_hal::driver::Driver;

const REMOTES: [usize; 4] = [1, 2, 8, 32];

fn cycle(criterion: &mut Criterion) {
    print_ratio();
    let mut group = criterion.benchmark_group("cycle");
    for count in REMOTES {
        let mut driver = frozen_driver(count);
        let words = process_data_words(&driver) as u64;
        group.throughput(Throughput::Elements(words));
        group.bench_function(BenchmarkId::new("read and write", count), |bencher| {
            bencher.iter(|| {
                let report = driver.read();
                // New data are taken from a read only after a write.
                let _ = driver.write();
                black_box(report.is_ok())
            });
        });
    }
    group.finish();
}

fn plan(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("plan");
    group.sample_size(10);
    for count in REMOTES {
        group.bench_function(BenchmarkId::new("build", count), |bencher| {
            bencher.iter(|| {
                let driver = Driver::start(field_cards(count), Settings::default());
                black_box(driver.is_ok())
            });
        });
    }
    group.finish();
}

/// Nanoseconds for a read and a write, the best of several runs.
fn nanos(count: usize) -> (f64, f64, usize) {
    let mut driver = frozen_driver(count);
    let words = process_data_words(&driver);
    let mut best = (f64::MAX, f64::MAX);
    for _ in 0..20 {
        let (mut reading, mut writing) = (Duration::ZERO, Duration::ZERO);
        let runs = 500;
        for _ in 0..runs {
            let start = Instant::now();
            let report = driver.read().expect("read");
            reading += start.elapsed();
            assert_eq!(report.good as usize, count);
            let start = Instant::now();
            driver.write().expect("write");
            writing += start.elapsed();
        }
        let per = |time: Duration| time.as_secs_f64() * 1e9 / f64::from(runs);
        best = (best.0.min(per(reading)), best.1.min(per(writing)));
    }
    (best.0, best.1, words)
}

fn print_ratio() {
    println!("remotes  words  read ns  write ns  ns/word  of one  DOIT to frame us");
    let mut one = None;
    for count in REMOTES {
        let (read, write, words) = nanos(count);
        let each = (read + write) / words as f64;
        let ratio = each / *one.get_or_insert(each);
        let (first, last) = from_doit_to_frames(count);
        let [first, last] = [first, last].map(|nanos| nanos as f64 / 1e3);
        println!(
            "{count:>7} {words:>6} {read:>8.0} {write:>9.0} {each:>8.1} {ratio:>7.2}  \
             {first:.1} to {last:.1}"
        );
    }
    println!("of one: the cost of a word beside that with one remote; 1.00 is in proportion");
}

criterion_group!(benches, cycle, plan);
criterion_main!(benches);
