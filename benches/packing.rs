//! Packing alone: between interface registers and pins, for each kind of remote.

#![allow(missing_docs, reason = "the macros of criterion write public items")]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use cycle_support::three_remotes;
use mesa_hal::RemoteId;
use mesa_hal::Settings;
use mesa_hal::discovery::PackingPlan;
use mesa_hal::driver::Driver;
use mesa_hal::hal::PinStore;
use mesa_hal::remote::RemotePins;

fn packing(criterion: &mut Criterion) {
    let driver = Driver::start(three_remotes(), Settings::default()).expect("complete");
    let mut group = criterion.benchmark_group("packing");
    for remote in driver.ports()[0].remotes() {
        let id = RemoteId::new(0, remote.started.channel.index());
        let mut pins = PinStore::default();
        let descriptor = remote.descriptor;
        let plan = PackingPlan::new(descriptor, 3).expect("a plan");
        let mut of =
            RemotePins::new(&mut pins, "bench.0", id, descriptor, &plan, None).expect("pins");
        let mut words = [0x0F0F_1234; 7];
        let bits = plan.input_bits + plan.output_bits;
        group.throughput(Throughput::Elements(bits.into()));
        let name = remote.started.to_string();
        group.bench_function(BenchmarkId::new("take_inputs", &name), |bencher| {
            bencher.iter(|| of.take_inputs(&mut pins, black_box(&words)));
        });
        group.bench_function(BenchmarkId::new("put_outputs", &name), |bencher| {
            bencher.iter(|| of.put_outputs(&mut pins, black_box(&mut words)));
        });
    }
    group.finish();
}

criterion_group!(benches, packing);
criterion_main!(benches);
