//! A driver is built with each simulated device, alone and with others: its inputs are read, its
//! outputs arrive, and no device is missing.

use crate::common::machine::start;
use mesa_hal::RemoteId;
use mesa_hal::Settings;
use mesa_hal::boards::{I7i77Analog, I7i77Field, i7i77};
use mesa_hal::bus::{Access, BusError, Direction, RegisterBus};
use mesa_hal::discovery::{DataType, ElementTable, RemoteTable};
use mesa_hal::driver::{
    Driver, DriverError, Presence, Remark, RemarkKind, RemoteConfig, RemoteState, SerialConfig,
};
use mesa_hal::hostmot2::HostMot2;
use mesa_hal::sslbp::{Channel, PortLayout};
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::devices::{
    Analog, Description, FieldIo, Outputs48, Plain, SignalValue, find, find_cable, find_mut,
};
use mesa_hal_sim::remote::Cable;
use mesa_hal_sim::wire::RemoteEnd;
use mesa_hal_sim::{SimFpga, machines};

use crate::common::bus::{Around, Between};

/// The devices, and the number of their software modes.
const DEVICES: [(&str, u8); 6] = [
    ("7i77", 4),
    ("7i77d", 4),
    ("analog", 1),
    ("7i72", 2),
    ("7i64", 1),
    ("stmbl", 1),
];

/// A drive whose numbers are unlimited, as those of STMBL. FACTS 11.10.
const STMBL: &str = "
remote stbl
unit 0x11223344
mode 0 standard
  data pos_cmd 32 float out -inf inf rad
  data vel_cmd 32 float out -inf inf rads
  data enable 1 boolean out
  data pad_out 7 pad out
  data pos_fb 32 float in -inf inf rad
  data vel_fb 32 float in -inf inf rads
  data fault 1 boolean in
  data pad_in 7 pad in
parameter scale 32 float both -inf inf
";

fn device(name: &str) -> Box<dyn RemoteEnd> {
    match name {
        "7i77" => Box::new(FieldIo::i7i77().expect("7I77")),
        "7i77d" => Box::new(FieldIo::i7i77d().expect("7I77D")),
        "analog" => Box::new(Analog::i7i77().expect("7I77")),
        "7i72" => Box::new(Outputs48::i7i72().expect("7I72")),
        "7i64" => Box::new(Plain::i7i64().expect("7I64")),
        "8i20" => Box::new(
            Plain::from_description("remote 8I20\nunit 1\nmode 0 m\nno-discovery\n").expect("8I20"),
        ),
        _ => Box::new(Plain::from_description(STMBL).expect("STMBL")),
    }
}

/// The driver of a board with these devices in these modes.
fn build(devices: &[(&str, u8)]) -> Result<Driver<SimFpga>, DriverError> {
    let mut fpga = SimFpga::new(machines::firmware_serial(&[8]));
    let mut modes = String::new();
    for (channel, (name, mode)) in devices.iter().enumerate() {
        fpga.plug(0, channel, Some(device(name)));
        modes.push_str(&mode.to_string());
    }
    let modes: SerialConfig = format!("{modes:x<8}").parse().expect("modes");
    start(fpga, |s| s.serial_ports = [(0, modes)].into())
}

fn step(driver: &mut Driver<SimFpga>) {
    let _ = driver.read().expect("the bus works");
    driver.write().expect("the bus works");
    let now = SimFpga::now(driver.bus());
    driver.bus_mut().advance_to(now + 1_000_000);
}

