//! Descriptors of the devices according to their manuals, written out for the tests.

use mesa_hal::discovery::{DataDirection, DataRecord, DataType, RemoteDescriptor};
use mesa_hal::sslbp::RemoteName;

pub fn record(
    name: &str,
    bits: u8,
    data_type: DataType,
    direction: DataDirection,
    min: f32,
    max: f32,
) -> DataRecord {
    DataRecord {
        record_address: 0x100,
        bits,
        data_type,
        direction,
        min,
        max,
        address: 0,
        unit: String::new(),
        name: name.into(),
    }
}

pub fn descriptor(
    name: [u8; 4],
    unit_number: u32,
    software_mode: u8,
    process_data: Vec<DataRecord>,
) -> RemoteDescriptor {
    RemoteDescriptor {
        name: RemoteName(name),
        unit_number,
        software_mode,
        process_data,
        parameters: Vec::new(),
        modes: Vec::new(),
    }
}

fn parameter(name: &str, bits: u8, data_type: DataType, direction: DataDirection) -> DataRecord {
    record(name, bits, data_type, direction, 0.0, 0.0)
}

/// The 7I77's field I/O (FACTS 8.2).
pub fn field_io(mode: u8) -> RemoteDescriptor {
    use DataDirection::{Bidirectional, Input, Output};
    let mut data = vec![
        record("Output", 16, DataType::Bits, Output, 0.0, 0.0),
        record("Input", 32, DataType::Bits, Input, 0.0, 0.0),
    ];
    let volts = |name: &str| DataRecord {
        unit: "volts".into(),
        ..record(name, 8, DataType::Unsigned, Input, 0.0, 36.3)
    };
    if mode >= 1 {
        data.extend((0..4).map(|n| volts(&format!("AnalogIn{n}"))));
    }
    if mode >= 2 {
        data.push(volts("FieldVoltage"));
    }
    if mode >= 3 {
        data.extend(
            (0..2).map(|n| record(&format!("Enc{n}"), 8, DataType::Encoder, Input, 0.0, 1.0)),
        );
    }
    let nonvolatile =
        |name: &str, bits| parameter(name, bits, DataType::NonvolUnsigned, Bidirectional);
    RemoteDescriptor {
        parameters: vec![
            parameter("SwRevision", 8, DataType::Unsigned, Input),
            parameter("HwRevision", 8, DataType::Unsigned, Input),
            parameter("UnitNumber", 32, DataType::Unsigned, Bidirectional),
            nonvolatile("NVBaudRate", 8),
            nonvolatile("NVUnitNumber", 32),
            nonvolatile("NVWatchDogTimeout", 16),
            nonvolatile("NVEncMode0", 8),
            nonvolatile("NVEncMode1", 8),
        ],
        ..descriptor(*b"7I77", 0x1200_0123, mode, data)
    }
}

/// The 7I77's analog part (FACTS 8.3).
pub fn analog() -> RemoteDescriptor {
    use DataDirection::Output;
    let mut data: Vec<_> = (0..6)
        .map(|n| DataRecord {
            unit: "volts".into(),
            ..record(
                &format!("AnalogOut{n}"),
                13,
                DataType::Signed,
                Output,
                -10.0,
                10.0,
            )
        })
        .collect();
    data.push(record("AnalogEna", 1, DataType::Boolean, Output, 0.0, 0.0));
    data.push(record("SpinEna", 1, DataType::Boolean, Output, 0.0, 0.0));
    descriptor(*b"7I77", 0x1100_0123, 0, data)
}

/// The 7I72 (FACTS 8.4).
pub fn outputs_48(mode: u8) -> RemoteDescriptor {
    let mut data = vec![record(
        "Output",
        48,
        DataType::Bits,
        DataDirection::Output,
        0.0,
        0.0,
    )];
    if mode == 1 {
        data.push(DataRecord {
            unit: "volts".into(),
            ..record(
                "FieldVoltage",
                16,
                DataType::Unsigned,
                DataDirection::Input,
                0.0,
                36.3,
            )
        });
    }
    descriptor(*b"7I72", 0x2000_0007, mode, data)
}
