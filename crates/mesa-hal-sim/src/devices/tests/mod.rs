//! The devices from the side of the line and of the world.

mod host;
mod protocol;
mod revision;

use host::Host;

use std::collections::BTreeMap;

use super::*;
use crate::remote::{Toward, WireFault};
use mesa_wire::lbp::{
    AccessSize, DISCOVERY, DiscoveryReply, LbpStatus, LocalLocation, RemoteAccess, RemoteFaults,
    Request,
};

/// Creates or removes the cause of a fault.
type Cause = fn(&mut dyn SimDevice, bool);

/// A card's line, name and sizes (RX, TX) by mode.
type Card<'a> = (&'a mut dyn RemoteEnd, &'a [u8; 4], &'a [(u8, u8)]);

#[test]
fn sizes_and_names_of_each_mode_are_those_of_the_cards() {
    let mut field_io = FieldIo::i7i77().unwrap();
    let mut analog = Analog::i7i77().unwrap();
    let mut outputs = Outputs48::i7i72().unwrap();
    let mut i7i84 = FieldIo::i7i84().unwrap();
    let mut i7i84u = FieldIo::i7i84u().unwrap();
    let mut i7i76 = FieldIo::i7i76().unwrap();
    let mut i7i76_14 = FieldIo::i7i76_of_revision_14().unwrap();
    let mut i7i76e = FieldIo::i7i76e().unwrap();
    let mut i7i76eu = FieldIo::i7i76eu().unwrap();
    let mut i7i69 = Plain::i7i69().unwrap();
    let mut i7i70 = Plain::i7i70().unwrap();
    let mut i7i71 = Outputs48::i7i71().unwrap();
    let mut i7i73 = Plain::i7i73().unwrap();
    let mut i7i73_display = Plain::i7i73_display().unwrap();
    let mut i7i83 = Plain::i7i83().unwrap();
    let mut i7i87 = Plain::i7i87().unwrap();
    let spindle = [(5, 4), (9, 4), (12, 4)];
    let field = [(5, 2), (10, 2), (11, 2)];
    let bits = [(7, 6), (7, 0), (1, 6), (4, 3), (11, 6)];
    // FACTS 8.2, 8.3, 8.4; of the others only names and numbers of modes: FACTS 8.7, 8.8.
    let cards: [Card<'_>; 16] = [
        (&mut field_io, b"7I77", &[(5, 2), (9, 2), (10, 2), (12, 2)]),
        (&mut analog, b"7I77", &[(1, 10)]),
        (&mut outputs, b"7I72", &[(1, 6), (3, 6)]),
        (&mut i7i84, b"7I84", &field),
        (&mut i7i84u, b"7I84", &field),
        (&mut i7i76, b"7I76", &spindle),
        (&mut i7i76_14, b"7I76", &spindle),
        (&mut i7i76e, b"7I76", &spindle),
        (&mut i7i76eu, b"7I76", &spindle),
        (&mut i7i69, b"7I69", &bits),
        (&mut i7i70, b"7I70", &[(7, 0), (13, 0), (8, 0)]),
        (&mut i7i71, b"7I71", &[(1, 6), (3, 6)]),
        (&mut i7i73, b"7I73", &[(8, 3), (12, 3), (12, 3)]),
        (&mut i7i73_display, b"7I73", &[(8, 3), (12, 3), (12, 6)]),
        (&mut i7i83, b"7I83", &[(2, 11)]),
        (&mut i7i87, b"7I87", &[(13, 0)]),
    ];
    for (remote, name, modes) in cards {
        let mut host = Host::new(remote);
        let card = [0x10, 0x11, 0x12, 0x13].map(|n| host.local(LocalLocation::new(n).unwrap()));
        assert_eq!(&card, name);
        for (mode, &(rx, tx)) in (0..).zip(modes) {
            host.set(LocalLocation::SOFTWARE_MODE, mode);
            let sizes = host.discovery();
            assert_eq!((sizes.rx_size, sizes.tx_size), (rx, tx), "mode {mode}");
        }
        host.set(LocalLocation::SOFTWARE_MODE, modes.len() as u8);
        assert_eq!(host.local(LocalLocation::FAULTS), 0x41, "illegal mode");
    }
}

