//! PWM generators.

use alloc::format;

use super::{Maker, at_terminals};
use crate::boards::Terminal;
use crate::hal::{
    AnalogOut, FullScale, GroupId, Output, OutputModifiers, OutputRule, Param, PinError, PinStore,
    Spec,
};

/// The pins of one generator: `hm2_7i97.0.pwmgen.00.value` and so on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PwmPins {
    /// The value; full scale is `scale`.
    pub value: Output<f64>,
    /// While it is false the output is zero (half scale in offset mode), whatever `value` says, and
    /// the generator's enable output is off, if it has one: the hardware's own enable leaves the
    /// PWM as it is. FACTS 12.3.
    pub enable: Output<bool>,
    /// 0 is half scale on the wire: for analog outputs of both signs.
    pub offset_mode: Param<bool>,
    /// The value that is full scale.
    pub scale: Param<f64>,
    /// 1 PWM and direction, 2 up and down, 3 PDM, 4 direction and PWM.
    pub output_type: Param<i32>,
}

/// Where the pins of a generator are, and what they are for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PwmUse {
    /// The terminals of the output.
    pub output: &'static [Terminal],
    /// The terminals of the enable output.
    pub enable: &'static [Terminal],
    /// The generator whose enable output switches this one's drive, if it has none of its own:
    /// while that generator is disabled, this one is, too.
    pub switched_by: Option<usize>,
    /// Full scale, at first.
    pub scale: f64,
    /// The unit of the value.
    pub unit: &'static str,
    /// Offset mode, at first.
    pub offset_mode: bool,
}

impl PwmPins {
    /// Makes the pins of generator `number`.
    pub fn new(
        pins: &mut PinStore,
        group: GroupId,
        board: &str,
        number: usize,
        usage: PwmUse,
    ) -> Result<Self, PinError> {
        let stem = format!("{board}.pwmgen.{number:02}.");
        let value = at_terminals(Spec::new(format!("{stem}value")), usage.output)
            .unit(usage.unit)
            .range(-usage.scale, usage.scale);
        let value = pins.add_output(group, value, OutputRule::safe_at(0.0))?;
        let enable = Maker::new(pins, group, stem.clone())
            .at(usage.enable)
            .output("enable")?;
        let mut make = Maker::new(pins, group, stem);
        let all = Self {
            value,
            enable,
            offset_mode: make.setting("offset-mode", usage.offset_mode)?,
            scale: make.setting("scale", usage.scale)?,
            output_type: make.setting("output-type", 1)?,
        };
        let full_scale = Some(FullScale {
            scale: all.scale,
            min: -1.0,
            max: 1.0,
        });
        let modifiers = OutputModifiers {
            full_scale,
            ..OutputModifiers::default()
        };
        pins.modify(value, modifiers)?;
        Ok(all)
    }

    /// It as an analog output, of a board that has it at one.
    pub fn analog_out(self) -> AnalogOut {
        AnalogOut {
            volts: self.value,
            enable: self.enable,
            full_scale: self.scale,
            ..AnalogOut::default()
        }
    }

    /// The value as a fraction of full scale, -1 to 1: 0 if it is not finite or the scale is 0, and
    /// the end if it is beyond. Both are counted.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn fraction(&self, pins: &mut PinStore) -> f64 {
        pins.fetch(self.value)
    }
}

/// The pins of all generators together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PwmBankPins {
    /// PWM frequency in Hz.
    pub pwm_frequency: Param<u32>,
    /// Frequency of the PDM clock in Hz, of which each tick is one step of 4096; as LinuxCNC has it.
    pub pdm_frequency: Param<u32>,
}

impl PwmBankPins {
    /// Makes the pins of all generators of a module, at this PWM frequency.
    pub fn new(
        pins: &mut PinStore,
        group: GroupId,
        board: &str,
        pwm_hz: u32,
    ) -> Result<Self, PinError> {
        let mut make = Maker::new(pins, group, format!("{board}.pwmgen."));
        Ok(Self {
            pwm_frequency: make.setting("pwm_frequency", pwm_hz)?,
            pdm_frequency: make.setting("pdm_frequency", 20_000)?,
        })
    }
}
