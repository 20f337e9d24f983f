//! The driver against recorded gateware, at register level: the manual's step lists, every recorded
//! failure of START, and the way out of a port that is stuck.

mod failures;

use crate::common::replay::{MODULE, Replay, Segment, recording, size_replies};
use crate::common::transfer::{PortWords, doit, port_words, started};
use mesa_hal::lbp::RemoteLink;
use mesa_hal::sslbp::{
    AccessSize, Channel, ChannelMask, ChannelVariable, ComState, LocalFaults, LocalLocation,
    NonvolatileMemory, Port, PortAccess, PortError, PortLayout, PortLink, PortOperation,
    PortParameters, PortState, ProcessDataSizes, RemoteAccess, RemoteFaults, StartFailureReason,
    StartMode,
};
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::sslbp::Register;

const ZERO: Channel = Channel::ALL[0];

fn port() -> Port {
    Port::new(PortLayout::new(&MODULE, 0, 8).unwrap())
}

fn identified(bus: &mut Replay) -> Port {
    let mut port = port();
    port.on(bus).identify().unwrap();
    port
}

/// A recording whose remotes have these sizes of replies and requests, and its port, which is
/// stopped.
fn stopped(mut bus: Replay, sizes: &[(u8, u8)]) -> (Replay, Port) {
    for (channel, &(rx, tx)) in (0..).zip(sizes) {
        bus.set_sizes(channel, rx, tx);
    }
    let mut port = identified(&mut bus);
    port.on(&mut bus).stop_all().unwrap();
    (bus, port)
}

/// The same with its remotes started in software mode 0.
fn running(bus: Replay, sizes: &[(u8, u8)]) -> (Replay, Port) {
    let (mut bus, mut port) = stopped(bus, sizes);
    let channels = Channel::ALL.into_iter().take(sizes.len());
    let starts: Vec<_> = channels.map(|channel| (channel, 0)).collect();
    port.on(&mut bus).start(StartMode::Normal, &starts).unwrap();
    (bus, port)
}

fn link<'a>(port: &'a mut Port, bus: &'a mut Replay) -> PortLink<'a, Replay> {
    PortLink {
        port,
        bus,
        channel: ZERO,
    }
}

fn start_zero(mode: u8) -> [(Channel, u8); 1] {
    [(ZERO, mode)]
}

fn outputs(words: &[u32]) -> PortWords {
    port_words([(ZERO, words)])
}

/// Checks that COMMAND was written only while it was 0; a reset is the exception.
fn never_busy(bus: &Replay) {
    for &(command, busy) in bus.commands.iter().filter(|(word, _)| *word != 1) {
        assert!(!busy, "COMMAND {command:04X} was written while it was busy");
    }
}

/// FACTS 2.3, 2.5; transcript t01.
#[test]
fn reset_waits_for_the_initialisation_and_reads_the_parameters() {
    let mut bus = Replay::of("t01_reset_local");
    let mut port = port();
    let parameters = port.on(&mut bus).reset().unwrap();
    assert_eq!(
        parameters,
        PortParameters {
            major: 1,
            minor: 43,
            variables_start: 0x70,
            variables_stride: 0x32,
            clock_hz: 100_000_000,
        }
    );
    assert_eq!(port.state(), PortState::Stopped);
    never_busy(&bus);
}

/// FACTS 2.3. Each local parameter with an unexpected value, by its name in the error.
#[test]
fn firmware_that_is_not_known_is_refused_by_name() {
    let identify = |parameter: u16, value: u8| {
        let mut bus = Replay::new(Vec::new());
        bus.local.insert(parameter, value);
        port().on(&mut bus).identify()
    };
    let refused = [
        (0, 0x13, "the interface type is 0x13, expected 0x12"),
        (1, 16, "the width of DATA is 0x10, expected 0x08"),
        (2, 2, "the SSLBP version is 2.43, expected 1.29"),
        (3, 28, "the SSLBP version is 1.28, expected 1.29"),
        (5, 0x20, "the channel variables is 0x70 with stride 0x20"),
        (6, 0xD9, "the interface processor is 0xD9, expected 0xD8"),
        (7, 3, "the number of channels is 0x03, expected 0x08"),
    ];
    for (parameter, value, text) in refused {
        let error = identify(parameter, value).unwrap_err();
        assert!(matches!(error, PortError::Unexpected { port: 0, .. }));
        assert!(error.to_string().contains(text), "{error}");
    }
    assert_eq!(identify(3, 44).map(|found| found.minor), Ok(44));
    // The other parameters of an unknown version are meaningless.
    let mut bus = Replay::new(Vec::new());
    bus.local.extend([(2, 2), (7, 3)]);
    let error = port().on(&mut bus).identify().unwrap_err();
    assert_eq!(error.advice(), Some(advice::FLASH_NEWER_FIRMWARE));
}

