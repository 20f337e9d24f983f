//! Skeleton of a controller on hm2_5i25.0, written by `mesa hal`. Enables no drive.
//!
//! In Cargo.toml: `mesa-pci = "0.1"` and `mesa-hal = { version = "0.1", features = ["realtime"] }`.

use std::error::Error;
use std::ops::ControlFlow::Continue;
use std::process::ExitCode;

use mesa_hal::hal::PinError;
use mesa_hal::runner::{Runner, Stop};
use mesa_hal::{Counter, Driver, Input, MesaError, Output, Pins, Settings};
use mesa_pci::{PciDevice, SYSFS};

/// The board, unless an argument names another. TODO: made from a simulated board.
const BOARD: &str = "0000:03:00.0";

/// A servo axis.
#[derive(Clone, Copy, Debug)]
struct Joint {
    encoder: Counter,
    /// In volts; 0 V while the drive is not enabled.
    volts: Output<f64>,
    /// Enables the drive, and every other drive with the same enable.
    #[allow(dead_code, reason = "nothing enables a drive yet")]
    enable: Output<bool>,
}

/// Handles of the machine's pins.
#[derive(Debug)]
#[allow(dead_code, reason = "remove unused fields")]
struct Machine {
    joints: [Joint; 6],
    /// TB3 pin 1, 2, 4, 5 QA0, /QA0, QB0, /QB0.
    encoder_00_velocity: Input<f64>,
    /// TB3 pin 9, 10, 12, 13 QA1, /QA1, QB1, /QB1.
    encoder_01_velocity: Input<f64>,
    /// TB3 pin 17, 18, 20, 21 QA2, /QA2, QB2, /QB2.
    encoder_02_velocity: Input<f64>,
    /// TB4 pin 1, 2, 4, 5 QA3, /QA3, QB3, /QB3.
    encoder_03_velocity: Input<f64>,
    /// TB4 pin 9, 10, 12, 13 QA4, /QA4, QB4, /QB4.
    encoder_04_velocity: Input<f64>,
    /// TB4 pin 17, 18, 20, 21 QA5, /QA5, QB5, /QB5.
    encoder_05_velocity: Input<f64>,
    /// TB8 pin 17 OUTPUT0.
    i7i77_0_0_output_00: Output<bool>,
    /// TB8 pin 18 OUTPUT1.
    i7i77_0_0_output_01: Output<bool>,
    /// TB8 pin 19 OUTPUT2.
    i7i77_0_0_output_02: Output<bool>,
    /// TB8 pin 20 OUTPUT3.
    i7i77_0_0_output_03: Output<bool>,
    /// TB8 pin 21 OUTPUT4.
    i7i77_0_0_output_04: Output<bool>,
    /// TB8 pin 22 OUTPUT5.
    i7i77_0_0_output_05: Output<bool>,
    /// TB8 pin 23 OUTPUT6.
    i7i77_0_0_output_06: Output<bool>,
    /// TB8 pin 24 OUTPUT7.
    i7i77_0_0_output_07: Output<bool>,
    /// TB7 pin 17 OUTPUT8.
    i7i77_0_0_output_08: Output<bool>,
    /// TB7 pin 18 OUTPUT9.
    i7i77_0_0_output_09: Output<bool>,
    /// TB7 pin 19 OUTPUT10.
    i7i77_0_0_output_10: Output<bool>,
    /// TB7 pin 20 OUTPUT11.
    i7i77_0_0_output_11: Output<bool>,
    /// TB7 pin 21 OUTPUT12.
    i7i77_0_0_output_12: Output<bool>,
    /// TB7 pin 22 OUTPUT13.
    i7i77_0_0_output_13: Output<bool>,
    /// TB7 pin 23 OUTPUT14.
    i7i77_0_0_output_14: Output<bool>,
    /// TB7 pin 24 OUTPUT15.
    i7i77_0_0_output_15: Output<bool>,
    /// TB8 pin 1 INPUT0.
    i7i77_0_0_input_00: Input<bool>,
    /// TB8 pin 2 INPUT1.
    i7i77_0_0_input_01: Input<bool>,
    /// TB8 pin 3 INPUT2.
    i7i77_0_0_input_02: Input<bool>,
    /// TB8 pin 4 INPUT3.
    i7i77_0_0_input_03: Input<bool>,
    /// TB8 pin 5 INPUT4.
    i7i77_0_0_input_04: Input<bool>,
    /// TB8 pin 6 INPUT5.
    i7i77_0_0_input_05: Input<bool>,
    /// TB8 pin 7 INPUT6.
    i7i77_0_0_input_06: Input<bool>,
    /// TB8 pin 8 INPUT7.
    i7i77_0_0_input_07: Input<bool>,
    /// TB8 pin 9 INPUT8.
    i7i77_0_0_input_08: Input<bool>,
    /// TB8 pin 10 INPUT9.
    i7i77_0_0_input_09: Input<bool>,
    /// TB8 pin 11 INPUT10.
    i7i77_0_0_input_10: Input<bool>,
    /// TB8 pin 12 INPUT11.
    i7i77_0_0_input_11: Input<bool>,
    /// TB8 pin 13 INPUT12.
    i7i77_0_0_input_12: Input<bool>,
    /// TB8 pin 14 INPUT13.
    i7i77_0_0_input_13: Input<bool>,
    /// TB8 pin 15 INPUT14.
    i7i77_0_0_input_14: Input<bool>,
    /// TB8 pin 16 INPUT15.
    i7i77_0_0_input_15: Input<bool>,
    /// TB7 pin 1 INPUT16.
    i7i77_0_0_input_16: Input<bool>,
    /// TB7 pin 2 INPUT17.
    i7i77_0_0_input_17: Input<bool>,
    /// TB7 pin 3 INPUT18.
    i7i77_0_0_input_18: Input<bool>,
    /// TB7 pin 4 INPUT19.
    i7i77_0_0_input_19: Input<bool>,
    /// TB7 pin 5 INPUT20.
    i7i77_0_0_input_20: Input<bool>,
    /// TB7 pin 6 INPUT21.
    i7i77_0_0_input_21: Input<bool>,
    /// TB7 pin 7 INPUT22.
    i7i77_0_0_input_22: Input<bool>,
    /// TB7 pin 8 INPUT23.
    i7i77_0_0_input_23: Input<bool>,
    /// TB7 pin 9 INPUT24.
    i7i77_0_0_input_24: Input<bool>,
    /// TB7 pin 10 INPUT25.
    i7i77_0_0_input_25: Input<bool>,
    /// TB7 pin 11 INPUT26.
    i7i77_0_0_input_26: Input<bool>,
    /// TB7 pin 12 INPUT27.
    i7i77_0_0_input_27: Input<bool>,
    /// TB7 pin 13 INPUT28.
    i7i77_0_0_input_28: Input<bool>,
    /// TB7 pin 14 INPUT29.
    i7i77_0_0_input_29: Input<bool>,
    /// TB7 pin 15 INPUT30.
    i7i77_0_0_input_30: Input<bool>,
    /// TB7 pin 16 INPUT31.
    i7i77_0_0_input_31: Input<bool>,
}