#[test]
fn records_of_the_field_io_have_the_names_and_order_of_the_card() {
    let mut remote = FieldIo::i7i77().unwrap();
    let mut host = Host::new(&mut remote);
    host.set(LocalLocation::SOFTWARE_MODE, 3);
    let sizes = host.discovery();
    let ptoc = host.table(sizes.ptoc);
    let names: Vec<&str> = ptoc.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(
        names,
        [
            "Output",
            "Input",
            "AnalogIn0",
            "AnalogIn1",
            "AnalogIn2",
            "AnalogIn3",
            "FieldVoltage",
            "Enc0",
            "Enc1",
            "standard",
            "io_encoder_analog_fieldvoltage"
        ]
    );
    // FACTS 7.1: type, bits, type of data, direction, min, max.
    assert_eq!(ptoc[0].1[..4], [0xA0, 16, 0x01, 0x80]);
    assert_eq!(ptoc[1].1[..4], [0xA0, 32, 0x01, 0x00]);
    assert_eq!(ptoc[2].1[..4], [0xA0, 8, 0x02, 0x00]);
    assert_eq!(ptoc[2].1[8..12], 36.3_f32.to_le_bytes());
    assert_eq!(ptoc[7].1[..4], [0xA0, 8, 0x08, 0x00]);
    let gtoc = host.table(sizes.gtoc);
    let parameters = gtoc
        .iter()
        .filter(|record| record.1[0] == 0xA0 && !ptoc.contains(record));
    let parameters: Vec<(&str, u8)> = parameters
        .map(|(name, record)| (name.as_str(), record[3]))
        .collect();
    // Names and directions of a real card: FACTS 8.2.
    let (read_only, writable) = (0x00, 0x40);
    assert_eq!(
        parameters,
        [
            ("SwRevision", read_only),
            ("HwRevision", read_only),
            ("UnitNumber", read_only),
            ("NVBaudRate", writable),
            ("NVUnitNumber", read_only),
            ("NVWatchDogTimeout", writable),
            ("NVEncMode0", read_only),
            ("NVEncMode1", read_only),
            ("EncMode0", read_only),
            ("EncMode1", read_only),
        ]
    );
    // FACTS 7.2: in mode 0 the data of the other modes are records of the GTOC alone.
    host.set(LocalLocation::SOFTWARE_MODE, 0);
    let sizes = host.discovery();
    let of_mode_0 = host.table(sizes.ptoc);
    assert_eq!(of_mode_0.len(), 4);
    assert_eq!(host.table(sizes.gtoc), gtoc);
    let modes = gtoc.iter().filter(|record| record.1[0] == 0xB0).count();
    assert_eq!(modes, 5, "one hardware mode, four software modes");
}

#[test]
fn narrower_element_of_a_later_mode_is_the_same_value() {
    let mut remote = Plain::i7i69().unwrap();
    let mut now = 1_000_000;
    for (mode, sent) in [(0, 0x8000_0080_0001_u64), (3, 0x80_0001)] {
        for input in [0, 23, 47] {
            remote.set_input(input, true).unwrap();
        }
        let mut host = Host::new(&mut remote);
        host.now = now;
        let sizes = host.start(mode);
        let output = [0x01, 0, 0x80, 0, 0, 0];
        let (faults, data) = host.exchange(sizes, &output[..sizes.tx_size.into()]);
        assert!(faults.is_empty());
        let mut word = [0; 8];
        word[..data.len()].copy_from_slice(&data);
        assert_eq!(u64::from_le_bytes(word), sent, "mode {mode}");
        now = host.now + 1_000_000;
        let world = remote.application().world();
        let on = (0..48).filter(|&n| world.output(n) == Some(true));
        let on: Vec<usize> = on.collect();
        assert_eq!(on, [0, 23], "mode {mode}");
    }
}