/// Checks that every digital output follows, and that every digital input is read.
fn drive(driver: &mut Driver<SimFpga>, channel: usize, name: &str) {
    for on in [true, false] {
        let end = driver.bus_mut().remote_mut(0, channel);
        let world = find_mut(end.expect("remote")).expect("device");
        for input in 0..world.inputs().len() {
            // Analog inputs are not digital ones.
            let _ = world.set_input(input, on);
        }
        let _ = driver.rearm().expect("the bus works");
        let prefix = driver.ports()[0]
            .remotes()
            .find(|r| usize::from(r.started.channel.index()) == channel);
        let prefix = prefix.expect("it runs").pins.prefix.clone();
        let end = driver.bus().remote(0, channel).expect("remote");
        let outputs = find(end).expect("device").outputs();
        for (output, value) in &outputs {
            let pin = format!("{prefix}.{output}");
            let pins = driver.pins_mut();
            if let SignalValue::Bool(_) = value {
                let pin = pins.output::<bool>(&pin).expect("output");
                pins.set(pin, on);
            } else {
                let pin = pins.output::<f64>(&pin).expect("output");
                pins.set(pin, if on { 2.0 } else { 0.0 });
            }
        }
        for _ in 0..5 {
            step(driver);
        }
        let end = driver.bus().remote(0, channel).expect("remote");
        let truth = find(end).expect("device");
        for (output, value) in truth.outputs() {
            let is_on = match value {
                SignalValue::Bool(is_on) => is_on,
                SignalValue::Volts(v) | SignalValue::Number(v) => (v - 2.0).abs() < 0.01,
                SignalValue::Count(count) => count != 0,
            };
            assert_eq!(is_on, on, "{name} on channel {channel}: {output}");
        }
        for (input, value) in truth.inputs() {
            if let SignalValue::Bool(is_on) = value {
                let pin = format!("{prefix}.{input}");
                let pin = driver.pins().input::<bool>(&pin).expect("input");
                let shown = driver.pins().read(pin);
                assert_eq!((shown.value, shown.valid), (is_on, true), "{name}: {input}");
            }
        }
    }
}

#[test]
fn driver_runs_each_device_alone_in_each_of_its_modes() {
    for (name, modes) in DEVICES {
        for mode in 0..modes {
            let mut driver = build(&[(name, mode)]).expect(name);
            assert_eq!(driver.missing(), [], "{name} in mode {mode}");
            assert_eq!(driver.remarks(), [], "{name} in mode {mode}");
            drive(&mut driver, 0, name);
        }
    }
}

#[test]
fn driver_runs_all_devices_in_company_in_any_order() {
    for first in 0..DEVICES.len() {
        let mut devices = DEVICES.map(|(name, modes)| (name, modes - 1));
        devices.rotate_left(first);
        let mut driver = build(&devices).expect("all of them");
        assert_eq!(driver.missing(), []);
        for (channel, (name, _)) in devices.iter().enumerate() {
            drive(&mut driver, channel, name);
        }
    }
}

/// While it transfers, its channel is in another state than those of the other cards (FACTS 4.6).
#[test]
fn a_7i64_comes_back_after_a_restart_in_the_cycle() {
    let channel = Channel::ALL[1];
    let mut fpga = SimFpga::new(machines::firmware_serial(&[8]));
    fpga.plug(0, 0, Some(device("7i72")));
    fpga.plug(0, 1, Some(Box::new(Cable::new(device("7i64"), 64))));
    let mut driver = Driver::start(fpga, Settings::default()).expect("both of them");
    drive(&mut driver, 1, "7i64");
    for (restarts, is_unplugged) in [(1, false), (2, true)] {
        if is_unplugged {
            cable(&mut driver, 1).unplug();
        } else {
            driver.restart((0, channel.index()));
        }
        let mut was_offline = false;
        for cycle in 0..1000 {
            let status = driver.ports()[0].remote(channel).expect("remote");
            let (state, group) = (status.state, status.pins.group);
            let is_running = state == RemoteState::Running;
            was_offline |= !is_running;
            if was_offline && is_running {
                break;
            }
            let group = driver.pins().group_state(group).expect("group");
            assert!(is_running || !group.valid && !group.armed, "{state:?}");
            let _ = driver.rearm().expect("the bus works");
            if cycle == 150 {
                cable(&mut driver, 1).replug();
            }
            step(&mut driver);
        }
        let status = driver.ports()[0].remote(channel).expect("remote");
        assert_eq!(status.state, RemoteState::Running);
        assert_eq!(status.restarts, restarts);
        assert!(was_offline);
        for _ in 0..3 {
            step(&mut driver);
        }
        drive(&mut driver, 1, "7i64");
        drive(&mut driver, 0, "7i72");
    }
}

fn cable(driver: &mut Driver<SimFpga>, channel: usize) -> &mut Cable {
    let end = driver.bus_mut().remote_mut(0, channel).expect("remote");
    find_cable(end).expect("cable")
}

