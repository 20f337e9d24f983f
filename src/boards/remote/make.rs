//! Making the pins of a remote's process data.

use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;

use super::RemoteLocation;
use super::binding::Binding;
use super::counter::CounterPins;
use super::parameter::largest_below;
use crate::boards::{BoardError, ElementTable, RemoteTable, at_terminals};
use crate::discovery::{DataRecord, RemoteDescriptor, RemoteName};
use crate::hal::{
    Counter, GroupId, Invert, OutputModifiers, OutputRule, Param, PinError, PinStore, Spec,
};
use crate::process_data::{Element, ElementKind, Field, PackingPlan, Scaling};

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

/// The unit of the record, or the table's, or none.
pub(super) fn in_unit(spec: Spec, record: &str, table: &'static str) -> Spec {
    if record.is_empty() {
        spec.unit(table)
    } else {
        spec.unit(record.to_string())
    }
}

pub(super) fn bindings(
    pins: &mut PinStore,
    group: GroupId,
    prefix: &str,
    plan: &PackingPlan,
    descriptor: &RemoteDescriptor,
    table: Option<&RemoteTable>,
) -> Result<Vec<Binding>, BoardError> {
    let mut bindings = Vec::new();
    for element in plan.elements() {
        let Some(record) = descriptor.process_data.get(element.record) else {
            continue;
        };
        let known = table.and_then(|table| table.element(&record.name, record.direction));
        let mut maker = Maker {
            pins,
            group,
            stem: format!("{prefix}.{}", lower(&record.name)),
            element: *element,
            record,
            known,
            bindings: &mut bindings,
        };
        maker.make().map_err(|source| BoardError::Element {
            element: element.record,
            source,
        })?;
    }
    Ok(bindings)
}

/// Makes the pins of one element.
struct Maker<'a> {
    pins: &'a mut PinStore,
    group: GroupId,
    /// What the names begin with: board, card, port, channel and element.
    stem: String,
    element: Element,
    record: &'a DataRecord,
    known: Option<&'a ElementTable>,
    bindings: &'a mut Vec<Binding>,
}

