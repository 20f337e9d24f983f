//! Discovery of the simulated devices over the wire, compared with an exact implementation of the
//! manual's step list: byte by byte, by code that is independent of the driver's.

use crate::common::fpga::set_up_pins;
use crate::common::transfer::{doit, port_words};
use mesa_hal::boards::REMOTES;
use mesa_hal::discovery::{
    DataDirection, DataType, Discovery, DiscoveryOptions, ProblemKind, RemoteDescriptor,
    discover_port,
};
use mesa_hal::hostmot2::HostMot2;
use mesa_hal::sslbp::{
    AccessSize, Channel, LocalLocation, NonvolatileMemory, Port, PortLayout, ProcessDataSizes,
    RemoteAccess, StartMode,
};
use mesa_hal_sim::devices::{Analog, Device, FieldIo, Outputs48, Plain, find_mut};
use mesa_hal_sim::remote::SimRemote;
use mesa_hal_sim::wire::RemoteEnd;
use mesa_hal_sim::{SimFpga, machines};

/// A 7I97 whose serial port has four channels: a 7I77's two remotes, a 7I72 and a 7I64.
fn machine() -> (SimFpga, Port) {
    let mut fpga = machines::i7i97(4);
    let remotes: [Box<dyn RemoteEnd>; 4] = [
        Box::new(FieldIo::i7i77().unwrap()),
        Box::new(Analog::i7i77().unwrap()),
        Box::new(Outputs48::i7i72().unwrap()),
        Box::new(Plain::i7i64().unwrap()),
    ];
    for (channel, remote) in remotes.into_iter().enumerate() {
        fpga.plug(0, channel, Some(remote));
    }
    set_up_pins(&mut fpga);
    let hostmot2 = HostMot2::identify(&mut fpga).unwrap();
    let mut port = Port::new(PortLayout::locate(&hostmot2, 0).unwrap());
    port.on(&mut fpga).reset().unwrap();
    (fpga, port)
}

/// The remotes on the first channels.
fn discovered(port: &mut Port, fpga: &mut SimFpga, modes: &[u8]) -> Vec<Discovery> {
    let starts: Vec<(Channel, u8)> = Channel::ALL
        .into_iter()
        .zip(modes)
        .map(|(channel, &mode)| (channel, mode))
        .collect();
    let options = DiscoveryOptions {
        tables: &REMOTES,
        ..DiscoveryOptions::default()
    };
    let found = discover_port(port, fpga, &starts, &options).unwrap();
    found.into_iter().map(Result::unwrap).collect()
}

fn found(port: &mut Port, fpga: &mut SimFpga, modes: &[u8]) -> Vec<Discovery> {
    let found = discovered(port, fpga, modes);
    for found in &found {
        assert_eq!(found.problems, [], "{}", found.started);
        assert!(found.plan.is_ok());
    }
    found
}

fn elements(descriptor: &RemoteDescriptor) -> Vec<(&str, u8, DataDirection)> {
    let data = descriptor.process_data.iter();
    data.map(|record| (record.name.as_str(), record.bits, record.direction))
        .collect()
}

/// FACTS 8.1 to 8.4, 4.7.
#[test]
fn discovered_devices_match_the_facts() {
    use DataDirection::{Input, Output};
    let (mut fpga, mut port) = machine();
    let found = found(&mut port, &mut fpga, &[0, 0, 0, 0]);
    let [field_io, analog, i7i72, i7i64] = &found[..] else {
        panic!("four remotes, and not {}", found.len());
    };

    assert_eq!(field_io.started.name.to_string(), "7I77");
    assert_eq!(field_io.started.unit_number >> 24, 0x12);
    assert_eq!(field_io.started.sizes, ProcessDataSizes { rx: 5, tx: 2 });
    assert_eq!(
        elements(&field_io.descriptor),
        [("Output", 16, Output), ("Input", 32, Input)]
    );
    let field = &field_io.descriptor;
    // Its ten parameters, and the seven values that modes 1 to 3 transfer.
    assert_eq!((field.parameters.len(), field.modes.len()), (17, 5));
    for name in [
        "SwRevision",
        "UnitNumber",
        "NVBaudRate",
        "NVWatchDogTimeout",
    ] {
        let parameter = field_io.descriptor.parameter(name);
        assert!(parameter.is_some(), "{name}");
    }

    assert_eq!(analog.started.unit_number >> 24, 0x11);
    assert_eq!(analog.started.sizes, ProcessDataSizes { rx: 1, tx: 10 });
    let last = &analog.descriptor.process_data[5];
    assert_eq!(
        (&*last.name, last.data_type),
        ("AnalogOut5", DataType::Signed)
    );
    assert_eq!((last.min, last.max), (-10.0, 10.0));
    let analog = elements(&analog.descriptor);
    assert_eq!(analog[0], ("AnalogOut0", 13, Output));
    assert_eq!(
        analog[6..],
        [("AnalogEna", 1, Output), ("SpinEna", 1, Output)]
    );
    assert_eq!(
        analog
            .iter()
            .map(|(_, bits, _)| u32::from(*bits))
            .sum::<u32>(),
        80
    );

    assert_eq!(i7i72.started.name.to_string(), "7I72");
    assert_eq!(elements(&i7i72.descriptor), [("Output", 48, Output)]);

    assert_eq!(i7i64.started.ptoc, 0);
}

