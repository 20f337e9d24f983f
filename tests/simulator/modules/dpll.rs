//! The phase-locked loop.

use super::{MS, wait};
use mesa_hal::sim::{SimFpga, machines};

/// A DPLL set up for 1 kHz by the formulas of FACTS 13.8, with the limit and time constant given.
fn dpll_at_1_khz(limit: u32, time_constant: u32) -> SimFpga {
    let mut fpga = machines::i7i97(1);
    assert_eq!(fpga.read_register(0x7300) & 0xFF, 42);
    let prescale = ((1u64 << 30) as f64 * 100e6 / (2f64.powi(42) * 1000.0)) as u32;
    let base = (1000.0 * 2f64.powi(42) * f64::from(prescale) / 100e6) as u32;
    fpga.write_register(0x7000, base);
    fpga.write_register(0x7200, prescale << 24 | limit);
    fpga.write_register(0x7300, time_constant << 16);
    let period = fpga.dpll().expect("DPLL").period().expect("runs");
    assert!((period - 1e6).abs() < 1.0);
    wait(&mut fpga, MS);
    fpga
}

fn fraction(word: u32) -> f64 {
    f64::from(word as i32) / 4_294_967_296.0
}

#[test]
fn dpll_follows_the_cycle_of_its_host_and_says_how_late_it_is() {
    let mut fpga = dpll_at_1_khz(0x0040_0000, 0xA000);
    fpga.write_register(0x7100, 0);
    wait(&mut fpga, 10 * MS + 100_000);
    let first = fraction(fpga.read_register(0x7600));
    assert!((first - 0.1).abs() < 0.001, "100 us late: {first}");
    // It rings, with two seconds a period: FACTS 12.4.
    let mut crossed = None;
    let mut error = first;
    for n in 0..3_000 {
        wait(&mut fpga, MS);
        error = fraction(fpga.read_register(0x7600));
        if error < 0.0 && crossed.is_none() {
            crossed = Some(n);
        }
    }
    assert!(
        crossed.is_some_and(|n| (400..600).contains(&n)),
        "{crossed:?}"
    );
    assert!(error.abs() < 0.03, "{error}");
}

#[test]
fn a_timer_rises_before_the_reference_by_its_register() {
    // Nobody syncs, so that it runs free.
    let mut fpga = dpll_at_1_khz(0x0040_0000, 0xA000);
    fpga.write_register(0x7100, 0);
    fpga.write_register(0x7400, 0xE666_1999);
    let begin = fpga.now();
    let edge = |timer: u8| {
        let dpll = fpga.dpll().expect("a DPLL");
        dpll.next_edge(begin + 5 * MS / 2, timer).expect("it runs") - begin
    };
    let near = |edge: u64, expected: u64| assert!(edge.abs_diff(expected) < 2_000, "{edge}");
    near(edge(0), 3_000_000);
    near(edge(1), 2_900_000);
    near(edge(2), 3_100_000);
}
