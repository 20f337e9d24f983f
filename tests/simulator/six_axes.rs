//! The complete machines with real devices on their serial lines, register by register.

use std::time::{Duration, Instant};

use crate::common::fpga::set_up_pins;
use mesa_hal::bus::{Access, Clock, RegisterBus};
use mesa_hal_sim::devices::{Analog, Device, FieldIo, Outputs48, World};
use mesa_hal_sim::remote::SimRemote;
use mesa_hal_sim::{Motor, SimFpga, machines};

const MS: u64 = 1_000_000;

const COMMAND: u16 = 0x5B00;
const DATA: u16 = 0x5C00;
const CS: u16 = 0x5D00;
const INTERFACE: u16 = 0x5E00;

fn command(fpga: &mut SimFpga, command: u32) -> u32 {
    fpga.write(COMMAND, command).expect("write");
    for _ in 0..200_000 {
        if fpga.read(COMMAND).expect("read") == 0 {
            return fpga.read(DATA).expect("read") & 0xFF;
        }
    }
    panic!("COMMAND {command:#06x} never cleared");
}

fn interface(channel: u16, n: u16) -> u16 {
    INTERFACE + 0x100 * n + 4 * channel
}

/// The machine set up and all three remotes running; the field I/O in `mode`.
fn start(mut fpga: SimFpga, mode: u32) -> SimFpga {
    set_up_pins(&mut fpga);
    fpga.wait(Duration::from_millis(1));
    fpga.write(CS, mode << 24).expect("write");
    assert_eq!(command(&mut fpga, 0x0907), 0, "normal START");
    let names: Vec<[u8; 4]> = (0..3)
        .map(|channel| {
            fpga.read(interface(channel, 1))
                .expect("read")
                .to_le_bytes()
        })
        .collect();
    assert_eq!(names, [*b"7I77", *b"7I77", *b"7I72"]);
    let kinds: Vec<u32> = (0..2)
        .map(|channel| fpga.read(interface(channel, 0)).expect("read") >> 24)
        .collect();
    assert_eq!(kinds, [0x12, 0x11], "field I/O, analog");
    fpga
}

/// Output words of the analog section (FACTS 8.3).
fn analog_words(volts: [f64; 6]) -> [u32; 3] {
    let raw = |volts: f64| (volts / 10.0 * 4096.0) as i16 & 0x1FFF;
    let outputs = volts.into_iter().enumerate();
    let word = outputs.fold(3u128 << 78, |word, (n, volts)| {
        word | (raw(volts) as u128) << (13 * n)
    });
    [word as u32, (word >> 32) as u32, (word >> 64) as u32]
}

fn set_analog(fpga: &mut SimFpga, volts: [f64; 6]) {
    for (n, word) in (0..).zip(analog_words(volts)) {
        fpga.write(interface(1, n), word).expect("write");
    }
}

/// A tenth of a second of transfers.
fn run(fpga: &mut SimFpga) {
    for _ in 0..100 {
        assert_eq!(command(fpga, 0x1007), 0);
        fpga.wait(Duration::from_micros(800));
    }
}

fn velocities(fpga: &mut SimFpga) -> [f64; 6] {
    [0, 1, 2, 3, 4, 5].map(|axis| fpga.motor(axis).expect("axis").velocity())
}

#[test]
fn field_io_and_7i72_follow_the_registers_and_the_world() {
    for fpga in [
        machines::six_axes_7i92(Motor::default()),
        machines::six_axes_5i25(Motor::default()),
        machines::six_axes_7i97(Motor::default()),
    ] {
        let mut fpga = start(fpga, 0);
        let field = fpga
            .device_mut::<SimRemote<Device<FieldIo>>>(0, 0)
            .expect("field I/O");
        let world = field.application_mut().world_mut();
        world.set_input(7, true).expect("input 7");
        world.set_input(31, true).expect("input 31");
        fpga.write(interface(0, 0), 0x8001).expect("write");
        fpga.write(interface(2, 0), 1 << 5).expect("write");
        fpga.write(interface(2, 1), 1 << 15).expect("write");
        assert_eq!(command(&mut fpga, 0x1007), 0);
        let inputs = fpga.read(interface(0, 0)).expect("read");
        assert_eq!(inputs, 1 << 31 | 1 << 7);
        let field = fpga
            .device::<SimRemote<Device<FieldIo>>>(0, 0)
            .expect("field I/O");
        let on: Vec<usize> = (0..16)
            .filter(|&n| field.application().world().output(n) == Some(true))
            .collect();
        assert_eq!(on, [0, 15]);
        let outputs = fpga
            .device::<SimRemote<Device<Outputs48>>>(0, 2)
            .expect("7I72");
        let on: Vec<usize> = (0..48)
            .filter(|&n| outputs.application().world().output(n) == Some(true))
            .collect();
        assert_eq!(on, [5, 47]);
    }
}

