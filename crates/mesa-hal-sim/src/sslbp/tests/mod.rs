//! Behaviour of a whole port with remotes on its lines.

mod line;
mod reset;

use proptest::prelude::*;

use super::{InterfaceRegisters, Lines, NoLines, PortConfig, Register, SslbpPort};
use crate::remote::SimRemote;
use crate::wire::{Burst, Nanos, RemoteEnd};

const MS: Nanos = 1_000_000;
const US: Nanos = 1_000;

type Ends = [Option<Box<dyn RemoteEnd>>; 8];

/// Lines that record the transmitted bursts.
struct Tapped {
    ends: Ends,
    sent: Vec<(usize, Burst)>,
    /// The channel whose receive line is held low.
    low: Option<usize>,
}

impl Lines for Tapped {
    fn transmit(&mut self, channel: usize, burst: &Burst) {
        self.sent.push((channel, *burst));
        self.ends.transmit(channel, burst);
    }

    fn receive(&mut self, channel: usize) -> Option<Burst> {
        self.ends.receive(channel)
    }

    fn held_low(&mut self, channel: usize, now: Nanos) -> bool {
        self.low == Some(channel) || self.ends.held_low(channel, now)
    }
}

/// A port, its remotes and a host.
struct Bench {
    port: SslbpPort,
    lines: Tapped,
    now: Nanos,
}

impl Bench {
    fn new(config: PortConfig, remotes: &[&str]) -> Self {
        let mut ends: Ends = Default::default();
        for (end, text) in ends.iter_mut().zip(remotes) {
            if !text.is_empty() {
                let mut remote = SimRemote::model();
                remote.apply(text).expect("a remote");
                *end = Some(Box::new(remote));
            }
        }
        let mut bench = Self {
            port: SslbpPort::new(config),
            lines: Tapped {
                ends,
                sent: Vec::new(),
                low: None,
            },
            now: 0,
        };
        bench.wait(MS);
        bench
    }

    /// Eight channels at 100 MHz.
    fn eight(remotes: &[&str]) -> Self {
        Self::new(PortConfig::new(8, 100_000_000), remotes)
    }

    fn wait(&mut self, time: Nanos) {
        self.now += time;
        self.port.advance(self.now, &mut self.lines);
    }

    fn write(&mut self, register: Register, value: u32) {
        self.wait(20);
        self.port.write(self.now, register, value);
    }

    fn read(&mut self, register: Register) -> u32 {
        self.wait(20);
        self.port.read(self.now, register)
    }

    /// Writes a command and waits until COMMAND reads 0; returns the time that took.
    fn command(&mut self, command: u32, limit: Nanos) -> Option<Nanos> {
        self.write(Register::Command, command);
        let start = self.now;
        while self.now < start + limit {
            self.wait(100);
            if self.port.read(self.now, Register::Command) == 0 {
                let took = self.now - start;
                self.wait(100);
                return Some(took);
            }
        }
        None
    }

    fn local_write(&mut self, address: u32, value: u32) {
        self.write(Register::Data, value);
        assert!(self.command(0xA000 | address, MS).is_some());
    }

    fn start(&mut self, command: u32) {
        assert!(self.command(0x0800, MS).is_some());
        assert!(self.command(command, 60 * MS).is_some());
    }
}

const REMOTE: &str = "present=1 name=7I77 unit=0x77aa mode0=5,2,0x49a,0x4a4";

#[test]
fn every_number_of_channels_starts_and_transfers_at_once() {
    for channels in 1..=8_u8 {
        let remotes = vec![REMOTE; usize::from(channels)];
        let mut bench = Bench::new(PortConfig::new(channels, 100_000_000), &remotes);
        let mask = (1_u32 << channels) - 1;
        bench.start(0x0900 | mask);
        assert_eq!(bench.read(Register::Data), 0);
        assert!(bench.command(0x1000 | mask, MS).is_some());
        bench.wait(100 * US);
        let took = bench.command(0x1000 | mask, MS).expect("a transfer");
        assert!((50 * US..75 * US).contains(&took), "{channels}: {took} ns");
        assert_eq!(bench.read(Register::Data), 0);
        assert_eq!(
            bench.read(Register::Interface(channels - 1, 0)),
            0x4433_2211
        );
    }
}

