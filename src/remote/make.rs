//! Making the pins of a remote's process data.

use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;

use super::binding::{Binding, BitInputs, Codec, Pin};
use super::counter::CounterPins;
use super::parameter::largest_below;
use super::{Element, ElementKind, Field, RemoteLocation, Scaling};
use crate::boards::{ElementTable, Terminals};
use crate::discovery::{DataDirection, DataRecord, RemoteName};
use crate::hal::{
    Counter, FullScale, GroupId, Input, Invert, OutputModifiers, OutputRule, Param, PinError,
    PinStore, Spec, Value,
};

/// What the names of a remote's pins begin with.
pub(super) fn prefix(location: RemoteLocation<'_>, name: RemoteName) -> String {
    let RemoteLocation {
        board,
        port,
        channel,
    } = location;
    format!("{board}.{}.{port}.{channel}", lower(&name.to_card()))
}

/// A remote's own name for something as HAL has it: lower case, and `_` for what a HAL file can
/// not hold.
pub(super) fn lower(name: &str) -> String {
    name.chars()
        .map(|c| match c.to_ascii_lowercase() {
            c if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.' | '+') => c,
            _ => '_',
        })
        .collect()
}

/// What the pins of a remote's process data are made of.
#[derive(Debug, Default)]
pub(super) struct Bindings {
    pub inputs: Vec<Binding>,
    pub bit_inputs: Vec<BitInputs>,
    pub counters: Vec<CounterPins>,
    pub outputs: Vec<Binding>,
}

/// Makes the pins of one element.
pub(super) struct Maker<'a> {
    pub pins: &'a mut PinStore,
    pub group: GroupId,
    /// What the names begin with: board, card, port, channel and element.
    pub stem: String,
    pub element: &'a Element,
    pub record: &'a DataRecord,
    pub known: Option<&'a ElementTable>,
    pub bindings: &'a mut Bindings,
}

