//! The simulator's own speed: time for a second of a 1 kHz machine with three remotes.

#![allow(missing_docs, reason = "the macros of criterion write public items")]

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use cycle_support::three_remotes;
use mesa_hal::Settings;
use mesa_hal::bus::Clock;
use mesa_hal::driver::Driver;
use mesa_hal_sim::SimFpga;

const CYCLES: u64 = 1000;

fn second(driver: &mut Driver<SimFpga>) {
    for _ in 0..CYCLES {
        let _ = black_box(driver.read());
        let _ = black_box(driver.write());
        driver.bus_mut().wait(Duration::from_micros(980));
    }
}

fn simulator(criterion: &mut Criterion) {
    let mut driver = Driver::start(three_remotes(), Settings::default()).expect("complete");
    second(&mut driver);
    let start = Instant::now();
    second(&mut driver);
    let took = start.elapsed();
    println!(
        "one second of three remotes at 1 kHz takes {took:?}: {:.0} times real time",
        1.0 / took.as_secs_f64()
    );
    let mut group = criterion.benchmark_group("simulator");
    group.sample_size(10);
    group.throughput(Throughput::Elements(CYCLES));
    group.bench_function("second of three remotes at 1 kHz", |bencher| {
        bencher.iter(|| second(&mut driver));
    });
    let mut idle = three_remotes();
    group.bench_function("second of an idle board", |bencher| {
        bencher.iter(|| idle.wait(Duration::from_secs(1)));
    });
    group.finish();
}

criterion_group!(benches, simulator);
criterion_main!(benches);
