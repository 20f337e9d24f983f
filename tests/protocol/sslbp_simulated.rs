//! The driver against the simulated FPGA and its remotes.

mod memory;

use crate::common::bus::{Around, Between};
use crate::common::fpga::set_up_pins;
use crate::common::image::Image;
use crate::common::replay::{recording, settings_of};
use crate::common::transfer::{PortWords, doit, port_words, started};
use mesa_hal::boards::REMOTES;
use mesa_hal::bus::{Access, BusError, Clock, Direction, RegisterBus};
use mesa_hal::discovery::{Discovery, DiscoveryOptions, ProblemKind, discover, discover_port};
use mesa_hal::hostmot2::HostMot2;
use mesa_hal::lbp::RemoteLink;
use mesa_hal::sslbp::{
    AccessSize, Channel, ChannelMask, ChannelVariable, CsStatus, NonvolatileMemory, Port,
    PortError, PortLayout, PortLink, PortParameters, PortState, ProcessDataSizes, RemoteAccess,
    StartFailureReason, StartMode,
};
use mesa_hal_sim::remote::{FixedData, SimRemote};
use mesa_hal_sim::{SimFpga, gtag, machines};
use proptest::prelude::*;
use std::time::Duration;

const ZERO: Channel = Channel::ALL[0];
const ONE: Channel = Channel::ALL[1];

/// The 7I77 of transcript t03: four software modes, parameters in EEPROM.
fn recorded_7i77() -> SimRemote<FixedData> {
    let mut remote = SimRemote::model();
    for setting in settings_of(&recording("t03_setup_one"), 0) {
        remote.apply(setting).unwrap();
    }
    remote
}

fn model(settings: &str) -> SimRemote<FixedData> {
    let mut remote = SimRemote::model();
    remote.apply(settings).unwrap();
    remote
}

/// A 7I92 with a 7I77, the recorded 7I77 on channel 0, and its port after a reset.
fn machine() -> (SimFpga, Port) {
    let mut fpga = machines::i7i92_7i77();
    fpga.plug(0, 0, Some(Box::new(recorded_7i77())));
    let port = reset_port(&mut fpga);
    (fpga, port)
}

fn reset_port(fpga: &mut SimFpga) -> Port {
    set_up_pins(fpga);
    let hostmot2 = HostMot2::identify(fpga).unwrap();
    let mut port = Port::new(PortLayout::locate(&hostmot2, 0).unwrap());
    port.on(fpga).reset().unwrap();
    port
}

fn remote(fpga: &mut SimFpga) -> &mut SimRemote<FixedData> {
    fpga.device_mut(0, 0).unwrap()
}

fn found(port: &mut Port, fpga: &mut SimFpga, start: (Channel, u8)) -> Discovery {
    let options = DiscoveryOptions {
        tables: &REMOTES,
        ..DiscoveryOptions::default()
    };
    let mut found = discover_port(port, fpga, &[start], &options).unwrap();
    found.remove(0).unwrap()
}

fn memory<'a>(port: &'a mut Port, fpga: &'a mut SimFpga) -> PortLink<'a, SimFpga> {
    PortLink {
        port,
        bus: fpga,
        channel: ZERO,
    }
}

fn start(channel: Channel, mode: u8) -> (Channel, u8) {
    (channel, mode)
}

#[test]
fn every_machine_has_a_port_that_resets() {
    for mut fpga in [
        machines::i7i92_7i77(),
        machines::i5i25_7i77(),
        machines::i7i97(1),
        machines::i7i97(8),
    ] {
        let mut port = reset_port(&mut fpga);
        assert_eq!(port.state(), PortState::Stopped);
        let parameters = port.on(&mut fpga).identify().unwrap();
        assert_eq!(parameters.clock_hz, fpga.firmware().clock(1));
        port.on(&mut fpga).stop_all().unwrap();
    }
}

/// A network that delivers every START twice, the second while the first runs.
struct StartsTwice;

