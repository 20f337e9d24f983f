//! Outputs that drive the axes: the analog outputs of a 7I97 itself, or those of a 7I77.

use mesa_hal::boards::{I7i77Analog, I7i97};
use mesa_hal::driver::Driver;
use mesa_hal::hal::AnalogOut;

use crate::machine::{AXES, World};
use crate::timed::Timed;
use crate::{Failure, advised};

/// The analog outputs of a machine.
#[derive(Debug)]
pub struct Drives {
    pub outputs: [AnalogOut; AXES],
    /// Their name, for the summary.
    pub name: &'static str,
    /// True if the card with the analog outputs has field I/O as well.
    pub needs_field_io: bool,
}

impl Drives {
    /// The analog outputs of the board itself if it has any, otherwise those of a 7I77 on
    /// channel 1.
    pub fn find<B: World>(driver: &Driver<Timed<B>>) -> Result<Self, Failure> {
        if let Ok(board) = driver.attach_board::<I7i97>() {
            return Ok(Self {
                outputs: board.analog_out,
                name: "the analog outputs of the 7I97",
                needs_field_io: false,
            });
        }
        let card = driver.attach::<I7i77Analog>((0, 1));
        let card = card.map_err(|error| advised(&error))?;
        Ok(Self {
            outputs: card.analog_out,
            name: "the analog outputs of the 7I77",
            needs_field_io: true,
        })
    }
}
