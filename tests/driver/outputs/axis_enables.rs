//! One axis is enabled or disabled, of several that share an enable: the signals at the simulated
//! drives.

use std::time::Duration;

use mesa_hal::hal::{AnalogOut, Output};
use mesa_hal::{Clock, Driver, I7i77Analog, I7i97, Settings};
use mesa_hal_sim::{Motor, SimFpga, machines};

struct Axes {
    driver: Driver<SimFpga>,
    outputs: [AnalogOut; 6],
    /// The axes that share an enable.
    shared: &'static [usize],
}

/// A 7I97, whose first four axes share an enable, and a 7I77, whose first five do.
fn both() -> [Axes; 2] {
    let start = |fpga| Driver::start(fpga, Settings::default()).expect("a board");
    let i7i97 = start(machines::six_axes_7i97(Motor::default()));
    let i7i77 = start(machines::six_axes_7i92(Motor::default()));
    let card: I7i97 = i7i97.attach_board().expect("a 7I97");
    let analog: I7i77Analog = i7i77.attach((0, 1)).expect("a 7I77");
    [
        Axes {
            driver: i7i97,
            outputs: card.analog_out,
            shared: &[0, 1, 2, 3],
        },
        Axes {
            driver: i7i77,
            outputs: analog.analog_out,
            shared: &[0, 1, 2, 3, 4],
        },
    ]
}

impl Axes {
    fn cycles(&mut self, mut change: impl FnMut(&mut Driver<SimFpga>, &[AnalogOut; 6])) {
        for _ in 0..4 {
            let _ = self.driver.read();
            change(&mut self.driver, &self.outputs);
            self.driver.write().expect("the bus does not fail");
            self.driver.bus_mut().wait(Duration::from_millis(1));
        }
    }

    /// The voltage and the enable at each drive, in tenths of a volt.
    fn drives(&mut self) -> [(i32, bool); 6] {
        [0, 1, 2, 3, 4, 5].map(|axis| {
            let signal = self.driver.bus_mut().drive_signal(axis).expect("a drive");
            ((signal.volts * 10.0).round() as i32, signal.enabled)
        })
    }

    /// Expected signals while these axes are enabled.
    fn expected(&self, enabled: &[usize]) -> [(i32, bool); 6] {
        let is_shared_on = self.shared.iter().any(|axis| enabled.contains(axis));
        [0, 1, 2, 3, 4, 5].map(|axis| {
            let is_on = enabled.contains(&axis);
            let is_near = is_shared_on && self.shared.contains(&axis);
            (if is_on { volts(axis) } else { 0 }, is_on || is_near)
        })
    }
}

fn volts(axis: usize) -> i32 {
    30 + axis as i32
}

fn set_volts(driver: &mut Driver<SimFpga>, outputs: &[AnalogOut; 6]) {
    for (axis, output) in outputs.iter().enumerate() {
        output.set(driver.pins_mut(), f64::from(volts(axis)) / 10.0);
    }
}

#[test]
fn axes_have_voltage_only_if_enabled_in_any_set_and_order() {
    for mut axes in both() {
        // Also with nothing enabled before.
        for enabled in (0..64_usize).chain([0, 63, 62, 61, 1, 2]) {
            let is_on = |axis: usize| enabled >> axis & 1 != 0;
            for backwards in [false, true] {
                axes.cycles(|driver, outputs| {
                    for n in 0..6 {
                        let axis = if backwards { 5 - n } else { n };
                        outputs[axis].enable(driver.pins_mut(), is_on(axis));
                    }
                    set_volts(driver, outputs);
                });
                let on: Vec<_> = (0..6).filter(|axis| is_on(*axis)).collect();
                assert_eq!(axes.drives(), axes.expected(&on), "{on:?}");
            }
        }
    }
}

#[test]
fn axis_that_was_never_enabled_has_0_volts_beside_one_that_is() {
    for alone in 0..6 {
        for mut axes in both() {
            axes.cycles(set_volts);
            axes.cycles(|driver, outputs| outputs[alone].enable(driver.pins_mut(), true));
            assert_eq!(axes.drives(), axes.expected(&[alone]), "axis {alone}");
            for axis in 0..6 {
                let pin = axes.outputs[axis].volts.into();
                let seen = axes.driver.pins().read_any(pin).value.as_f64();
                let is_seen = (seen * 10.0).round() as i32;
                // Its own enable is on, and it has 0 V.
                let enable = axes.driver.pins().commanded(axes.outputs[axis].enable);
                let is_held = enable && axis != alone;
                let expected = if is_held { 0 } else { volts(axis) };
                assert_eq!(is_seen, expected, "axis {axis} beside {alone}");
            }
        }
    }
}

#[test]
fn enable_pins_set_by_name_act_on_all_axes_as_in_linuxcnc() {
    for mut axes in both() {
        axes.cycles(set_volts);
        assert_eq!(axes.drives(), axes.expected(&[]));
        let set_enables = |on: bool| {
            move |driver: &mut Driver<SimFpga>, outputs: &[AnalogOut; 6]| {
                for output in outputs {
                    let pins = driver.pins_mut();
                    let name = pins.info(output.enable).expect("a pin").name.clone();
                    let enable: Output<bool> = pins.output(&name).expect("an output");
                    pins.set(enable, on);
                }
            }
        };
        axes.cycles(set_enables(true));
        assert_eq!(axes.drives(), axes.expected(&[0, 1, 2, 3, 4, 5]));
        axes.cycles(set_enables(false));
        assert_eq!(axes.drives(), axes.expected(&[]));
        // A single disabled axis is not enabled again, and an enabled one can be stopped.
        axes.cycles(|driver, outputs| {
            outputs[0].enable(driver.pins_mut(), false);
            outputs[1].enable(driver.pins_mut(), true);
        });
        assert_eq!(axes.drives(), axes.expected(&[1]));
        axes.cycles(set_enables(false));
        assert_eq!(axes.drives(), axes.expected(&[]));
        axes.cycles(set_enables(true));
        assert_eq!(axes.drives()[0], (0, true));
        assert_eq!(axes.drives()[1], (volts(1), true));
    }
}

#[test]
fn axis_that_was_enabled_before_a_fault_is_not_enabled_after_it() {
    for mut axes in both() {
        axes.cycles(|driver, outputs| {
            for output in outputs {
                output.enable(driver.pins_mut(), true);
            }
            set_volts(driver, outputs);
        });
        assert_eq!(axes.drives(), axes.expected(&[0, 1, 2, 3, 4, 5]));
        // The watchdog bites.
        axes.driver.bus_mut().wait(Duration::from_millis(20));
        axes.cycles(|_, _| ());
        for _ in 0..50 {
            let _ = axes.driver.rearm().expect("the bus does not fail");
            axes.cycles(|_, _| ());
        }
        axes.cycles(set_volts);
        assert_eq!(axes.drives(), axes.expected(&[]));
        axes.cycles(|driver, outputs| outputs[2].enable(driver.pins_mut(), true));
        assert_eq!(axes.drives(), axes.expected(&[2]));
        axes.cycles(|driver, outputs| outputs[3].enable(driver.pins_mut(), false));
        assert_eq!(axes.drives(), axes.expected(&[2]));
        axes.cycles(|driver, outputs| outputs[2].enable(driver.pins_mut(), false));
        assert_eq!(axes.drives(), axes.expected(&[]));
    }
}
