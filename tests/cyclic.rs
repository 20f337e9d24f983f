//! The cycle on the simulated machine: values arrive where they belong, and what is planned is
//! what happens.

mod cyclic_support;

use cyclic_support::{ANALOG, FIELD, Machine, OUTPUTS};

#[test]
fn inputs_and_outputs_of_three_remotes_arrive_at_the_right_terminals() {
    let mut machine = Machine::new();
    assert!(
        machine.driver.missing().is_empty(),
        "{:?}",
        machine.driver.missing()
    );
    machine.cycles(3);
    for input in 0..32 {
        machine
            .device_mut(FIELD)
            .set_input(input, input % 3 == 0)
            .unwrap();
    }
    let (field, analog, outputs) = (machine.field, machine.analog, machine.outputs);
    let pins = machine.driver.pins_mut();
    for (n, output) in field.outputs.iter().enumerate() {
        pins.set(output.pin, n % 2 == 0);
    }
    for (n, output) in analog.analog_out.iter().enumerate() {
        pins.set(output.pin, n as f64 - 2.5);
    }
    pins.set(analog.analogena.pin, true);
    pins.set(analog.spinena.pin, true);
    for (n, output) in outputs.outputs.iter().enumerate() {
        pins.set(output.pin, n % 5 == 0);
    }
    machine.cycles(2);
    let report = machine.cycle();
    assert!(report.is_good(), "{report:?}");
    assert_eq!(report.good, 3);
    for n in 0..16 {
        assert_eq!(
            machine.device(FIELD).world().output(n),
            Some(n % 2 == 0),
            "output {n}"
        );
    }
    for n in 0..6 {
        let volts = machine.device(ANALOG).world().analog_output(n).unwrap();
        assert!(
            (volts - (n as f64 - 2.5)).abs() < 0.003,
            "output {n}: {volts}"
        );
    }
    for n in 0..48 {
        assert_eq!(
            machine.device(OUTPUTS).world().output(n),
            Some(n % 5 == 0),
            "output {n}"
        );
    }
    let pins = machine.driver.pins();
    for (n, input) in field.inputs.iter().enumerate() {
        let reading = pins.read(input.pin);
        assert!(reading.valid && reading.age.cycles == 0);
        assert_eq!(reading.value, n % 3 == 0, "input {n}");
        assert_eq!(pins.read(input.not).value, n % 3 != 0, "input {n}-not");
    }
}