/// FACTS 11.5: an 8I20 has its own start sequence in the gateware, and no tables.
#[test]
fn unsupported_8i20_is_named_and_does_not_disturb_others() {
    let mut driver = build(&[("7i64", 0), ("8i20", 0), ("7i72", 0)]).expect("the others");
    let [missing] = driver.missing() else {
        panic!("{:?}", driver.missing());
    };
    assert_eq!(missing.remote, Some(RemoteId::new(0, 1).into()));
    assert!(matches!(missing.kind, RemarkKind::Tables(_)));
    let text = missing.to_string();
    assert!(
        text.contains("8I20") && text.contains("not supported"),
        "{text}"
    );
    assert_eq!(missing.advice(), Some(advice::ADD_TABLE));
    drive(&mut driver, 0, "7i64");
    drive(&mut driver, 2, "7i72");
}

/// A gateware that has the sizes of a 7I64 on channel 0 only after a normal START.
struct SizesOfNormalStart {
    layout: PortLayout,
    is_setup: bool,
    is_asked: bool,
}

impl Between for SizesOfNormalStart {
    fn exchange(
        &mut self,
        fpga: &mut SimFpga,
        accesses: &[Access],
        words: &mut [u32],
    ) -> Result<(), BusError> {
        let at = |address, direction| {
            let mut accesses = accesses.iter();
            let access = accesses.find(|a| (a.address, a.direction) == (address, direction));
            access.map(|access| usize::from(access.first))
        };
        if let Some(place) = at(self.layout.command, Direction::Write) {
            let command = words[place];
            self.is_setup = match command >> 8 {
                0x0F => true,
                0x09 => false,
                _ => self.is_setup,
            };
            // RXSize and TXSize.
            self.is_asked = matches!(command, 0x209E | 0x209F);
        }
        fpga.exchange(accesses, words)?;
        if let Some(place) = at(self.layout.data(), Direction::Read)
            && self.is_setup
            && self.is_asked
        {
            words[place] = 0;
        }
        Ok(())
    }
}

/// FACTS 4.7: the gateware gives a 7I64 its sizes. Their values in setup mode are not known.
#[test]
fn table_of_equal_sizes_runs_a_7i64_sized_only_by_normal_start() {
    const OTHER: RemoteTable = RemoteTable {
        has_discovery: false,
        ..RemoteTable::new(
            "other 7I64",
            *b"7I64",
            &[ElementTable::output("output", 24, DataType::Bits)],
        )
    };
    for (remotes, runs) in [(vec![], true), (vec![&OTHER], false)] {
        let mut fpga = machine(vec![device("7i64")]);
        let firmware = HostMot2::identify(&mut fpga).expect("a firmware");
        let between = SizesOfNormalStart {
            layout: PortLayout::locate(&firmware, 0).expect("a port"),
            is_setup: false,
            is_asked: false,
        };
        let settings = Settings {
            serial_ports: [(0, "0xxxxxxx".parse().expect("modes"))].into(),
            remotes,
            ..Settings::default()
        };
        let driver = Driver::start(Around { fpga, between }, settings).expect("a board");
        assert_eq!(driver.missing(), []);
        let remote = driver.ports()[0].remotes().next().expect("a 7I64");
        assert_eq!(remote.state == RemoteState::Running, runs);
        let mut remarks = driver.remarks().iter();
        let offline = remarks.find(|one| matches!(one.kind, RemarkKind::Offline { .. }));
        assert_eq!(offline.is_none(), runs);
        if let Some(remark) = offline {
            let text = remark.to_string();
            assert!(text.contains("process data is"), "{text}");
        }
    }
}

fn machine(ends: Vec<Box<dyn RemoteEnd>>) -> SimFpga {
    let mut fpga = SimFpga::new(machines::firmware_serial(&[8]));
    for (channel, end) in ends.into_iter().enumerate() {
        fpga.plug(0, channel, Some(end));
    }
    fpga
}

