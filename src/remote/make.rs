//! Construction of the pins of a remote's process data.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use super::binding::{Binding, BitInputs, Codec, Pin};
use super::counter::CounterPins;
use super::field::Field;
use super::scaling::narrow_limits;
use super::{RemoteError, RemoteParameter, RemotePins, Scaling};
use crate::discovery::{
    DataDirection, DataRecord, DataType, Element, ElementTable, PackingPlan, RemoteDescriptor,
    RemoteTable, hal_name,
};
use crate::hal::{
    Counter, FullScale, Input, Invert, Output, Param, PinError, PinMaker, PinStore, Place, Spec,
    Value,
};
use crate::hostmot2::RemoteId;
use crate::sslbp::RemoteLabel;

impl RemotePins {
    /// Makes the pins and parameters of the remote on a port and channel of `board`, in a separate
    /// group. `plan` is that of the descriptor.
    ///
    /// Names follow LinuxCNC: `hm2_7i92.0.7i77.0.0.input-07`.
    ///
    /// # Errors
    /// [`RemoteError`] with the element or parameter at fault; the store has none of the remote's
    /// pins then.
    pub fn new(
        pins: &mut PinStore,
        board: &str,
        id: RemoteId,
        descriptor: &RemoteDescriptor,
        plan: &PackingPlan,
        table: Option<&RemoteTable>,
    ) -> Result<Self, RemoteError> {
        pins.as_a_whole(|pins| {
            let label = RemoteLabel::new(id, descriptor.name);
            let mut remote = Self {
                label,
                prefix: format!("{board}.{label}"),
                group: pins.add_group(),
                parameters: Vec::new(),
                inputs: Vec::new(),
                bit_inputs: Vec::new(),
                counters: Vec::new(),
                outputs: Vec::new(),
            };
            for &element in &plan.elements {
                let Some(record) = descriptor.process_data.get(element.record) else {
                    debug_assert!(false, "the plan is of this descriptor");
                    continue;
                };
                let mut maker = Maker {
                    stem: format!("{}.{}", remote.prefix, hal_name(&record.name)),
                    pins,
                    remote: &mut remote,
                    element,
                    record,
                    known: table.and_then(|table| table.element(&record.name, record.direction)),
                };
                let made = maker.make();
                let name = maker.stem;
                made.map_err(|source| RemoteError {
                    name,
                    source: source.into(),
                })?;
            }
            remote.link_enables(pins, table);
            for record in &descriptor.parameters {
                let name = format!("{}.{}", remote.prefix, hal_name(&record.name));
                let made = RemoteParameter::new(pins, remote.group, &name, record);
                let made = made.map_err(|source| RemoteError {
                    name,
                    source: source.into(),
                })?;
                remote.parameters.extend(made);
            }
            Ok(remote)
        })
    }

    /// Links the outputs of the table to their enables.
    fn link_enables(&self, pins: &mut PinStore, table: Option<&RemoteTable>) {
        // Looking up a missing name compares it with all names, to build the error. This is
        // therefore done only for elements for which the table names an enable.
        let known = table.iter().flat_map(|table| table.elements);
        for known in known.filter(|known| !known.enabled_by.is_empty()) {
            let id = |name| pins.id(&format!("{}.{}", self.prefix, hal_name(name)));
            // If a mode lacks one of the two, the other one needs no link.
            if let (Ok(output), Ok(enable)) = (id(known.name), id(known.enabled_by)) {
                pins.enabled_by(output, enable);
            }
        }
    }
}

/// Maker of the pins of one element.
struct Maker<'a> {
    pub pins: &'a mut PinStore,
    pub remote: &'a mut RemotePins,
    /// Common start of the names: board, card, port, channel and element.
    pub stem: String,
    pub element: Element,
    pub record: &'a DataRecord,
    pub known: Option<&'a ElementTable>,
}

