//! Filters of the simulated encoders: gated index, polarity, probe and live bits, see FACTS 12.12.
//! The comparison with recordings is in `tests/module_conformance`.

use mesa_hal_sim::{SimFpga, SimPinDescriptor, gtag, machines};

/// Control bits.
const GATE: u32 = 1 << 7;
const JUST_ONCE: u32 = 1 << 6;
const LATCH_ON_INDEX: u32 = 1 << 4;
const INDEX_POLARITY: u32 = 1 << 3;
const AB_POLARITY: u32 = 1 << 14;
const LATCH_ON_PROBE: u32 = 1 << 13;
const PROBE_POLARITY: u32 = 1 << 12;
const UP_DOWN: u32 = 1 << 10;
const QUADRATURE_ERROR: u32 = 1 << 15;
/// Live index bit.
const INDEX: u32 = 1 << 2;

/// The pin of the probe.
const PROBE: usize = 40;

/// Encoders of a kind, with a probe, in an FPGA on which an access takes no time.
struct Bench {
    fpga: SimFpga,
    base: u16,
}

impl Bench {
    fn new(tag: u8) -> Self {
        let mut firmware = machines::firmware_7i97(1);
        // The divider of Mesa's newer sources: a tick of the filters every 260 ns.
        firmware.mux_rate = 11;
        let module = firmware.module_mut(gtag::MUXED_ENCODER).expect("encoders");
        (module.gtag, module.registers) = (tag, 6);
        let base = module.base;
        firmware.pins[PROBE] = SimPinDescriptor::new(tag, 0, 0x05);
        let mut fpga = SimFpga::new(firmware);
        fpga.set_access_cost(0);
        // The select line of the multiplexer: alternate source and direction.
        fpga.write_register(0x1204, 1 << 1);
        fpga.write_register(0x1104, 1 << 1);
        let mut bench = Self { fpga, base };
        bench.lines([false; 3]);
        bench.wait(20_000);
        bench
    }

    fn wait(&mut self, nanos: u64) {
        let to = self.fpga.now() + nanos;
        self.fpga.advance_to(to);
    }

    fn lines(&mut self, abz: [bool; 3]) {
        let now = self.fpga.now();
        let bank = self.fpga.encoders().expect("encoders");
        bank.set_lines(now, 0, abz);
    }

    fn count(&mut self) -> u16 {
        self.fpga.read_register(self.base) as u16
    }

    fn control(&mut self) -> u32 {
        self.fpga.read_register(self.base + 0x100)
    }

    fn set_control(&mut self, word: u32) {
        self.fpga.write_register(self.base + 0x100, word);
    }

    /// True if an armed latch has been triggered.
    fn is_caught(&mut self) -> bool {
        self.control() & (LATCH_ON_INDEX | LATCH_ON_PROBE) == 0
    }
}

/// The kinds, with the period of their filters' ticks in nanoseconds.
const KINDS: [(u8, u64); 2] = [(gtag::ENCODER, 60), (gtag::MUXED_ENCODER, 260)];

#[test]
fn index_overlapping_its_gate_under_three_samples_is_ignored() {
    for (tag, tick) in KINDS {
        for (overlap, caught) in [(tick * 3 / 2, false), (tick * 5, true)] {
            let mut bench = Bench::new(tag);
            bench.set_control(GATE | AB_POLARITY | INDEX_POLARITY | LATCH_ON_INDEX | JUST_ONCE);
            bench.wait(20_000);
            // Index and gate each last long, but overlap only briefly.
            bench.lines([false, false, true]);
            bench.wait(20_000);
            bench.lines([true, true, true]);
            bench.wait(overlap);
            bench.lines([true, true, false]);
            bench.wait(20_000);
            assert_eq!(bench.is_caught(), caught, "{tag:#x}, {overlap} ns");
        }
    }
}

#[test]
fn new_polarity_of_the_index_goes_through_the_filter() {
    for (tag, tick) in KINDS {
        let mut bench = Bench::new(tag);
        bench.set_control(INDEX_POLARITY);
        bench.wait(20_000);
        assert_eq!(bench.control() & INDEX, 0);
        bench.set_control(LATCH_ON_INDEX | JUST_ONCE);
        bench.wait(tick * 3);
        assert_eq!(bench.control() & INDEX, 0, "{tag:#x}");
        assert!(!bench.is_caught(), "{tag:#x}");
        bench.wait(tick * 3);
        assert_eq!(bench.control() & INDEX, INDEX, "{tag:#x}");
        assert!(bench.is_caught(), "{tag:#x}");
    }
}

#[test]
fn probe_pulse_shorter_than_its_filter_does_not_latch() {
    for (tag, tick) in KINDS {
        for (pulse, caught) in [(50, false), (tick * 2, false), (tick * 5, true)] {
            let mut bench = Bench::new(tag);
            bench.fpga.drive_pin(PROBE, Some(false));
            bench.wait(20_000);
            bench.set_control(LATCH_ON_PROBE | PROBE_POLARITY | JUST_ONCE);
            bench.fpga.drive_pin(PROBE, Some(true));
            bench.wait(pulse);
            bench.fpga.drive_pin(PROBE, Some(false));
            bench.wait(20_000);
            assert_eq!(bench.is_caught(), caught, "{tag:#x}, {pulse} ns");
        }
    }
}

#[test]
fn live_bits_change_with_the_count_not_with_a_full_filter() {
    for (tag, tick) in KINDS {
        let mut bench = Bench::new(tag);
        bench.lines([true, false, false]);
        let start = bench.fpga.now();
        let mut seen = [0, 0];
        while seen.contains(&0) {
            bench.wait(10);
            let now = bench.fpga.now() - start;
            let shown = [bench.control() & 1 == 1, bench.count() == 1];
            for (seen, shown) in seen.iter_mut().zip(shown) {
                if shown && *seen == 0 {
                    *seen = now;
                }
            }
            assert!(now < 10 * tick, "{tag:#x}: {seen:?}");
        }
        // The registers that are read show the live bit a clock before the count.
        assert_eq!(seen[1] - seen[0], 10, "{tag:#x}");
        assert!(seen[1] > 3 * tick, "{tag:#x}: {seen:?}");
    }
}

#[test]
fn up_down_mode_counts_by_the_earlier_b_without_any_error() {
    for (tag, _) in KINDS {
        let mut bench = Bench::new(tag);
        bench.set_control(UP_DOWN);
        let mut counted = 0_u16;
        for (before, step) in [(false, -1), (true, 1), (true, 1), (false, -1)] {
            bench.lines([false, before, false]);
            bench.wait(20_000);
            bench.lines([true, !before, false]);
            bench.wait(20_000);
            counted = counted.wrapping_add_signed(step);
            assert_eq!(bench.count(), counted, "{tag:#x}: B {before}");
        }
        assert_eq!(bench.control() & QUADRATURE_ERROR, 0, "{tag:#x}");
    }
}