/// The remote's own tables are used, and the differences are reported.
#[test]
fn remote_differing_from_its_table_runs_and_is_reported() {
    let text = "
remote 7I77
unit 0x11000007
mode 0 analogout_enables
  data AnalogOut0 12 signed out -5 5 volts
  data AnalogOut1 13 signed out -10 10 volts
  data AnalogOut2 13 signed out -10 10 volts
  data AnalogOut3 13 signed out -10 10 volts
  data AnalogOut4 13 signed out -10 10 volts
  data SpinEna 1 boolean out
  data AnalogEna 1 boolean out
  data Extra 1 boolean out
  data Filler 13 pad out
";
    let odd = Plain::from_description(text).expect("description");
    let fpga = machine(vec![Box::new(odd)]);
    let driver = Driver::start(fpga, Settings::default()).expect("it runs");
    assert_eq!(driver.ports()[0].remotes().count(), 1);
    let remarks: Vec<String> = driver.remarks().iter().map(ToString::to_string).collect();
    let has = |text: &str| remarks.iter().any(|remark| remark.contains(text));
    for text in [
        "AnalogOut0: width 12, by the table 13",
        "AnalogOut0: limits -5 to 5, by the table -10 to 10",
        "AnalogOut5: place none, by the table 5",
        "SpinEna: place 5, by the table 7",
        ": place 7, by the table none",
        "7i77.0.0: this 7I77 differs from the 7I77 analog",
    ] {
        assert!(has(text), "{text}: {remarks:#?}");
    }
}

#[test]
fn scaled_numbers_without_finite_limits_run_and_are_reported() {
    let text = "
remote XYZ1
unit 5
mode 0 m
  data speed 16 unsigned in 0 inf hz
  data level 16 unsigned out 0 10 volts
";
    let odd = Plain::from_description(text).expect("description");
    let driver = Driver::start(machine(vec![Box::new(odd)]), Settings::default()).expect("it runs");
    assert_eq!(driver.ports()[0].remotes().count(), 1);
    let [remark] = driver.remarks() else {
        panic!("{:?}", driver.remarks());
    };
    let text = remark.to_string();
    assert!(text.contains("0 to inf are not finite"), "{text}");
    assert_eq!(remark.advice(), Some(advice::CHECK_SCALE));
}

/// A silent channel is not a fault, unless the other half of a card is beside it.
#[test]
fn silent_channel_is_empty_unless_its_other_card_part_answers() {
    let missing = |silent: usize| {
        let mut fpga = machine(vec![device("7i77"), device("analog")]);
        fpga.plug(0, silent, None);
        let driver = Driver::start(fpga, Settings::default()).expect("the other runs");
        driver.missing().to_vec()
    };
    for (silent, part, other) in [
        (0, "7I77 field I/O", "7I77 analog"),
        (1, "7I77 analog", "7I77 field I/O"),
    ] {
        let missing = missing(silent);
        let (lost, empty) = missing.split_first().expect("it is missing");
        assert_eq!(lost.remote, Some(RemoteId::new(0, silent as u8).into()));
        assert!(!lost.is_silent(), "{lost}");
        let text = lost.to_string();
        let says = format!(
            "no reply from the {part}, although the {other} on channel {}",
            1 - silent
        );
        assert!(text.contains(&says), "{text}");
        assert_eq!(empty.len(), 6);
        assert!(empty.iter().all(Remark::is_silent), "{empty:?}");
    }
}

