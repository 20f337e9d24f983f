//! The port machine without a bus: stepped on recorded registers as in the cycle, and its times
//! against every recorded operation.

use crate::common::recording::{files, own_directory};
use crate::common::replay::{MODULE, Replay, recording, segments};
use crate::sslbp_recorded::recorded_access;
use mesa_hal::bus::{Access, Clock, RegisterBus};
use mesa_hal::sslbp::{
    Channel, ChannelMask, CompletedOperation, Failure, PortEvent, PortImage, PortLayout,
    PortMachine, PortOperation, StartMode, TransferResult, software_mode_word,
};
use mesa_hal_sim::sslbp::Register;
use std::collections::BTreeMap;
use std::time::Duration;

const ZERO: Channel = Channel::ALL[0];

/// All registers of a port of eight channels, read in one exchange.
struct Registers([u32; 34]);

impl Registers {
    fn read(bus: &mut Replay) -> Self {
        let layout = PortLayout::new(&MODULE, 0, 8).unwrap();
        let mut addresses = vec![layout.command, layout.data()];
        for channel in Channel::ALL {
            addresses.push(layout.cs(channel).unwrap());
            addresses.extend(layout.interfaces(channel));
        }
        let accesses: Vec<_> = (0..)
            .zip(addresses)
            .map(|(n, address)| Access::read(address, n, 1))
            .collect();
        let mut words = [0; 34];
        bus.exchange(&accesses, &mut words).unwrap();
        Self(words)
    }

    fn interface(&self, channel: Channel) -> [u32; 3] {
        let first = 3 + 4 * usize::from(channel.index());
        [self.0[first], self.0[first + 1], self.0[first + 2]]
    }
}

impl PortImage for Registers {
    fn command(&self) -> u32 {
        self.0[0]
    }

    fn data(&self) -> u32 {
        self.0[1]
    }

    fn cs(&self, channel: Channel) -> u32 {
        self.0[2 + 4 * usize::from(channel.index())]
    }

    fn interfaces(&self, channel: Channel) -> [u32; 3] {
        self.interface(channel)
    }
}

/// A cycle of 1 ms: one read, one step, one write.
struct Cycle {
    bus: Replay,
    machine: PortMachine,
}

impl Cycle {
    fn new(bus: Replay) -> Self {
        let machine = PortMachine::new(ChannelMask::first(8));
        Self { bus, machine }
    }

    fn read(&mut self) -> (PortEvent, Registers) {
        self.bus.wait(Duration::from_millis(1));
        let registers = Registers::read(&mut self.bus);
        let now = Clock::now(&mut self.bus);
        (self.machine.observe(now, &registers, true), registers)
    }

    /// Writes `words` to CS or the interface registers of channel 0, and begins `operation`.
    fn write(&mut self, operation: PortOperation, words: &[(Register, u32)]) {
        let layout = PortLayout::new(&MODULE, 0, 8).unwrap();
        for &(register, word) in words {
            let address = match register {
                Register::Interface(0, n) => layout.interfaces(ZERO).nth(n.into()).unwrap(),
                _ => layout.cs(ZERO).unwrap(),
            };
            self.bus.write(address, word).unwrap();
        }
        let command = self.machine.begin(operation);
        self.bus.write(layout.command, command).unwrap();
        let now = Clock::now(&mut self.bus);
        self.machine.written(now, true);
    }

    /// The first read in which the operation is complete.
    fn complete(&mut self) -> (CompletedOperation, Registers) {
        for _ in 0..100 {
            if let (PortEvent::Complete(complete), registers) = self.read() {
                return (complete, registers);
            }
        }
        panic!("{:?} is never complete", self.machine.in_flight());
    }
}

/// Manual: 7I77, "NORMAL MODE OPERATION", steps 1 to 11, write before read; transcript t06.
#[test]
fn write_before_read_gives_the_inputs_of_the_doit_before() {
    let mut cycle = Cycle::new(Replay::of("t06_normal_mode1"));
    assert_eq!(cycle.read().0, PortEvent::Idle);
    cycle.write(PortOperation::StopAll, &[]);
    assert_eq!(cycle.complete().0.bad, ChannelMask::NONE);
    let start = PortOperation::Start(StartMode::Normal, ZERO.mask());
    cycle.write(start, &[(Register::Cs(0), software_mode_word(1))]);
    assert_eq!(cycle.complete().0.good, ZERO.mask());
    let [unit_number, ..] = cycle.machine.link(ZERO).start_registers;
    assert_eq!(unit_number, 0x77AA);
    for word in [0xFFFF_1234, 0x100] {
        let doit = PortOperation::Transfer(ZERO.mask());
        cycle.write(doit, &[(Register::Interface(0, 0), word)]);
        let (complete, registers) = cycle.complete();
        assert_eq!((complete.good, complete.reads_before), (ZERO.mask(), 0));
        assert_eq!(registers.interface(ZERO), [0x4433_2211, 0xA3A2_A1A0, 0]);
    }
    assert!(cycle.bus.commands.iter().all(|&(_, busy)| !busy));
}

/// FACTS 5.4; transcript t10: the DOITs up to the end of the bad CRC.
#[test]
fn lost_and_damaged_replies_are_distinguished() {
    let bus = Replay::of("t10_errors").without(|segment| segment.command & 0x2000 != 0);
    let mut cycle = Cycle::new(bus);
    cycle.read();
    cycle.write(PortOperation::StopAll, &[]);
    cycle.complete();
    cycle.write(PortOperation::Start(StartMode::Normal, ZERO.mask()), &[]);
    cycle.complete();
    let mut verdicts = Vec::new();
    for word in [0, 0, 0x101, 0x202, 0x303, 0x101, 0x202, 0x303] {
        let doit = PortOperation::Transfer(ZERO.mask());
        cycle.write(doit, &[(Register::Interface(0, 0), word)]);
        cycle.complete();
        verdicts.push(cycle.machine.link(ZERO).verdict);
    }
    let (good, failed) = (TransferResult::Good, TransferResult::Failed);
    let (no_reply, crc) = (failed(Failure::NoReply), failed(Failure::Crc));
    assert_eq!(
        verdicts,
        [good, good, no_reply, good, good, crc, good, good]
    );
}

