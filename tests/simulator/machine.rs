//! The complete simulated machine, register by register: remotes on its serial ports, drives and
//! motors behind them, its speed and its determinism.

use std::time::{Duration, Instant};

use crate::common::fpga::set_up_pins;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::sim::remote::{FixedData, Remote};
use mesa_hal::sim::wire::RemoteEnd;
use mesa_hal::sim::{AxisWiring, DriveSignal, DriveSource, MotorConfig, SimFpga, gtag, machines};

const MS: u64 = 1_000_000;

/// Register addresses of one port, as its module descriptor gives them.
#[derive(Clone, Copy)]
struct Port {
    base: u16,
}

impl Port {
    const FIRST: Self = Self { base: 0x5A00 };

    fn cs(self, channel: u16) -> u16 {
        self.base + 0x200 + 4 * channel
    }

    fn interface(self, channel: u16, n: u16) -> u16 {
        self.base + 0x300 + 0x100 * n + 4 * channel
    }

    fn command(self, fpga: &mut SimFpga, command: u32) -> u32 {
        fpga.write(self.base, command).expect("write");
        for _ in 0..200_000 {
            if fpga.read(self.base).expect("read") == 0 {
                return fpga.read(self.base + 0x100).expect("read") & 0xFF;
            }
        }
        panic!("COMMAND {command:#06x} never cleared");
    }
}

/// A remote as the transcripts have them, with the sizes of one mode.
fn model(name: &str, rx: u8, tx: u8) -> Box<Remote<FixedData>> {
    let mut remote = Remote::model();
    let line = format!("present=1 name={name} unit=1 mode0={rx},{tx},0,0");
    remote.apply(&line).expect("model");
    Box::new(remote)
}

/// Power-up of the ports takes less than that.
fn settle(fpga: &mut SimFpga) {
    fpga.wait(Duration::from_millis(1));
}

fn outputs(fpga: &SimFpga, port: usize, channel: usize) -> &[u8] {
    let remote = fpga.device::<Remote<FixedData>>(port, channel);
    remote.expect("remote").application().outputs()
}

#[test]
fn three_remotes_start_and_exchange_data() {
    let mut fpga = machines::i7i92_7i77();
    for (channel, (rx, tx)) in [(5, 2), (1, 10), (1, 6)].into_iter().enumerate() {
        fpga.plug(0, channel, Some(model("7I77", rx, tx)));
    }
    set_up_pins(&mut fpga);
    settle(&mut fpga);
    let port = Port::FIRST;
    assert_eq!(port.command(&mut fpga, 0x0907), 0, "normal START");
    let name = fpga.read(port.interface(1, 1)).expect("read");
    assert_eq!(name, u32::from_le_bytes(*b"7I77"));
    fpga.write(port.interface(0, 0), 0xBEEF).expect("write");
    fpga.write(port.interface(1, 2), 0x1234).expect("write");
    assert_eq!(port.command(&mut fpga, 0x1007), 0, "DOIT");
    assert_eq!(fpga.read(port.interface(0, 0)).expect("read"), 0x4433_2211);
    assert_eq!(outputs(&fpga, 0, 0), [0xEF, 0xBE]);
    assert_eq!(outputs(&fpga, 0, 1), [0, 0, 0, 0, 0, 0, 0, 0, 0x34, 0x12]);
    assert_eq!(outputs(&fpga, 0, 2), [0; 6]);
    assert_eq!(fpga.read(port.cs(0)).expect("read") & 0xFF00_FF00, 0);
}

#[test]
fn a_channel_whose_pins_are_not_set_up_reaches_nobody() {
    let mut fpga = machines::i7i97(2);
    for channel in 0..2 {
        fpga.plug(0, channel, Some(model("7I72", 1, 6)));
    }
    // TX and TXEN of channel 0 (I/O 32 and 33), TX of channel 1 (I/O 35).
    fpga.write(0x1204, 0x1_8000).expect("write");
    fpga.write(0x1104, 0x0_8000).expect("write");
    fpga.write(0x1208, 0x2).expect("write");
    fpga.write(0x1108, 0x2).expect("write");
    settle(&mut fpga);
    let port = Port::FIRST;
    assert_eq!(port.command(&mut fpga, 0x0903), 1, "no TXEN on channel 0");
    assert_eq!(port.command(&mut fpga, 0x0800), 0xAA);
    fpga.write(0x1104, 0x1_8000).expect("write");
    settle(&mut fpga);
    assert_eq!(port.command(&mut fpga, 0x0903), 0);
}