impl Maker<'_> {
    pub fn make(&mut self) -> Result<(), PinError> {
        let codec = match self.record.data_type {
            DataType::Pad | DataType::Unknown(_) => return Ok(()),
            DataType::Bits => return self.bits(),
            DataType::Encoder | DataType::EncoderHigh | DataType::EncoderLow => {
                return self.counter();
            }
            DataType::Boolean => {
                let (pin, not) = self.bit("", None)?;
                Codec::Bit { pin, not }
            }
            DataType::Unsigned
            | DataType::Signed
            | DataType::NonvolUnsigned
            | DataType::NonvolSigned => self.number()?,
            DataType::Float | DataType::NonvolFloat => self.float()?,
            DataType::Stream => self.stream()?,
        };
        let Element { bits, .. } = self.element;
        let [input, output] = [self.element.input, self.element.output];
        self.bind(Field::new(input, bits), Field::new(output, bits), codec);
        Ok(())
    }

    fn bind(&mut self, input: Option<Field>, output: Option<Field>, codec: Codec) {
        let bound = |field: Field| Binding { field, codec };
        self.remote.inputs.extend(input.map(bound));
        self.remote.outputs.extend(output.map(bound));
    }

    /// A pin with the direction of the element.
    fn pin<T: Value>(&mut self, spec: Spec, safe: T) -> Result<Pin<T>, PinError> {
        let direction = self.record.direction;
        let mut make = self.maker();
        Ok(match direction {
            DataDirection::Input => Pin(make.input(spec)?, Output::default()),
            DataDirection::Output => Pin(Input::default(), make.output(spec, safe)?),
            DataDirection::Bidirectional => {
                let pin = make.bidirectional(spec, safe)?;
                Pin(pin.as_input(), pin.as_output())
            }
        })
    }

    /// Maker of pins whose names begin with that of the element.
    fn maker(&mut self) -> PinMaker<'_> {
        PinMaker::new(self.pins, self.remote.group, self.stem.clone())
    }

    /// Spec with the element's unit, from the record or else from the table, and with the terminal
    /// of the given bit or of the element.
    fn spec(&self, suffix: &str, bit: Option<u16>) -> Spec {
        let unit = match self.known {
            Some(known) if self.record.unit.is_empty() => known.unit,
            _ => &self.record.unit,
        };
        Spec {
            unit: unit.into(),
            place: self.place(bit),
            ..Spec::from(suffix)
        }
    }

    fn place(&self, bit: Option<u16>) -> Place {
        let known = self.known.iter();
        known.flat_map(|known| known.places(bit)).collect()
    }

    fn safe(&self) -> f64 {
        self.known.map_or(0.0, |known| known.safe)
    }

    fn bits(&mut self) -> Result<(), PinError> {
        let Element { bits, .. } = self.element;
        let [input, output] = [self.element.input, self.element.output];
        let one = |first: Option<u16>, bit: u16| Field::new(Some(first?.saturating_add(bit)), 1);
        let mut together = Vec::new();
        for bit in 0..bits {
            let (pin, not) = self.bit(&format!("-{bit:02}"), Some(bit))?;
            match not {
                Some(not) => together.push((pin.0, not)),
                None => self.bind(one(input, bit), one(output, bit), Codec::Bit { pin, not }),
            }
        }
        let fields = (0..bits).step_by(usize::from(Field::MAX_BITS));
        for (first, pins) in fields.zip(together.chunks(usize::from(Field::MAX_BITS))) {
            let input = input.map(|input| input.saturating_add(first));
            let bits = Field::new(input, pins.len() as u16).map(|field| BitInputs {
                field,
                pins: pins.to_vec(),
                taken: None,
            });
            self.remote.bit_inputs.extend(bits);
        }
        Ok(())
    }

    /// Pins of a bit; an input has its opposite beside it, and an output can be inverted.
    fn bit(
        &mut self,
        suffix: &str,
        bit: Option<u16>,
    ) -> Result<(Pin<bool>, Option<Input<bool>>), PinError> {
        let mut spec = self.spec(suffix, bit);
        if self.record.direction == DataDirection::Output {
            let invert = self.maker().setting(format!("{suffix}-invert"), false)?;
            spec.invert = Some(Invert::Setting(invert));
        }
        let pin = self.pin(spec, self.safe() != 0.0)?;
        let mut not = None;
        if self.record.direction == DataDirection::Input {
            let spec = self.spec(&format!("{suffix}-not"), bit);
            not = Some(self.maker().opposite(spec)?);
        }
        Ok((pin, not))
    }

    fn number(&mut self) -> Result<Codec, PinError> {
        let scaling = Scaling::of(self.record);
        let Scaling { min, max, .. } = scaling;
        let name = self.spec("-scalemax", None);
        // A number whose largest value is 0 cannot have another scale.
        let scale = match self.maker().scale(name.clone(), max) {
            Err(PinError::BadScale { .. }) => self.maker().property(name, max),
            made => made,
        }?;
        let mut spec = Spec {
            range: Some((min, max)),
            ..self.spec("", None)
        };
        if self.record.direction != DataDirection::Input {
            spec.max_limit = Some(self.setting("-maxlim", max)?);
            spec.min_limit = Some(self.setting("-minlim", min)?);
            spec.full_scale = Some(FullScale { scale, min, max });
        }
        Ok(Codec::Number {
            pin: self.pin(spec, self.safe())?,
            scaling,
            scale,
        })
    }

    fn setting(&mut self, suffix: &str, value: f64) -> Result<Param<f64>, PinError> {
        let spec = self.spec(suffix, None);
        self.maker().setting(spec, value)
    }

    fn float(&mut self) -> Result<Codec, PinError> {
        let (min, max) = (f64::from(self.record.min), f64::from(self.record.max));
        let largest = f64::from(f32::MAX);
        let limits = if min < max && min.is_finite() && max.is_finite() {
            Some((min, max))
        } else {
            (self.element.bits == 32).then_some((-largest, largest))
        };
        let spec = Spec {
            limits,
            ..self.spec("", None)
        };
        Ok(Codec::Float(self.pin(spec, self.safe())?))
    }

    fn stream(&mut self) -> Result<Codec, PinError> {
        let bits = self.record.bits;
        let spec = Spec {
            limits: narrow_limits(bits, false),
            ..self.spec("", None)
        };
        Ok(match bits {
            33.. => Codec::Wide(self.pin(spec, 0)?),
            _ => Codec::Raw(self.pin(spec, 0)?),
        })
    }

    fn counter(&mut self) -> Result<(), PinError> {
        // A counter written by the host makes no sense; its bits stay zero.
        let Some(field) = Field::new(self.element.input, self.element.bits) else {
            return Ok(());
        };
        let full_scale = f64::from(self.record.max);
        let place = self.place(None);
        let mut make = self.maker().at(place);
        let handles = Counter {
            count: make.input(".count")?,
            rawcounts: make.input(".rawcounts")?,
            position: make.input(".position")?,
            index_enable: make.inout(".index-enable")?,
            reset: make.inout(".reset")?.as_output(),
            // As in LinuxCNC, 0 counts as 1.
            scale: match make.scale(".scale", full_scale) {
                Err(PinError::BadScale { .. }) => make.scale(".scale", 1.0),
                made => made,
            }?,
            counts_per_rev: Some(make.setting(".counts-per-rev", 256)?),
            count_unsure: None,
        };
        self.remote.counters.push(CounterPins {
            field,
            high_bits: self.element.high_bits,
            handles,
            last: None,
            now: 0,
            zero: 0,
        });
        Ok(())
    }
}
