//! What moves the axes: the analog outputs of a 7I97 itself, or those of a 7I77.

use mesa_hal::boards::{I7i77Analog, I7i97};
use mesa_hal::driver::Driver;
use mesa_hal::hal::{Output, Pins};

use crate::Failure;
use crate::machine::{AXES, World};
use crate::timed::Timed;

/// The analog outputs, in volts, and everything that has to be on for them to work.
#[derive(Debug)]
pub struct Drives {
    volts: [Output<f64>; AXES],
    enables: Vec<Output<bool>>,
    name: &'static str,
    /// The card whose analog outputs they are has field I/O as well.
    pub needs_field_io: bool,
}

impl Drives {
    /// Those of the board itself if it has any, otherwise those of a 7I77 on channel 1.
    pub fn find<B: World>(driver: &Driver<Timed<B>>) -> Result<Self, Failure> {
        if let Ok(card) = I7i97::of(driver.fpga_pins(), driver.firmware()) {
            return Ok(Self {
                volts: card.analog_out.map(|output| output.volts),
                enables: card.analog_out.map(|output| output.enable).to_vec(),
                name: "the analog outputs of the 7I97",
                needs_field_io: false,
            });
        }
        let remote = crate::found::remote(driver, 1);
        let remote = remote.ok_or("channel 1: the analog part of a 7I77 is missing, see above")?;
        let analog = I7i77Analog::new(driver.pins(), remote.pins())?;
        Ok(Self {
            volts: analog.analog_out.map(|output| output.volts),
            enables: vec![analog.analogena.pin, analog.spinena.pin],
            name: "the analog outputs of the 7I77",
            needs_field_io: true,
        })
    }

    /// What they are, for people.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Sets the voltage of an axis.
    pub fn set(&self, pins: &mut Pins, axis: usize, volts: f64) {
        if let Some(output) = self.volts.get(axis) {
            pins.set(*output, volts);
        }
    }

    /// Switches all drives on or off.
    pub fn enable(&self, pins: &mut Pins, on: bool) {
        for enable in &self.enables {
            pins.set(*enable, on);
        }
    }
}
