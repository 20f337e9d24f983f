//! Handles that belong together, found by name.

use alloc::format;

use super::remote::CounterHandles;
use crate::hal::{Input, Output, Param, PinError, Pins};

/// A digital input and its opposite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputPair {
    /// The input.
    pub pin: Input<bool>,
    /// The same turned round.
    pub not: Input<bool>,
}

/// A digital output and whether it is turned round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoolOutput {
    /// The output.
    pub pin: Output<bool>,
    /// Turns it round on its way out.
    pub invert: Param<bool>,
}

/// A number that is read, and its scale.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScaledInput {
    /// The value.
    pub pin: Input<f64>,
    /// The value that full scale is shown as.
    pub scalemax: Param<f64>,
}

/// A number that is written, its scale and its limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScaledOutput {
    /// The value.
    pub pin: Output<f64>,
    /// The value that is full scale.
    pub scalemax: Param<f64>,
    /// No larger value goes out.
    pub maxlim: Param<f64>,
    /// No smaller value goes out.
    pub minlim: Param<f64>,
}

impl InputPair {
    /// By the input's name.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            pin: pins.input(name)?,
            not: pins.input(&format!("{name}-not"))?,
        })
    }
}

impl BoolOutput {
    /// By the output's name.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            pin: pins.output(name)?,
            invert: pins.parameter(&format!("{name}-invert"))?,
        })
    }
}

impl ScaledInput {
    /// By the input's name.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            pin: pins.input(name)?,
            scalemax: pins.parameter(&format!("{name}-scalemax"))?,
        })
    }
}

impl ScaledOutput {
    /// By the output's name.
    pub fn find(pins: &Pins, name: &str) -> Result<Self, PinError> {
        Ok(Self {
            pin: pins.output(name)?,
            scalemax: pins.parameter(&format!("{name}-scalemax"))?,
            maxlim: pins.parameter(&format!("{name}-maxlim"))?,
            minlim: pins.parameter(&format!("{name}-minlim"))?,
        })
    }
}

impl CounterHandles {
    /// By what its pins' names begin with.
    pub fn find(pins: &Pins, stem: &str) -> Result<Self, PinError> {
        Ok(Self {
            count: pins.input(&format!("{stem}.count"))?,
            rawcounts: pins.input(&format!("{stem}.rawcounts"))?,
            position: pins.input(&format!("{stem}.position"))?,
            index_enable: pins.inout(&format!("{stem}.index-enable"))?,
            reset: pins.inout(&format!("{stem}.reset"))?,
            scale: pins.parameter(&format!("{stem}.scale"))?,
            counts_per_rev: pins.parameter(&format!("{stem}.counts-per-rev"))?,
        })
    }
}

/// An array of handles, each found by its number.
pub(super) fn handles<T: Copy + Default, const N: usize>(
    find: impl Fn(usize) -> Result<T, PinError>,
) -> Result<[T; N], PinError> {
    let mut all = [T::default(); N];
    for (n, handle) in all.iter_mut().enumerate() {
        *handle = find(n)?;
    }
    Ok(all)
}