#[test]
fn slower_clocks_start_and_transfer_as_well() {
    for clock in [33_333_333, 50_000_000, 100_000_000, 200_000_000] {
        let mut bench = Bench::new(PortConfig::new(3, clock), &[REMOTE, REMOTE, REMOTE]);
        bench.start(0x0907);
        assert_eq!(bench.read(Register::Data), 0, "{clock} Hz");
        assert!(bench.command(0x1007, MS).is_some());
        assert_eq!(bench.read(Register::Data), 0, "{clock} Hz");
        let bit = bench.lines.sent[0].1.bit;
        assert!(
            (399..=410).contains(&bit),
            "{clock} Hz: a bit takes {bit} ns"
        );
    }
}

#[test]
fn stopall_during_a_transfer_sticks_until_a_stop_with_a_mask() {
    let mut bench = Bench::eight(&[REMOTE]);
    bench.start(0x0901);
    assert!(bench.command(0x1001, MS).is_some());
    bench.write(Register::Command, 0x1001);
    bench.wait(10 * US);
    assert_eq!(bench.command(0x0800, 5 * MS), None);
    assert_eq!(bench.read(Register::Command), 0x0800);
    assert_eq!(
        bench.command(0x0800, 5 * MS),
        None,
        "repeating does not help"
    );
    assert!(bench.command(0x08FF, MS).is_some());
    // The firmware still finds the COMMAND write that freed it, and treats it as invalid; a command
    // that is written half a microsecond later is cleared together with it.
    bench.wait(15 * US);
    assert_eq!(
        bench.read(Register::Cs(0)),
        0x0042_0000,
        "nothing was stopped"
    );
    assert!(bench.command(0x0800, MS).is_some());
    assert_eq!(bench.read(Register::Data), 0xAA);
}

#[test]
fn stop_during_a_transfer_ends_the_waiting_and_stops_nothing() {
    let mut bench = Bench::eight(&[REMOTE]);
    bench.start(0x0901);
    assert!(bench.command(0x1001, MS).is_some());
    bench.write(Register::Command, 0x1001);
    bench.wait(10 * US);
    assert!(bench.command(0x0801, 10 * US).is_some());
    bench.wait(MS);
    assert_eq!(bench.read(Register::Cs(0)) & 0x00FF_FF00, 0x0042_0000);
}

#[test]
fn command_during_a_transfer_becomes_invalid_after_it() {
    let mut bench = Bench::eight(&[REMOTE]);
    bench.start(0x0901);
    assert!(bench.command(0x1001, MS).is_some());
    bench.write(Register::Command, 0x1001);
    bench.wait(10 * US);
    assert!(bench.command(0x2003, MS).is_some());
    bench.wait(15 * US);
    assert_eq!(bench.read(Register::Data), 0xFF);
}

#[test]
fn remote_fault_shows_in_cs_and_never_in_data() {
    let mut bench = Bench::eight(&["present=1 name=7I77 unit=1 mode0=5,2,1,2 wd=1"]);
    bench.start(0x0901);
    assert!(bench.command(0x1001, MS).is_some());
    bench.wait(5 * MS);
    assert!(bench.command(0x1001, MS).is_some());
    assert_eq!(bench.read(Register::Data), 0);
    assert_eq!(bench.read(Register::Cs(0)), 0x0142_2140);
}

#[test]
fn error_limit_is_a_local_variable_of_the_channel() {
    let mut bench = Bench::eight(&[]);
    assert!(bench.command(0x0800, MS).is_some());
    bench.write(Register::Command, 0x0901);
    bench.wait(100 * US);
    bench.lines.sent.clear();
    bench.wait(30 * MS);
    assert_eq!(bench.lines.sent.len(), 21, "cookie requests");

    assert!(bench.command(0x0801, MS).is_some());
    bench.write(Register::Command, 0x0901);
    bench.wait(20 * MS);
    assert_eq!(bench.read(Register::Cs(0)) & 0xFF, 0x88);
}

#[test]
fn request_without_crc_has_nothing_appended() {
    let mut bench = Bench::eight(&[]);
    assert!(bench.command(0x0800, MS).is_some());
    bench.local_write(0x70 + 0x1E, 1);
    assert!(bench.command(0x0901, 60 * MS).is_some());
    assert_eq!(bench.lines.sent[0].1.bytes(), &[0xDF]);
}