impl Between for StartsTwice {
    fn exchange(
        &mut self,
        fpga: &mut SimFpga,
        accesses: &[Access],
        words: &mut [u32],
    ) -> Result<(), BusError> {
        let mut again = words.to_vec();
        fpga.exchange(accesses, words)?;
        let is_start = again
            .last()
            .is_some_and(|command| matches!(command >> 8, 0x0F | 0x09));
        if is_start && accesses.iter().all(|a| a.direction == Direction::Write) {
            fpga.wait(Duration::from_micros(300));
            fpga.exchange(accesses, &mut again)?;
        }
        Ok(())
    }
}

#[test]
fn start_delivered_twice_still_starts_the_channel() {
    let (fpga, mut port) = machine();
    let between = StartsTwice;
    let mut bus = Around { fpga, between };
    for mode in [StartMode::Setup, StartMode::Normal] {
        port.on(&mut bus).stop_all().unwrap();
        let report = port.on(&mut bus).start(mode, &[start(ZERO, 1)]).unwrap();
        assert_eq!(started(&report), ZERO.mask(), "{mode:?}: {report:?}");
    }
    let report = port.on(&mut bus).stop_all().and_then(|()| {
        port.on(&mut bus)
            .start(StartMode::Normal, &[start(ZERO, 0), start(ONE, 0)])
    });
    let started = started(&report.unwrap());
    assert_eq!(started, ZERO.mask(), "what is absent still fails");
}

/// A command completes at whatever point of the firmware's loop it is written.
#[test]
fn local_reads_complete_at_any_phase_of_the_firmware_loop() {
    let (mut fpga, mut port) = machine();
    for pause in 0..2_000 {
        fpga.wait(Duration::from_nanos(1_000 + 7 * pause));
        let address = PortParameters::MINOR;
        assert_eq!(
            port.on(&mut fpga).local_read(address),
            Ok(0x2B),
            "after {pause}"
        );
    }
}

/// COMMAND has 12 bits of address: 1066 would be 066, which holds another byte.
#[test]
fn address_too_wide_for_command_is_refused_and_not_truncated() {
    const SCRATCH: u16 = 0x66;
    let (mut fpga, mut port) = machine();
    port.on(&mut fpga).local_write(SCRATCH, 0x5A).unwrap();
    let refused = |error: PortError, address| {
        let text = format!("the local address is {address:#X}, expected 0xFFF at most");
        assert!(error.to_string().contains(&text), "{error}");
    };
    for address in [0x1000, 0x1000 | SCRATCH, u16::MAX] {
        let read = port.on(&mut fpga).local_read(address);
        refused(read.unwrap_err(), address);
        let written = port.on(&mut fpga).local_write(address, 0xA5);
        refused(written.unwrap_err(), address);
    }
    assert_eq!(port.on(&mut fpga).local_read(SCRATCH), Ok(0x5A));
}

