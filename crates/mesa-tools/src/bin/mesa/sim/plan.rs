//! Mechanics and input wiring of a machine, from its description.

use std::net::Ipv4Addr;

use mesa_hal_sim::{Motor, SimTerminal, Stepper};

use super::slot::Slot;

/// Axes, switches, handwheels and emergency stop. Without axes, each axis of the board has its
/// usual motor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    pub axes: Vec<AxisPlan>,
    pub switches: Vec<SwitchPlan>,
    pub wheels: Vec<WheelPlan>,
    pub estop: Option<EstopPlan>,
    /// Address to listen on, if the description contains one.
    pub listen: Option<Ipv4Addr>,
    pub port: Option<u16>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct AxisPlan {
    pub name: String,
    pub mover: MoverPlan,
}

/// The motor of an axis, and what drives it.
#[derive(Clone, Debug, PartialEq)]
pub enum MoverPlan {
    /// A motor on an analog output, with its encoder.
    Servo {
        output: u8,
        encoder: usize,
        motor: Motor,
    },
    /// A stepper motor on a step generator.
    Stepper {
        generator: usize,
        encoder: Option<usize>,
        motor: Stepper,
    },
}

impl MoverPlan {
    /// The encoder on the motor.
    pub const fn encoder(&self) -> Option<usize> {
        match *self {
            Self::Servo { encoder, .. } => Some(encoder),
            Self::Stepper { encoder, .. } => encoder,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct SwitchPlan {
    pub name: String,
    /// Index of the switch's axis.
    pub axis: usize,
    pub from: f64,
    pub to: f64,
    pub hysteresis: f64,
    pub bounce_ms: f64,
    pub normally_closed: bool,
    pub wire: Wire,
}

#[derive(Clone, Debug, PartialEq)]
pub struct WheelPlan {
    pub name: String,
    pub a: Wire,
    pub b: Wire,
    pub speed: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct EstopPlan {
    pub inputs: Vec<Wire>,
    pub cuts_drives: bool,
    /// Channels, each with its line in the description.
    pub cuts_field: Vec<(Slot, usize)>,
}

/// A wire to an input, with its line in the description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wire {
    pub terminal: SimTerminal,
    pub line: usize,
}

/// Index of the item that a word names, by its name or by its number.
pub fn index_of<'a>(
    what: &str,
    word: &str,
    names: impl ExactSizeIterator<Item = &'a str>,
    count: usize,
) -> Result<usize, String> {
    let names: Vec<&str> = names.collect();
    let by_number = word.parse().ok().filter(|&index| index < count);
    let index = names.iter().position(|name| *name == word).or(by_number);
    index.ok_or_else(|| match (count, names.is_empty()) {
        (0, _) => format!("there is no {what} `{word}`: this machine has none"),
        (_, true) => format!("there is no {what} {word}: there are 0 to {}", count - 1),
        (_, false) => format!(
            "there is no {what} `{word}`: there are {}",
            names.join(", ")
        ),
    })
}
