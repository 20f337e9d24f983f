//! Analog outputs of firmware whose PWM dithers: no step of a voltage wraps a period.

use mesa_hal_sim::gtag;

use super::*;

/// The pin of analog output 0.
const PIN: usize = 0;

/// A 7I97 with PWM version 1, whose generators have 12 bits at 20 kHz, 11 at 75 kHz, 10 at 150 kHz.
fn dithers(hz: u32) -> Machine<SimFpga> {
    let mut firmware = machines::firmware_7i97(1);
    firmware.module_mut(gtag::PWM).expect("PWM").version = 1;
    let mut fpga = SimFpga::new(firmware);
    // A write takes less than a period of the PWM.
    fpga.set_access_cost(20);
    build(fpga, |settings| settings.pwm_hz = Some(hz))
}

/// The longest time in nanoseconds for which the pin is low.
fn longest_low(fpga: &mut SimFpga, nanos: u64) -> u64 {
    let start = SimFpga::now(fpga);
    let (mut longest, mut since) = (0, start);
    for time in (start..start + nanos).step_by(500) {
        fpga.advance_to(time);
        if fpga.pin_level(PIN) {
            since = time;
        }
        longest = longest.max(time - since);
    }
    longest
}

#[test]
fn no_step_of_a_voltage_has_a_period_of_0() {
    const VOLTS: [f64; 8] = [0.0, 5.0, 9.99, 9.995, 9.9975, 9.999, 9.9999, 10.0];
    for hz in [20_000, 75_000, 150_000] {
        let mut machine = dithers(hz);
        let period = 1_000_000_000 / u64::from(hz);
        let [output, ..] = machine.cards.analog_out;
        machine.driver.pins_mut().set(output.enable, true);
        for from in VOLTS {
            for to in VOLTS {
                for volts in [from, to] {
                    let _ = machine.driver.read().expect("the bus does not fail");
                    machine.driver.pins_mut().set(output.volts, volts);
                    machine.driver.write().expect("the bus does not fail");
                    let low = longest_low(machine.fpga(), 4 * period);
                    machine.rest();
                    // At 0 V and above the pin is low for half of a period at most.
                    assert!(
                        low < period * 3 / 4,
                        "{hz} Hz, {from} to {to} V: low for {low} ns"
                    );
                }
            }
        }
    }
}

/// The mean of the voltage that generator 0 makes.
fn mean_volts(machine: &mut Machine<SimFpga>) -> f64 {
    machine.cycles(3);
    machine.fpga().analog_output(0).volts
}

#[test]
fn dither_is_used_while_its_parameter_is_true() {
    let mut machine = dithers(20_000);
    let dither = machine.param::<bool>("pwmgen.00.dither");
    let [output, ..] = machine.cards.analog_out;
    let step = 20.0 / 4096.0;
    machine.driver.pins_mut().set(output.enable, true);
    machine.driver.pins_mut().set(output.volts, 2.25 * step);
    for (on, steps) in [(true, 2.25), (false, 2.0), (true, 2.25)] {
        machine.set_param(dither, on);
        let volts = mean_volts(&mut machine);
        assert!((volts / step - steps).abs() < 0.01, "{on}: {volts} V");
    }
    // Firmware of version 0 has none.
    let usual = board();
    assert!(
        usual
            .driver
            .pins()
            .parameter::<bool>("hm2_7i97.0.pwmgen.00.dither")
            .is_err()
    );
}