impl Machine {
    #[allow(clippy::too_many_lines, reason = "a line for each pin")]
    fn find(pins: &Pins) -> Result<Self, PinError> {
        let joint = |encoder: &str, volts: &str, enable: &str| {
            Ok(Joint {
                encoder: Counter::find(pins, encoder)?,
                volts: pins.output(volts)?,
                enable: pins.output(enable)?,
            })
        };
        Ok(Self {
            joints: [
                joint(
                    "hm2_5i25.0.encoder.00",
                    "hm2_5i25.0.7i77.0.1.analogout0",
                    "hm2_5i25.0.7i77.0.1.analogena",
                )?,
                joint(
                    "hm2_5i25.0.encoder.01",
                    "hm2_5i25.0.7i77.0.1.analogout1",
                    "hm2_5i25.0.7i77.0.1.analogena",
                )?,
                joint(
                    "hm2_5i25.0.encoder.02",
                    "hm2_5i25.0.7i77.0.1.analogout2",
                    "hm2_5i25.0.7i77.0.1.analogena",
                )?,
                joint(
                    "hm2_5i25.0.encoder.03",
                    "hm2_5i25.0.7i77.0.1.analogout3",
                    "hm2_5i25.0.7i77.0.1.analogena",
                )?,
                joint(
                    "hm2_5i25.0.encoder.04",
                    "hm2_5i25.0.7i77.0.1.analogout4",
                    "hm2_5i25.0.7i77.0.1.analogena",
                )?,
                joint(
                    "hm2_5i25.0.encoder.05",
                    "hm2_5i25.0.7i77.0.1.analogout5",
                    "hm2_5i25.0.7i77.0.1.spinena",
                )?,
            ],
            encoder_00_velocity: pins.input("hm2_5i25.0.encoder.00.velocity")?,
            encoder_01_velocity: pins.input("hm2_5i25.0.encoder.01.velocity")?,
            encoder_02_velocity: pins.input("hm2_5i25.0.encoder.02.velocity")?,
            encoder_03_velocity: pins.input("hm2_5i25.0.encoder.03.velocity")?,
            encoder_04_velocity: pins.input("hm2_5i25.0.encoder.04.velocity")?,
            encoder_05_velocity: pins.input("hm2_5i25.0.encoder.05.velocity")?,
            i7i77_0_0_output_00: pins.output("hm2_5i25.0.7i77.0.0.output-00")?,
            i7i77_0_0_output_01: pins.output("hm2_5i25.0.7i77.0.0.output-01")?,
            i7i77_0_0_output_02: pins.output("hm2_5i25.0.7i77.0.0.output-02")?,
            i7i77_0_0_output_03: pins.output("hm2_5i25.0.7i77.0.0.output-03")?,
            i7i77_0_0_output_04: pins.output("hm2_5i25.0.7i77.0.0.output-04")?,
            i7i77_0_0_output_05: pins.output("hm2_5i25.0.7i77.0.0.output-05")?,
            i7i77_0_0_output_06: pins.output("hm2_5i25.0.7i77.0.0.output-06")?,
            i7i77_0_0_output_07: pins.output("hm2_5i25.0.7i77.0.0.output-07")?,
            i7i77_0_0_output_08: pins.output("hm2_5i25.0.7i77.0.0.output-08")?,
            i7i77_0_0_output_09: pins.output("hm2_5i25.0.7i77.0.0.output-09")?,
            i7i77_0_0_output_10: pins.output("hm2_5i25.0.7i77.0.0.output-10")?,
            i7i77_0_0_output_11: pins.output("hm2_5i25.0.7i77.0.0.output-11")?,
            i7i77_0_0_output_12: pins.output("hm2_5i25.0.7i77.0.0.output-12")?,
            i7i77_0_0_output_13: pins.output("hm2_5i25.0.7i77.0.0.output-13")?,
            i7i77_0_0_output_14: pins.output("hm2_5i25.0.7i77.0.0.output-14")?,
            i7i77_0_0_output_15: pins.output("hm2_5i25.0.7i77.0.0.output-15")?,
            i7i77_0_0_input_00: pins.input("hm2_5i25.0.7i77.0.0.input-00")?,
            i7i77_0_0_input_01: pins.input("hm2_5i25.0.7i77.0.0.input-01")?,
            i7i77_0_0_input_02: pins.input("hm2_5i25.0.7i77.0.0.input-02")?,
            i7i77_0_0_input_03: pins.input("hm2_5i25.0.7i77.0.0.input-03")?,
            i7i77_0_0_input_04: pins.input("hm2_5i25.0.7i77.0.0.input-04")?,
            i7i77_0_0_input_05: pins.input("hm2_5i25.0.7i77.0.0.input-05")?,
            i7i77_0_0_input_06: pins.input("hm2_5i25.0.7i77.0.0.input-06")?,
            i7i77_0_0_input_07: pins.input("hm2_5i25.0.7i77.0.0.input-07")?,
            i7i77_0_0_input_08: pins.input("hm2_5i25.0.7i77.0.0.input-08")?,
            i7i77_0_0_input_09: pins.input("hm2_5i25.0.7i77.0.0.input-09")?,
            i7i77_0_0_input_10: pins.input("hm2_5i25.0.7i77.0.0.input-10")?,
            i7i77_0_0_input_11: pins.input("hm2_5i25.0.7i77.0.0.input-11")?,
            i7i77_0_0_input_12: pins.input("hm2_5i25.0.7i77.0.0.input-12")?,
            i7i77_0_0_input_13: pins.input("hm2_5i25.0.7i77.0.0.input-13")?,
            i7i77_0_0_input_14: pins.input("hm2_5i25.0.7i77.0.0.input-14")?,
            i7i77_0_0_input_15: pins.input("hm2_5i25.0.7i77.0.0.input-15")?,
            i7i77_0_0_input_16: pins.input("hm2_5i25.0.7i77.0.0.input-16")?,
            i7i77_0_0_input_17: pins.input("hm2_5i25.0.7i77.0.0.input-17")?,
            i7i77_0_0_input_18: pins.input("hm2_5i25.0.7i77.0.0.input-18")?,
            i7i77_0_0_input_19: pins.input("hm2_5i25.0.7i77.0.0.input-19")?,
            i7i77_0_0_input_20: pins.input("hm2_5i25.0.7i77.0.0.input-20")?,
            i7i77_0_0_input_21: pins.input("hm2_5i25.0.7i77.0.0.input-21")?,
            i7i77_0_0_input_22: pins.input("hm2_5i25.0.7i77.0.0.input-22")?,
            i7i77_0_0_input_23: pins.input("hm2_5i25.0.7i77.0.0.input-23")?,
            i7i77_0_0_input_24: pins.input("hm2_5i25.0.7i77.0.0.input-24")?,
            i7i77_0_0_input_25: pins.input("hm2_5i25.0.7i77.0.0.input-25")?,
            i7i77_0_0_input_26: pins.input("hm2_5i25.0.7i77.0.0.input-26")?,
            i7i77_0_0_input_27: pins.input("hm2_5i25.0.7i77.0.0.input-27")?,
            i7i77_0_0_input_28: pins.input("hm2_5i25.0.7i77.0.0.input-28")?,
            i7i77_0_0_input_29: pins.input("hm2_5i25.0.7i77.0.0.input-29")?,
            i7i77_0_0_input_30: pins.input("hm2_5i25.0.7i77.0.0.input-30")?,
            i7i77_0_0_input_31: pins.input("hm2_5i25.0.7i77.0.0.input-31")?,
        })
    }