#[test]
fn analog_outputs_of_a_7i77_drive_the_motors() {
    let mut fpga = start(machines::six_axes_7i92(Motor::default()), 0);
    let volts = [5.0, -5.0, 1.0, 0.0, 9.0, -10.0];
    set_analog(&mut fpga, volts);
    run(&mut fpga);
    let analog = fpga
        .device::<SimRemote<Device<Analog>>>(0, 1)
        .expect("analog");
    assert_eq!(analog.application().world().volts(0), Some(5.0));
    let speeds = velocities(&mut fpga);
    for (speed, volts) in speeds.iter().zip(volts) {
        assert!((speed - 10.0 * volts).abs() < 0.1, "{speeds:?}");
    }
    for axis in 0..6u16 {
        let counts = fpga.motor(axis.into()).expect("axis").counts();
        let count = fpga.read_register(0x3600 + 4 * axis) as u16;
        assert_eq!(count, counts.floor() as i64 as u16);
    }
    // SPINENA alone: only the last motor goes on.
    fpga.write(interface(1, 2), analog_words(volts)[2] & !(1 << 14))
        .expect("write");
    run(&mut fpga);
    let speeds = velocities(&mut fpga);
    assert!(speeds[..5].iter().all(|v| v.abs() < 1e-3), "{speeds:?}");
    assert!((speeds[5] + 100.0).abs() < 0.1, "{speeds:?}");
    // The remote is no longer addressed: its watchdog switches the outputs off after 50 ms.
    fpga.wait(Duration::from_millis(200));
    assert!(velocities(&mut fpga)[5].abs() < 1e-6);
}

#[test]
fn unplugging_the_analog_remote_stops_the_motors() {
    let mut fpga = start(machines::six_axes_7i92(Motor::default()), 0);
    set_analog(&mut fpga, [5.0; 6]);
    run(&mut fpga);
    assert!(velocities(&mut fpga)[0] > 10.0);
    assert!(fpga.plug(0, 1, None).is_some());
    fpga.wait(Duration::from_millis(100));
    assert!(velocities(&mut fpga).iter().all(|v| v.abs() < 1e-3));
}

/// The cycle at 1 kHz, an outer loop closed on the encoders. Returns the trace of counts.
fn servo(seconds: f64) -> (Vec<u16>, SimFpga) {
    let mut fpga = start(machines::six_axes_7i92(Motor::default()), 3);
    let begin = fpga.now();
    let mut trace = Vec::new();
    let mut total = [0i64; 6];
    for n in 0..(seconds * 1000.0) as u64 {
        let mut words = [0; 6];
        let encoders = [Access::read(0x3600, 0, 6)];
        fpga.exchange(&encoders, &mut words).expect("encoders");
        for (total, word) in total.iter_mut().zip(words) {
            let step = (word as u16).wrapping_sub(*total as u16) as i16;
            *total += i64::from(step);
            trace.push(word as u16);
        }
        let target = 20.0 * (n as f64 * 0.004).sin();
        let volts = (target - total[0] as f64 / 1000.0).clamp(-9.9, 9.9);
        set_analog(&mut fpga, [volts; 6]);
        assert_eq!(command(&mut fpga, 0x1007), 0, "cycle {n}");
        fpga.advance_to(begin + (n + 1) * MS);
    }
    (trace, fpga)
}

#[test]
fn servo_second_is_deterministic() {
    let begin = Instant::now();
    let (first, mut fpga) = servo(1.0);
    let host = begin.elapsed();
    let accesses = fpga.counters().reads + fpga.counters().writes;
    println!("1 s of virtual time, {accesses} accesses: {host:?}");
    let travelled = fpga.motor(0).expect("axis").position();
    assert!(travelled.abs() > 1.0, "{travelled}");
    let (second, mut other) = servo(1.0);
    assert_eq!(first, second);
    for axis in 0..6 {
        let ends = [&mut fpga, &mut other].map(|f| f.motor(axis).expect("axis").position());
        assert_eq!(ends[0].to_bits(), ends[1].to_bits());
    }
    assert_eq!(
        (fpga.now(), fpga.counters()),
        (other.now(), other.counters())
    );
}