/// Manual: 7I77, "NORMAL MODE OPERATION", steps 1 to 11 in the poll form; transcript t06.
#[test]
fn normal_mode_operation_step_by_step() {
    // 1: STOPALL
    let bus = Replay::of("t06_normal_mode1");
    let (mut bus, mut port) = stopped(bus, &[(9, 2)]);
    // 2, 3, 4: START, wait, DATA
    let report = port
        .on(&mut bus)
        .start(StartMode::Normal, &start_zero(1))
        .unwrap();
    // 5: unit number
    let remote = report[0].unwrap();
    assert_eq!(remote.unit_number, 0x77AA);
    assert_eq!(remote.name.to_string(), "7I77");
    assert_eq!((remote.ptoc, remote.gtoc), (0x5C0, 0x5D2));
    assert_eq!(remote.sizes, ProcessDataSizes { rx: 9, tx: 2 });
    assert_eq!(remote.cs.state(), ComState::Chatter);
    // 6 to 10, and the data of this DOIT
    let words = [0xFFFF_1234];
    let transfer = doit(&mut port, &mut bus, ZERO.mask(), &outputs(&words));
    assert_eq!(transfer.failed, ChannelMask::NONE);
    assert_eq!(transfer.inputs[ZERO][..3], [0x4433_2211, 0xA3A2_A1A0, 0]);
    assert_eq!(transfer.cs[ZERO].0, 0x0042_0000);
    for word in [0x100, 0x101, 0x102] {
        let transfer = doit(&mut port, &mut bus, ZERO.mask(), &outputs(&[word]));
        assert_eq!(transfer.inputs[ZERO][0], 0x4433_2211);
    }
    never_busy(&bus);
}

/// The access that a recorded CS word stands for, if the driver makes it.
pub fn recorded_access(segment: &Segment) -> Option<RemoteAccess> {
    let written = |register| {
        let write = segment.writes.iter().rev().find(|(r, _)| *r == register);
        write.map(|&(_, value)| u64::from(value))
    };
    let word = written(Register::Cs(0))? as u32;
    let (command, address) = ((word >> 24) as u8, word as u16);
    let sizes = [
        AccessSize::Byte,
        AccessSize::Word,
        AccessSize::Long,
        AccessSize::Double,
    ];
    let size = sizes[usize::from(command & 3)];
    let value = written(Register::Interface(0, 0)).unwrap_or(0)
        | written(Register::Interface(0, 1)).unwrap_or(0) << 32;
    let location = LocalLocation::new(command & 0x1F)?;
    match command {
        0x44..=0x47 => Some(RemoteAccess::Read { address, size }),
        0x64..=0x67 => Some(RemoteAccess::Write {
            address,
            size,
            value,
        }),
        0xC0..=0xDF => Some(RemoteAccess::ReadLocal(location)),
        0xE0..=0xFF => Some(RemoteAccess::WriteLocal(location, value as u8)),
        _ => None,
    }
}

