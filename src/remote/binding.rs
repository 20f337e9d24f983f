//! One pin and its bits.

use super::scaling::{real, real_bits};
use super::{Field, Scaling};
use crate::hal::{Input, Output, Param, PinStore};

/// The halves of a pin: what is published, and what is fetched. A pin that goes one way only has
/// nothing in place of the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pin<T>(pub Input<T>, pub Output<T>);

/// A field of the interface registers, in one direction, and the pin it belongs to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binding {
    pub field: Field,
    pub codec: Codec,
}

/// How the bits of a field are the value of a pin, and the other way round.
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
        /// What full scale is for the application.
        scale: Param<f64>,
    },
    /// IEEE-754, of 32 or 64 bits.
    Float(Pin<f64>),
    Raw(Pin<u32>),
    Wide(Pin<u64>),
}

impl Binding {
    /// From the interface registers to the pin.
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

    /// From the pin to the interface registers.
    pub fn put(&self, pins: &mut PinStore, words: &mut [u32]) {
        let bits = match self.codec {
            Codec::Bit { pin, .. } if pins.fetch(pin.1) => u64::MAX,
            Codec::Bit { .. } => 0,
            // The store scales and limits it.
            Codec::Number { pin, scaling, .. } => scaling.raw(pins.fetch(pin.1)),
            // The pin's limits are those of 32 bits, or closer.
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
    /// The bits that the pins have.
    pub taken: Option<u64>,
}

impl BitInputs {
    /// From the interface registers to the pins. Bits change seldom, and are most of the pins: only
    /// those that did are published.
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

    // Apart from the usual way, which would prepare for it.
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

/// A value in the units of `-scalemax`: as long as nobody changes that, the remote's own.
// The scale is compared with what it was set to: nothing was computed.
#[allow(clippy::float_cmp)]
fn to_scale(scaling: Scaling, scale: f64, value: f64) -> f64 {
    if scale == scaling.max {
        value
    } else {
        value / scaling.max * scale
    }
}
