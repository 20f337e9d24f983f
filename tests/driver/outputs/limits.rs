//! Limits of analog outputs.

use crate::common::machine::{ANALOG, Machine};

#[test]
fn limits_that_cross_allow_nothing_but_the_safe_value() {
    let mut machine = Machine::new();
    let analog = machine.cards.analog;
    let name = "hm2_7i92.0.7i77.0.1.analogout1";
    for (min, max) in [(3.0, -3.0), (20.0, 10.0), (-10.0, -20.0), (9.0, 8.0)] {
        let pins = machine.driver.pins_mut();
        let minlim = pins.parameter(&format!("{name}-minlim")).unwrap();
        let maxlim = pins.parameter(&format!("{name}-maxlim")).unwrap();
        pins.set_param(minlim, min).unwrap();
        pins.set_param(maxlim, max).unwrap();
        pins.set(analog.analogena.pin, true);
        for volts in [-10.0, 0.0, 5.0, 10.0] {
            machine
                .driver
                .pins_mut()
                .set(analog.analog_out[1].volts, volts);
            machine.cycles(2);
            let volts_out = machine.device(ANALOG).world().analog_output(1).unwrap();
            let allowed = if min > max {
                0.0
            } else {
                volts.clamp(min, max)
            };
            assert!(
                (volts_out - allowed.clamp(-10.0, 10.0)).abs() < 0.01,
                "{min} {max}: {volts} V became {volts_out} V"
            );
        }
    }
}
