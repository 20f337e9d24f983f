//! Places of the process data's elements in the interface registers.

use super::{DataRecord, DataType, Problem, ProblemKind, RemoteDescriptor, Table};
use crate::sslbp::ProcessDataSizes;
use alloc::vec::Vec;

/// Layout of a remote's process data in the interface registers of its channel, computed once.
///
/// Elements are packed in the order of the PTOC, least significant bit first. Inputs and outputs
/// are two independent streams; a bidirectional element is in both. Pads are zeros in the output.
///
/// Source: manual 7I77, "PROCESS DATA ELEMENT PACKING AND UNPACKING"; FACTS 7.5.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PackingPlan {
    /// The elements, in PTOC order.
    pub elements: Vec<Element>,
    /// Width of all inputs together, in bits.
    pub input_bits: u32,
    /// Width of all outputs together, in bits.
    pub output_bits: u32,
}

/// An element of process data and its places.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Element {
    /// Index of its record in the descriptor's `process_data`; for a count in two parts, of the
    /// first one.
    pub record: usize,
    /// Its first bit in the input stream, if it is an input.
    pub input: Option<u16>,
    /// Its first bit in the output stream, if it is an output.
    pub output: Option<u16>,
    /// Its width; for a count in two parts, the sum of both.
    pub bits: u16,
    /// Number of bits of a count's upper part if that comes first; else 0.
    pub high_bits: u8,
}

impl PackingPlan {
    /// The plan for a remote with this descriptor, on a port with 3 or 7 interface registers for
    /// each channel. A plan needs no further checks of the layout.
    ///
    /// # Errors
    /// [`Problem`], naming the record. No descriptor causes a panic or unbounded work.
    pub fn new(descriptor: &RemoteDescriptor, registers: u8) -> Result<Self, Problem> {
        let mut plan = Self::default();
        let limit = u32::from(registers) * 32;
        let mut records = descriptor.process_data.iter().enumerate().peekable();
        while let Some((index, record)) = records.next() {
            let second = match record.data_type {
                DataType::EncoderHigh => Some(DataType::EncoderLow),
                DataType::EncoderLow => Some(DataType::EncoderHigh),
                _ => None,
            };
            let follows = |next: &DataRecord| {
                Some(next.data_type) == second && next.direction == record.direction
            };
            let low_or_high = records.next_if(|(_, next)| follows(next));
            let result = match (second, low_or_high) {
                (Some(_), None) => Err(ProblemKind::HalfCount),
                (_, second) => plan.append(index, record, second.map(|(_, record)| record), limit),
            };
            result.map_err(|kind| Problem {
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
        record: &DataRecord,
        second: Option<&DataRecord>,
        limit: u32,
    ) -> Result<(), ProblemKind> {
        let bits = u16::from(record.bits) + second.map_or(0, |second| second.bits.into());
        record.data_type.check_width(bits)?;
        let place = |stream: &mut u32, direction, is_in_it: bool| {
            // Never more than `limit` before.
            let first = *stream as u16;
            if is_in_it {
                *stream += u32::from(bits);
            }
            let bits = *stream;
            match bits {
                _ if bits > limit => Err(ProblemKind::RegistersTooSmall {
                    direction,
                    bits,
                    limit,
                }),
                _ => Ok(is_in_it.then_some(first)),
            }
        };
        let way = record.direction;
        let input = place(&mut self.input_bits, "input", way.is_input())?;
        let output = place(&mut self.output_bits, "output", way.is_output())?;
        self.elements.push(Element {
            record: index,
            input,
            output,
            bits,
            // With the low part first, the two parts form one number of adjacent bits.
            high_bits: match record.data_type {
                DataType::EncoderHigh => record.bits,
                _ => 0,
            },
        });
        Ok(())
    }

    /// Sizes that a remote with this plan reports, with or without a fault byte.
    pub(crate) fn sizes(&self, has_fault_byte: bool) -> ProcessDataSizes {
        // At most 28 bytes, those of seven registers.
        ProcessDataSizes {
            rx: self.input_bytes() as u8 + u8::from(has_fault_byte),
            tx: self.output_bytes() as u8,
        }
    }

    /// Bytes of a reply, without the remote's fault byte.
    pub fn input_bytes(&self) -> u32 {
        self.input_bits.div_ceil(8)
    }

    /// Bytes of a request after its command; named TXSize in the remote.
    pub fn output_bytes(&self) -> u32 {
        self.output_bits.div_ceil(8)
    }
}