#[test]
fn the_watchdog_silences_the_ports() {
    let mut fpga = machines::i7i92_7i77();
    fpga.plug(0, 0, Some(model("7I77", 5, 2)));
    set_up_pins(&mut fpga);
    settle(&mut fpga);
    let port = Port::FIRST;
    assert_eq!(port.command(&mut fpga, 0x0901), 0);
    assert_eq!(port.command(&mut fpga, 0x1001), 0);
    fpga.write(0x0C00, 99_999).expect("write");
    fpga.wait(Duration::from_millis(2));
    assert_eq!(fpga.read(0x0D00).expect("read"), 1);
    assert_eq!(port.command(&mut fpga, 0x1001), 1, "no reply any more");
}

#[test]
fn seven_interface_registers_reach_their_channels_and_ports() {
    let firmware = machines::firmware_serial(&[2, 1, 8, 3]);
    let mut fpga = SimFpga::new(machines::with_seven_interface_registers(firmware));
    assert_eq!(fpga.serial_ports(), 4);
    for (port, channel) in [(0, 1), (2, 7), (3, 2)] {
        fpga.plug(port, channel, Some(model("BIG1", 13, 12)));
    }
    set_up_pins(&mut fpga);
    settle(&mut fpga);
    for (number, channel) in [(0, 1), (2, 7), (3, 2)] {
        let port = Port {
            base: 0x5A00 + 0x40 * number,
        };
        assert_eq!(port.command(&mut fpga, 0x0900 | 1 << channel), 0);
        for n in 0..3u16 {
            let value = u32::from(number) << 24 | (u32::from(n) + 1);
            fpga.write(port.interface(channel, n), value)
                .expect("write");
        }
        assert_eq!(port.command(&mut fpga, 0x1000 | 1 << channel), 0);
        let n = number as u8;
        let expected = [1, 0, 0, n, 2, 0, 0, n, 3, 0, 0, n];
        let got = outputs(&fpga, usize::from(number), usize::from(channel));
        assert_eq!(got, expected);
        let last = fpga.read(port.interface(channel, 2)).expect("read");
        assert_eq!(last, 0xCCBB_AA99);
        assert_eq!(fpga.read(port.interface(channel, 6)).expect("read"), 0);
    }
    assert_eq!(fpga.counters().unknown_reads, 0);
    assert_eq!(fpga.counters().unknown_writes, 0);
    let descriptor = fpga.firmware().module(gtag::SSERIAL_B).expect("module");
    assert_eq!((descriptor.registers, descriptor.multiple), (10, 0x3FC));
}

/// The six analog outputs of a 7I77 as FACTS 8.3 packs them.
fn analog(remote: &dyn RemoteEnd, output: u8) -> DriveSignal {
    let any: &dyn std::any::Any = remote;
    let remote = any.downcast_ref::<Remote<FixedData>>().expect("a model");
    let bytes = remote.application().outputs();
    if bytes.len() != 10 {
        return DriveSignal::default();
    }
    let word = bytes
        .iter()
        .rev()
        .fold(0u128, |word, &byte| word << 8 | u128::from(byte));
    let raw = (word >> (13 * output)) as i16 & 0x1FFF;
    let volts = f64::from(raw << 3 >> 3) / 4096.0 * 10.0;
    let enable = if output == 5 { 79 } else { 78 };
    DriveSignal {
        volts,
        enabled: word >> enable & 1 != 0,
    }
}

/// A 7I92 with a 7I77 and a 7I72: three remotes, six motors on the analog outputs.
fn six_axes() -> SimFpga {
    let mut fpga = machines::i7i92_7i77();
    for (channel, (rx, tx)) in [(5, 2), (1, 10), (1, 6)].into_iter().enumerate() {
        fpga.plug(0, channel, Some(model("7I77", rx, tx)));
    }
    for output in 0..6 {
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Remote {
                port: 0,
                channel: 1,
                output,
                readout: analog,
            },
            encoder: usize::from(output),
            motor: MotorConfig::default(),
        });
    }
    set_up_pins(&mut fpga);
    settle(&mut fpga);
    assert_eq!(Port::FIRST.command(&mut fpga, 0x0907), 0);
    fpga
}

