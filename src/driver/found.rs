//! What a driver found, in a line.

use core::fmt;

use super::{Driver, SerialPort};
use crate::bus::{Clock, RegisterBus};
use crate::modules::encoder::Encoders;
use crate::modules::in_mux::InMux;
use crate::modules::led::Leds;
use crate::modules::outputs::Outputs;
use crate::modules::pwm::Pwm;
use crate::modules::stepgen::Stepgens;

/// The board, its remotes and what it drives, in a line:
/// `hm2_7i92.0 (MESA7I92): 3 remotes (7i77.0.0, 7i77.0.1, 7i72.0.2), 6 encoders`.
impl<B: RegisterBus + Clock> fmt::Display for Driver<B> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let board = self.firmware().idrom.board_name.trim_end();
        write!(f, "{} ({board}): ", self.name())?;
        let count = self.ports().iter().flat_map(SerialPort::remotes).count();
        write!(f, "{count} remote{}", plural(count))?;
        let remotes = self.ports().iter().flat_map(SerialPort::remotes);
        for (number, remote) in remotes.enumerate() {
            let separator = if number == 0 { " (" } else { ", " };
            write!(f, "{separator}{}", remote.label)?;
        }
        f.write_str(if count == 0 { "" } else { ")" })?;
        let outputs = self.modules::<Outputs>().map(|part| part.outputs().len());
        for (count, what) in [
            (
                self.modules::<Encoders>()
                    .map(|part| part.pins().len())
                    .sum(),
                "encoder",
            ),
            (
                self.modules::<Pwm>().map(|part| part.pins().len()).sum(),
                "PWM generator",
            ),
            (
                self.modules::<Stepgens>()
                    .map(|part| part.pins().len())
                    .sum(),
                "step generator",
            ),
            (
                self.modules::<InMux>()
                    .map(|part| part.pins.inputs.len())
                    .sum(),
                "isolated input",
            ),
            (outputs.sum(), "isolated output"),
            (
                self.modules::<Leds>().map(|part| part.leds.len()).sum(),
                "LED",
            ),
        ] {
            if count > 0 {
                write!(f, ", {count} {what}{}", plural(count))?;
            }
        }
        match self.missing().len() {
            0 => Ok(()),
            missing => write!(f, "; missing: {missing}"),
        }
    }
}

const fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}
