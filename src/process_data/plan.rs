//! Which element of process data is where in the interface registers.

use alloc::vec::Vec;

use super::{Field, PlanError, Scaling};
use crate::discovery::{DataDirection, DataRecord, DataType, RemoteDescriptor};

/// How many interface registers a channel of a port has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InterfaceRegisters {
    /// GTAG C1: 96 bits each way.
    Three,
    /// GTAG C6: 224 bits each way.
    Seven,
}

impl InterfaceRegisters {
    /// From their number.
    pub const fn from_count(registers: usize) -> Result<Self, PlanError> {
        match registers {
            3 => Ok(Self::Three),
            7 => Ok(Self::Seven),
            _ => Err(PlanError::Registers { registers }),
        }
    }

    /// Their number.
    pub const fn count(self) -> usize {
        match self {
            Self::Three => 3,
            Self::Seven => 7,
        }
    }

    /// How many bits of process data they carry each way.
    pub const fn bits(self) -> u32 {
        self.count() as u32 * 32
    }
}

/// Where the process data of a remote is in the interface registers of its channel, computed once.
///
/// Elements are packed in the order of the PTOC, least significant bit first. Inputs and outputs
/// are two independent streams; a bidirectional element is in both. Pads are zeros in the output.
///
/// Source: manual 7I77, "PROCESS DATA ELEMENT PACKING AND UNPACKING"; FACTS 7.5.
#[derive(Clone, Debug, PartialEq)]
pub struct PackingPlan {
    elements: Vec<Element>,
    registers: InterfaceRegisters,
    input_bits: u32,
    output_bits: u32,
}

/// An element of process data and its places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// The place of its record in the descriptor's `process_data`.
    pub record: usize,
    /// What its bits are.
    pub kind: ElementKind,
    /// Which way it goes.
    pub direction: DataDirection,
    /// Its first bit in the input stream, if it is an input.
    pub input: Option<u16>,
    /// Its first bit in the output stream, if it is an output.
    pub output: Option<u16>,
    /// Its width; for a count in two parts both together.
    pub bits: u16,
}

/// What the bits of an element are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ElementKind {
    /// Alignment: nothing.
    Pad,
    /// Single bits, bit 0 first.
    Bits,
    /// A number with a scale.
    Number(Scaling),
    /// True if any bit is set; all bits are set for true.
    Boolean,
    /// A counter, to be continued to 64 bits.
    Counter,
    /// A counter whose upper part comes first.
    SplitCounter {
        /// How many of its bits are the upper part.
        high_bits: u8,
    },
    /// An IEEE-754 number of 32 bits.
    Float32,
    /// An IEEE-754 number of 64 bits.
    Float64,
    /// Bits as they are.
    Stream,
    /// A type this crate does not know: read and shown to nobody, written as zeros.
    Unknown(u8),
}

impl PackingPlan {
    /// The plan for what a remote says of itself.
    ///
    /// # Errors
    /// [`PlanError`], naming the record; nothing in a descriptor makes it panic or go on for long.
    pub fn new(
        descriptor: &RemoteDescriptor,
        registers: InterfaceRegisters,
    ) -> Result<Self, PlanError> {
        Self::from_records(&descriptor.process_data, registers)
    }

    /// The plan for a list of process-data records in PTOC order.
    pub fn from_records(
        records: &[DataRecord],
        registers: InterfaceRegisters,
    ) -> Result<Self, PlanError> {
        let mut plan = Self {
            elements: Vec::with_capacity(records.len()),
            registers,
            input_bits: 0,
            output_bits: 0,
        };
        let mut records = records.iter().enumerate().peekable();
        while let Some((index, record)) = records.next() {
            let mut bits = u16::from(record.bits);
            let kind = match half(record.data_type) {
                None => kind_of(index, record)?,
                Some(other) => {
                    let second = records
                        .next_if(|(_, next)| {
                            next.data_type == other && next.direction == record.direction
                        })
                        .ok_or(PlanError::HalfCount {
                            element: index,
                            record: record.record_address,
                        })?;
                    bits += u16::from(second.1.bits);
                    counter_of_two(index, record, second.1)?
                }
            };
            plan.append(index, record.direction, kind, bits);
        }
        plan.checked()
    }

    fn append(&mut self, record: usize, direction: DataDirection, kind: ElementKind, bits: u16) {
        let place = |stream: &mut u32, used: bool| {
            // Offsets past what fits are refused by `checked`, before anybody uses them.
            let offset = u16::try_from(*stream).unwrap_or(u16::MAX);
            used.then(|| {
                *stream = stream.saturating_add(u32::from(bits));
                offset
            })
        };
        let input = place(&mut self.input_bits, direction.is_input());
        let output = place(&mut self.output_bits, direction.is_output());
        self.elements.push(Element {
            record,
            kind,
            direction,
            input,
            output,
            bits,
        });
    }

