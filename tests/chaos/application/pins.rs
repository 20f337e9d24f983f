//! The pins that the application uses.

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{Driver, RemoteState};
use mesa_hal::hal::{GroupId, Input, Output, Param, PinError, Pins};
use mesa_hal::sslbp::Channel;

use super::super::journal::Level;
use super::super::plan::Card;
use super::field::Field;
use crate::common::chance::Chance;

/// The pins of one remote.
pub(super) struct Remote {
    pub(super) number: usize,
    pub(super) place: (usize, Channel),
    pub(super) card: Card,
    pub(super) group: GroupId,
    pub(super) inputs: Vec<Input<bool>>,
    pub(super) outputs: Vec<Output<bool>>,
    pub(super) volts: Vec<Output<f64>>,
    /// What field I/O has in its other modes.
    pub(super) field: Option<Field>,
    /// What it was set to since it was armed.
    pub(super) set: Level,
    pub(super) is_armed: bool,
    /// How often it was disarmed.
    pub(super) disarmed: u64,
}

pub(super) struct GpioPin {
    pub(super) pin: usize,
    pub(super) out: Output<bool>,
    pub(super) is_output: Param<bool>,
    pub(super) drives: bool,
}

/// A voltage that is not 0.
fn volts(chance: &mut Chance) -> i32 {
    let volts = 100 * (1 + chance.below(90) as i32);
    if chance.one_in(2) { volts } else { -volts }
}

/// A voltage to set and what becomes of it: of one that is not finite, 0.
pub(super) fn value(chance: &mut Chance, sets_nan: bool) -> (f64, i32) {
    let millivolts = volts(chance);
    if sets_nan && chance.one_in(20) {
        return (chance.of(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]), 0);
    }
    (f64::from(millivolts) / 1000.0, millivolts)
}

impl Remote {
    pub(super) fn new(
        pins: &Pins,
        prefix: &str,
        number: usize,
        place: (usize, Channel),
        card: Card,
        (group, mode): (GroupId, u8),
    ) -> Result<Self, PinError> {
        let inputs = if card == Card::Field { 0..32 } else { 0..0 };
        let inputs = inputs.map(|n| pins.input(&format!("{prefix}.input-{n:02}")));
        let bits = |count: usize| (0..count).map(|n| format!("{prefix}.output-{n:02}"));
        let outputs: Vec<String> = match card {
            Card::Field => bits(16).collect(),
            Card::Outputs => bits(48).collect(),
            Card::Analog => ["analogena", "spinena"]
                .map(|name| format!("{prefix}.{name}"))
                .into(),
        };
        let volts = if card == Card::Analog { 0..6 } else { 0..0 };
        let volts = volts.map(|n| pins.output(&format!("{prefix}.analogout{n}")));
        let field = (card == Card::Field).then(|| Field::new(pins, prefix, mode));
        Ok(Self {
            field: field.transpose()?,
            number,
            place,
            card,
            group,
            inputs: inputs.collect::<Result<_, _>>()?,
            outputs: outputs
                .iter()
                .map(|name| pins.output(name))
                .collect::<Result<_, _>>()?,
            volts: volts.collect::<Result<_, _>>()?,
            set: Level::OFF,
            is_armed: true,
            disarmed: 0,
        })
    }

    pub(super) fn state<B: RegisterBus + Clock>(&self, driver: &Driver<B>) -> Option<RemoteState> {
        let (port, channel) = self.place;
        let status = driver.ports().get(port)?.remote(channel)?;
        Some(status.state)
    }

    /// Takes whether it is armed now. What it was set to is forgotten while it is not.
    pub(super) fn notice(&mut self, is_armed: bool) {
        self.disarmed += u64::from(self.is_armed && !is_armed);
        self.is_armed = is_armed;
        if !is_armed {
            self.set = Level::OFF;
        }
    }

    /// Commands something new; now and then a voltage that is no number, which is 0 V.
    pub(super) fn command(&self, pins: &mut Pins, chance: &mut Chance, sets_nan: bool) -> Level {
        if self.card == Card::Analog {
            let mut level = Level::OFF;
            let [ena, spin] = [self.outputs[0], self.outputs[1]];
            pins.set(ena, true);
            let spins = chance.one_in(2);
            pins.set(spin, spins);
            // The enables of 0 to 4 are one.
            level.bits = 0x1F | u64::from(spins) << 5;
            for (n, output) in self.volts.iter().enumerate() {
                let (set, millivolts) = value(chance, sets_nan);
                pins.set(*output, set);
                level.millivolts[n] = if n < 5 || spins { millivolts } else { 0 };
            }
            return level;
        }
        let pattern = chance.below(1 << 31) ^ chance.below(1 << 31) << 20 | 1;
        let mut level = Level::OFF;
        for (n, output) in self.outputs.iter().enumerate() {
            pins.set(*output, pattern >> n & 1 != 0);
            level.bits |= pattern & 1 << n;
        }
        level
    }
}