/// Manual: 7I77, "REMOTE READ EXAMPLE", "REMOTE WRITE EXAMPLE"; transcript t05, all accesses that
/// the driver makes, including the lost reply.
#[test]
fn every_recorded_pass_through_access_gives_the_recorded_value() {
    // Steps 1 to 4.
    let bus = Replay::of("t05_passthrough").without(|segment| {
        segment.command == 0x2000 || segment.command == 0x1001 && recorded_access(segment).is_none()
    });
    let (mut bus, mut port) = stopped(bus, &[(5, 2)]);
    let report = port
        .on(&mut bus)
        .start(StartMode::Setup, &start_zero(0))
        .unwrap();
    assert_eq!(started(&report), ZERO.mask());
    let mut compared = 0;
    while let Some(segment) = bus.upcoming().cloned() {
        // Steps 5 to 9.
        let access = recorded_access(&segment).unwrap();
        let value = port.on(&mut bus).access(ZERO, access).unwrap();
        if access.written().is_none() {
            let lost = segment.last(Register::Data) != Some(0);
            let words = [0, 1].map(|n| segment.last(Register::Interface(0, n)).unwrap());
            let recorded = if lost { 0xBEEF } else { access.value(words) };
            assert_eq!(value, recorded, "{access}");
            compared += 1;
        }
    }
    assert_eq!(
        compared, 20,
        "reads in the transcript, the repeated one once"
    );
    never_busy(&bus);
}

/// FACTS 6.3; transcript t05: EC 01, read, write, read back, EC 00, and then a read of the other
/// memory.
#[test]
fn nonvolatile_access_is_confirmed_and_switched_off_again() {
    let mut bus = Replay::of("t05_passthrough").without(|segment| {
        // Local writes, and reads or writes of address 24.
        let in_sequence = recorded_access(segment).is_some_and(|access| {
            let word = access.cs_word();
            word >= 0xE000_0000 || word & 0x8000_FFFF == 0x24
        });
        segment.command != 0x0800 && segment.command != 0x0F01 && !in_sequence
    });
    bus.set_sizes(0, 5, 2);
    let mut port = identified(&mut bus);
    port.on(&mut bus).stop_all().unwrap();
    port.on(&mut bus)
        .start(StartMode::Setup, &start_zero(0))
        .unwrap();
    let (memory, size) = (NonvolatileMemory::Eeprom, AccessSize::Word);
    let write = RemoteAccess::Write {
        address: 0x24,
        size,
        value: 0x64,
    };
    link(&mut port, &mut bus)
        .access(Some(memory), write)
        .unwrap();
    let read = RemoteAccess::Read {
        address: 0x24,
        size,
    };
    assert_eq!(port.on(&mut bus).access(ZERO, read), Ok(0x32));
    assert!(bus.upcoming().is_none(), "the whole sequence was played");
    never_busy(&bus);
}

/// Transcript t08: one channel is stopped, the other goes on; then it is started again.
#[test]
fn one_channel_can_be_stopped_and_started_while_the_other_runs() {
    let mut doits = 0;
    let mut bus = Replay::of("t08_stops").without(|segment| {
        // The third DOIT of both has the stopped channel in its mask; the driver refuses that.
        doits += u32::from(segment.command == 0x1003);
        segment.command == 0x1003 && doits == 3
    });
    let (both, one) = (ChannelMask::from_bits(3), Channel::ALL[1]);
    bus.set_sizes(0, 5, 2);
    bus.set_sizes(1, 7, 6);
    let mut port = identified(&mut bus);
    port.on(&mut bus).stop_all().unwrap();
    let starts = [(ZERO, 0), (one, 0)];
    port.on(&mut bus).start(StartMode::Normal, &starts).unwrap();
    let none = PortWords::default();
    for _ in 0..2 {
        doit(&mut port, &mut bus, both, &none);
    }
    port.on(&mut bus).stop(one.mask()).unwrap();
    assert_eq!(port.running(), ZERO.mask());
    doit(&mut port, &mut bus, ZERO.mask(), &none);
    port.on(&mut bus)
        .start(StartMode::Normal, &starts[1..])
        .unwrap();
    let transfer = doit(&mut port, &mut bus, both, &none);
    assert_eq!(transfer.failed, ChannelMask::NONE);
    assert_eq!(transfer.inputs[one][..2], [0x4433_2211, 0x6655]);
    never_busy(&bus);
}

