//! The simulated cards on a simulated port, found and moved by the driver.

use crate::common::replay::port_words;
use mesa_hal::boards::REMOTES;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::discovery::{DataDirection, DataType, Discovered, DiscoveryOptions, discover_port};
use mesa_hal::hostmot2::HostMot2;
use mesa_hal::sim::devices::{Analog, Device, FieldIo, Outputs48, Plain, find_mut};
use mesa_hal::sim::remote::{Cable, Remote, Toward, WireFault};
use mesa_hal::sim::wire::RemoteEnd;
use mesa_hal::sim::{SimFpga, machines};
use mesa_hal::sslbp::{Channel, ChannelMask, Layout, Port, PortWords, ProcessDataSizes, StartMode};

const FIELD: Channel = Channel::ALL[0];
const ANALOG: Channel = Channel::ALL[1];
const THIRD: Channel = Channel::ALL[2];

/// A 7I92 with a 7I77 and `third` on its expansion port, all behind cables.
fn machine(third: Box<dyn RemoteEnd>) -> (SimFpga, Port) {
    let mut fpga = machines::i7i92_7i77();
    let field: Box<dyn RemoteEnd> = Box::new(FieldIo::i7i77().unwrap());
    let analog: Box<dyn RemoteEnd> = Box::new(Analog::i7i77().unwrap());
    for (channel, end) in [field, analog, third].into_iter().enumerate() {
        let seed = 0xCAB1E + channel as u64;
        fpga.plug(0, channel, Some(Box::new(Cable::new(end, seed))));
    }
    let width = fpga.firmware().port_width as usize;
    let mut words = vec![0_u32; fpga.firmware().ports as usize];
    for (number, pin) in fpga.firmware().pins.iter().enumerate() {
        words[number / width] |= u32::from(pin.pin & 0x80 != 0) << (number % width);
    }
    for (port, word) in (0_u16..).zip(words) {
        fpga.write(0x1200 + 4 * port, word).unwrap();
        fpga.write(0x1100 + 4 * port, word).unwrap();
    }
    let hostmot2 = HostMot2::identify(&mut fpga).unwrap();
    let mut port = Port::new(Layout::locate(&hostmot2, 0).unwrap());
    port.reset(&mut fpga).unwrap();
    (fpga, port)
}

fn starts(field_mode: u8) -> [(Channel, u8); 3] {
    [(FIELD, field_mode), (ANALOG, 0), (THIRD, 0)]
}

/// What is on all channels, in their order.
fn found(port: &mut Port, fpga: &mut SimFpga, field_mode: u8) -> Vec<Discovered> {
    let options = DiscoveryOptions {
        tables: &REMOTES,
        ..DiscoveryOptions::default()
    };
    let found = discover_port(port, fpga, &starts(field_mode), &options).unwrap();
    found.into_iter().map(Result::unwrap).collect()
}

/// FACTS 8.1 to 8.4: what discovery must find on the cards, without a single complaint.
#[test]
fn discovery_finds_the_cards_as_they_are() {
    let (mut fpga, mut port) = machine(Box::new(Outputs48::i7i72().unwrap()));
    for mode in 0..4 {
        let found = found(&mut port, &mut fpga, mode);
        for remote in &found {
            assert_eq!(remote.problems, []);
        }
        let [field, analog, outputs] = &found[..] else {
            panic!("three remotes, and not {}", found.len());
        };
        let field = &field.descriptor;
        assert_eq!(field.unit_number >> 24, 0x12);
        assert_eq!(field.parameters.len(), 8);
        assert_eq!(field.modes.len(), 5);
        assert_eq!(
            field.process_data.len(),
            [2, 6, 7, 9][usize::from(mode)],
            "mode {mode}"
        );
        let analog = &analog.descriptor;
        assert_eq!(analog.unit_number >> 24, 0x11);
        let element = &analog.process_data[5];
        assert_eq!(
            (element.name.as_str(), element.bits, element.data_type),
            ("AnalogOut5", 13, DataType::Signed)
        );
        assert_eq!((element.min, element.max), (-10.0, 10.0));
        assert_eq!(element.direction, DataDirection::Output);
        let outputs = &outputs.descriptor;
        assert_eq!(outputs.name.0, *b"7I72");
        assert_eq!(outputs.process_data.len(), 1);
    }
}