/// A host that ends in the middle of an access to non-volatile memory leaves the remote with that
/// memory in the place of its tables (FACTS 6.3).
#[test]
fn remotes_left_with_nonvolatile_memory_selected_are_found() {
    let (mut fpga, mut port) = machine();
    let before = found(&mut port, &mut fpga, &[0, 0, 0, 0]);
    for memory in [NonvolatileMemory::Eeprom, NonvolatileMemory::Flash] {
        for channel in Channel::ALL.into_iter().take(3) {
            let select = RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, memory as u8);
            port.on(&mut fpga).access(channel, select).unwrap();
        }
        let after = found(&mut port, &mut fpga, &[0, 0, 0, 0]);
        assert_eq!(after, before, "{memory:?}");
    }
}

/// FACTS 4.7, transcript t26: all eight bytes of a 7I64's reply are data, so that its inputs are at
/// the places of the built-in table.
#[test]
fn inputs_of_a_7i64_are_at_the_places_of_its_table() {
    let (mut fpga, mut port) = machine();
    let channel = Channel::ALL[3];
    let found = found(&mut port, &mut fpga, &[0, 0, 0, 0]);
    let records = &found[3].descriptor.process_data;
    let names = ["output", "pad", "input", "pad", "analog0", "analog1"];
    assert!(records.iter().map(|record| record.name.as_str()).eq(names));
    port.on(&mut fpga).stop_all().unwrap();
    let starts = [(channel, 0)];
    let report = port
        .on(&mut fpga)
        .start(StartMode::Normal, &starts)
        .unwrap();
    let sizes = report[0].unwrap().sizes;
    assert_eq!(sizes, ProcessDataSizes { rx: 8, tx: 4 });
    let device = find_mut(fpga.remote_mut(0, 3).unwrap()).unwrap();
    device.set_input(0, true).unwrap();
    device.set_input(23, true).unwrap();
    device.set_input_volts(1, 3.3).unwrap();
    let outputs = port_words([(channel, &[0x00C0_FFEE])]);
    let transfer = doit(&mut port, &mut fpga, channel.mask(), &outputs);
    assert_eq!(transfer.inputs[channel][..3], [0x0080_0001, 0xFFFF_0000, 0]);
    let device: &SimRemote<Device<Plain>> = fpga.device(0, 3).unwrap();
    let world = device.application().world();
    assert_eq!(world.raw("Output"), Some(&[0xEE, 0xFF, 0xC0][..]));
}

/// Manual: 7I77, "REMOTE MODES": each software mode has its own process data. FACTS 8.2.
#[test]
fn every_software_mode_of_the_7i77_has_its_sizes() {
    let (mut fpga, mut port) = machine();
    for (mode, rx, count) in [(0, 5, 2), (1, 9, 6), (2, 10, 7), (3, 12, 9)] {
        let remote = &found(&mut port, &mut fpga, &[mode])[0];
        assert_eq!(remote.started.sizes, ProcessDataSizes { rx, tx: 2 });
        let descriptor = &remote.descriptor;
        assert_eq!(
            (descriptor.software_mode, descriptor.process_data.len()),
            (mode, count)
        );
        println!("7I77 field I/O, mode {mode}: {} accesses", remote.accesses);
    }
}

/// The manual's "remote read", counted.
struct ByTheManual<'a> {
    port: &'a mut Port,
    fpga: &'a mut SimFpga,
    reads: u32,
}

impl ByTheManual<'_> {
    fn read(&mut self, address: u16, size: AccessSize) -> u32 {
        self.reads += 1;
        let channel = Channel::ALL[0];
        let value = self
            .port
            .on(self.fpga)
            .access(channel, RemoteAccess::Read { address, size });
        value.unwrap() as u32
    }

    /// Steps 22, 23 and 27.
    fn string(&mut self, pointer: &mut u16) -> String {
        let mut text = String::new();
        loop {
            let byte = self.read(*pointer, AccessSize::Byte) as u8;
            *pointer += 1;
            if byte == 0 {
                return text;
            }
            text.push(char::from(byte));
        }
    }

    /// Steps 5 to 10.
    fn table(&mut self, mut pointer: u16) -> Vec<u16> {
        let mut table = Vec::new();
        loop {
            let word = self.read(pointer, AccessSize::Word) as u16;
            if word == 0 {
                return table;
            }
            table.push(word);
            pointer += 2;
        }
    }

    /// Steps 12 to 28, with the offsets of FACTS 7.1; each record as one line of text.
    fn record(&mut self, record: u16) -> String {
        let byte = |this: &mut Self, offset| this.read(record + offset, AccessSize::Byte);
        match byte(self, 0) {
            0xA0 => {
                let header = [1, 2, 3].map(|offset| byte(self, offset));
                let limits = [4, 8]
                    .map(|offset| f32::from_bits(self.read(record + offset, AccessSize::Long)));
                let address = self.read(record + 12, AccessSize::Word);
                let mut pointer = record + 14;
                let unit = self.string(&mut pointer);
                let name = self.string(&mut pointer);
                format!("data {record:04X} {header:02X?} {limits:?} {address:04X} {unit} {name}")
            }
            0xB0 => {
                let header = [1, 2].map(|offset| byte(self, offset));
                let name = self.string(&mut (record + 4));
                format!("mode {record:04X} {header:02X?} {name}")
            }
            other => panic!("record type {other:02X}"),
        }
    }
}

