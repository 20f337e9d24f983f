//! The list of all pins and parameters against a written one.

use std::collections::BTreeMap;

use crate::common::descriptors::{analog, field_io, outputs_48};
use mesa_hal::boards::fpga::{EncoderBankPins, EthernetPins, GpioPins, WatchdogPins};
use mesa_hal::boards::{I7i97, RemoteLocation, RemotePins, RemoteTable, i7i77};
use mesa_hal::hal::{AnyValue, PinInfo, PinStore, Pins, Visitor};
use mesa_hal::hostmot2::PinDescriptor;
use mesa_hal::process_data::InterfaceRegisters;

/// Name to everything else that the manifest tells.
type List = BTreeMap<String, String>;

struct Lister {
    list: List,
    order: Vec<String>,
}

impl Lister {
    fn add(&mut self, kind: &str, info: &PinInfo) {
        let terminal = if info.terminal.is_empty() {
            "-"
        } else {
            &info.terminal
        };
        let direction = info.role.hal_direction();
        let line = format!("{kind} {} {direction} {terminal}", info.hal_type);
        assert!(self.list.insert(info.name.clone(), line).is_none());
        self.order.push(info.name.clone());
    }
}

impl Visitor for Lister {
    fn pin(&mut self, info: &PinInfo, _: AnyValue) {
        self.add("pin", info);
    }

    fn parameter(&mut self, info: &PinInfo, _: AnyValue) {
        self.add("param", info);
    }
}

fn visited(pins: &Pins) -> Lister {
    let mut lister = Lister {
        list: List::new(),
        order: Vec::new(),
    };
    pins.visit(&mut lister);
    lister
}

fn manifest(text: &str) -> List {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let mut words = line.split_whitespace();
            let mut word = || words.next().expect("a line of at least five words");
            let (kind, hal_type, direction, name) = (word(), word(), word(), word());
            let terminal = words.collect::<Vec<_>>().join(" ");
            (
                name.to_owned(),
                format!("{kind} {hal_type} {direction} {terminal}"),
            )
        })
        .collect()
}

/// Every difference in words, not just the first.
fn differences(made: &List, written: &List) -> Vec<String> {
    let mut found = Vec::new();
    for (name, line) in written {
        match made.get(name) {
            None => found.push(format!("not made: {name}")),
            Some(other) if other != line => {
                found.push(format!("{name}: made {other}, written {line}"));
            }
            Some(_) => {}
        }
    }
    found.extend(
        made.keys()
            .filter(|name| !written.contains_key(*name))
            .map(|name| format!("not written: {name}")),
    );
    found
}

/// Descriptor words of one connector with a 7I77 (FACTS 8.1; secondary tags of the register map).
fn connector_with_7i77() -> Vec<PinDescriptor> {
    let serial = [0x93, 0x83, 0x03, 0x82, 0x02, 0x81, 0x01].map(|pin| 0x0300_C100 | pin);
    let select = [0x0300_0D81];
    let encoders = (0..3).flat_map(|unit| (1..=3).map(move |pin| 0x0300_0C00 | unit << 16 | pin));
    serial
        .into_iter()
        .chain(select)
        .chain(encoders)
        .map(PinDescriptor::parse)
        .collect()
}

fn machine_7i92() -> PinStore {
    let board = "hm2_7i92.0";
    let mut pins = PinStore::new();
    let group = pins.add_group();
    WatchdogPins::new(&mut pins, group, board).unwrap();
    EthernetPins::new(&mut pins, group, board).unwrap();
    EncoderBankPins::new(&mut pins, group, board, 12_500_000, Some(4), false).unwrap();
    i7i77::encoder_pins(&mut pins, group, board, 0).unwrap();
    let mut io = connector_with_7i77();
    io.extend([PinDescriptor::parse(0x0300_0000); 17]);
    GpioPins::all(&mut pins, group, board, &io, |_| &[]).unwrap();
    for (channel, descriptor) in (0..).zip([field_io(3), analog(), outputs_48(1)]) {
        let location = RemoteLocation {
            board,
            port: 0,
            channel,
        };
        let table = RemoteTable::for_remote(&descriptor);
        assert!(table.is_some_and(|table| table.differences(&descriptor).is_empty()));
        RemotePins::new(
            &mut pins,
            location,
            &descriptor,
            InterfaceRegisters::Three,
            table,
        )
        .unwrap();
    }
    pins
}

