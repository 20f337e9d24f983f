//! Pins and outputs of firmware with InM and OutM, in the place of InMux and SSR or beside them.

use super::{Machine, both_firmwares, started};
use mesa_hal::Settings;
use mesa_hal::driver::Driver;
use mesa_hal_sim::{SimFpga, SimModuleDescriptor, SimPinDescriptor, gtag, machines};

/// Name and terminals of all pins of a module.
fn names_of(driver: &Driver<SimFpga>, module: &str) -> Vec<(String, String)> {
    let stem = format!("hm2_7i97.0.{module}.");
    let infos = driver.pins().infos().iter();
    infos
        .filter(|info| info.name.starts_with(&stem))
        .map(|info| {
            (
                info.name[stem.len()..].to_owned(),
                info.place.terminal.clone(),
            )
        })
        .collect()
}

#[test]
fn inm_and_outm_have_the_pins_and_terminals_of_inmux_and_ssr() {
    let [usual, newer] =
        both_firmwares().map(|fpga| Driver::start(fpga, Settings::default()).expect("a 7I97"));
    let inputs = names_of(&newer, "inm.00");
    assert_eq!(inputs, names_of(&usual, "inmux.00"));
    assert!(inputs.contains(&("raw-input-15-not".into(), "TB5 pin 11".into())));
    let outputs = names_of(&newer, "outm.00");
    let mut of_ssr = names_of(&usual, "ssr.00");
    of_ssr.retain(|(name, _)| name != "rate");
    assert_eq!(outputs, of_ssr);
    assert!(outputs.contains(&("invert-05".into(), "TB5 pin 23, TB5 pin 24".into())));
    for (driver, other) in [
        (&usual, "inm"),
        (&usual, "outm"),
        (&newer, "inmux"),
        (&newer, "ssr"),
    ] {
        assert_eq!(names_of(driver, other), []);
    }
}

#[test]
fn outm_beside_ssr_has_its_pin_numbers_and_no_board_terminals() {
    let mut firmware = machines::firmware_7i97(1);
    let out_m = SimModuleDescriptor {
        gtag: gtag::OUT_M,
        base: 0xB000,
        registers: 1,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.push(out_m);
    for (pin, output) in [(34, 5), (35, 4), (36, 31)] {
        firmware.pins[pin] = SimPinDescriptor::new(gtag::OUT_M, 0, 0x81 + output);
    }
    let mut machine = started(SimFpga::new(firmware));
    let names: Vec<_> = [
        "invert-04",
        "out-04",
        "invert-05",
        "out-05",
        "invert-31",
        "out-31",
    ]
    .map(|name| (name.to_owned(), String::new()))
    .into();
    assert_eq!(names_of(&machine.driver, "outm.00"), names);
    let five = machine.output::<bool>("outm.00.out-05");
    let last_inverted = machine.output::<bool>("outm.00.invert-31");
    let levels = |machine: &mut Machine<SimFpga>| {
        let fpga = machine.fpga();
        (
            [34, 35, 36].map(|pin| fpga.pin_level(pin)),
            fpga.read_register(0xB000),
        )
    };
    machine.cycles(2);
    assert_eq!(levels(&mut machine), ([false; 3], 0));
    let relay = machine.cards.outputs[5];
    let pins = machine.driver.pins_mut();
    pins.set(five, true);
    pins.set(last_inverted, true);
    machine.cycles(1);
    assert_eq!(
        levels(&mut machine),
        ([true, false, true], 1 << 5 | 1 << 31)
    );
    assert!(
        !machine.fpga().isolated_output(5),
        "the board's outputs are those of SSR"
    );
    machine.driver.pins_mut().set(relay.pin, true);
    machine.cycles(1);
    assert!(machine.fpga().isolated_output(5));
}