impl Maker<'_> {
    pub fn make(&mut self) -> Result<(), PinError> {
        let bits = self.element.bits;
        let codec = match self.element.kind {
            ElementKind::Pad | ElementKind::Unknown(_) => return Ok(()),
            ElementKind::Bits => return self.bits(),
            ElementKind::Counter { high_bits } => return self.counter(high_bits),
            ElementKind::Boolean => {
                let (pin, not) = self.bit(&self.stem.clone(), None)?;
                Codec::Bit { pin, not }
            }
            ElementKind::Number(scaling) => self.number(scaling)?,
            ElementKind::Float => {
                let spec = self.float_limits(self.spec());
                Codec::Float(self.pin(spec, self.safe())?)
            }
            ElementKind::Stream => {
                let spec = match u8::try_from(bits) {
                    Ok(bits) if bits != 32 && bits < 64 => {
                        self.spec().limits(0.0, largest_below(bits))
                    }
                    _ => self.spec(),
                };
                if bits > 32 {
                    Codec::Wide(self.pin(spec, 0)?)
                } else {
                    Codec::Raw(self.pin(spec, 0)?)
                }
            }
        };
        let element = self.element;
        self.bind(element.input_field(), element.output_field(), codec);
        Ok(())
    }

    fn bind(&mut self, input: Option<Field>, output: Option<Field>, codec: Codec) {
        let bound = |field: Field| Binding { field, codec };
        self.bindings.inputs.extend(input.map(bound));
        self.bindings.outputs.extend(output.map(bound));
    }

    /// A pin that goes the way of the element.
    fn pin<T: Value>(&mut self, spec: Spec, safe: T) -> Result<Pin<T>, PinError> {
        let rule = OutputRule::safe_at(safe);
        let (pins, group) = (&mut *self.pins, self.group);
        Ok(match self.record.direction {
            DataDirection::Input => Pin::In(pins.add_input(group, spec)?),
            DataDirection::Output => Pin::Out(pins.add_output(group, spec, rule)?),
            DataDirection::Bidirectional => Pin::Both(pins.add_inout(group, spec, rule)?),
        })
    }

    /// A pin of the element's own name, at its terminal.
    fn spec(&self) -> Spec {
        self.at_terminal(&self.stem, None)
    }

    /// A pin or parameter in the element's unit: the record's, or the table's.
    fn in_unit(&self, name: &str) -> Spec {
        in_unit(
            Spec::new(name),
            &self.record.unit,
            self.known.map_or("", |known| known.unit),
        )
    }

    /// Adds terminal and unit: the bit's own terminal, or all of the element's.
    fn at_terminal(&self, name: &str, bit: Option<u16>) -> Spec {
        let terminals = self.known.map_or(&[][..], |known| known.terminals);
        let place = match bit {
            Some(bit) => Terminals::of(terminals, bit),
            None => Terminals::all(terminals),
        };
        self.in_unit(name).at(place.terminal, place.signal)
    }

    fn safe(&self) -> f64 {
        self.known.map_or(0.0, |known| known.safe)
    }

    fn bits(&mut self) -> Result<(), PinError> {
        let Element {
            input,
            output,
            bits,
            ..
        } = *self.element;
        let one = |first: Option<u16>, bit: u16| Field::new(first? + bit, 1);
        let mut together = Vec::new();
        for bit in 0..bits {
            let name = format!("{}-{bit:02}", self.stem);
            let (pin, not) = self.bit(&name, Some(bit))?;
            match (pin, not) {
                (Pin::In(pin), Some(not)) => together.push((pin, not)),
                _ => self.bind(one(input, bit), one(output, bit), Codec::Bit { pin, not }),
            }
        }
        let fields = (0..bits).step_by(usize::from(Field::MAX_BITS));
        for (first, pins) in fields.zip(together.chunks(usize::from(Field::MAX_BITS))) {
            let field = input.and_then(|input| Field::new(input + first, pins.len() as u8));
            self.bindings
                .bit_inputs
                .extend(field.map(|field| BitInputs {
                    field,
                    pins: pins.to_vec(),
                    taken: None,
                }));
        }
        Ok(())
    }

    /// A bit; an input has its opposite beside it, and an output can be inverted.
    fn bit(
        &mut self,
        name: &str,
        bit: Option<u16>,
    ) -> Result<(Pin<bool>, Option<Input<bool>>), PinError> {
        let spec = self.at_terminal(name, bit);
        let opposite = spec.clone().named(format!("{name}-not"));
        let pin = self.pin(spec, self.safe() != 0.0)?;
        let mut not = None;
        match pin {
            Pin::In(_) => not = Some(self.pins.add_input(self.group, opposite)?),
            Pin::Out(output) => {
                let invert = Spec::new(format!("{name}-invert"));
                let modifiers = OutputModifiers {
                    invert: Some(Invert::Setting(
                        self.pins.add_setting(self.group, invert, false)?,
                    )),
                    ..OutputModifiers::default()
                };
                self.pins.modify(output, modifiers)?;
            }
            Pin::Both(_) => {}
        }
        Ok((pin, not))
    }

    fn number(&mut self, scaling: Scaling) -> Result<Codec, PinError> {
        let (min, max) = (scaling.min(), scaling.max());
        let pin = self.pin(self.spec().range(min, max), self.safe())?;
        let scale = self.setting("-scalemax", max)?;
        let output = match pin {
            Pin::In(_) => None,
            Pin::Out(output) => Some(output),
            Pin::Both(both) => Some(both.as_output()),
        };
        if let Some(output) = output {
            let modifiers = OutputModifiers {
                max_limit: Some(self.setting("-maxlim", max)?),
                min_limit: Some(self.setting("-minlim", min)?),
                full_scale: Some(FullScale { scale, min, max }),
                invert: None,
            };
            self.pins.modify(output, modifiers)?;
        }
        Ok(Codec::Number {
            pin,
            scaling,
            scale,
        })
    }

    fn setting(&mut self, suffix: &str, value: f64) -> Result<Param<f64>, PinError> {
        let spec = self.in_unit(&format!("{}{suffix}", self.stem));
        self.pins.add_setting(self.group, spec, value)
    }

    fn float_limits(&self, spec: Spec) -> Spec {
        let (min, max) = (f64::from(self.record.min), f64::from(self.record.max));
        let largest = f64::from(f32::MAX);
        if min < max && min.is_finite() && max.is_finite() {
            spec.limits(min, max)
        } else if self.element.bits == 32 {
            spec.limits(-largest, largest)
        } else {
            spec
        }
    }

    fn counter(&mut self, high_bits: u8) -> Result<(), PinError> {
        // A counter that the host would write makes no sense; its bits stay zero.
        let Some(field) = self.element.input_field() else {
            return Ok(());
        };
        let group = self.group;
        let at =
            |maker: &Self, pin: &str| maker.at_terminal(&format!("{}.{pin}", maker.stem), None);
        let plain = |maker: &Self, name: &str| Spec::new(format!("{}.{name}", maker.stem));
        let full_scale = f64::from(self.record.max);
        let full_scale = if full_scale.is_finite() {
            full_scale
        } else {
            1.0
        };
        let off = OutputRule::switch(false);
        let handles = Counter {
            count: self.pins.add_input(group, at(self, "count"))?,
            rawcounts: self.pins.add_input(group, at(self, "rawcounts"))?,
            position: self.pins.add_input(group, at(self, "position"))?,
            index_enable: self.pins.add_inout(group, at(self, "index-enable"), off)?,
            reset: self
                .pins
                .add_inout(group, at(self, "reset"), off)?
                .as_output(),
            scale: self
                .pins
                .add_setting(group, plain(self, "scale"), full_scale)?,
            counts_per_rev: Some(self.pins.add_setting(
                group,
                plain(self, "counts-per-rev"),
                256,
            )?),
        };
        let counter = CounterPins::new(field, high_bits, handles);
        self.bindings.counters.push(counter);
        Ok(())
    }
}

/// The unit of the record, or the table's, or none.
pub(super) fn in_unit(spec: Spec, record: &str, table: &'static str) -> Spec {
    if record.is_empty() {
        spec.unit(table)
    } else {
        spec.unit(record.to_string())
    }
}