/// One cycle as a driver does it: encoders in, outputs and DOIT, results.
fn cycle(fpga: &mut SimFpga, volts: [f64; 6]) -> [u16; 6] {
    let mut counts = [0; 6];
    fpga.read_block(0x3500, &mut counts).expect("encoders");
    let mut word = 3u128 << 78;
    for (output, volts) in volts.into_iter().enumerate() {
        let raw = (volts / 10.0 * 4096.0) as i16 & 0x1FFF;
        word |= (raw as u128) << (13 * output);
    }
    for n in 0..3 {
        let part = (word >> (32 * n)) as u32;
        fpga.write(Port::FIRST.interface(1, n), part)
            .expect("write");
    }
    assert_eq!(Port::FIRST.command(fpga, 0x1007), 0);
    counts.map(|count| count as u16)
}

fn run(seconds: f64) -> (Vec<u16>, SimFpga) {
    let mut fpga = six_axes();
    let cycles = (seconds * 1000.0) as u64;
    let begin = fpga.now();
    let mut trace = Vec::new();
    for n in 0..cycles {
        let angle = n as f64 * 0.01;
        let volts = core::array::from_fn(|axis| 9.0 * (angle * (axis + 1) as f64).sin());
        trace.extend(cycle(&mut fpga, volts));
        fpga.advance_to(begin + (n + 1) * MS);
    }
    (trace, fpga)
}

#[test]
fn analog_outputs_turn_the_motors_and_their_encoders() {
    let mut fpga = six_axes();
    for _ in 0..100 {
        cycle(&mut fpga, [5.0, -5.0, 1.0, 0.0, 9.0, -10.0]);
        fpga.wait(Duration::from_micros(800));
    }
    let speeds: Vec<f64> = (0..6)
        .map(|axis| fpga.motor(axis).expect("axis").velocity())
        .collect();
    for (speed, expected) in speeds.iter().zip([50.0, -50.0, 10.0, 0.0, 90.0, -100.0]) {
        assert!((speed - expected).abs() < 0.1, "{speeds:?}");
    }
    for axis in 0..6u16 {
        let count = fpga.read(0x3500 + 4 * axis).expect("read") as u16;
        let position = fpga.motor(axis.into()).expect("axis").counts();
        assert_eq!(count, position.floor() as i64 as u16);
    }
    // Nobody talks to the remote any more: its watchdog takes the outputs away after 50 ms.
    fpga.wait(Duration::from_millis(200));
    for axis in 0..6 {
        assert!(fpga.motor(axis).expect("axis").velocity().abs() < 1e-6);
    }
}

#[test]
fn unplugging_the_analog_remote_stops_the_motors() {
    let mut fpga = six_axes();
    for _ in 0..20 {
        cycle(&mut fpga, [5.0; 6]);
    }
    assert!(fpga.motor(0).expect("axis").velocity() > 10.0);
    assert!(fpga.plug(0, 1, None).is_some());
    fpga.wait(Duration::from_millis(100));
    assert!(fpga.motor(0).expect("axis").velocity().abs() < 1e-3);
}

#[test]
fn two_runs_give_identical_traces() {
    let (first, mut a) = run(0.3);
    let (second, mut b) = run(0.3);
    assert_eq!(first, second);
    assert!(first.iter().any(|&count| count != 0));
    for axis in 0..6 {
        let positions = [&mut a, &mut b].map(|fpga| fpga.motor(axis).expect("axis").position());
        assert_eq!(positions[0].to_bits(), positions[1].to_bits());
    }
    assert_eq!(a.now(), b.now());
    assert_eq!(a.counters(), b.counters());
}

/// Prints how long a second of the machine takes; the bound is far off, for slow test machines.
#[test]
fn a_second_of_the_machine_takes_less_than_a_second() {
    let begin = Instant::now();
    let (_, fpga) = run(1.0);
    let host = begin.elapsed();
    println!(
        "1 s of virtual time, {} accesses: {host:?}",
        fpga.counters().reads + fpga.counters().writes
    );
    assert!(host < Duration::from_secs(3), "{host:?}");
}
