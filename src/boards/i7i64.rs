//! The 7I64: 24 inputs and 24 outputs, two analog inputs of 0 to 3.3 V. It does not support
//! discovery, and its reply has no fault byte.

use crate::discovery::{DataType, ElementTable, RemoteTable};

/// The gateware sends 4 bytes, three of which are outputs. FACTS 11.10.
///
/// Source: public tables of the field's clients; gateware transcript t26 for the sizes and for the
/// place of the inputs.
pub const REMOTE: RemoteTable = RemoteTable {
    has_discovery: false,
    ..RemoteTable::new(
        "7I64",
        *b"7I64",
        &[
            without_unit(ElementTable::output("output", 24, DataType::Bits)),
            ElementTable::output("pad", 8, DataType::Pad),
            without_unit(ElementTable::input("input", 24, DataType::Bits)),
            ElementTable::input("pad", 8, DataType::Pad),
            ElementTable::input("analog0", 16, DataType::Unsigned).range(0.0, 3.3, "volts"),
            ElementTable::input("analog1", 16, DataType::Unsigned).range(0.0, 3.3, "volts"),
        ],
    )
};

const fn without_unit(element: ElementTable) -> ElementTable {
    ElementTable {
        unit: "none",
        ..element
    }
}
