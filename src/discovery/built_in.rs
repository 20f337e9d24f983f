//! Remotes that do not support discovery.
//!
//! Only what is certain is here. The 8I20 has a path of its own in the gateware as well (FACTS 11.5),
//! but what its process data means is not known, so it is not supported.

use super::{DataDirection, DataRecord, DataType, ProblemKind, RemoteIdentity, RemoteName};
use crate::sslbp::{ProcessDataSizes, StartedRemote};
use alloc::{string::String, vec::Vec};

/// One element of a table: bits, type, direction, maximum, unit, name.
type Element = (u8, DataType, DataDirection, f32, &'static str, &'static str);

/// 24 inputs and 24 outputs, two analog inputs of 0 to 3.3 V. Its reply has no fault byte. The
/// gateware sends 4 bytes, of which the outputs are three. FACTS 11.10.
///
/// Source: public tables of the field's clients; gateware transcript t26 for the sizes and for the
/// place of the inputs.
const I7I64: [Element; 6] = [
    (
        24,
        DataType::Bits,
        DataDirection::Output,
        0.0,
        "none",
        "output",
    ),
    (8, DataType::Pad, DataDirection::Output, 0.0, "", "pad"),
    (
        24,
        DataType::Bits,
        DataDirection::Input,
        0.0,
        "none",
        "input",
    ),
    (8, DataType::Pad, DataDirection::Input, 0.0, "", "pad"),
    (
        16,
        DataType::Unsigned,
        DataDirection::Input,
        3.3,
        "volts",
        "analog0",
    ),
    (
        16,
        DataType::Unsigned,
        DataDirection::Input,
        3.3,
        "volts",
        "analog1",
    ),
];

/// The drive that has a path of its own in the gateware. FACTS 11.5.
const NAME_8I20: RemoteName = RemoteName(*b"8I20");

/// FACTS 4.7.
const I7I64_SIZES: ProcessDataSizes = ProcessDataSizes { rx: 8, tx: 4 };

/// The process data of a remote by its name.
pub(super) fn process_data(identity: &RemoteIdentity) -> Result<Vec<DataRecord>, ProblemKind> {
    if identity.name == NAME_8I20 {
        return Err(ProblemKind::NotSupported);
    }
    if identity.name != StartedRemote::NAME_7I64 {
        return Err(ProblemKind::NoDiscovery);
    }
    // The gateware knows the sizes itself, but keeps them only for a normal START.
    let told = identity.sizes != ProcessDataSizes::default();
    if told && identity.sizes != I7I64_SIZES {
        return Err(ProblemKind::OtherSizes {
            rx: identity.sizes.rx,
            tx: identity.sizes.tx,
            table_rx: I7I64_SIZES.rx,
            table_tx: I7I64_SIZES.tx,
        });
    }
    Ok(I7I64.iter().map(record).collect())
}

fn record(element: &Element) -> DataRecord {
    let &(bits, data_type, direction, max, unit, name) = element;
    DataRecord {
        record_address: 0,
        bits,
        data_type,
        direction,
        min: 0.0,
        max,
        address: 0,
        unit: String::from(unit),
        name: String::from(name),
    }
}
