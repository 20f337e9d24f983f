//! Handles that belong together: the same struct for the same function on every board.
//!
//! An application that takes an [`AnalogOut`] works with one of a 7I97 and with one of a 7I77, on
//! which several axes share an enable:
//!
//! ```
//! use mesa_hal::hal::{AnalogOut, DigitalIn, Pins};
//!
//! fn follow(pins: &mut Pins, drive: AnalogOut, limit: DigitalIn, volts: f64) {
//!     let is_free = limit.read(pins).ok() == Some(false);
//!     drive.enable(pins, is_free);
//!     drive.set(pins, volts);
//! }
//! ```

use alloc::format;

use super::{InOut, Input, Invert, Output, Param, PinError, Pins, Reading, ShortName};

/// A digital input and its opposite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DigitalIn {
    /// The input.
    pub pin: Input<bool>,
    /// Its opposite.
    pub not: Input<bool>,
}

/// A digital output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DigitalOut {
    /// The output.
    pub pin: Output<bool>,
    /// The parameter or pin that inverts it on its way out, if there is one.
    pub invert: Option<Invert>,
}

/// An analog input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AnalogIn {
    /// The voltage, while `full_scale` has its initial value.
    pub volts: Input<f64>,
    /// The value that represents the end of the range.
    pub full_scale: Param<f64>,
}

/// An analog output and its enable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AnalogOut {
    /// The voltage, while `full_scale` has its initial value.
    pub volts: Output<f64>,
    /// The pin that must be on for the output to have its voltage. Several outputs may share it,
    /// which [`enable`](Self::enable) takes into account. If the switch of the drive follows a
    /// further pin, [`Pins::enables`] contains it.
    pub enable: Output<bool>,
    /// The value that goes out as the end of the range. The limits are in the same unit:
    /// [`set_full_scale`](Self::set_full_scale) changes all three.
    pub full_scale: Param<f64>,
    /// Upper limit: no larger value goes out.
    pub max_limit: Option<Param<f64>>,
    /// Lower limit: no smaller value goes out.
    pub min_limit: Option<Param<f64>>,
}

/// A counter: an encoder of the FPGA, or an MPG of a remote.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counter {
    /// Counts since the last reset or index.
    pub count: Input<i32>,
    /// Counts since the start.
    pub rawcounts: Input<i32>,
    /// `count / scale`.
    pub position: Input<f64>,
    /// Requests that `count` becomes 0 at the next index, or at the next full revolution of a
    /// counter without index; switched off when that has happened.
    pub index_enable: InOut<bool>,
    /// Keeps `count` at 0.
    pub reset: Output<bool>,
    /// Counts for one unit of position, never 0.
    pub scale: Param<f64>,
    /// Counts per revolution of a counter without index; 0 if it has no revolutions.
    pub counts_per_rev: Option<Param<u32>>,
    /// Indicates that the home position of an encoder of the FPGA may be lost. `count` is as valid
    /// as before, but may be wrong. The causes are:
    /// - The counter was set up again (the board was reset, its watchdog has bitten, or the bus was
    ///   down), and the counts in between are not known.
    /// - The gap without received inputs was long enough for the encoder to turn further than 16
    ///   bits can represent.
    /// - The encoder was at nine tenths of `max-count-rate` and seemed to stop from one cycle to
    ///   the next, as it does beyond that rate.
    /// - Packets were lost, late or repeated within 100 cycles after the board was set up.
    ///
    /// On until `reset`, or until an index in a cycle without such a gap or packet.
    pub count_unsure: Option<Input<bool>>,
}

impl DigitalIn {
    /// Finds the input by its name: `hm2_7i92.0.7i77.0.0.input-07`.
    ///
    /// # Errors
    /// [`PinError`] if the input, or the `-not` beside it, does not exist.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            pin: pins.input(name)?,
            not: pins.input(&format!("{name}-not"))?,
        })
    }

    /// Reads the level.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn read(self, pins: &Pins) -> Reading<bool> {
        pins.read(self.pin)
    }
}

impl DigitalOut {
    /// Finds the output by its name: `hm2_7i92.0.7i77.0.0.output-07`.
    ///
    /// # Errors
    /// [`PinError`] if the output, or the `-invert` beside it, does not exist.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            pin: pins.output(name)?,
            invert: Some(Invert::Setting(pins.parameter(&format!("{name}-invert"))?)),
        })
    }

    /// Switches the output on or off.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn set(self, pins: &mut Pins, on: bool) {
        pins.set(self.pin, on);
    }

    /// Sets the inversion of the output, which describes its wiring and therefore also applies to
    /// its safe value.
    ///
    /// # Errors
    /// [`PinError::NothingInverts`]; [`PinError::ForeignHandle`].
    pub fn set_inverted(self, pins: &mut Pins, inverted: bool) -> Result<(), PinError> {
        match self.invert {
            Some(Invert::Setting(param)) => pins.set_param(param, inverted),
            Some(Invert::Pin(pin)) => {
                pins.set(pin, inverted);
                Ok(())
            }
            None => {
                let info = pins.info_of(self.pin.into());
                let name = info.map_or("", |info| &info.name);
                Err(PinError::NothingInverts {
                    name: ShortName::new(name),
                })
            }
        }
    }
}

