//! The pins that the application uses.

use mesa_hal::RemoteId;
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
    /// Of each voltage.
    limits: Vec<Limits>,
    /// The pins of field I/O in its other modes.
    pub(super) field: Option<Field>,
    /// Values set since it was armed.
    pub(super) set: Level,
    pub(super) is_armed: bool,
    /// Number of times that it was disarmed.
    pub(super) disarmed: u64,
}

pub(super) struct GpioPin {
    pub(super) pin: usize,
    pub(super) out: Output<bool>,
    pub(super) is_output: Param<bool>,
    pub(super) drives: bool,
}

/// Parameters for full scale and limits of a voltage, with their values.
struct Limits {
    params: [Param<f64>; 3],
    values: [f64; 3],
}

impl Limits {
    fn new(pins: &Pins, name: &str) -> Result<Self, PinError> {
        let param = |suffix| pins.parameter(&format!("{name}-{suffix}"));
        Ok(Self {
            params: [param("scalemax")?, param("minlim")?, param("maxlim")?],
            values: [FULL, -FULL, FULL],
        })
    }

    /// The resulting output for a set value.
    fn applied(&self, millivolts: i32) -> i32 {
        let [full, least, most] = self.values;
        let volts = (f64::from(millivolts) / 1000.0).clamp(least, most);
        ((volts / full).clamp(-1.0, 1.0) * FULL * 1000.0).round() as i32
    }
}

/// Volts at full scale.
const FULL: f64 = 10.0;

/// A voltage that is not 0.
fn volts(chance: &mut Chance) -> i32 {
    let volts = 100 * (1 + chance.below(90) as i32);
    if chance.one_in(2) { volts } else { -volts }
}

/// A voltage to set and the resulting one: 0 if it is not finite.
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
        let inputs = if card.is_field() { 0..32 } else { 0..0 };
        let inputs = inputs.map(|n| pins.input(&format!("{prefix}.input-{n:02}")));
        let bits = |count: usize| (0..count).map(|n| format!("{prefix}.output-{n:02}"));
        let outputs: Vec<String> = match card {
            Card::Field | Card::Field76 => bits(16).collect(),
            Card::Outputs => bits(48).collect(),
            Card::Analog => ["analogena", "spinena"]
                .map(|name| format!("{prefix}.{name}"))
                .into(),
        };
        let volts = if card == Card::Analog { 0..6 } else { 0..0 };
        let limits = volts.clone();
        let limits = limits.map(|n| Limits::new(pins, &format!("{prefix}.analogout{n}")));
        let volts = volts.map(|n| pins.output(&format!("{prefix}.analogout{n}")));
        let field = card.is_field().then(|| Field::new(pins, prefix, mode));
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
            limits: limits.collect::<Result<_, _>>()?,
            set: Level::OFF,
            is_armed: true,
            disarmed: 0,
        })
    }

    pub(super) fn id(&self) -> RemoteId {
        RemoteId::new(self.place.0 as u8, self.place.1.index())
    }

    pub(super) fn state<B: RegisterBus + Clock>(&self, driver: &Driver<B>) -> Option<RemoteState> {
        let (port, channel) = self.place;
        let status = driver.ports().get(port)?.remote(channel)?;
        Some(status.state)
    }

    /// Records the armed state. The set values are forgotten while it is not armed.
    pub(super) fn notice(&mut self, is_armed: bool) {
        self.disarmed += u64::from(self.is_armed && !is_armed);
        self.is_armed = is_armed;
        if !is_armed {
            self.set = Level::OFF;
        }
    }

    /// Commands new values; occasionally a voltage that is not a number, which results in 0 V.
    /// `side`: present where drives are not always enabled.
    pub(super) fn command(
        &self,
        pins: &mut Pins,
        chance: &mut Chance,
        side: Option<&mut Chance>,
        sets_nan: bool,
    ) -> Level {
        if self.card == Card::Analog {
            let mut level = Level::OFF;
            let [ena, spin] = [self.outputs[0], self.outputs[1]];
            let is_enabled = side.is_none_or(|side| !side.one_in(6));
            pins.set(ena, is_enabled);
            let spins = chance.one_in(2);
            pins.set(spin, spins);
            // The enables of 0 to 4 are one.
            level.bits = if is_enabled { 0x1F } else { 0 } | u64::from(spins) << 5;
            for (n, output) in self.volts.iter().enumerate() {
                let (set, millivolts) = value(chance, sets_nan);
                pins.set(*output, set);
                let is_on = if n < 5 { is_enabled } else { spins };
                level.millivolts[n] = if is_on { millivolts } else { 0 };
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

    /// The outputs that result from the set values with the current limits.
    pub(super) fn sent(&self) -> Level {
        let mut level = self.set;
        for (millivolts, limits) in level.millivolts.iter_mut().zip(&self.limits) {
            *millivolts = limits.applied(*millivolts);
        }
        level
    }

    /// Changes full scale or a limit of a voltage.
    pub(super) fn tune(&mut self, pins: &mut Pins, chance: &mut Chance) {
        if self.limits.is_empty() {
            return;
        }
        let count = self.limits.len() as u64;
        let limits = &mut self.limits[chance.below(count) as usize];
        let which = chance.below(3) as usize;
        let new = match which {
            0 => chance.of(&[FULL, 5.0, 20.0]),
            1 => chance.of(&[-FULL, -4.0, -1.0]),
            _ => chance.of(&[FULL, 6.0, 2.0]),
        };
        if pins.set_param(limits.params[which], new).is_ok() {
            limits.values[which] = new;
        }
    }

    /// The first limit that accepts a value that is not a number.
    pub(super) fn takes_nonsense(&self, pins: &mut Pins) -> Option<String> {
        let mut limits = self.limits.iter();
        let takes = limits.position(|limits| {
            let mut both = limits.params.iter().zip(limits.values);
            both.any(|(param, value)| {
                pins.set_param(*param, f64::NAN).is_ok() || pins.param(*param) != value
            })
        })?;
        Some(format!(
            "a limit of voltage {takes} of remote {}",
            self.number
        ))
    }
}