/// Descriptor words of a 7I97 (FACTS 9.2; secondary tags of the register map).
fn io_of_7i97() -> Vec<PinDescriptor> {
    let mut words: Vec<u32> = (0..4).map(|unit| 0x0300_0681 | unit << 16).collect();
    words.extend([0x0304_0681, 0x0304_0683, 0x0305_0681, 0x0305_0683]);
    words.push(0x0300_0683);
    words.extend((0..3).flat_map(|unit| (1..=3).map(move |pin| 0x0300_0C00 | unit << 16 | pin)));
    words.push(0x0300_0D81);
    words.extend((0x81..=0x86).map(|pin| 0x0300_C300 | pin));
    words.push(0x0300_C3A0);
    words.extend((0x81..=0x84).map(|pin| 0x0300_1E00 | pin));
    words.push(0x0300_1E01);
    words.extend([0x0300_C101, 0x0300_C181, 0x0300_C191]);
    words.resize(51, 0x0300_0000);
    words.into_iter().map(PinDescriptor::parse).collect()
}

fn machine_7i97() -> (PinStore, I7i97) {
    let mut pins = PinStore::new();
    let group = pins.add_group();
    let card = I7i97::new(&mut pins, group, "hm2_7i97.0", &io_of_7i97()).unwrap();
    (pins, card)
}

#[test]
fn a_7i92_with_a_7i77_and_a_7i72_has_exactly_the_pins_that_are_written() {
    let made = visited(&machine_7i92()).list;
    let written = manifest(include_str!("../manifests/7i92-7i77-7i72.txt"));
    assert_eq!(differences(&made, &written), Vec::<String>::new());
    assert!(written.len() > 500, "the manifest is whole");
}

#[test]
fn a_7i97_has_exactly_the_pins_that_are_written() {
    let made = visited(&machine_7i97().0).list;
    let written = manifest(include_str!("../manifests/7i97.txt"));
    assert_eq!(differences(&made, &written), Vec::<String>::new());
    assert!(written.len() > 400, "the manifest is whole");
}

#[test]
fn the_order_of_the_list_is_the_same_in_every_run() {
    assert_eq!(
        visited(&machine_7i92()).order,
        visited(&machine_7i92()).order
    );
}

#[test]
fn every_name_fits_the_tools_of_linuxcnc() {
    for pins in [machine_7i92(), machine_7i97().0] {
        for info in pins.infos() {
            assert!(info.name.len() <= 41, "{}", info.name);
        }
    }
}

#[test]
fn the_7i97_switches_outputs_leds_and_filters_by_the_bit() {
    let (mut pins, card) = machine_7i97();
    pins.set(card.outputs.outputs[0].out, true);
    pins.set(card.outputs.outputs[5].invert, true);
    assert_eq!(card.outputs.data(&mut pins), 0b10_0001);
    pins.set(card.leds.leds[0], true);
    pins.set(card.leds.leds[3], true);
    assert_eq!(card.leds.word(&mut pins), 0x9000_0000);
    pins.set(card.inputs.inputs[15].slow, true);
    assert_eq!(card.inputs.slow(&mut pins), 0x8000);
    card.inputs.publish(&mut pins, 0x8001, 0x0002);
    card.inputs.publish_counts(&mut pins, [1, -1, 300, 0]);
    assert!(pins.read(card.inputs.inputs[15].filtered.pin).value);
    assert!(!pins.read(card.inputs.inputs[0].filtered.not).value);
    assert!(pins.read(card.inputs.inputs[1].raw.pin).value);
    assert_eq!(pins.read(card.inputs.mpg_counts[2]).value, 300);
}

#[test]
fn analog_outputs_of_the_7i97_are_a_fraction_of_10_v_and_never_anything_else() {
    let (mut pins, card) = machine_7i97();
    let [volts, ..] = card.analog_out;
    for (set, expected) in [
        (5.0, 0.5),
        (-10.0, -1.0),
        (12.0, 1.0),
        (f64::NAN, 0.0),
        (0.0, 0.0),
    ] {
        pins.set(volts.volts, set);
        assert!((pins.fetch(volts.volts) - expected).abs() < 1e-12, "{set}");
    }
    let counted = pins.rejections(volts.volts);
    assert_eq!((counted.not_finite, counted.out_of_range), (1, 1));
    pins.set_param(volts.full_scale, 0.0).unwrap();
    assert!(pins.fetch(volts.volts).abs() < 1e-12);
}