#[test]
fn process_data_moves_the_terminals_of_all_cards_at_once() {
    let (mut fpga, mut port) = machine(Box::new(Outputs48::i7i72().unwrap()));
    let report = port
        .start(&mut fpga, StartMode::Normal, &starts(0))
        .unwrap();
    let all = report.started();
    assert_eq!(all.bits(), 7);
    let field = find_mut(fpga.remote_mut(0, 0).unwrap()).unwrap();
    field.set_input(7, true).unwrap();
    let outputs = port_words([
        (FIELD, &[0x8001]),
        (ANALOG, &[0x0000_0800, 0, 1 << 14]),
        (THIRD, &[0, 0x8000]),
    ]);
    let transfer = port.transfer(&mut fpga, all, &outputs).unwrap();
    assert_eq!(transfer.failed, ChannelMask::NONE);
    assert_eq!(transfer.inputs[FIELD][0], 1 << 7);
    let field = find_mut(fpga.remote_mut(0, 0).unwrap()).unwrap();
    let on: Vec<usize> = (0..16)
        .filter(|&n| field.world().output(n) == Some(true))
        .collect();
    assert_eq!(on, [0, 15]);
    let analog = find_mut(fpga.remote_mut(0, 1).unwrap()).unwrap();
    assert_eq!(analog.world().analog_output(0), Some(5.0));
    let third = find_mut(fpga.remote_mut(0, 2).unwrap()).unwrap();
    assert_eq!(third.world().output(47), Some(true));
}

#[test]
fn a_faulty_cable_fails_its_own_channel_only() {
    let (mut fpga, mut port) = machine(Box::new(Outputs48::i7i72().unwrap()));
    let report = port
        .start(&mut fpga, StartMode::Normal, &starts(0))
        .unwrap();
    let all = report.started();
    let outputs = PortWords::default();
    port.transfer(&mut fpga, all, &outputs).unwrap();
    let faults = [
        (Toward::Fpga, WireFault::Lost),
        (Toward::Fpga, WireFault::Short(1)),
        (Toward::Remote, WireFault::Corrupted),
        (Toward::Remote, WireFault::Lost),
    ];
    for (toward, fault) in faults {
        let cable: &mut Cable = fpga.device_mut(0, 1).unwrap();
        assert!(cable.inject(toward, fault, 1));
        let transfer = port.transfer(&mut fpga, all, &outputs).unwrap();
        assert_eq!(transfer.failed, ANALOG.mask(), "{toward:?} {fault:?}");
        fpga.wait(std::time::Duration::from_micros(200));
        let transfer = port.transfer(&mut fpga, all, &outputs).unwrap();
        assert_eq!(transfer.failed, ChannelMask::NONE, "{toward:?} {fault:?}");
    }
}

/// FACTS 4.7: the built-in path of the gateware clears the faults of a 7I64 by process data.
#[test]
fn a_7i64_without_discovery_starts_and_exchanges_data() {
    let (mut fpga, mut port) = machine(Box::new(Plain::i7i64().unwrap()));
    let found = found(&mut port, &mut fpga, 0);
    assert_eq!(
        (found[2].started.ptoc, &found[2].problems[..]),
        (0, &[][..])
    );
    port.stop_all(&mut fpga).unwrap();
    let report = port
        .start(&mut fpga, StartMode::Normal, &starts(0))
        .unwrap();
    let third = report.remotes.iter().find(|remote| remote.channel == THIRD);
    assert_eq!(third.unwrap().sizes, ProcessDataSizes { rx: 8, tx: 4 });
    let outputs = port_words([(THIRD, &[0x00C0_FFEE])]);
    port.transfer(&mut fpga, report.started(), &outputs)
        .unwrap();
    let device: &Remote<Device<Plain>> = fpga.device(0, 2).unwrap();
    let world = device.application().world();
    assert_eq!(world.raw("Output"), Some(&[0xEE, 0xFF, 0xC0][..]));
}