#[test]
fn outputs_of_a_7i76eu_source_sink_or_both_by_its_masks() {
    let mut remote = FieldIo::i7i76eu().unwrap();
    let layout = remote.application().layout().clone();
    let place = |name: &str| layout.address(name).unwrap();
    let mut now = 1_000_000;
    // Manual 7I76EU, "OUTPUT TRUTH TABLE"; output 0 is on, 1 is off.
    for (source, sink, conducts, volts) in [
        (0x0000, 0x0000, false, [0.0, 0.0]),
        (0x0000, 0xFFFF, true, [0.0, 24.0]),
        (0xFFFF, 0x0000, true, [24.0, 0.0]),
        (0xFFFF, 0xFFFF, true, [24.0, 0.0]),
    ] {
        let mut host = Host::new(&mut remote);
        host.now = now;
        let sizes = host.start(0);
        host.write(place("Output_Source"), AccessSize::Word, source);
        host.write(place("Output_Sink"), AccessSize::Word, sink);
        assert!(host.exchange(sizes, &[0x01, 0, 0, 0]).0.is_empty());
        now = host.now + 1_000_000;
        let world = remote.application().world();
        let case = format!("source {source:04x}, sink {sink:04x}");
        assert_eq!(
            [0, 1].map(|n| world.output_volts(n)),
            volts.map(Some),
            "{case}"
        );
        assert_eq!(
            [0, 1].map(|n| world.output(n)),
            [Some(conducts), Some(false)],
            "{case}"
        );
    }
}

#[test]
fn spindle_mode_makes_7i76eu_outputs_forward_and_reverse() {
    let mut remote = FieldIo::i7i76eu().unwrap();
    let layout = remote.application().layout().clone();
    let mode = layout.address("SpinMode").unwrap();
    let mut now = 1_000_000;
    for (value, names, reverse) in [
        (0, ["spinena", "spindir"], [true, true]),
        (1, ["spinfwd", "spinrev"], [false, true]),
    ] {
        let mut host = Host::new(&mut remote);
        host.now = now;
        let sizes = host.start(0);
        host.write(mode, AccessSize::Word, value);
        // 13 bits of SpinOut, SpinEna, SpinDir behind the 16 outputs.
        let word = (4096_u32 | 1 << 13 | 1 << 14) << 16;
        assert!(host.exchange(sizes, &word.to_le_bytes()).0.is_empty());
        now = host.now + 1_000_000;
        let outputs = SimDevice::outputs(&remote);
        let found = |name: &str| {
            let mut outputs = outputs.iter();
            outputs
                .find(|(found, _)| found == name)
                .map(|(_, value)| *value)
        };
        assert_eq!(
            names.map(found),
            reverse.map(|on| Some(SignalValue::Bool(on)))
        );
        let Some(SignalValue::Volts(volts)) = found("spinout") else {
            panic!("no voltage");
        };
        assert!((volts - 5.0).abs() < 0.01, "half of the supply: {volts}");
    }
}

#[test]
fn outputs_follow_the_host_only_while_no_fault_is_set() {
    let mut remote = FieldIo::i7i77().unwrap();
    let mut host = Host::new(&mut remote);
    host.set(LocalLocation::SOFTWARE_MODE, 0);
    let sizes = host.discovery();
    // FACTS 1.5: powers up with fault 01.
    assert_eq!(
        host.exchange(sizes, &[0xFF, 0xFF]).0,
        RemoteFaults::WATCHDOG
    );
    assert_eq!(lit(&remote), 0);
    let mut host = Host::new(&mut remote);
    host.now = 1_000_000;
    host.start(0);
    assert!(host.exchange(sizes, &[0x05, 0x80]).0.is_empty());
    let now = host.now;
    assert_eq!(lit(&remote), 0x8005);
    let mut host = Host::new(&mut remote);
    host.now = now;
    host.wait(50_000_001);
    assert_eq!(lit(&remote), 0, "the watchdog has bitten");
    let mut host = Host::new(&mut remote);
    host.now = now + 51_000_000;
    assert_eq!(host.exchange(sizes, &[0xFF, 0]).0, RemoteFaults::WATCHDOG);
    assert_eq!(
        host.local(LocalLocation::STATUS),
        LbpStatus::WATCHDOG.bits(),
        "LBP status says it too"
    );
    assert_eq!(lit(&remote), 0);
}

/// Outputs that conduct, as bits.
fn lit(device: &dyn SimDevice) -> u32 {
    (0..16).fold(0, |bits, n| {
        bits | u32::from(device.world().output(n) == Some(true)) << n
    })
}

