//! PWM generators of module version 1: the fraction of a value is added up at the end of each
//! period, and its carry is added to the duty without saturation. Source: Mesa's VHDL
//! (`dpwmpdmgenh`), see FACTS 13.5.

use mesa_hal_sim::{SimFpga, gtag, machines};

const DOUBLE_BUFFERED: u32 = 1 << 5;
const DITHER: u32 = 1 << 6;
/// Master rate: the PWM clock is half of 200 MHz.
const RATE: u32 = 0x8000;
/// 4094 and 15/16.
const LAST: u32 = 0x0FFE_F000;
/// 4095.
const FULL: u32 = 0x0FFF_0000;

/// Generator 0 of a 7I97 with a module version and this number of bits.
struct Bench {
    fpga: SimFpga,
    base: u16,
    period: u64,
}

impl Bench {
    fn new(version: u8, bits: u32) -> Self {
        let mut firmware = machines::firmware_7i97(1);
        let module = firmware.module_mut(gtag::PWM).expect("PWM");
        module.version = version;
        let base = module.base;
        let mut fpga = SimFpga::new(firmware);
        fpga.write_register(0x1200, 1);
        fpga.write_register(0x1100, 1);
        fpga.write_register(base + 0x200, RATE);
        fpga.write_register(base + 0x100, (bits - 9) | DOUBLE_BUFFERED | DITHER);
        Self {
            fpga,
            base,
            period: 10 << bits,
        }
    }

    fn wait(&mut self, nanos: u64) {
        let to = self.fpga.now() + nanos;
        self.fpga.advance_to(to);
    }

    fn set(&mut self, value: u32) {
        self.fpga.write_register(self.base, value);
    }

    /// Nanoseconds in which the pin is high in the next periods, in steps of 5 ns.
    fn high(&mut self, periods: u64) -> u64 {
        let steps = (0..periods * self.period / 5).filter(|_| {
            self.wait(5);
            self.fpga.pin_level(0)
        });
        steps.count() as u64 * 5
    }

    /// The voltage of the analog output, sampled through the next periods: least and greatest.
    fn volts(&mut self, periods: u64) -> [f64; 2] {
        let mut seen = [f64::MAX, f64::MIN];
        for _ in 0..periods * 64 {
            self.wait(self.period / 64);
            let volts = self.fpga.analog_output(0).volts;
            seen = [seen[0].min(volts), seen[1].max(volts)];
        }
        seen
    }
}

/// Time after a step for which the pin is low, in periods.
fn wrapped(bits: u32, [from, to]: [u32; 2], wait: u64) -> f64 {
    let mut bench = Bench::new(1, bits);
    bench.set(from);
    bench.wait(20 * bench.period + wait);
    bench.set(to);
    let periods = 6;
    let low = periods * bench.period - bench.high(periods);
    low as f64 / bench.period as f64
}

#[test]
fn step_to_full_scale_has_one_period_of_0_with_12_bits_only() {
    // At any point of a period, and in any period.
    for step in 0..8 {
        let wait = step * 47_000 + 300;
        let low = wrapped(12, [LAST, FULL], wait);
        assert!((0.99..1.01).contains(&low), "step {step}: {low} periods");
        for bits in [10, 11] {
            let one = 1 << bits << 16;
            let values = [one - 0x1_1000, one - 0x1_0000];
            let low = wrapped(bits, values, wait);
            assert!(low < 0.01, "{bits} bits, step {step}: {low} periods");
        }
        // To the greatest value at which the carry has room.
        let low = wrapped(12, [LAST - 0x1000, LAST], wait);
        assert!(low < 0.01, "step {step}: {low} periods");
    }
}

#[test]
fn voltage_shows_that_period_and_no_other() {
    let mut bench = Bench::new(1, 12);
    bench.set(LAST);
    bench.wait(20 * bench.period);
    bench.set(FULL);
    let [least, _] = bench.volts(3);
    assert!((least + 10.0).abs() < 1e-9, "{least} V");
    let [least, most] = bench.volts(20);
    assert!(least > 9.99 && most < 10.0, "{least} to {most} V");
}

#[test]
fn fractions_are_met_on_average_and_version_0_has_none() {
    for (version, fraction) in [(1, 0x4000), (1, 0x0800), (0, 0x4000)] {
        let mut bench = Bench::new(version, 10);
        bench.set(0x0100_0000 | fraction);
        bench.wait(5 * bench.period);
        let periods = 64;
        let high = bench.high(periods) as f64 / (periods * bench.period) as f64 * 1024.0;
        let added = if version == 1 {
            f64::from(fraction) / 65_536.0
        } else {
            0.0
        };
        assert!(
            (high - 256.0 - added).abs() < 0.02,
            "version {version}: {high} of 1024"
        );
        let duty = (bench.fpga.analog_output(0).volts / 20.0 + 0.5) * 1024.0;
        assert!((duty - 256.0 - added).abs() < 1e-9, "{duty}");
    }
}
