//! Which element of process data is where in the interface registers.

use alloc::vec::Vec;

use super::{Field, Scaling};
use crate::discovery::{
    DataDirection, DataRecord, DataType, Flow, Problem, ProblemKind, RemoteDescriptor, Table,
};

/// Where the process data of a remote is in the interface registers of its channel, computed once.
///
/// Elements are packed in the order of the PTOC, least significant bit first. Inputs and outputs
/// are two independent streams; a bidirectional element is in both. Pads are zeros in the output.
///
/// Source: manual 7I77, "PROCESS DATA ELEMENT PACKING AND UNPACKING"; FACTS 7.5.
#[derive(Clone, Debug, PartialEq)]
pub struct PackingPlan {
    elements: Vec<Element>,
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
    Counter {
        /// How many of its bits are an upper part that comes first; 0 for a count in one piece.
        high_bits: u8,
    },
    /// An IEEE-754 number of 32 or 64 bits.
    Float,
    /// Bits as they are.
    Stream,
    /// A type this crate does not know: read and shown to nobody, written as zeros.
    Unknown(u8),
}

impl PackingPlan {
    /// The plan for what a remote says of itself, on a port with 3 or 7 interface registers for
    /// each channel. Behind it nothing about the layout is left to check.
    ///
    /// # Errors
    /// [`Problem`], naming the record; nothing in a descriptor makes it panic or go on for long.
    pub fn new(descriptor: &RemoteDescriptor, registers: u8) -> Result<Self, Problem> {
        let mut plan = Self {
            elements: Vec::with_capacity(descriptor.process_data.len()),
            input_bits: 0,
            output_bits: 0,
        };
        let limit = u16::from(registers) * 32;
        let mut records = descriptor.process_data.iter().enumerate().peekable();
        while let Some((index, record)) = records.next() {
            let second = half(record.data_type).map(|other| {
                let next = records.next_if(|(_, next)| {
                    next.data_type == other && next.direction == record.direction
                });
                next.map(|(_, next)| next).ok_or(ProblemKind::HalfCount)
            });
            second
                .transpose()
                .and_then(|second| plan.append(index, (record, second), limit))
                .map_err(|kind| Problem {
                    name: descriptor.name,
                    unit_number: descriptor.unit_number,
                    table: Table::Process,
                    record: record.record_address,
                    kind,
                })?;
        }
        Ok(plan)
    }

    fn append(
        &mut self,
        index: usize,
        (record, second): (&DataRecord, Option<&DataRecord>),
        limit: u16,
    ) -> Result<(), ProblemKind> {
        let kind = kind_of(record, second)?;
        let bits = u16::from(record.bits) + second.map_or(0, |second| u16::from(second.bits));
        let input = place(
            &mut self.input_bits,
            Flow::Input,
            record.direction,
            bits,
            limit,
        )?;
        let output = place(
            &mut self.output_bits,
            Flow::Output,
            record.direction,
            bits,
            limit,
        )?;
        self.elements.push(Element {
            record: index,
            kind,
            input,
            output,
            bits,
        });
        Ok(())
    }

    /// The elements, in PTOC order.
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// All inputs together, in bits.
    pub fn input_bits(&self) -> u32 {
        self.input_bits
    }

    /// All outputs together, in bits.
    pub fn output_bits(&self) -> u32 {
        self.output_bits
    }

    /// Bytes of a request after its command: what the remote calls TXSize.
    pub fn transmit_size(&self) -> u32 {
        self.output_bits.div_ceil(8)
    }

    /// Bytes of a reply, without the remote's fault byte.
    pub fn input_bytes(&self) -> u32 {
        self.input_bits.div_ceil(8)
    }
}

impl Element {
    /// Its bits in the input stream as one field; `None` if it is no input or wider than 64 bits.
    pub fn input_field(&self) -> Option<Field> {
        Field::new(self.input?, u8::try_from(self.bits).ok()?)
    }

    /// Its bits in the output stream as one field; `None` if it is no output or wider than 64 bits.
    pub fn output_field(&self) -> Option<Field> {
        Field::new(self.output?, u8::try_from(self.bits).ok()?)
    }
}

/// The first bit of an element in a stream, which grows by it.
fn place(
    stream: &mut u32,
    flow: Flow,
    direction: DataDirection,
    bits: u16,
    limit: u16,
) -> Result<Option<u16>, ProblemKind> {
    if !flow.has(direction) {
        return Ok(None);
    }
    // Never more than `limit` before.
    let first = *stream as u16;
    *stream += u32::from(bits);
    if *stream > u32::from(limit) {
        return Err(ProblemKind::RegistersTooSmall {
            direction: flow,
            bits: *stream,
            limit,
        });
    }
    Ok(Some(first))
}

/// For one part of a count, the type of the other.
fn half(data_type: DataType) -> Option<DataType> {
    match data_type {
        DataType::EncoderHigh => Some(DataType::EncoderLow),
        DataType::EncoderLow => Some(DataType::EncoderHigh),
        _ => None,
    }
}

/// What the bits of a record are, or of a count in two records. With the low part first, the two
/// are one number of neighbouring bits.
pub(super) fn kind_of(
    record: &DataRecord,
    second: Option<&DataRecord>,
) -> Result<ElementKind, ProblemKind> {
    let second = second.map(|second| second.bits);
    if record.bits == 0 || second == Some(0) {
        return Err(ProblemKind::NoBits);
    }
    let bits = record.bits.saturating_add(second.unwrap_or(0));
    let kind = match record.data_type {
        DataType::Pad => return Ok(ElementKind::Pad),
        DataType::Bits => return Ok(ElementKind::Bits),
        DataType::Unknown(code) => return Ok(ElementKind::Unknown(code)),
        DataType::Float | DataType::NonvolFloat if bits != 32 && bits != 64 => {
            return Err(ProblemKind::FloatSize { bits });
        }
        _ if bits > Field::MAX_BITS => {
            let limit = Field::MAX_BITS;
            return Err(ProblemKind::TooManyBits { bits, limit });
        }
        DataType::Float | DataType::NonvolFloat => ElementKind::Float,
        DataType::Boolean => ElementKind::Boolean,
        DataType::Stream => ElementKind::Stream,
        DataType::Encoder | DataType::EncoderLow => ElementKind::Counter { high_bits: 0 },
        DataType::EncoderHigh => ElementKind::Counter {
            high_bits: record.bits,
        },
        DataType::Unsigned
        | DataType::Signed
        | DataType::NonvolUnsigned
        | DataType::NonvolSigned => {
            let (min, max) = (record.min, record.max);
            let scaling = Scaling::of(record);
            ElementKind::Number(scaling.ok_or(ProblemKind::LimitsNotFinite { min, max })?)
        }
    };
    Ok(kind)
}