#[test]
fn process_data_goes_both_ways_and_a_lost_reply_is_marked() {
    let (mut fpga, mut port) = machine();
    fpga.plug(
        0,
        1,
        Some(Box::new(model("present=1 name=7I72 unit=2 mode0=7,6,0,0"))),
    );
    let starts = [start(ZERO, 1), start(ONE, 0)];
    let report = port
        .on(&mut fpga)
        .start(StartMode::Normal, &starts)
        .unwrap();
    let both = started(&report);
    assert_eq!(both.bits(), 3);
    let outputs = port_words([(ZERO, &[0xBEEF]), (ONE, &[0x0403_0201, 0x0605])]);
    let transfer = doit(&mut port, &mut fpga, both, &outputs);
    assert_eq!(transfer.failed, ChannelMask::NONE);
    assert_eq!(transfer.inputs[ZERO][..2], [0x4433_2211, 0x8877_6655]);
    let sent = |fpga: &SimFpga, channel| {
        let device = fpga.device::<SimRemote<FixedData>>(0, channel).unwrap();
        device.application().outputs().to_vec()
    };
    assert_eq!(sent(&fpga, 0), [0xEF, 0xBE]);
    assert_eq!(sent(&fpga, 1), [1, 2, 3, 4, 5, 6]);

    remote(&mut fpga).apply("drop=1").unwrap();
    let transfer = doit(&mut port, &mut fpga, both, &outputs);
    assert_eq!(transfer.failed, ZERO.mask());
    let transfer = doit(&mut port, &mut fpga, both, &outputs);
    assert_eq!(transfer.failed, ChannelMask::NONE);
    let counters: [u8; 7] = port
        .on(&mut fpga)
        .read_variable(ZERO, ChannelVariable::ErrorCounters)
        .unwrap();
    assert_eq!(counters[3], 1, "time-outs");

    port.on(&mut fpga).stop(ZERO.mask()).unwrap();
    doit(&mut port, &mut fpga, ONE.mask(), &outputs);
    port.on(&mut fpga)
        .start(StartMode::Normal, &[start(ZERO, 1)])
        .unwrap();
    let transfer = doit(&mut port, &mut fpga, both, &outputs);
    assert_eq!(transfer.failed, ChannelMask::NONE);
}

/// FACTS 2.1: GTAG C6 has seven interface registers.
#[test]
fn wide_layout_moves_more_than_96_bits() {
    let mut firmware = machines::firmware_7i92_7i77();
    for module in &mut firmware.modules {
        if module.gtag == gtag::SSERIAL {
            module.gtag = gtag::SSERIAL_B;
            module.registers = 10;
            module.multiple = 0x3FC;
        }
    }
    for pin in &mut firmware.pins {
        if pin.secondary == gtag::SSERIAL {
            pin.secondary = gtag::SSERIAL_B;
        }
    }
    let mut fpga = SimFpga::new(firmware);
    let settings = "present=1 name=WIDE unit=5 mode0=15,14,0,0 in=0102030405060708090A0B0C0D0E";
    fpga.plug(0, 0, Some(Box::new(model(settings))));
    let mut port = reset_port(&mut fpga);
    assert_eq!(port.layout().interface_registers, 7);
    let report = port
        .on(&mut fpga)
        .start(StartMode::Normal, &[start(ZERO, 0)])
        .unwrap();
    assert_eq!(started(&report), ZERO.mask());
    let outputs = port_words([(ZERO, &[0x1111_1111, 0x2222_2222, 0x3333_3333, 0x4444])]);
    let transfer = doit(&mut port, &mut fpga, ZERO.mask(), &outputs);
    assert_eq!(transfer.failed, ChannelMask::NONE);
    assert_eq!(
        transfer.inputs[ZERO][..4],
        [0x0403_0201, 0x0807_0605, 0x0C0B_0A09, 0x0000_0E0D]
    );
    let sent = remote(&mut fpga).application().outputs();
    assert_eq!(sent[10..], [0x33, 0x33, 0x44, 0x44]);
}

/// FACTS 5.6: 14/13 would start and never work; it is refused, and its line is quiet again.
#[test]
fn remote_with_too_much_data_is_refused_and_stopped() {
    let (mut fpga, mut port) = machine();
    fpga.plug(
        0,
        1,
        Some(Box::new(model(
            "present=1 name=BIG! unit=9 mode0=14,13,0,0",
        ))),
    );
    let starts = [start(ZERO, 0), start(ONE, 0)];
    let report = port
        .on(&mut fpga)
        .start(StartMode::Normal, &starts)
        .unwrap();
    assert_eq!(started(&report), ZERO.mask());
    let failure = report[1].unwrap_err();
    assert_eq!(
        failure.reason,
        StartFailureReason::SizesTooLarge {
            sizes: ProcessDataSizes { rx: 14, tx: 13 },
            limit: ProcessDataSizes { rx: 13, tx: 12 },
        }
    );
    let cs = port.layout().cs(ONE).unwrap();
    let cs = CsStatus(fpga.read(cs).unwrap());
    assert!(cs.is_stopped(), "{cs}");
    // In setup mode its tables can still be read.
    port.on(&mut fpga).stop_all().unwrap();
    let report = port.on(&mut fpga).start(StartMode::Setup, &starts).unwrap();
    assert_eq!(started(&report).bits(), 3);
}

