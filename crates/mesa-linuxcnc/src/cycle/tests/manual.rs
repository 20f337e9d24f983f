//! The manual page and the page on LinuxCNC name what only this component has.

use super::*;

const MANUAL: &str = include_str!("../../../packaging/mesa_eth.9");
const PAGE: &str = include_str!("../../../../../docs/linuxcnc.md");

/// Ends of the names that only this component has, and the boards that have them.
const OWN: [(&str, [bool; 2]); 11] = [
    ("valid", [true, true]),
    ("armed", [true, true]),
    ("rearm", [true, true]),
    ("count-unsure", [true, true]),
    ("max-count-rate", [true, true]),
    ("near-max-count-rate", [true, true]),
    ("homed", [true, true]),
    ("position-unsure", [false, true]),
    ("near-max-rate", [false, true]),
    ("position-lag", [false, true]),
    ("disable-ramp", [false, true]),
];

/// The names of a board with the words of LinuxCNC.
fn names(fpga: SimFpga) -> Vec<String> {
    let settings = settings("");
    let driver = Driver::start(Faulty::new(fpga, 1), settings).expect("the machine is complete");
    wanted(&driver).into_iter().map(|pin| pin.name).collect()
}

#[test]
fn pages_name_each_pin_of_its_own() {
    let boards = [
        names(machines::six_axes_7i97(Motor::default())),
        names(machines::i7i92_7i76()),
    ];
    let manual = MANUAL.replace('\\', "");
    for (end, has) in OWN {
        let is_it = |name: &String| name.rsplit('.').next() == Some(end);
        let found = [0, 1].map(|board: usize| boards[board].iter().any(is_it));
        assert_eq!(found, has, "{end}");
        assert!(manual.contains(end), "{end} in the manual page");
        assert!(PAGE.contains(end), "{end} in docs/linuxcnc.md");
    }
}

#[test]
fn pages_name_each_word_and_function() {
    let source = include_str!("../../exports.rs");
    let words = source.split("pub static rtapi_info_address_").skip(1);
    let words: Vec<_> = words.filter_map(|rest| rest.split(':').next()).collect();
    assert!(words.len() >= 6, "{words:?}");
    let functions = ["read", "write", "read-request", "read_gpio", "write_gpio"];
    let component = include_str!("../../component.rs");
    for name in functions {
        assert!(component.contains(&format!("=> \"{name}\"")), "{name}");
    }
    // For tests alone.
    let words = words.into_iter().filter(|word| *word != "panic_in");
    for name in words.chain(functions).chain(["enable_raw", "firmware"]) {
        assert!(MANUAL.contains(name), "{name} in the manual page");
        assert!(PAGE.contains(name), "{name} in docs/linuxcnc.md");
    }
}
