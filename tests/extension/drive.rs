//! An external module drives simulated motors: its own registers, its own analog outputs, its own
//! enable pin, and a ramp that it generates by itself.

use mesa_hal_sim::wire::Nanos;
use mesa_hal_sim::{
    AxisWiring, Configuration, DriveSignal, DriveSource, Fabric, Motor, MotorConfig, PinSource,
    SimFpga, SimIoPorts, SimModule, SimModuleDescriptor, SimPinDescriptor, machines,
};

/// The firmware's number for the module, and the base address of its registers.
const DAC: u8 = 0x9A;
const BASE: u16 = 0xA000;
/// Volts of an output in 1/1000; for each instance.
const MILLIVOLTS: u16 = BASE;
/// The time in us after which an output goes to 0 by itself; 0 is never.
const TIMEOUT: u16 = BASE + 0x100;
/// The I/O pin that enables the drives of all outputs, and its bit in port 1.
const ENABLE: usize = 20;
const ENABLE_BIT: u32 = 1 << (ENABLE - 17);

const MS: Nanos = 1_000_000;

/// Two analog outputs, which are enabled by a pin that the module drives high.
#[derive(Debug, Default)]
struct Dac {
    millivolts: [i32; 2],
    ends: [Option<Nanos>; 2],
    timeout: Nanos,
}

impl Dac {
    fn volts(&self, now: Nanos, output: usize) -> f64 {
        let is_over = self.ends[output].is_some_and(|end| end <= now);
        if is_over {
            return 0.0;
        }
        f64::from(self.millivolts[output]) / 1000.0
    }
}

impl SimModule for Dac {
    fn read(&mut self, _: &Fabric, _: u8, instance: u8) -> u32 {
        self.millivolts[usize::from(instance)] as u32
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, instance: u8, value: u32) {
        let output = usize::from(instance);
        if register == 1 {
            self.timeout = Nanos::from(value) * 1_000;
            return;
        }
        self.millivolts[output] = value as i32;
        self.ends[output] = (self.timeout > 0).then_some(fabric.now() + self.timeout);
    }

    fn reload(&mut self, _: &Configuration<'_>) {
        *self = Self::default();
    }

    fn drive_signal(&self, now: Nanos, output: u8, io: &SimIoPorts) -> DriveSignal {
        DriveSignal {
            volts: self.volts(now, output.into()),
            enabled: match io.source(Some(ENABLE)) {
                PinSource::Module { inverted } => !inverted,
                PinSource::Level(level) => level,
                PinSource::Undriven => false,
            },
        }
    }

    fn next_event(&self, now: Nanos) -> Option<Nanos> {
        let ends = self.ends.iter().flatten().copied();
        ends.filter(|&end| end > now).min()
    }
}

/// A 7I92 whose gateware has the module, and a motor of 1000 counts/s per volt on each of its
/// outputs, at encoders 0 and 1.
fn machine() -> SimFpga {
    let mut firmware = machines::firmware_7i92_7i77();
    let descriptor = SimModuleDescriptor {
        gtag: DAC,
        instances: 2,
        base: BASE,
        registers: 2,
        multiple: 0x01,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.push(descriptor);
    firmware.pins[ENABLE] = SimPinDescriptor::new(DAC, 0, 0x81);
    let mut fpga = SimFpga::new(firmware);
    fpga.add_module(DAC, Box::new(Dac::default()));
    for output in 0..2 {
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Module { gtag: DAC, output },
            encoder: output.into(),
            motor: motor(),
        });
    }
    fpga
}

fn motor() -> Motor {
    let config = MotorConfig {
        counts_per_unit: 1000.0,
        // One unit per second for each volt, without delay.
        max_speed: 10.0,
        full_scale: 10.0,
        time_constant: 0.0,
        friction: 0.0,
        ..MotorConfig::default()
    };
    Motor::new(config).expect("a motor")
}

/// Lets the module drive its pin.
fn enable(fpga: &mut SimFpga) {
    fpga.write_register(0x1204, ENABLE_BIT);
    fpga.write_register(0x1104, ENABLE_BIT);
}

