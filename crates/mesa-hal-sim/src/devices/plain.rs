//! A device from a description, without a world of its own: values in, values out.

use super::{
    Description, DescriptionError, Device, SignalValue, SimElement, SimLayout, World, WorldError,
    image,
};
use crate::remote::{SimMemory, SimRemote};

/// Maximum length of an element in bytes.
const MAX_BYTES: usize = 32;

const BITS: u8 = 0x01;
const UNSIGNED: u8 = 0x02;
const SIGNED: u8 = 0x03;
const BOOLEAN: u8 = 0x07;
const FLOAT: u8 = 0x10;

/// A world with settable inputs that stores the last applied outputs.
#[derive(Clone, Debug, Default)]
pub struct Plain {
    slots: Vec<Slot>,
}

#[derive(Clone, Debug)]
struct Slot {
    element: SimElement,
    input: [u8; MAX_BYTES],
    output: [u8; MAX_BYTES],
}

impl Slot {
    fn is_digital(&self) -> bool {
        matches!(self.element.record.kind, BITS | BOOLEAN)
    }

    fn is_number(&self) -> bool {
        matches!(self.element.record.kind, UNSIGNED | SIGNED)
    }

    fn digital_count(&self) -> usize {
        match self.element.record.kind {
            BITS => usize::from(self.element.record.bits),
            _ => 1,
        }
    }

    /// Largest raw value of a number, considering at most 32 bits.
    fn full_scale(&self) -> f64 {
        let sign = u32::from(self.element.record.kind == SIGNED);
        let bits = u32::from(self.element.record.bits) - sign;
        ((1_u64 << bits.min(62)) - u64::from(sign == 0)) as f64
    }

    fn set_scaled(&mut self, value: f64) {
        let full = self.full_scale();
        let max = f64::from(self.element.record.max);
        let raw = (value / if max == 0.0 { 1.0 } else { max } * full).round();
        let raw = if self.element.record.kind == SIGNED {
            raw.clamp(-full, full - 1.0)
        } else {
            raw.clamp(0.0, full)
        };
        for (to, from) in self.input.iter_mut().zip((raw as i64).to_le_bytes()) {
            *to = from;
        }
    }

    fn signals(&self, bytes: &[u8]) -> Vec<(String, SignalValue)> {
        let record = &self.element.record;
        let name = record.name.to_ascii_lowercase();
        let bit = |n: usize| {
            bytes
                .get(n / 8)
                .is_some_and(|byte| byte >> (n % 8) & 1 != 0)
        };
        if self.is_digital() {
            let numbered = record.kind == BITS;
            return (0..self.digital_count())
                .map(|n| {
                    let name = if numbered {
                        format!("{name}-{n:02}")
                    } else {
                        name.clone()
                    };
                    (name, SignalValue::Bool(bit(n)))
                })
                .collect();
        }
        let bits = usize::from(record.bits).min(64);
        let raw = (0..bits).fold(0_u64, |raw, n| raw | u64::from(bit(n)) << n);
        let value = match record.kind {
            0x00 => return Vec::new(),
            UNSIGNED | SIGNED if bits > 0 => {
                let raw = if record.kind == SIGNED {
                    let unused = 64 - bits;
                    ((raw << unused) as i64 >> unused) as f64
                } else {
                    raw as f64
                };
                let max = f64::from(record.max);
                let scale = if max == 0.0 { 1.0 } else { max };
                SignalValue::Number(raw / self.full_scale() * scale)
            }
            FLOAT if bits == 32 => SignalValue::Number(f32::from_bits(raw as u32).into()),
            FLOAT if bits == 64 => SignalValue::Number(f64::from_bits(raw)),
            _ => SignalValue::Count(raw),
        };
        vec![(name, value)]
    }
}