#[test]
fn new_baud_rate_counts_from_the_next_stopall_on() {
    let mut bench = Bench::eight(&[]);
    for (offset, byte) in 115_200_u32.to_le_bytes().into_iter().enumerate() {
        bench.local_write(0x70 + 0x2A + offset as u32, u32::from(byte));
    }
    bench.write(Register::Command, 0x0901);
    bench.wait(2 * MS);
    assert_eq!(bench.lines.sent[0].1.bit, 401);
    bench.wait(40 * MS);
    bench.start(0x0901);
    let bit = bench.lines.sent.last().expect("a request").1.bit;
    assert!((8_680..8_700).contains(&bit), "a bit takes {bit} ns");
}

#[test]
fn baud_rate_of_zero_hangs_the_firmware_until_its_reset() {
    let mut bench = Bench::eight(&[]);
    for offset in 0..4 {
        bench.local_write(0x70 + 0x2A + offset, 0);
    }
    assert!(bench.command(0x0800, MS).is_some());
    assert_eq!(bench.command(0x0901, 60 * MS), None);
    assert_eq!(bench.command(0x08FF, MS), None);
    bench.write(Register::Command, 0x4000);
    bench.write(Register::Command, 0x0001);
    bench.wait(MS);
    assert!(bench.command(0x2003, MS).is_some());
    assert_eq!(bench.read(Register::Data), 43);
}

#[test]
fn seven_interface_registers_carry_28_bytes_each_way() {
    let config =
        PortConfig::new(2, 100_000_000).with_interface_registers(InterfaceRegisters::Seven);
    let inputs = "404142434445464748494A4B4C4D4E4F505152535455565758595A5B";
    let remote = format!("present=1 name=WIDE unit=1 mode0=29,28,1,2 in={inputs}");
    let mut bench = Bench::new(config, &[&remote]);
    bench.start(0x0901);
    assert_eq!(bench.read(Register::Data), 0);
    for n in 0..7 {
        bench.write(Register::Interface(0, n), 0x0403_0201 * (u32::from(n) + 1));
    }
    assert!(bench.command(0x1001, MS).is_some());
    assert_eq!(bench.read(Register::Data), 0);
    let (_, frame) = bench.lines.sent.last().expect("a frame");
    assert_eq!(frame.len(), 30);
    assert_eq!(&frame.bytes()[25..29], &[7, 14, 21, 28]);
    assert_eq!(bench.read(Register::Interface(0, 6)), 0x5B5A_5958);
}

#[test]
fn idle_port_lets_any_time_pass_in_one_step() {
    let mut bench = Bench::eight(&[REMOTE]);
    bench.start(0x0901);
    assert!(bench.command(0x1001, MS).is_some());
    bench.wait(MS);
    assert_eq!(bench.port.next_event(), None);
    bench.wait(3_600_000 * MS);
    let took = bench.command(0x1001, MS).expect("a transfer");
    assert!((50 * US..62 * US).contains(&took), "{took} ns");
}

#[test]
fn write_to_a_register_that_is_not_there_does_nothing() {
    let mut port = SslbpPort::new(PortConfig::new(8, 100_000_000));
    port.advance(MS, &mut NoLines);
    port.write(MS, Register::Cs(200), 1);
    port.write(MS, Register::Interface(9, 9), 1);
    assert_eq!(port.read(MS, Register::Interface(0, 3)), 0);
    assert_eq!(port.read(MS, Register::Cs(255)), 0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is written, the port continues with bounded work, and the ROM reset recovers it.
    #[test]
    fn port_recovers_by_a_reset_after_any_sequence_of_writes(
        writes in proptest::collection::vec((0_u8..4, any::<u32>(), 0_u64..200_000), 1..40),
        channels in 1_u8..=8,
    ) {
        let mut bench = Bench::new(PortConfig::new(channels, 100_000_000), &[REMOTE, "", REMOTE]);
        for (register, value, pause) in writes {
            bench.wait(pause);
            let register = match register {
                0 => Register::Data,
                1 => Register::Cs(value as u8 % 8),
                2 => Register::Interface(value as u8 % 8, 0),
                _ => Register::Command,
            };
            bench.write(register, value);
        }
        bench.wait(MS);
        bench.write(Register::Command, 0x4000);
        bench.write(Register::Command, 0);
        bench.wait(MS);
        prop_assert!(bench.command(0x2007, MS).is_some());
        prop_assert_eq!(bench.read(Register::Data), u32::from(channels));
    }
}