fn wait(fpga: &mut SimFpga, nanos: Nanos) {
    let to = fpga.now() + nanos;
    fpga.advance_to(to);
}

/// Counts that the motors move in a time.
fn moved(fpga: &mut SimFpga, nanos: Nanos) -> [f64; 2] {
    let before = [0, 1].map(|axis| counts(fpga, axis));
    wait(fpga, nanos);
    [0, 1].map(|axis| counts(fpga, axis) - before[axis])
}

fn counts(fpga: &mut SimFpga, axis: usize) -> f64 {
    fpga.motor(axis).expect("an axis").counts()
}

fn assert_near(found: [f64; 2], expected: [f64; 2]) {
    let differs = found.iter().zip(expected).any(|(a, b)| (a - b).abs() > 2.0);
    assert!(!differs, "{found:?}, expected {expected:?}");
}

#[test]
fn each_output_of_a_module_from_outside_turns_its_own_motor() {
    let mut fpga = machine();
    fpga.write_register(MILLIVOLTS, 2_000);
    fpga.write_register(MILLIVOLTS + 4, -5_000_i32 as u32);
    assert_near(moved(&mut fpga, 100 * MS), [0.0, 0.0]);
    enable(&mut fpga);
    assert_near(moved(&mut fpga, 100 * MS), [200.0, -500.0]);
    let signal = fpga.drive_signal(1).expect("an axis");
    assert_eq!((signal.volts, signal.enabled), (-5.0, true));
    // The encoder of the motor has counted.
    let counted = fpga.encoders().expect("encoders").lines(0);
    wait(&mut fpga, 3 * MS / 2);
    assert_ne!(fpga.encoders().expect("encoders").lines(0), counted);
    // A write between two looks takes effect immediately.
    fpga.write_register(MILLIVOLTS, 0);
    assert_near(moved(&mut fpga, 10 * MS), [0.0, -50.0]);
}

#[test]
fn watchdog_and_reload_stop_motors_of_an_external_module() {
    let mut fpga = machine();
    enable(&mut fpga);
    fpga.write_register(MILLIVOLTS, 2_000);
    fpga.write_register(0x0C00, 1_000_000);
    assert_near(moved(&mut fpga, 30 * MS), [20.0, 0.0]);
    assert!(fpga.watchdog().has_bitten());
    assert_eq!(
        fpga.drive_signal(0).map(|signal| signal.enabled),
        Some(false)
    );
    fpga.write_register(0x0D00, 0);
    enable(&mut fpga);
    assert_near(moved(&mut fpga, 10 * MS), [20.0, 0.0]);
    fpga.reload();
    assert_near(moved(&mut fpga, 10 * MS), [0.0, 0.0]);
    enable(&mut fpga);
    assert_near(moved(&mut fpga, 10 * MS), [0.0, 0.0]);
}

#[test]
fn signal_that_changes_by_itself_does_so_to_the_nanosecond() {
    let mut fpga = machine();
    enable(&mut fpga);
    fpga.write_register(TIMEOUT, 12_345);
    fpga.write_register(MILLIVOLTS, 10_000);
    let start = counts(&mut fpga, 0);
    wait(&mut fpga, 50 * MS);
    let travelled = counts(&mut fpga, 0) - start;
    assert!((travelled - 123.45).abs() < 1e-3, "{travelled}");
    assert_eq!(fpga.drive_signal(0).map(|signal| signal.volts), Some(0.0));
}

#[test]
fn drive_has_no_signal_without_its_module() {
    let mut fpga = SimFpga::new(machines::firmware_7i92_7i77());
    let axis = fpga.wire_axis(AxisWiring {
        source: DriveSource::Module {
            gtag: DAC,
            output: 0,
        },
        encoder: 0,
        motor: motor(),
    });
    wait(&mut fpga, 10 * MS);
    assert_eq!(fpga.drive_signal(axis), Some(DriveSignal::default()));
    assert!(fpga.motor(axis).expect("an axis").counts().abs() < 1e-9);
}
