//! The modules of the simulated FPGA behave as FACTS 9.4 and 13 say.

mod dpll;
mod encoders;
mod inputs_and_outputs;
mod io_ports;
mod pwm;
mod watchdog;

use mesa_hal::sim::{AxisWiring, DriveSource, MotorConfig, SimFpga, machines};

const MS: u64 = 1_000_000;

/// All pins of a connector to their modules: direction and alternate source.
fn set_up_pins(fpga: &mut SimFpga, outputs: &[usize]) {
    for port in 0..3u16 {
        let word = outputs
            .iter()
            .filter(|&&pin| pin / 17 == usize::from(port))
            .fold(0, |word, &pin| word | 1 << (pin % 17));
        fpga.write_register(0x1200 + 4 * port, word);
        fpga.write_register(0x1100 + 4 * port, word);
    }
}

fn wait(fpga: &mut SimFpga, nanos: u64) {
    let to = fpga.now() + nanos;
    fpga.advance_to(to);
}

/// A 7I97 whose motors are turned by hand, all module outputs set up.
fn turned_by_hand() -> SimFpga {
    let mut fpga = machines::i7i97(1);
    for encoder in 0..6 {
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Nothing,
            encoder,
            motor: MotorConfig {
                counts_per_unit: 1.0,
                counts_per_revolution: 400,
                ..MotorConfig::default()
            },
        });
    }
    let outputs: Vec<usize> = (0..9).chain(18..30).chain(32..34).collect();
    set_up_pins(&mut fpga, &outputs);
    fpga
}

fn turn(fpga: &mut SimFpga, axis: usize, counts_per_second: f64) {
    let motor = fpga.motor(axis).expect("axis");
    motor.turn_by_hand(Some(counts_per_second));
}

fn count(fpga: &mut SimFpga, encoder: u16) -> u16 {
    fpga.read_register(0x3500 + 4 * encoder) as u16
}