    /// One cycle: inputs have been read, outputs are written after it.
    fn control(&self, pins: &mut Pins) {
        let may_move = may_move(self, pins);
        for joint in self.joints {
            let position = joint.encoder.read(pins).ok().filter(|_| may_move);
            pins.set(joint.volts, position.map_or(0.0, servo));
            // TODO: once the emergency stop and each axis's direction of counting are tested:
            // pins.set(joint.enable, may_move);
        }
    }
}

/// True if motion is allowed. TODO: the input of the emergency stop. An input that is not valid
/// counts as pressed: `pins.read(machine.INPUT).ok() == Some(true)`.
fn may_move(_machine: &Machine, _pins: &Pins) -> bool {
    false
}

/// Servo loop of an axis: volts for a position, in counts while `encoder.scale` is 1. TODO
fn servo(_position: f64) -> f64 {
    0.0
}

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let address = std::env::args().nth(1);
    let address = address.as_deref().unwrap_or(BOARD).parse()?;
    let settings = Settings {
        serial_ports: [(0, "00xxxxxx".parse()?)].into(),
        ..Settings::default()
    };
    let device = PciDevice::at(SYSFS.as_ref(), address)?;
    let bus = device
        .open()
        .map_err(|error| error.with_advice().to_string())?;
    let driver = Driver::start(bus, settings)?;
    for missing in driver.missing() {
        let missing = missing.with_advice();
        eprintln!("MISSING: {missing}");
    }
    let machine = Machine::find(driver.pins())?;
    let events = driver.events();
    eprintln!("{} runs; Ctrl-C ends it", driver.name());
    let runner = Runner::new(driver).stop_on(Stop::on_signals()?);
    let ended = runner.run(|cycle| {
        machine.control(cycle.pins_mut());
        Continue(())
    });
    for event in events {
        eprintln!("{}", event.with_advice());
    }
    ended.stopped?;
    Ok(match ended.signal {
        Some(signal) => signal.exit_code(),
        None => ExitCode::SUCCESS,
    })
}
