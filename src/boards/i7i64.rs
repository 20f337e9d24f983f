//! The 7I64: 24 inputs and 24 outputs, two analog inputs of 0 to 3.3 V. It does not support
//! discovery, and its reply has no fault byte.

use crate::discovery::{DataDirection, ElementTable, RemoteTable};

/// The gateware sends 4 bytes, of which the outputs are three. FACTS 11.10.
///
/// Source: public tables of the field's clients; gateware transcript t26 for the sizes and for the
/// place of the inputs.
pub const REMOTE: RemoteTable = RemoteTable {
    has_discovery: false,
    ..RemoteTable::new(
        "7I64",
        *b"7I64",
        &[
            with_unit("none", ElementTable::bits_out("output", 24)),
            ElementTable::pad(8, DataDirection::Output),
            with_unit("none", ElementTable::bits_in("input", 24)),
            ElementTable::pad(8, DataDirection::Input),
            with_unit("volts", ElementTable::volts_in("analog0", 16, 3.3)),
            with_unit("volts", ElementTable::volts_in("analog1", 16, 3.3)),
        ],
    )
};

const fn with_unit(unit: &'static str, element: ElementTable) -> ElementTable {
    ElementTable { unit, ..element }
}
