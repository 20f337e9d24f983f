//! One pin and its bits.

use super::CounterPins;
use crate::hal::{InOut, Input, Output, Param, PinStore, Rejection, Value};
use crate::process_data::{Field, Fit, Scaling};

/// One pin of a remote and its bits in the interface registers.
#[derive(Debug)]
pub(super) enum Binding {
    BitIn {
        field: Field,
        pin: Input<bool>,
        not: Input<bool>,
    },
    /// Also a boolean: all bits of the field are set for true.
    BitOut {
        field: Field,
        pin: Output<bool>,
    },
    BitBoth {
        input: Field,
        output: Field,
        pin: InOut<bool>,
    },
    NumberIn {
        field: Field,
        scaling: Scaling,
        pin: Input<f64>,
        scale: Param<f64>,
    },
    NumberOut {
        field: Field,
        scaling: Scaling,
        pin: Output<f64>,
        scale: Param<f64>,
        safe: f64,
    },
    NumberBoth {
        input: Field,
        output: Field,
        scaling: Scaling,
        pin: InOut<f64>,
        scale: Param<f64>,
    },
    RealIn {
        field: Field,
        pin: Input<f64>,
    },
    RealOut {
        field: Field,
        pin: Output<f64>,
    },
    RealBoth {
        input: Field,
        output: Field,
        pin: InOut<f64>,
    },
    RawIn {
        field: Field,
        pin: Input<u32>,
    },
    RawOut {
        field: Field,
        pin: Output<u32>,
    },
    RawBoth {
        input: Field,
        output: Field,
        pin: InOut<u32>,
    },
    WideIn {
        field: Field,
        pin: Input<u64>,
    },
    WideOut {
        field: Field,
        pin: Output<u64>,
    },
    WideBoth {
        input: Field,
        output: Field,
        pin: InOut<u64>,
    },
    Counter(CounterPins),
}

impl Binding {
    /// From the interface registers to the pin.
    pub fn take(&mut self, pins: &mut PinStore, words: &[u32]) {
        match self {
            Self::BitIn { field, pin, not } => {
                let value = field.get(words) != 0;
                pins.publish(*pin, value);
                pins.publish(*not, !value);
            }
            Self::BitBoth { input, pin, .. } => {
                pins.publish(*pin, input.get(words) != 0);
            }
            Self::NumberIn {
                field,
                scaling,
                pin,
                scale,
            } => {
                let value = to_scale(*scaling, pins.param(*scale), field.get(words));
                pins.publish(*pin, value);
            }
            Self::NumberBoth {
                input,
                scaling,
                pin,
                scale,
                ..
            } => {
                let value = to_scale(*scaling, pins.param(*scale), input.get(words));
                pins.publish(*pin, value);
            }
            Self::RealIn { field, pin } => pins.publish(*pin, real(*field, words)),
            Self::RealBoth { input, pin, .. } => pins.publish(*pin, real(*input, words)),
            Self::RawIn { field, pin } => pins.publish(*pin, field.get(words) as u32),
            Self::RawBoth { input, pin, .. } => {
                pins.publish(*pin, input.get(words) as u32);
            }
            Self::WideIn { field, pin } => pins.publish(*pin, field.get(words)),
            Self::WideBoth { input, pin, .. } => pins.publish(*pin, input.get(words)),
            Self::Counter(counter) => counter.take(pins, words),
            Self::BitOut { .. }
            | Self::NumberOut { .. }
            | Self::RealOut { .. }
            | Self::RawOut { .. }
            | Self::WideOut { .. } => {}
        }
    }

    /// From the pin to the interface registers.
    pub fn put(&self, pins: &mut PinStore, words: &mut [u32]) {
        match self {
            Self::BitOut { field, pin } => field.put(words, all_or_none(pins.fetch(*pin))),
            Self::BitBoth { output, pin, .. } => {
                output.put(words, all_or_none(pins.fetch(*pin)));
            }
            Self::NumberOut {
                field,
                scaling,
                pin,
                scale,
                safe,
            } => {
                let value = from_scale(*scaling, pins.param(*scale), pins.fetch(*pin));
                let raw = scaling.raw(value);
                let bits = match raw.fit {
                    Fit::Exact => raw.bits,
                    Fit::Clamped => {
                        pins.count_rejection(*pin, Rejection::OutOfRange);
                        raw.bits
                    }
                    // A scale of zero: no value means anything.
                    Fit::NotFinite => {
                        pins.count_rejection(*pin, Rejection::NotFinite);
                        scaling.raw(*safe).bits
                    }
                };
                field.put(words, bits);
            }
            Self::NumberBoth {
                output,
                scaling,
                pin,
                scale,
                ..
            } => {
                let value = from_scale(*scaling, pins.param(*scale), pins.fetch(*pin));
                let raw = scaling.raw(value);
                match raw.fit {
                    Fit::Exact => {}
                    Fit::Clamped => pins.count_rejection(*pin, Rejection::OutOfRange),
                    Fit::NotFinite => pins.count_rejection(*pin, Rejection::NotFinite),
                }
                output.put(words, raw.bits);
            }
            Self::RealOut { field, pin } => {
                let value = pins.fetch(*pin);
                put_real(*field, words, value);
            }
            Self::RealBoth { output, pin, .. } => {
                let value = pins.fetch(*pin);
                put_real(*output, words, value);
            }
            Self::RawOut { field, pin } => field.put(words, u64::from(pins.fetch(*pin))),
            Self::RawBoth { output, pin, .. } => {
                output.put(words, u64::from(pins.fetch(*pin)));
            }
            Self::WideOut { field, pin } => field.put(words, pins.fetch(*pin)),
            Self::WideBoth { output, pin, .. } => output.put(words, pins.fetch(*pin)),
            Self::BitIn { .. }
            | Self::NumberIn { .. }
            | Self::RealIn { .. }
            | Self::RawIn { .. }
            | Self::WideIn { .. }
            | Self::Counter(_) => {}
        }
    }
}

fn all_or_none(value: bool) -> u64 {
    if value { u64::MAX } else { 0 }
}

/// A raw value in the units of `-scalemax`: as long as nobody changes that, the remote's own.
// The scale is compared with what it was set to: nothing was computed.
#[allow(clippy::float_cmp)]
fn to_scale(scaling: Scaling, scale: f64, raw: u64) -> f64 {
    let value = scaling.value(raw);
    if scale == scaling.max() {
        value
    } else {
        value / scaling.max() * scale
    }
}

/// The other way round.
#[allow(clippy::float_cmp)]
fn from_scale(scaling: Scaling, scale: f64, value: f64) -> f64 {
    if scale == scaling.max() {
        value
    } else {
        value / scale * scaling.max()
    }
}

fn real(field: Field, words: &[u32]) -> f64 {
    let bits = field.get(words);
    if field.bits() == 64 {
        <f64 as Value>::from_bits(bits)
    } else {
        f64::from(f32::from_bits(bits as u32))
    }
}

/// A value too large for 32 bits becomes the largest one: the pin's limits keep it below, and this
/// keeps an infinity off the wire if they do not.
fn put_real(field: Field, words: &mut [u32], value: f64) {
    let bits = if field.bits() == 64 {
        value.to_bits()
    } else {
        let largest = f64::from(f32::MAX);
        u64::from((value.clamp(-largest, largest) as f32).to_bits())
    };
    field.put(words, bits);
}
