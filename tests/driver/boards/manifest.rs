//! The list of all pins and parameters that a driver makes, against a written one.

use std::collections::BTreeMap;

use crate::common::machine::Machine;
use mesa_hal::Settings;
use mesa_hal::driver::{Driver, SerialConfig};
use mesa_hal::hal::Pins;
use mesa_hal_sim::{SimFpga, machines};

/// Name to the rest of its line in the manifest.
type List = BTreeMap<String, String>;

fn made(pins: &Pins) -> List {
    let mut list = List::new();
    for info in pins.infos() {
        let kind = if info.role.is_param() { "param" } else { "pin" };
        let terminal = if info.place.terminal.is_empty() {
            "-"
        } else {
            &info.place.terminal
        };
        let direction = info.role.hal_direction();
        let line = format!("{kind} {} {direction} {terminal}", info.hal_type.as_str());
        assert!(list.insert(info.name.clone(), line).is_none());
    }
    list
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

/// A 7I77 with all its measurements, and a 7I72 with its supply voltage.
fn machine_7i92() -> Driver<SimFpga> {
    let modes: SerialConfig = "301".parse().expect("modes");
    Machine::build(|s| s.serial_ports = [(0, modes)].into()).driver
}

fn machine_7i97() -> Driver<SimFpga> {
    Driver::start(machines::i7i97(1), Settings::default()).expect("a 7I97")
}

#[test]
fn board_7i92_with_7i77_and_7i72_has_exactly_the_manifest_pins() {
    let made = made(machine_7i92().pins());
    let written = manifest(include_str!("../../manifests/7i92-7i77-7i72.txt"));
    assert_eq!(differences(&made, &written), Vec::<String>::new());
    assert!(written.len() > 500, "the manifest is whole");
}

#[test]
fn a_7i97_has_exactly_the_pins_that_are_written() {
    let made = made(machine_7i97().pins());
    let written = manifest(include_str!("../../manifests/7i97.txt"));
    assert_eq!(differences(&made, &written), Vec::<String>::new());
    assert!(written.len() > 400, "the manifest is whole");
}

#[test]
fn order_of_the_list_is_the_same_in_every_run() {
    let [one, other] = [machine_7i92(), machine_7i92()];
    let names = |driver: &Driver<SimFpga>| {
        let infos = driver.pins().infos().iter();
        infos.map(|info| info.name.clone()).collect::<Vec<_>>()
    };
    assert_eq!(names(&one), names(&other));
}

#[test]
fn every_name_fits_the_tools_of_linuxcnc() {
    // LinuxCNC's own name is as long.
    let is_longer = |name: &str| name.ends_with(".position-interpolated");
    for driver in [machine_7i92(), machine_7i97()] {
        for info in driver.pins().infos() {
            let limit = if is_longer(&info.name) { 47 } else { 41 };
            assert!(info.name.len() <= limit, "{}", info.name);
        }
    }
}