impl Maker<'_> {
    fn make(&mut self) -> Result<(), PinError> {
        let input = self.element.input_field();
        let output = self.element.output_field();
        match self.element.kind {
            ElementKind::Pad | ElementKind::Unknown(_) => Ok(()),
            ElementKind::Bits => (0..self.element.bits).try_for_each(|bit| {
                let name = format!("{}-{bit:02}", self.stem);
                let spec = self.at_terminal(Spec::new(name.as_str()), Some(bit));
                let input = self.element.input_bit(bit);
                let output = self.element.output_bit(bit);
                self.bit(&name, spec, input, output)
            }),
            ElementKind::Boolean => {
                let name = self.stem.clone();
                let spec = self.spec();
                self.bit(&name, spec, input, output)
            }
            ElementKind::Number(scaling) => self.number(scaling, input, output),
            ElementKind::Float32 | ElementKind::Float64 => self.real(input, output),
            ElementKind::Stream if self.element.bits > 32 => self.wide(input, output),
            ElementKind::Stream => self.raw(input, output),
            ElementKind::Counter => self.counter(input, 0),
            ElementKind::SplitCounter { high_bits } => self.counter(input, high_bits),
        }
    }

    /// A pin of the element's own name, at its terminal.
    fn spec(&self) -> Spec {
        self.at_terminal(Spec::new(self.stem.as_str()), None)
    }

    /// A pin or parameter named after the element, with something behind it.
    fn with_suffix(&self, suffix: &str) -> Spec {
        in_unit(
            Spec::new(format!("{}{suffix}", self.stem)),
            &self.record.unit,
            self.known.map_or("", |known| known.unit),
        )
    }

    /// Adds terminal and unit: the bit's own terminal, or all of the element's.
    fn at_terminal(&self, spec: Spec, bit: Option<u16>) -> Spec {
        let spec = in_unit(
            spec,
            &self.record.unit,
            self.known.map_or("", |known| known.unit),
        );
        let terminals = self.known.map_or(&[][..], |known| known.terminals);
        match bit {
            // One terminal for each bit, and none for bits that the table does not know.
            Some(bit) => {
                let one = terminals.get(usize::from(bit)).map(core::slice::from_ref);
                at_terminals(spec, one.unwrap_or(&[]))
            }
            None => at_terminals(spec, terminals),
        }
    }

    fn safe(&self) -> f64 {
        self.known.map_or(0.0, |known| known.safe)
    }

    fn bit(
        &mut self,
        name: &str,
        spec: Spec,
        input: Option<Field>,
        output: Option<Field>,
    ) -> Result<(), PinError> {
        let group = self.group;
        let rule = OutputRule::safe_at(self.safe() != 0.0);
        let binding = match (input, output) {
            (Some(input), Some(output)) => Binding::BitBoth {
                input,
                output,
                pin: self.pins.add_inout(group, spec, rule)?,
            },
            (Some(field), None) => {
                let not = spec.clone().named(format!("{name}-not"));
                Binding::BitIn {
                    field,
                    pin: self.pins.add_input(group, spec)?,
                    not: self.pins.add_input(group, not)?,
                }
            }
            (None, Some(field)) => {
                let pin = self.pins.add_output(group, spec, rule)?;
                let invert = Spec::new(format!("{name}-invert"));
                let invert = Some(self.pins.add_setting(group, invert, false)?);
                let modifiers = OutputModifiers {
                    invert: invert.map(Invert::Setting),
                    ..OutputModifiers::default()
                };
                self.pins.modify(pin, modifiers)?;
                Binding::BitOut { field, pin }
            }
            (None, None) => return Ok(()),
        };
        self.bindings.push(binding);
        Ok(())
    }

    fn number(
        &mut self,
        scaling: Scaling,
        input: Option<Field>,
        output: Option<Field>,
    ) -> Result<(), PinError> {
        let group = self.group;
        let (min, max) = (scaling.min(), scaling.max());
        let spec = self.spec().range(min, max);
        let safe = self.safe();
        let rule = OutputRule::safe_at(safe);
        let binding = match (input, output) {
            (Some(input), Some(output)) => {
                let pin = self.pins.add_inout(group, spec, rule)?;
                let scale = self.scale_parameter(max)?;
                let modifiers = self.limit_parameters(min, max)?;
                self.pins.modify(pin, modifiers)?;
                Binding::NumberBoth {
                    input,
                    output,
                    scaling,
                    pin,
                    scale,
                }
            }
            (Some(field), None) => Binding::NumberIn {
                field,
                scaling,
                pin: self.pins.add_input(group, spec)?,
                scale: self.scale_parameter(max)?,
            },
            (None, Some(field)) => {
                let pin = self.pins.add_output(group, spec, rule)?;
                let scale = self.scale_parameter(max)?;
                let modifiers = self.limit_parameters(min, max)?;
                self.pins.modify(pin, modifiers)?;
                Binding::NumberOut {
                    field,
                    scaling,
                    pin,
                    scale,
                    safe,
                }
            }
            (None, None) => return Ok(()),
        };
        self.bindings.push(binding);
        Ok(())
    }

    fn scale_parameter(&mut self, max: f64) -> Result<Param<f64>, PinError> {
        let spec = self.with_suffix("-scalemax");
        self.pins.add_setting(self.group, spec, max)
    }

    fn limit_parameters(&mut self, min: f64, max: f64) -> Result<OutputModifiers, PinError> {
        let maxlim = self.with_suffix("-maxlim");
        let minlim = self.with_suffix("-minlim");
        Ok(OutputModifiers {
            max_limit: Some(self.pins.add_setting(self.group, maxlim, max)?),
            min_limit: Some(self.pins.add_setting(self.group, minlim, min)?),
            ..OutputModifiers::default()
        })
    }

    fn real(&mut self, input: Option<Field>, output: Option<Field>) -> Result<(), PinError> {
        let group = self.group;
        let (min, max) = (f64::from(self.record.min), f64::from(self.record.max));
        let largest = f64::from(f32::MAX);
        let spec = if min < max && min.is_finite() && max.is_finite() {
            self.spec().limits(min, max)
        } else if self.element.bits == 32 {
            self.spec().limits(-largest, largest)
        } else {
            self.spec()
        };
        let rule = OutputRule::safe_at(self.safe());
        let binding = match (input, output) {
            (Some(input), Some(output)) => Binding::RealBoth {
                input,
                output,
                pin: self.pins.add_inout(group, spec, rule)?,
            },
            (Some(field), None) => Binding::RealIn {
                field,
                pin: self.pins.add_input(group, spec)?,
            },
            (None, Some(field)) => Binding::RealOut {
                field,
                pin: self.pins.add_output(group, spec, rule)?,
            },
            (None, None) => return Ok(()),
        };
        self.bindings.push(binding);
        Ok(())
    }

    fn raw(&mut self, input: Option<Field>, output: Option<Field>) -> Result<(), PinError> {
        let group = self.group;
        let spec = match u8::try_from(self.element.bits) {
            Ok(bits) if bits < 32 => self.spec().limits(0.0, largest_below(bits)),
            _ => self.spec(),
        };
        let rule = OutputRule::safe_at(0);
        let binding = match (input, output) {
            (Some(input), Some(output)) => Binding::RawBoth {
                input,
                output,
                pin: self.pins.add_inout(group, spec, rule)?,
            },
            (Some(field), None) => Binding::RawIn {
                field,
                pin: self.pins.add_input(group, spec)?,
            },
            (None, Some(field)) => Binding::RawOut {
                field,
                pin: self.pins.add_output(group, spec, rule)?,
            },
            (None, None) => return Ok(()),
        };
        self.bindings.push(binding);
        Ok(())
    }

    fn wide(&mut self, input: Option<Field>, output: Option<Field>) -> Result<(), PinError> {
        let group = self.group;
        let spec = match u8::try_from(self.element.bits) {
            Ok(bits) if bits < 64 => self.spec().limits(0.0, largest_below(bits)),
            _ => self.spec(),
        };
        let rule = OutputRule::safe_at(0);
        let binding = match (input, output) {
            (Some(input), Some(output)) => Binding::WideBoth {
                input,
                output,
                pin: self.pins.add_inout(group, spec, rule)?,
            },
            (Some(field), None) => Binding::WideIn {
                field,
                pin: self.pins.add_input(group, spec)?,
            },
            (None, Some(field)) => Binding::WideOut {
                field,
                pin: self.pins.add_output(group, spec, rule)?,
            },
            (None, None) => return Ok(()),
        };
        self.bindings.push(binding);
        Ok(())
    }

    fn counter(&mut self, input: Option<Field>, high_bits: u8) -> Result<(), PinError> {
        // A counter that the host would write makes no sense; its bits stay zero.
        let Some(field) = input else { return Ok(()) };
        let group = self.group;
        let at = |maker: &Self, suffix: &str| {
            let spec = Spec::new(format!("{}.{suffix}", maker.stem));
            maker.at_terminal(spec, None)
        };
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
            scale: self.pins.add_setting(
                group,
                Spec::new(format!("{}.scale", self.stem)),
                full_scale,
            )?,
            counts_per_rev: Some(self.pins.add_setting(
                group,
                Spec::new(format!("{}.counts-per-rev", self.stem)),
                256,
            )?),
        };
        self.bindings.push(Binding::Counter(CounterPins::new(
            field, high_bits, handles,
        )));
        Ok(())
    }
}