    fn checked(self) -> Result<Self, PlanError> {
        let capacity = self.registers.bits();
        if self.input_bits > capacity {
            return Err(PlanError::TooManyInputs {
                bits: self.input_bits,
                capacity,
            });
        }
        if self.output_bits > capacity {
            return Err(PlanError::TooManyOutputs {
                bits: self.output_bits,
                capacity,
            });
        }
        Ok(self)
    }

    /// The elements, in PTOC order.
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// The interface registers it is for.
    pub fn registers(&self) -> InterfaceRegisters {
        self.registers
    }

    /// All inputs together, in bits.
    pub fn input_bits(&self) -> u32 {
        self.input_bits
    }

    /// All outputs together, in bits.
    pub fn output_bits(&self) -> u32 {
        self.output_bits
    }

    /// How many interface registers have to be read each cycle.
    pub fn input_words(&self) -> usize {
        self.input_bits.div_ceil(32) as usize
    }

    /// How many interface registers have to be written each cycle.
    pub fn output_words(&self) -> usize {
        self.output_bits.div_ceil(32) as usize
    }

    /// Bytes of a reply, the remote's fault byte included: what the remote calls RXSize.
    pub fn receive_size(&self) -> u32 {
        self.input_bits.div_ceil(8) + 1
    }

    /// Bytes of a request after its command: what the remote calls TXSize.
    pub fn transmit_size(&self) -> u32 {
        self.output_bits.div_ceil(8)
    }
}

impl Element {
    /// Its bits in the input stream as one field; `None` if it is no input or wider than 64 bits.
    pub fn input_field(&self) -> Option<Field> {
        self.field(self.input)
    }

    /// Its bits in the output stream as one field; `None` if it is no output or wider than 64 bits.
    pub fn output_field(&self) -> Option<Field> {
        self.field(self.output)
    }

    /// One of its bits in the input stream.
    pub fn input_bit(&self, bit: u16) -> Option<Field> {
        self.bit(self.input, bit)
    }

    /// One of its bits in the output stream.
    pub fn output_bit(&self, bit: u16) -> Option<Field> {
        self.bit(self.output, bit)
    }

    fn field(&self, offset: Option<u16>) -> Option<Field> {
        Field::new(offset?, u8::try_from(self.bits).ok()?)
    }

    fn bit(&self, offset: Option<u16>, bit: u16) -> Option<Field> {
        if bit >= self.bits {
            return None;
        }
        Field::new(offset?.checked_add(bit)?, 1)
    }
}

/// For one part of a count, the type of the other.
fn half(data_type: DataType) -> Option<DataType> {
    match data_type {
        DataType::EncoderHigh => Some(DataType::EncoderLow),
        DataType::EncoderLow => Some(DataType::EncoderHigh),
        _ => None,
    }
}

/// A count in two parts. With the low part first, the two are one number of neighbouring bits.
fn counter_of_two(
    element: usize,
    first: &DataRecord,
    second: &DataRecord,
) -> Result<ElementKind, PlanError> {
    let bits = first.bits.saturating_add(second.bits);
    if first.bits == 0 || second.bits == 0 {
        return Err(PlanError::NoBits {
            element,
            record: first.record_address,
        });
    }
    if bits > Field::MAX_BITS {
        return Err(PlanError::Width {
            element,
            record: first.record_address,
            data_type: first.data_type,
            bits,
        });
    }
    Ok(match first.data_type {
        DataType::EncoderHigh => ElementKind::SplitCounter {
            high_bits: first.bits,
        },
        _ => ElementKind::Counter,
    })
}

fn kind_of(element: usize, record: &DataRecord) -> Result<ElementKind, PlanError> {
    let bits = record.bits;
    if bits == 0 {
        return Err(PlanError::NoBits {
            element,
            record: record.record_address,
        });
    }
    let width = PlanError::Width {
        element,
        record: record.record_address,
        data_type: record.data_type,
        bits,
    };
    let narrow = |kind: ElementKind| {
        if bits <= Field::MAX_BITS {
            Ok(kind)
        } else {
            Err(width)
        }
    };
    match record.data_type {
        DataType::Pad => Ok(ElementKind::Pad),
        DataType::Bits => Ok(ElementKind::Bits),
        DataType::Unsigned
        | DataType::Signed
        | DataType::NonvolUnsigned
        | DataType::NonvolSigned => match Scaling::of(record) {
            Some(scaling) => Ok(ElementKind::Number(scaling)),
            None if bits > Field::MAX_BITS => Err(width),
            None => Err(PlanError::Limits {
                element,
                record: record.record_address,
                min: record.min,
                max: record.max,
            }),
        },
        DataType::Boolean => narrow(ElementKind::Boolean),
        DataType::Encoder | DataType::EncoderHigh | DataType::EncoderLow => {
            narrow(ElementKind::Counter)
        }
        DataType::Float | DataType::NonvolFloat => match bits {
            32 => Ok(ElementKind::Float32),
            64 => Ok(ElementKind::Float64),
            _ => Err(width),
        },
        DataType::Stream => narrow(ElementKind::Stream),
        DataType::Unknown(code) => Ok(ElementKind::Unknown(code)),
    }
}
