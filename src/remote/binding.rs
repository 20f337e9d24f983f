//! A pin and its bits.

use super::Scaling;
use super::field::Field;
use super::scaling::{real, real_bits};
use crate::hal::{Input, Output, Param, PinStore};

/// The two halves of a pin: one is published, the other fetched. A unidirectional pin has a default
/// handle for the missing half.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pin<T>(pub Input<T>, pub Output<T>);

/// A field of the interface registers, in one direction, and its pin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binding {
    pub field: Field,
    pub codec: Codec,
}

/// Conversion between the bits of a field and the value of a pin.
#[derive(Clone, Copy, Debug)]
pub(super) enum Codec {
    /// True if any bit is set; all bits are set for true.
    Bit {
        pin: Pin<bool>,
        /// The opposite of an input.
        not: Option<Input<bool>>,
    },
    Number {
        pin: Pin<f64>,
        scaling: Scaling,
        /// The application's full scale.
        scale: Param<f64>,
    },
    /// IEEE-754, of 32 or 64 bits.
    Float(Pin<f64>),
    Raw(Pin<u32>),
    Wide(Pin<u64>),
}

impl Binding {
    /// Copies the value from the interface registers to the pin.
    pub fn take(&self, pins: &mut PinStore, words: &[u32]) {
        let bits = self.field.get(words);
        match self.codec {
            Codec::Bit { pin, not } => {
                pins.publish(pin.0, bits != 0);
                if let Some(not) = not {
                    pins.publish(not, bits == 0);
                }
            }
            Codec::Number {
                pin,
                scaling,
                scale,
            } => {
                let value = to_scale(scaling, pins.param(scale), scaling.value(bits));
                pins.publish(pin.0, value);
            }
            Codec::Float(pin) => pins.publish(pin.0, real(bits, self.field.bits)),
            Codec::Raw(pin) => pins.publish(pin.0, bits as u32),
            Codec::Wide(pin) => pins.publish(pin.0, bits),
        }
    }

    /// Copies the value from the pin to the interface registers.
    pub fn put(&self, pins: &mut PinStore, words: &mut [u32]) {
        let bits = match self.codec {
            Codec::Bit { pin, .. } if pins.fetch(pin.1) => u64::MAX,
            Codec::Bit { .. } => 0,
            // The store scales and limits the value.
            Codec::Number { pin, scaling, .. } => scaling.raw(pins.fetch(pin.1)),
            // The pin's limits are those of 32 bits, or narrower.
            Codec::Float(pin) => real_bits(pins.fetch(pin.1), self.field.bits),
            Codec::Raw(pin) => u64::from(pins.fetch(pin.1)),
            Codec::Wide(pin) => pins.fetch(pin.1),
        };
        self.field.put(words, bits);
    }
}

/// Up to 64 single bits, each an input and its opposite.
#[derive(Debug)]
pub(super) struct BitInputs {
    pub field: Field,
    pub pins: alloc::vec::Vec<(Input<bool>, Input<bool>)>,
    /// The bits that were published last.
    pub taken: Option<u64>,
}

impl BitInputs {
    /// Copies the bits from the interface registers to the pins. Most pins are bits, and bits
    /// change rarely, so only the changed ones are published.
    pub fn take(&mut self, pins: &mut PinStore, words: &[u32]) {
        let bits = self.field.get(words);
        let changed = match self.taken.replace(bits) {
            Some(taken) => taken ^ bits,
            None => self.field.mask,
        };
        if changed != 0 {
            self.publish(pins, bits, changed);
        }
    }

    // Separate from `take`, whose common path would otherwise set up registers for it.
    #[inline(never)]
    fn publish(&self, pins: &mut PinStore, bits: u64, mut changed: u64) {
        while changed != 0 {
            let bit = changed.trailing_zeros();
            changed &= changed.wrapping_sub(1);
            if let Some(&(pin, not)) = self.pins.get(bit as usize) {
                let value = bits >> bit & 1 != 0;
                pins.publish(pin, value);
                pins.publish(not, !value);
            }
        }
    }
}

/// A value in the units of `-scalemax`; while that has its initial value, these are the remote's
/// own.
// Exact comparison: the scale is compared with the value it was initialised with, not with a
// computed one.
#[allow(clippy::float_cmp)]
fn to_scale(scaling: Scaling, scale: f64, value: f64) -> f64 {
    if scale == scaling.max {
        value
    } else {
        value / scaling.max * scale
    }
}
