//! Discovery: register accesses for each remote, and the cost for the host.

#![allow(missing_docs, reason = "the macros of criterion write public items")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use cycle_support::three_remotes;
use mesa_hal::Settings;
use mesa_hal::discovery::{Discovery, DiscoveryOptions, discover_port};
use mesa_hal::driver::Driver;
use mesa_hal::hostmot2::{Gtag, HostMot2, IoPorts};
use mesa_hal::sslbp::{Channel, Port, PortLayout};
use mesa_hal_sim::SimFpga;

/// A port whose pins are set up.
fn located(fpga: &mut SimFpga) -> Port {
    let firmware = HostMot2::identify(fpga).expect("HostMot2");
    let layout = PortLayout::locate(&firmware, 0).expect("layout");
    let mut ports = IoPorts::locate(&firmware).expect("I/O ports");
    let pins = ports.use_module(&firmware, Gtag::SSERIAL, 0, |_| true);
    pins.expect("pins");
    ports.apply(fpga).expect("set-up");
    Port::new(layout)
}

fn discovered(fpga: &mut SimFpga, port: &mut Port, channels: &[(Channel, u8)]) -> Vec<Discovery> {
    port.on(fpga).reset().expect("reset");
    let found = discover_port(port, fpga, channels, &DiscoveryOptions::default());
    found.expect("discovery").into_iter().flatten().collect()
}

fn discovery(criterion: &mut Criterion) {
    let mut fpga = three_remotes();
    let mut port = located(&mut fpga);
    for channel in Channel::ALL.into_iter().take(3) {
        let one = [(channel, 0)];
        let before = fpga.counters();
        let found = discovered(&mut fpga, &mut port, &one);
        let after = fpga.counters();
        let found = found.first().expect("remote");
        println!(
            "{}: {} accesses to its memory; {} registers read and {} written in all, start included",
            found.started,
            found.accesses,
            after.reads - before.reads,
            after.writes - before.writes
        );
    }
    let all: Vec<_> = Channel::ALL
        .into_iter()
        .take(3)
        .map(|channel| (channel, 0))
        .collect();
    let mut group = criterion.benchmark_group("discovery");
    group.sample_size(10);
    group.bench_function("three remotes", |bencher| {
        bencher.iter(|| black_box(discovered(&mut fpga, &mut port, &all).len()));
    });
    group.bench_function("driver of three remotes, built and dropped", |bencher| {
        bencher.iter(|| black_box(Driver::start(three_remotes(), Settings::default()).is_ok()));
    });
    group.finish();
}

criterion_group!(benches, discovery);
criterion_main!(benches);