/// FACTS 8.1: both parts have the name 7I77, and differ in the top byte of the unit number.
#[test]
fn swapped_7i77_channels_are_detected_with_the_next_step() {
    let swapped = || machine(vec![device("analog"), device("7i77")]);
    let driver = Driver::start(swapped(), Settings::default()).expect("both run");
    let [remark] = driver.remarks() else {
        panic!("{:?}", driver.remarks());
    };
    assert_eq!(remark.kind, RemarkKind::Swapped);
    let field = driver.attach::<I7i77Field>((0, 0));
    let analog = driver.attach::<I7i77Analog>((0, 1));
    let errors = [field.expect_err("analog"), analog.expect_err("field")];
    for error in &errors {
        assert_eq!(error.advice(), Some(advice::EXCHANGE_CHANNELS));
    }
    let texts = errors.map(|error| error.to_string());
    assert!(
        texts[0]
            .contains("is 7I77 analog, because the channels are swapped, expected 7I77 field I/O"),
        "{texts:?}"
    );
    assert!(
        texts[1]
            .contains("is 7I77 field I/O, because the channels are swapped, expected 7I77 analog"),
        "{texts:?}"
    );

    let required = |kind| RemoteConfig {
        kind: Some(kind),
        presence: Presence::Required,
        ..RemoteConfig::default()
    };
    let (field, analog) = (required(&i7i77::FIELD), required(&i7i77::ANALOG));
    let kinds = SerialConfig {
        channels: [(0, field), (1, analog)].into(),
    };
    let error =
        start(swapped(), |s| s.serial_ports = [(0, kinds.clone())].into()).expect_err("swapped");
    assert_eq!(error.advice(), Some(advice::EXCHANGE_CHANNELS));
    let right = machine(vec![device("7i77"), device("analog")]);
    let driver = start(right, |s| s.serial_ports = [(0, kinds)].into()).expect("right");
    assert_eq!((driver.missing(), driver.remarks()), (&[][..], &[][..]));
}

/// As in LinuxCNC: a channel with `x` leaves its RX, TX and TXEN to plain I/O.
#[test]
fn pins_of_channels_that_are_not_used_are_plain_io() {
    let build = |modes: &str| {
        let fpga = machines::six_axes_7i92(mesa_hal_sim::Motor::default());
        let modes: SerialConfig = modes.parse().expect("modes");
        start(fpga, |s| s.serial_ports = [(0, modes)].into()).expect("complete")
    };
    // FACTS 8.1: TXEN2, TX2 and RX2 are I/O 0 to 2, TX1 and RX1 are 3 and 4.
    let all = build("000");
    let two = build("00x");
    for pin in 0..17 {
        let name = format!("hm2_7i92.0.gpio.{pin:03}.out");
        assert!(all.pins().output::<bool>(&name).is_err(), "{name}");
        assert_eq!(two.pins().output::<bool>(&name).is_ok(), pin < 3, "{name}");
    }
    assert_eq!(two.ports()[0].remotes().count(), 2);
    let directions = [all, two].map(|mut driver| driver.bus_mut().read_register(0x1100) & 7);
    // TXEN2 and TX2 are driven by the channel; as plain I/O they are not driven until requested.
    assert_eq!(directions, [0b011, 0]);
}

/// Names as hostmot2 makes them: the second letter small, the others as the card has them.
#[test]
fn second_letter_of_a_cards_name_is_small_and_no_other() {
    for (name, expected) in [
        ("PnLb", "PnLb"),
        ("TsHW", "TsHW"),
        ("ABCD", "AbCD"),
        ("7I99", "7i99"),
        ("a-Z ", "a-Z_"),
    ] {
        let text = "remote CARD\nunit 1\nmode 0 m\n  data Led 2 bits out\n";
        let mut description = Description::parse(text).expect("a card");
        description.name = name.as_bytes().try_into().expect("four letters");
        let mut fpga = machines::i7i97(1);
        fpga.plug(
            0,
            0,
            Some(Box::new(Plain::remote(&description).expect("a card"))),
        );
        let driver = Driver::start(fpga, Settings::default()).expect("a 7I97");
        let pin = format!("hm2_7i97.0.{expected}.0.0.led-01");
        assert!(driver.pins().output::<bool>(&pin).is_ok(), "{pin}");
    }
}

/// As LinuxCNC shows them on real machines: FACTS 7.2.
#[test]
fn data_of_other_modes_are_parameters_where_they_are_values() {
    let mut fpga = machines::i7i97(1);
    fpga.plug(0, 0, Some(Box::new(FieldIo::i7i76().expect("7I76"))));
    let driver = Driver::start(fpga, Settings::default()).expect("a 7I97");
    let has = |name: &str| {
        let name = format!("hm2_7i97.0.7i76.0.0.{name}");
        driver.pins().has(&name)
    };
    for value in [
        "analogin0",
        "analogin3",
        "fieldvoltage",
        "encmode0",
        "nvencmode1",
    ] {
        assert!(has(value), "{value}");
    }
    for other in ["enc0", "enc1", "input", "output", "enc0.count"] {
        assert!(!has(other), "{other}");
    }
}
