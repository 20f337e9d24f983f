//! Handles that belong together: the same shape for the same function on every board.
//!
//! An application that takes an [`AnalogOut`] works with one of a 7I97 and with one of a 7I77, where
//! several axes share an enable:
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

use super::{InOut, Input, Invert, Output, Param, PinError, Pins, Reading};

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
    /// What inverts it on its way out, where anything does.
    pub invert: Option<Invert>,
}

/// An analog input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AnalogIn {
    /// The voltage, while `full_scale` is what it was at first.
    pub volts: Input<f64>,
    /// What the end of the range is shown as.
    pub full_scale: Param<f64>,
}

/// An analog output and its enable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AnalogOut {
    /// The voltage, while `full_scale` is what it was at first.
    pub volts: Output<f64>,
    /// What has to be on for it to have its voltage. Several outputs may share it, which
    /// [`enable`](Self::enable) knows; where the switch of the drive follows another one besides,
    /// [`Pins::enables`] tells.
    pub enable: Output<bool>,
    /// The value that goes out as the end of the range.
    pub full_scale: Param<f64>,
    /// No larger value goes out.
    pub max_limit: Option<Param<f64>>,
    /// No smaller value goes out.
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
    /// Asks for `count` to become 0 at the next index, or full revolution of a counter without
    /// index; off when that happened.
    pub index_enable: InOut<bool>,
    /// Keeps `count` at 0.
    pub reset: Output<bool>,
    /// Counts for one unit of position, never 0.
    pub scale: Param<f64>,
    /// Counts of a revolution, of a counter without index; 0 is no revolutions.
    pub counts_per_rev: Option<Param<u32>>,
    /// A home is lost, of an encoder of the FPGA: its counter was set up again (the board was reset, or
    /// its watchdog has bitten, or the bus was down), and what it counted meanwhile is not known; or the
    /// board was not heard for so long that the encoder may have turned further than 16 bits can
    /// represent; or it was at nine tenths of `max-count-rate` and seemed to stop from one cycle to
    /// the next, as beyond that rate; or packets were lost, late or repeated within 100 cycles after the
    /// board was set up. `count` is as valid as before, and may be wrong. On until `reset`, or until an index
    /// in a cycle without such a gap or packet.
    pub count_unsure: Option<Input<bool>>,
}

impl DigitalIn {
    /// By the input's name: `hm2_7i92.0.7i77.0.0.input-07`.
    ///
    /// # Errors
    /// [`PinError`] if there is no such input, or no `-not` beside it.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            pin: pins.input(name)?,
            not: pins.input(&format!("{name}-not"))?,
        })
    }

    /// Its level.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn read(self, pins: &Pins) -> Reading<bool> {
        pins.read(self.pin)
    }
}

impl DigitalOut {
    /// By the output's name: `hm2_7i92.0.7i77.0.0.output-07`.
    ///
    /// # Errors
    /// [`PinError`] if there is no such output, or no `-invert` beside it.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            pin: pins.output(name)?,
            invert: Some(Invert::Setting(pins.parameter(&format!("{name}-invert"))?)),
        })
    }

    /// Switches it.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn set(self, pins: &mut Pins, on: bool) {
        pins.set(self.pin, on);
    }

    /// Says whether it goes out inverted, also while it is safe: that is how it is wired.
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
            None => Err(PinError::NothingInverts),
        }
    }
}

impl AnalogIn {
    /// By the input's name: `hm2_7i92.0.7i77.0.0.fieldvoltage`.
    ///
    /// # Errors
    /// [`PinError`] if there is no such input, or no `-scalemax` beside it.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            volts: pins.input(name)?,
            full_scale: pins.parameter(&format!("{name}-scalemax"))?,
        })
    }

    /// Its voltage.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn read(self, pins: &Pins) -> Reading<f64> {
        pins.read(self.volts)
    }
}

impl AnalogOut {
    /// By the names of the output and of its enable: `hm2_7i92.0.7i77.0.1.analogout0` and
    /// `hm2_7i92.0.7i77.0.1.analogena`.
    ///
    /// # Errors
    /// [`PinError`] if there are no such outputs, or no `-scalemax`, `-maxlim` and `-minlim`.
    pub fn find(pins: &Pins, name: &str, enable: &str) -> Result<Self, PinError> {
        Ok(Self {
            volts: pins.output(name)?,
            enable: pins.output(enable)?,
            full_scale: pins.parameter(&format!("{name}-scalemax"))?,
            max_limit: Some(pins.parameter(&format!("{name}-maxlim"))?),
            min_limit: Some(pins.parameter(&format!("{name}-minlim"))?),
        })
    }

    /// Sets its voltage.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn set(self, pins: &mut Pins, volts: f64) {
        pins.set(self.volts, volts);
    }

    /// Enables it, alone: it has 0 V (its safe value) while it is not enabled, whatever it is
    /// [set](Self::set) to and whatever other outputs share its enable. After a fault it has to be
    /// enabled again.
    ///
    /// The pin [`enable`](Self::enable), and those that this one needs in its turn, are on while any
    /// output that shares them is enabled: a drive beside an enabled one sees its enable, and 0 V.
    /// Whoever sets these pins directly, as a program for LinuxCNC does, switches them until the next
    /// call of this for one of the outputs: off, all drives are off. On, those have their voltage that
    /// were enabled here; all have it while none was ever enabled or disabled here.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn enable(self, pins: &mut Pins, on: bool) {
        pins.enable_alone(self.volts.key, self.enable.key, on);
    }
}

impl Counter {
    /// By what its pins' names begin with: `hm2_7i92.0.7i77.0.0.enc0`, `hm2_7i92.0.encoder.00`.
    ///
    /// # Errors
    /// [`PinError`] if any of its pins is missing, but for `counts-per-rev` and `count-unsure`.
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
            counts_per_rev: pins.parameter(&format!("{stem}.counts-per-rev")).ok(),
            count_unsure: pins.input(&format!("{stem}.count-unsure")).ok(),
        })
    }

    /// Its position, which is still from the same zero unless
    /// [`count_unsure`](Self::count_unsure) is on.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn read(self, pins: &Pins) -> Reading<f64> {
        pins.read(self.position)
    }
}