impl AnalogIn {
    /// Finds the input by its name: `hm2_7i92.0.7i77.0.0.fieldvoltage`.
    ///
    /// # Errors
    /// [`PinError`] if the input, or the `-scalemax` beside it, does not exist.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            volts: pins.input(name)?,
            full_scale: pins.parameter(&format!("{name}-scalemax"))?,
        })
    }

    /// Reads the voltage.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn read(self, pins: &Pins) -> Reading<f64> {
        pins.read(self.volts)
    }
}

impl AnalogOut {
    /// Finds the output by its name and that of its enable: `hm2_7i92.0.7i77.0.1.analogout0` and
    /// `hm2_7i92.0.7i77.0.1.analogena`.
    ///
    /// # Errors
    /// [`PinError`] if one of these outputs, or its `-scalemax`, `-maxlim` or `-minlim`, does not
    /// exist.
    pub fn find(pins: &Pins, name: &str, enable: &str) -> Result<Self, PinError> {
        Ok(Self {
            volts: pins.output(name)?,
            enable: pins.output(enable)?,
            full_scale: pins.parameter(&format!("{name}-scalemax"))?,
            max_limit: Some(pins.parameter(&format!("{name}-maxlim"))?),
            min_limit: Some(pins.parameter(&format!("{name}-minlim"))?),
        })
    }

    /// Sets the value that goes out as the end of the range, and with it the unit of the output:
    /// with 100.0, a value of 100.0 is 10 V. The limits keep their share of the range, whereas the
    /// parameter [`full_scale`](Self::full_scale) alone leaves them as they are: an output with
    /// limits of ±10 would then never exceed 1 V.
    ///
    /// # Errors
    /// The errors of [`Pins::set_param`]. On error, the output keeps its scale and its limits.
    pub fn set_full_scale(self, pins: &mut Pins, full_scale: f64) -> Result<(), PinError> {
        let before = pins.param(self.full_scale);
        let limits = [self.max_limit, self.min_limit].map(|limit| {
            let limit = limit?;
            Some((limit, pins.param(limit) / before * full_scale))
        });
        let is_too_large = |(_, value): &(_, f64)| full_scale.is_finite() && !value.is_finite();
        if let Some((limit, value)) = limits.into_iter().flatten().find(is_too_large) {
            return pins.set_param(limit, value);
        }
        pins.set_param(self.full_scale, full_scale)?;
        for (limit, value) in limits.into_iter().flatten() {
            pins.set_param(limit, value)?;
        }
        Ok(())
    }

    /// Sets the voltage.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn set(self, pins: &mut Pins, volts: f64) {
        pins.set(self.volts, volts);
    }

    /// Enables or disables this output individually. While it is not enabled it has 0 V (its safe
    /// value), whatever it is [set](Self::set) to and whatever other outputs share its enable.
    /// After a fault it must be enabled again.
    ///
    /// The pin [`enable`](Self::enable), and those that it needs in turn, are on while any output
    /// that shares them is enabled: a drive next to an enabled one sees its enable on, and 0 V.
    ///
    /// An application that sets these pins directly, as a LinuxCNC configuration does, switches
    /// them until the next call of this function for one of the outputs. Off: all drives are off.
    /// On: the outputs that were enabled here have their voltage, or all outputs if none was ever
    /// enabled or disabled here.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn enable(self, pins: &mut Pins, on: bool) {
        let Some(output) = pins.resolve(self.volts.key) else {
            return;
        };
        // Without a valid enable the output is held all the same.
        let enable = pins.resolve(self.enable.key).unwrap_or(output);
        pins.values.enable_alone(output, enable, on);
    }
}

impl Counter {
    /// Finds the counter by the common start of its pin names: `hm2_7i92.0.7i77.0.0.enc0`,
    /// `hm2_7i92.0.encoder.00`.
    ///
    /// # Errors
    /// [`PinError`] if any of its pins except `counts-per-rev` and `count-unsure` is missing.
    pub fn find(pins: &Pins, stem: &str) -> Result<Self, PinError> {
        let reset = format!("{stem}.reset");
        Ok(Self {
            count: pins.input(&format!("{stem}.count"))?,
            rawcounts: pins.input(&format!("{stem}.rawcounts"))?,
            position: pins.input(&format!("{stem}.position"))?,
            index_enable: pins.inout(&format!("{stem}.index-enable"))?,
            reset: pins
                .output(&reset)
                .or_else(|_| pins.inout(&reset).map(InOut::as_output))?,
            scale: pins.parameter(&format!("{stem}.scale"))?,
            counts_per_rev: pins.optional(&format!("{stem}.counts-per-rev"), Pins::parameter)?,
            count_unsure: pins.optional(&format!("{stem}.count-unsure"), Pins::input)?,
        })
    }

    /// Reads the position. Its zero is unchanged unless [`count_unsure`](Self::count_unsure) is on.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn read(self, pins: &Pins) -> Reading<f64> {
        pins.read(self.position)
    }
}