/// FACTS 5.3; transcript t11: a remote's fault shows in CS only.
#[test]
fn remote_fault_shows_although_data_is_clear() {
    let bus = Replay::of("t11_fault");
    let (mut bus, mut port) = running(bus, &[(5, 2)]);
    let mut faults = Vec::new();
    for _ in 0..6 {
        let transfer = doit(&mut port, &mut bus, ZERO.mask(), &PortWords::default());
        assert_eq!(transfer.failed, ChannelMask::NONE);
        faults.push(transfer.cs[ZERO].remote_faults());
    }
    let (none, bitten) = (RemoteFaults::empty(), RemoteFaults::WATCHDOG);
    let expected = [none, none, bitten, bitten, RemoteFaults::LOW_VOLTAGE, none];
    assert_eq!(faults, expected);
}

/// FACTS 4.4; transcript t12: a remote that is gone costs its own data, not its neighbour's.
#[test]
fn dead_remote_fails_alone() {
    let bus = Replay::of("t12_toomany");
    let (mut bus, mut port) = stopped(bus, &[(5, 2), (7, 6)]);
    let starts = [0, 1].map(|n| (Channel::ALL[n], 0));
    port.on(&mut bus).start(StartMode::Normal, &starts).unwrap();
    let both = ChannelMask::from_bits(3);
    let mut transfer = || doit(&mut port, &mut bus, both, &PortWords::default());
    for _ in 0..2 {
        assert_eq!(transfer().failed, ChannelMask::NONE);
    }
    let last = (0..25).map(|_| transfer()).inspect(|bad| {
        assert_eq!(bad.failed, ZERO.mask());
    });
    let faults = last.last().unwrap().cs[ZERO].local_faults();
    assert!(faults.contains(LocalFaults::TOO_MANY_ERRORS), "{faults}");
}

/// Transcript t26: a 7I64 has 8 bytes of data in its reply and no fault byte.
#[test]
fn a_7i64_starts_without_discovery() {
    let bus = Replay::of("t26_7i64");
    let (mut bus, mut port) = stopped(bus, &[(8, 4)]);
    let report = port
        .on(&mut bus)
        .start(StartMode::Normal, &start_zero(0))
        .unwrap();
    let remote = report[0].unwrap();
    assert_eq!((remote.ptoc, remote.input_bytes()), (0, 8));
    let transfer = doit(&mut port, &mut bus, ZERO.mask(), &outputs(&[0x00C0_FFEE]));
    assert_eq!(transfer.inputs[ZERO][..2], [0x0002_0100, 0xA3A2_A1A0]);
}

/// FACTS 2.4; transcript t18: 115200 baud on channel 0, from 9A on.
#[test]
fn baud_rate_is_written_and_read_back() {
    let mut bus = Replay::of("t18_baud");
    bus.local.extend((0x9A..).zip(2_500_000u32.to_le_bytes()));
    let (mut bus, mut port) = stopped(bus, &[(5, 2)]);
    let rate = |port: &mut Port, bus: &mut Replay| {
        let bytes = port.on(bus).read_variable(ZERO, ChannelVariable::BaudRate);
        bytes.map(u32::from_le_bytes)
    };
    assert_eq!(rate(&mut port, &mut bus), Ok(2_500_000));
    port.on(&mut bus).set_baud_rate(ZERO, 0x0001_C200).unwrap();
    assert_eq!(rate(&mut port, &mut bus), Ok(115_200));
}

#[test]
fn operations_in_the_wrong_state_write_nothing() {
    let mut bus = Replay::new(Vec::new());
    let mut port = identified(&mut bus);
    let commands = bus.commands.len();
    let read = RemoteAccess::Read {
        address: 0,
        size: AccessSize::Word,
    };
    assert!(port.on(&mut bus).access(ZERO, read).is_err());
    let memory = NonvolatileMemory::Eeprom;
    assert!(
        link(&mut port, &mut bus)
            .access(Some(memory), read)
            .is_err()
    );
    assert!(
        port.on(&mut bus)
            .start(StartMode::Normal, &start_zero(0))
            .is_err()
    );
    assert_eq!(bus.commands.len(), commands);
}