/// FACTS 3.1; transcript t09c: COMMAND stays 0800 for good.
#[test]
fn slow_operation_makes_the_port_stuck_and_only_free_is_written() {
    let mut bus = Replay::of("t09c_stopall_doit")
        .without(|segment| segment.command == 0x1001 || segment.command == 0x0901);
    bus.begin_inside();
    let mut cycle = Cycle::new(bus);
    let mut reads = 0;
    loop {
        assert_eq!(cycle.read().0, PortEvent::Busy);
        reads += 1;
        let now = Clock::now(&mut cycle.bus);
        if cycle.machine.is_stuck(now) {
            break;
        }
        assert_eq!(cycle.machine.begin(PortOperation::StopAll), 0x8000_0000);
    }
    assert!(reads > 100, "stuck after {reads} ms");
    cycle.write(PortOperation::Free, &[]);
    cycle.complete();
    cycle.write(PortOperation::StopAll, &[]);
    assert_eq!(cycle.complete().0.bad, ChannelMask::NONE);
}

/// Every recorded operation that was completed, and its duration.
fn recorded_operations() -> Vec<(String, PortOperation, Duration)> {
    let mut found = Vec::new();
    for path in files(&own_directory("transcripts")) {
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        // Operations that meet a reset, or another operation, take as long as that.
        let meets = ["reset", "_busy", "stopall_", "phase", "odd_doit"];
        if meets.iter().any(|meet| name.contains(meet)) {
            continue;
        }
        let (mut in_setup, mut is_busy) = (false, false);
        for segment in segments(&recording(&name)) {
            let mask = ChannelMask::from_bits(segment.command as u8);
            let address = (segment.command & 0xFFF) as u16;
            let operation = match segment.command >> 8 {
                0x08 if mask.is_empty() => Some(PortOperation::StopAll),
                0x08 => Some(PortOperation::Stop(mask)),
                0x09 => Some(PortOperation::Start(StartMode::Normal, mask)),
                0x0F => Some(PortOperation::Start(StartMode::Setup, mask)),
                0x10 if in_setup => {
                    recorded_access(&segment).map(|access| PortOperation::Access(ZERO, access))
                }
                0x10 => Some(PortOperation::Transfer(mask)),
                0x20..=0x2F => Some(PortOperation::ReadLocal(address)),
                0xA0..=0xAF => Some(PortOperation::WriteLocal(address)),
                _ => None,
            };
            if let Some(PortOperation::Start(mode, _)) = operation {
                in_setup = mode == StartMode::Setup;
            }
            if let (Some(operation), Some(took), false) = (operation, segment.cleared, is_busy) {
                let took = Duration::from_nanos(took);
                found.push((name.clone(), operation, took));
            }
            is_busy = segment.cleared.is_none();
        }
    }
    found
}

fn kind_of(operation: &PortOperation) -> &'static str {
    match operation {
        PortOperation::StopAll => "STOPALL",
        PortOperation::Stop(_) => "STOP",
        PortOperation::Start(StartMode::Normal, _) => "START",
        PortOperation::Start(StartMode::Setup, _) => "setup START",
        PortOperation::Transfer(_) => "DOIT",
        PortOperation::Access(..) => "access",
        _ => "local",
    }
}

/// Too short a limit makes an operation fail that is only slow; a limit that is wrong by an order
/// of magnitude has no relation to the operation.
#[test]
fn every_recorded_operation_ends_within_half_its_longest_time() {
    let operations = recorded_operations();
    assert!(operations.len() > 800, "{}", operations.len());
    let mut kinds = BTreeMap::<&str, (u32, Duration)>::new();
    for (name, operation, took) in operations {
        let longest = operation.longest_time();
        assert!(2 * took <= longest, "{name}: {operation:?} took {took:?}");
        let entry = kinds.entry(kind_of(&operation)).or_default();
        *entry = (entry.0 + 1, entry.1.max(took));
    }
    for (kind, (count, longest)) in &kinds {
        println!("{kind}: {count} recorded, the longest {longest:?}");
    }
    assert_eq!(kinds.len(), 7);
}

/// The first check is made when the operation can be complete, and before it is late.
#[test]
fn usual_time_of_an_operation_is_what_the_recordings_took() {
    let mut times = BTreeMap::<String, (PortOperation, Vec<Duration>)>::new();
    for (_, operation, took) in recorded_operations() {
        let kind = match operation {
            PortOperation::Transfer(_) => continue,
            PortOperation::Access(_, access) => {
                format!("access of {} characters", access.characters())
            }
            other => kind_of(&other).to_owned(),
        };
        let (_, all) = times.entry(kind).or_insert((operation, Vec::new()));
        all.push(took);
    }
    for (kind, (operation, mut took)) in times {
        took.sort();
        let (first, median) = (took[0], took[took.len() / 2]);
        let usual = operation.usual_time();
        let last = took.last();
        println!("{kind}: usually {usual:?}; recorded {first:?} to {last:?}, half {median:?}");
        assert!(
            2 * usual >= first && usual <= 2 * median,
            "{kind}: {usual:?}"
        );
    }
}