#[test]
fn inputs_analog_values_and_mpgs_arrive_in_their_places() {
    let mut remote = FieldIo::i7i77().unwrap();
    remote.set_input(0, true).unwrap();
    remote.set_input(31, true).unwrap();
    remote.set_input_volts(1, 18.15).unwrap();
    let mut host = Host::new(&mut remote);
    let sizes = host.start(3);
    let (_, data) = host.exchange(sizes, &[]);
    let inputs = u32::from_le_bytes(data[..4].try_into().unwrap());
    assert_eq!(inputs, 0x8000_0003, "18.15 V is above 60 % of 24 V");
    assert_eq!(data[4], 169, "24 V of 36.3 V");
    assert_eq!(data[5], 128, "18.15 V of 36.3 V");
    assert_eq!(data[8], 169, "field voltage");
    assert_eq!(data[9..11], [0, 0]);
    let now = host.now;
    // Two cycles of a 5 V MPG: 1X, thresholds of mode 3.
    for _ in 0..2 {
        for (a, b) in [(5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (0.0, 0.0)] {
            remote.set_input_volts(18, a).unwrap();
            remote.set_input_volts(19, b).unwrap();
        }
    }
    let mut host = Host::new(&mut remote);
    host.now = now;
    assert_eq!(host.exchange(sizes, &[]).1[9..11], [0, 2]);
}

#[test]
fn mpg_counts_all_edges_after_its_parameter_and_a_power_cycle() {
    let mut remote = FieldIo::i7i77().unwrap();
    let address = remote.application().layout().address("NVEncMode0").unwrap();
    let mut host = Host::new(&mut remote);
    host.set(LocalLocation::NONVOLATILE, 1);
    host.write(address, AccessSize::Byte, 1);
    host.set(LocalLocation::NONVOLATILE, 0);
    let now = host.now;
    remote.set_power(now, false);
    remote.set_power(now + 1_000_000, true);
    let mut host = Host::new(&mut remote);
    host.now = now + 2_000_000;
    let sizes = host.start(3);
    let now = host.now;
    for (a, b) in [(5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (0.0, 0.0)] {
        remote.set_input_volts(16, a).unwrap();
        remote.set_input_volts(17, b).unwrap();
    }
    let mut host = Host::new(&mut remote);
    host.now = now;
    assert_eq!(host.exchange(sizes, &[]).1[9..11], [4, 0]);
}

#[test]
fn field_faults_stay_in_the_fault_byte_until_their_cause_ends() {
    let mut remote = FieldIo::i7i77().unwrap();
    let mut host = Host::new(&mut remote);
    let sizes = host.start(0);
    host.exchange(sizes, &[0x02, 0]);
    let mut now = host.now;
    let causes: [(RemoteFaults, Cause); 4] = [
        (RemoteFaults::LOW_VOLTAGE, |device, on| {
            device
                .set_field_volts(0, if on { 3.0 } else { 24.0 })
                .unwrap();
        }),
        (RemoteFaults::HIGH_VOLTAGE, |device, on| {
            device
                .set_field_volts(0, if on { 40.0 } else { 24.0 })
                .unwrap();
        }),
        (RemoteFaults::OVER_CURRENT, |device, on| {
            device.set_over_current(1, on).unwrap();
        }),
        (RemoteFaults::OVER_TEMPERATURE, |device, on| {
            device.set_over_temperature(1, on).unwrap();
        }),
    ];
    for (fault, cause) in causes {
        cause(&mut remote, true);
        let mut host = Host {
            remote: &mut remote,
            now,
        };
        assert_eq!(host.exchange(sizes, &[0x02, 0]).0, fault);
        host.set(LocalLocation::CLEAR_FAULTS, 0xFF);
        let left = host.exchange(sizes, &[0x02, 0]).0;
        now = host.now;
        assert_eq!(left, fault, "its cause still holds");
        cause(&mut remote, false);
        let mut host = Host {
            remote: &mut remote,
            now,
        };
        host.set(LocalLocation::CLEAR_FAULTS, 0xFF);
        assert!(host.exchange(sizes, &[0x02, 0]).0.is_empty(), "{fault:?}");
        now = host.now;
        assert_eq!(lit(&remote), 2, "{fault:?}");
    }
}

#[test]
fn shorted_output_is_switched_off_alone() {
    let mut remote = FieldIo::i7i77().unwrap();
    let mut host = Host::new(&mut remote);
    let sizes = host.start(0);
    host.exchange(sizes, &[0xFF, 0xFF]);
    let now = host.now;
    SimDevice::set_over_current(&mut remote, 3, true).unwrap();
    assert_eq!(lit(&remote), 0xFFF7);
    assert!(SimDevice::set_over_current(&mut remote, 16, true).is_err());
    let mut host = Host {
        remote: &mut remote,
        now,
    };
    assert_eq!(host.exchange(sizes, &[0, 0]).0, RemoteFaults::OVER_CURRENT);
    assert_eq!(
        lit(&remote),
        0xFFF7,
        "a fault is set: nothing is taken over"
    );
}

#[test]
fn card_that_is_supplied_by_field_power_is_silent_without_it() {
    let mut remote = FieldIo::i7i77().unwrap();
    remote.application_mut().world_mut().set_separate_vin(false);
    SimDevice::set_field_volts(&mut remote, 1_000, 0.0).unwrap();
    let cookie = Request::access(RemoteAccess::ReadLocal(LocalLocation::COOKIE));
    let mut host = Host::new(&mut remote);
    host.now = 10_000;
    assert_eq!(host.ask(&cookie), None);
    SimDevice::set_field_volts(&mut remote, 1_000_000, 24.0).unwrap();
    let mut host = Host::new(&mut remote);
    host.now = 2_000_000;
    assert_eq!(host.ask(&cookie), Some(vec![0x5A]));
}

#[test]
fn analog_outputs_have_the_volts_of_their_13_bits_when_enabled() {
    let mut remote = Analog::i7i77().unwrap();
    let mut host = Host::new(&mut remote);
    let sizes = host.start(0);
    // FACTS 7.4: 5.0 V -> 2047, -10 V -> 1000.
    let pack = |raw: [u16; 6], enables: u128| {
        let bits = raw
            .iter()
            .rev()
            .fold(enables, |bits, &raw| bits << 13 | u128::from(raw));
        bits.to_le_bytes()[..10].to_vec()
    };
    let raw = [2047, 0x1000, 0x1FFF, 0, 1, 0x0FFF];
    let (faults, data) = host.exchange(sizes, &pack(raw, 0b01));
    assert!(faults.is_empty() && data.is_empty());
    let now = host.now;
    let volts =
        |remote: &dyn SimDevice| [0, 1, 2, 3, 4, 5].map(|n| remote.world().analog_output(n));
    let step = 10.0 / 4096.0;
    assert_eq!(
        volts(&remote),
        [2047.0 * step, -10.0, -step, 0.0, step, 0.0].map(Some),
        "the spindle is not enabled"
    );
    let mut host = Host {
        remote: &mut remote,
        now,
    };
    host.exchange(sizes, &pack(raw, 0b10));
    let now = host.now;
    assert_eq!(
        volts(&remote),
        [0.0, 0.0, 0.0, 0.0, 0.0, 4095.0 * step].map(Some),
        "only the spindle is enabled"
    );
    // Manual 7I77, "ANALOG SECTION WATCHDOG".
    remote.advance(now + 50_000_000);
    assert_eq!(volts(&remote), [Some(0.0); 6]);
    assert_eq!(remote.world().output(5), Some(false));
}

#[test]
fn forty_eight_outputs_and_the_field_voltage_of_a_7i72() {
    let mut remote = Outputs48::i7i72().unwrap();
    let mut host = Host::new(&mut remote);
    let sizes = host.start(1);
    let (_, data) = host.exchange(sizes, &[0x01, 0, 0, 0, 0, 0x80]);
    let raw = u16::from_le_bytes(data[..2].try_into().unwrap());
    assert!((f64::from(raw) / 65535.0 * 36.3 - 24.0).abs() < 0.001);
    let on: Vec<usize> = (0..48)
        .filter(|&n| remote.world().output(n) == Some(true))
        .collect();
    assert_eq!(on, [0, 47]);
}

#[test]
fn card_7i64_has_no_discovery_process_data_clears_its_faults() {
    // FACTS 4.7; transcript t26.
    let mut remote = Plain::i7i64().unwrap();
    SimDevice::set_input(&mut remote, 8, true).unwrap();
    SimDevice::set_input_volts(&mut remote, 0, 3.3).unwrap();
    let sizes = DiscoveryReply {
        rx_size: 8,
        tx_size: 4,
        ..DiscoveryReply::default()
    };
    let mut host = Host::new(&mut remote);
    let request = Request::rpc(DISCOVERY, &[], 6);
    assert_eq!(host.ask(&request), None);
    host.now += 1_000_000;
    // The reply has no fault byte: the helper returns the first data byte instead.
    host.exchange(sizes, &[0xFF; 3]);
    assert_eq!(
        host.local(LocalLocation::FAULTS),
        0x01,
        "watchdog, from power-up"
    );
    host.exchange(sizes, &[0, 0, 0, 8]);
    assert_eq!(host.local(LocalLocation::FAULTS), 0);
    let (first, data) = host.exchange(sizes, &[0xEE, 0xFF, 0xC0, 0]);
    assert_eq!(first.bits(), 0);
    assert_eq!(data, [1, 0, 0, 0xFF, 0xFF, 0, 0]);
    let world = remote.application().world();
    assert_eq!(world.raw("Output"), Some(&[0xEE, 0xFF, 0xC0][..]));
}

#[test]
fn device_from_a_description_has_its_modes_data_and_parameters() {
    let text = "
remote GADG          # a gadget
unit 77
mode 0 small
  data Speed 12 unsigned in 0 3000 rpm
  data Lamp 1 boolean out
mode 1 large
  data Speed 12 unsigned in 0 3000 rpm
  data Lamp 1 boolean out
  data Wide 70 bits both
parameter Gain 16 unsigned out 0 65535 = 300
";
    let mut remote = Plain::from_description(text).unwrap();
    SimDevice::set_input_volts(&mut remote, 0, 1500.0).unwrap();
    SimDevice::set_input(&mut remote, 69, true).unwrap();
    let gain = remote.application().layout().address("Gain").unwrap();
    let mut host = Host::new(&mut remote);
    assert_eq!(host.read(gain, AccessSize::Word), 300);
    let small = host.start(0);
    assert_eq!((small.rx_size, small.tx_size), (3, 1));
    let (_, data) = host.exchange(small, &[1]);
    assert_eq!(u16::from_le_bytes([data[0], data[1]]), 2048);
    let large = host.start(1);
    assert_eq!((large.rx_size, large.tx_size), (12, 9));
    let (_, data) = host.exchange(large, &[0x03, 0, 0, 0, 0, 0, 0, 0, 0x40]);
    assert_eq!(data[10], 1 << 1, "bit 69 behind 12 bits of speed");
    let outputs: BTreeMap<_, _> = remote.outputs().into_iter().collect();
    assert_eq!(outputs["lamp"], SignalValue::Bool(true));
    assert_eq!(outputs["wide-00"], SignalValue::Bool(true));
    assert_eq!(outputs["wide-69"], SignalValue::Bool(true), "{outputs:?}");
    assert_eq!(outputs["wide-68"], SignalValue::Bool(false));
}

#[test]
fn devices_are_found_behind_cables_and_cables_too() {
    let mut end: Box<dyn RemoteEnd> = Box::new(Cable::new(Box::new(Analog::i7i77().unwrap()), 1));
    assert_eq!(find(&*end).unwrap().card(), *b"7I77");
    let device = find_mut(&mut *end).unwrap();
    assert_eq!(device.set_input(0, true), Err(WorldError::NotThere));
    assert_eq!(device.outputs().len(), 8);
    assert!(device.set_initial_mode(0, 0));
    assert!(!device.set_initial_mode(0, 1));
    let cable = find_cable(&mut *end).unwrap();
    assert!(cable.inject(Toward::Fpga, WireFault::Lost, 1));
    cable.unplug();
}

#[test]
fn values_that_are_no_voltages_are_refused() {
    let mut remote = FieldIo::i7i77().unwrap();
    for volts in [f64::NAN, f64::INFINITY] {
        let refused = Err(WorldError::NotFinite);
        assert_eq!(SimDevice::set_input_volts(&mut remote, 0, volts), refused);
        assert_eq!(SimDevice::set_field_volts(&mut remote, 0, volts), refused);
    }
}