impl Plain {
    /// Creates the device from a description in text form.
    pub fn from_description(text: &str) -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::remote(&Description::parse(text)?)
    }

    /// Creates the device from `description`.
    pub fn remote(description: &Description) -> Result<SimRemote<Device<Self>>, DescriptionError> {
        let (_, layout) = image::build(description)?;
        let mut slots: Vec<Slot> = Vec::new();
        for element in layout.elements() {
            // A mode may have fewer bits of the same value.
            let is_new = |slot: &Slot| slot.element.address != element.address;
            if slots.iter().all(is_new) {
                slots.push(Slot {
                    element: element.clone(),
                    input: [0; MAX_BYTES],
                    output: [0; MAX_BYTES],
                });
            }
        }
        Device::remote(description, Self { slots })
    }

    /// Sets the raw value of an input element by its name, least significant byte first.
    pub fn set_raw(&mut self, name: &str, value: &[u8]) -> Result<(), WorldError> {
        let mut slots = self.slots.iter_mut();
        let slot = slots.find(|s| s.element.record.name == name && s.element.record.is_input());
        let slot = slot.ok_or(WorldError::NotThere)?;
        slot.input = [0; MAX_BYTES];
        for (to, &from) in slot.input.iter_mut().zip(value) {
            *to = from;
        }
        Ok(())
    }

    /// The raw value of an output element by its name, as applied last.
    pub fn raw(&self, name: &str) -> Option<&[u8]> {
        let mut slots = self.slots.iter();
        let slot = slots.find(|s| s.element.record.name == name && s.element.record.is_output())?;
        slot.output.get(..slot.element.record.bytes())
    }
}

impl World for Plain {
    fn sample(&mut self, _mode: u8, _layout: &SimLayout, memory: &mut SimMemory) {
        for slot in self.slots.iter().filter(|s| s.element.record.is_input()) {
            // Bidirectional elements: the host reads the value from the world's side.
            for (offset, &byte) in (0..slot.element.record.bytes() as u16).zip(&slot.input) {
                memory.set_byte(slot.element.address.wrapping_add(offset), byte);
            }
        }
    }

    fn drive(&mut self, _layout: &SimLayout, memory: &SimMemory) {
        for slot in self
            .slots
            .iter_mut()
            .filter(|s| s.element.record.is_output())
        {
            for (offset, byte) in (0..slot.element.record.bytes() as u16).zip(&mut slot.output) {
                *byte = memory.byte(slot.element.address.wrapping_add(offset));
            }
        }
    }

    fn off(&mut self) {
        for slot in &mut self.slots {
            slot.output = [0; MAX_BYTES];
        }
    }

    fn set_input(&mut self, n: usize, on: bool) -> Result<(), WorldError> {
        let mut count = 0;
        for slot in &mut self.slots {
            if !slot.is_digital() || !slot.element.record.is_input() {
                continue;
            }
            let bits = slot.digital_count();
            if n < count + bits {
                let bit = n - count;
                if let Some(byte) = slot.input.get_mut(bit / 8) {
                    *byte = *byte & !(1 << (bit % 8)) | u8::from(on) << (bit % 8);
                }
                return Ok(());
            }
            count += bits;
        }
        Err(WorldError::NoSuchInput { index: n, count })
    }

    fn set_input_volts(&mut self, n: usize, volts: f64) -> Result<(), WorldError> {
        let numbers = |slot: &&mut Slot| slot.is_number() && slot.element.record.is_input();
        let count = self.slots.iter_mut().filter(numbers).count();
        let slot = self.slots.iter_mut().filter(numbers).nth(n);
        slot.ok_or(WorldError::NoSuchInput { index: n, count })?
            .set_scaled(volts);
        Ok(())
    }

    fn inputs(&self, _layout: &SimLayout) -> Vec<(String, SignalValue)> {
        let slots = self.slots.iter().filter(|s| s.element.record.is_input());
        slots.flat_map(|slot| slot.signals(&slot.input)).collect()
    }

    fn outputs(&self, _layout: &SimLayout) -> Vec<(String, SignalValue)> {
        let slots = self.slots.iter().filter(|s| s.element.record.is_output());
        slots.flat_map(|slot| slot.signals(&slot.output)).collect()
    }

    fn output(&self, n: usize) -> Option<bool> {
        let slots = self.slots.iter();
        let slots = slots.filter(|s| s.is_digital() && s.element.record.is_output());
        let mut left = n;
        for slot in slots {
            let bits = slot.digital_count();
            if left < bits {
                let byte = slot.output.get(left / 8)?;
                return Some(byte >> (left % 8) & 1 != 0);
            }
            left -= bits;
        }
        None
    }
}