/// FACTS 3.1: whatever another program left behind.
#[test]
fn stop_all_frees_a_port_that_another_program_left_stuck() {
    let (mut fpga, mut port) = machine();
    port.on(&mut fpga)
        .start(StartMode::Normal, &[start(ZERO, 0)])
        .unwrap();
    let command = port.layout().command;
    doit(&mut port, &mut fpga, ZERO.mask(), &PortWords::default());
    fpga.write(command, 0x1001).unwrap();
    fpga.wait(Duration::from_micros(10));
    fpga.write(command, 0x0800).unwrap();
    fpga.wait(Duration::from_millis(5));
    assert_eq!(fpga.read(command), Ok(0x0800), "it is stuck");
    let mut other = Port::new(*port.layout());
    other.on(&mut fpga).identify().unwrap_err();
    other.on(&mut fpga).stop_all().unwrap();
    other.on(&mut fpga).identify().unwrap();
    assert_eq!(other.state(), PortState::Stopped);
}

/// One step of a program that ignores the rules.
#[derive(Clone, Copy, Debug)]
enum Step {
    Command(u32),
    Data(u32),
    Channel(u8, u8, u32),
    Wait(u32),
}

fn any_step() -> impl Strategy<Value = Step> {
    let command = prop_oneof![
        Just(0x0800u32),
        Just(0x0801),
        Just(0x0907),
        Just(0x0F07),
        Just(0x1007),
        Just(0x4000),
        Just(0x0001),
        (0u32..0x1000).prop_map(|address| 0x2000 | address),
        any::<u16>().prop_map(u32::from),
        any::<u32>(),
    ];
    prop_oneof![
        4 => command.prop_map(Step::Command),
        1 => any::<u32>().prop_map(Step::Data),
        2 => (0u8..3, 0u8..4, any::<u32>()).prop_map(|(c, r, v)| Step::Channel(c, r, v)),
        3 => (0u32..200_000).prop_map(Step::Wait),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// The driver's operations end within bounds whatever was done to the port before, and a reset
    /// always recovers it.
    #[test]
    fn no_sequence_of_commands_hangs_the_driver(
        steps in proptest::collection::vec(any_step(), 0..24),
    ) {
        let (mut fpga, mut port) = machine();
        let layout = *port.layout();
        for step in steps {
            match step {
                Step::Command(word) => fpga.write(layout.command, word).unwrap(),
                Step::Data(word) => fpga.write(layout.data(), word).unwrap(),
                Step::Channel(channel, register, word) => {
                    let channel = Channel::ALL[usize::from(channel)];
                    let address = match register {
                        0 => layout.cs(channel).unwrap(),
                        n => layout.interfaces(channel).nth(usize::from(n) - 1).unwrap(),
                    };
                    fpga.write(address, word).unwrap();
                }
                Step::Wait(nanos) => fpga.wait(Duration::from_nanos(nanos.into())),
            }
        }
        let begin = fpga.now();
        let _ = port.on(&mut fpga).stop_all();
        port.on(&mut fpga).reset().unwrap();
        let report = port
            .on(&mut fpga).start(StartMode::Normal, &[start(ZERO, 0)])
            .unwrap();
        prop_assert_eq!(started(&report), ZERO.mask());
        doit(&mut port, &mut fpga, ZERO.mask(), &PortWords::default());
        let took = Duration::from_nanos(fpga.now() - begin);
        prop_assert!(took < Duration::from_secs(2), "took {:?}", took);
    }
}
