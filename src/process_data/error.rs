//! Why process data can not be packed.

use crate::discovery::DataType;

/// Why a descriptor does not make a packing plan.
///
/// `element` is the place of the record in the descriptor's `process_data`.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// The port has a number of interface registers that no gateware has.
    #[error(
        "{registers} interface registers: a port has 3 or 7 (is the module descriptor read right?)"
    )]
    Registers {
        /// What was given.
        registers: usize,
    },
    /// An element without bits.
    #[error(
        "element {element} at record {record:#06x} has no bits (damaged record, or the remote's firmware needs an update)"
    )]
    NoBits {
        /// Which one.
        element: usize,
        /// Where its record is in the remote.
        record: u16,
    },
    /// A number that is wider than its type can be.
    #[error(
        "element {element} at record {record:#06x}: {bits} bits are no width for {data_type:?} (damaged record, or the remote's firmware needs an update)"
    )]
    Width {
        /// Which one.
        element: usize,
        /// Where its record is in the remote.
        record: u16,
        /// Its type.
        data_type: DataType,
        /// Its width.
        bits: u8,
    },
    /// Limits that are no numbers.
    #[error(
        "element {element} at record {record:#06x} has limits {min} and {max}, which can not be scaled by (damaged record, or the remote's firmware needs an update)"
    )]
    Limits {
        /// Which one.
        element: usize,
        /// Where its record is in the remote.
        record: u16,
        /// Its lower limit.
        min: f32,
        /// Its upper limit.
        max: f32,
    },
    /// The inputs do not fit the interface registers.
    #[error(
        "{bits} bits of inputs do not fit {capacity} (choose another software mode, or gateware with seven registers)"
    )]
    TooManyInputs {
        /// All inputs together.
        bits: u32,
        /// What fits.
        capacity: u32,
    },
    /// The outputs do not fit the interface registers.
    #[error(
        "{bits} bits of outputs do not fit {capacity} (choose another software mode, or gateware with seven registers)"
    )]
    TooManyOutputs {
        /// All outputs together.
        bits: u32,
        /// What fits.
        capacity: u32,
    },
    /// One part of a count in two parts stands alone.
    #[error(
        "element {element} at record {record:#06x} is one part of a count, and the other part does not follow (choose another software mode)"
    )]
    HalfCount {
        /// Which one.
        element: usize,
        /// Where its record is in the remote.
        record: u16,
    },
}