/// The driver's records in the same form.
fn lines(descriptor: &RemoteDescriptor) -> Vec<String> {
    use mesa_hal::discovery::DataType as T;
    let code = |data_type| {
        (0..=255)
            .find(|&byte| T::from_byte(byte) == data_type)
            .unwrap()
    };
    let direction = |direction| match direction {
        DataDirection::Input => 0x00,
        DataDirection::Bidirectional => 0x40,
        DataDirection::Output => 0x80u32,
    };
    let data = descriptor.process_data.iter().chain(&descriptor.parameters);
    let data = data.map(|r| {
        let header = [
            u32::from(r.bits),
            u32::from(code(r.data_type)),
            direction(r.direction),
        ];
        let limits = [r.min, r.max];
        format!(
            "data {:04X} {header:02X?} {limits:?} {:04X} {} {}",
            r.record_address, r.address, r.unit, r.name
        )
    });
    let modes = descriptor.modes.iter().map(|mode| {
        let kind = match mode.mode_type {
            mesa_hal::discovery::ModeType::Hardware => 0,
            mesa_hal::discovery::ModeType::Software => 1,
            mesa_hal::discovery::ModeType::Other(other) => other,
        };
        let header = [mode.index, kind];
        format!(
            "mode {:04X} {header:02X?} {}",
            mode.record_address, mode.name
        )
    });
    data.chain(modes).collect()
}

/// Manual: 7I77, "DISCOVERY SEQUENCE", steps 1 to 29.
#[test]
fn manuals_steps_find_the_same_with_many_more_accesses() {
    let (mut fpga, mut port) = machine();
    for mode in 0..4 {
        let ours = &found(&mut port, &mut fpga, &[mode])[0];
        // 1 to 4
        port.on(&mut fpga).stop_all().unwrap();
        let start = (Channel::ALL[0], mode);
        let report = port
            .on(&mut fpga)
            .start(StartMode::Setup, &[start])
            .unwrap();
        let remote = report[0].unwrap();
        let mut manual = ByTheManual {
            port: &mut port,
            fpga: &mut fpga,
            reads: 0,
        };
        let process = manual.table(remote.ptoc);
        let global = manual.table(remote.gtoc);
        let mut expected: Vec<String> = process.iter().map(|&r| manual.record(r)).collect();
        let addresses: Vec<String> = expected.iter().map(|line| data_address(line)).collect();
        for record in global {
            if process.contains(&record) {
                continue;
            }
            let line = manual.record(record);
            if line.starts_with("mode") || !addresses.contains(&data_address(&line)) {
                expected.push(line);
            }
        }
        let reads = manual.reads;
        let mut found = lines(&ours.descriptor);
        found.sort();
        expected.sort();
        assert_eq!(found, expected, "mode {mode}");
        println!(
            "mode {mode}: {} accesses, {reads} by the manual's steps",
            ours.accesses
        );
        assert!(ours.accesses * 5 < reads, "mode {mode}");
    }
}

/// The data address of a line of [`ByTheManual::record`]; modes have none.
fn data_address(line: &str) -> String {
    let after_limits = line.rsplit(']').next().unwrap_or_default();
    if line.starts_with("data") {
        after_limits
            .split_whitespace()
            .next()
            .unwrap_or_default()
            .to_owned()
    } else {
        String::from("none")
    }
}

/// The fault is 40 in the fault byte; a setup START does not check it.
#[test]
fn illegal_software_mode_is_a_problem_until_a_legal_start() {
    let (mut fpga, mut port) = machine();
    let mut in_mode = |mode| discovered(&mut port, &mut fpga, &[mode]).remove(0);
    let illegal = in_mode(7);
    let [problem] = &illegal.problems[..] else {
        panic!("{:?}", illegal.problems);
    };
    let known = vec![0, 1, 2, 3];
    assert_eq!(
        problem.kind,
        ProblemKind::IllegalSoftwareMode { mode: 7, known }
    );
    assert!(
        problem
            .to_string()
            .contains("software mode 7 is not one of this remote's modes (0, 1, 2, 3)"),
        "{problem}"
    );
    assert_eq!(illegal.plan.as_ref(), Err(problem));
    assert_eq!(in_mode(3).problems, []);
}
