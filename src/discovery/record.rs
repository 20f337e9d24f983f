//! Bytes and records of a remote's memory, fetched with as few accesses as possible.

use super::{DataDirection, DataRecord, DataType, ModeRecord, ModeType, ProblemKind, RemoteMemory};
use crate::sslbp::AccessSize;
use alloc::{
    collections::BTreeMap,
    string::{String, ToString},
    vec::Vec,
};

/// Addresses that can not be read before discovery gives up. Each costs some hundred milliseconds.
const FAILURES: u32 = 4;

/// Characters of a string, its end not counted.
const CHARACTERS: u16 = 255;

/// Characters that clients keep. FACTS 7.1.
const KEPT: u16 = 48;

/// Record types. Manual: 7I77, "RECORD_TYPE", "MODE DESCRIPTOR".
const DATA: u8 = 0xA0;
const MODE: u8 = 0xB0;

/// Where the strings begin. FACTS 7.1.
const UNIT: u16 = 14;
const MODE_NAME: u16 = 4;

/// A record of either kind.
pub(super) enum Record {
    Data(DataRecord),
    Mode(ModeRecord),
}

/// Reads ahead in doubles, and reads no byte twice.
pub(super) struct Reader<'m, M> {
    memory: &'m mut M,
    most_accesses: u32,
    /// What has been read. Never larger than eight bytes for each access.
    known: BTreeMap<u16, u8>,
    /// The largest access that works with this remote.
    size: AccessSize,
    pub accesses: u32,
    failures: u32,
    /// The last access that failed.
    pub error: Option<String>,
    /// Problems of the record that is being read which do not make it useless.
    pub notes: Vec<ProblemKind>,
}

impl<'m, M: RemoteMemory> Reader<'m, M> {
    pub fn new(memory: &'m mut M, most_accesses: u32) -> Self {
        Self {
            memory,
            most_accesses,
            known: BTreeMap::new(),
            size: AccessSize::Double,
            accesses: 0,
            failures: 0,
            error: None,
            notes: Vec::new(),
        }
    }

    /// Reads the record at `address`; an error if there is nothing to be kept of it.
    pub fn record(&mut self, address: u16) -> Result<Record, ProblemKind> {
        match self.byte(address, 0)? {
            DATA => self.data(address).map(Record::Data),
            MODE => self.mode(address).map(Record::Mode),
            found => Err(ProblemKind::IllegalByte {
                field: "type",
                found,
                expected: "A0 (data) or B0 (mode)",
            }),
        }
    }

    /// Manual: 7I77, "PROCESS DATA DESCRIPTOR"; FACTS 7.1 for the offsets.
    fn data(&mut self, record_address: u16) -> Result<DataRecord, ProblemKind> {
        let [bits, data_type, direction] = self.bytes(record_address, 1)?;
        let illegal = ProblemKind::IllegalByte {
            field: "direction",
            found: direction,
            expected: "00 (input), 40 (both) or 80 (output)",
        };
        let direction = DataDirection::from_byte(direction).ok_or(illegal)?;
        let data_type = DataType::from_byte(data_type);
        data_type.check_width(bits.into())?;
        if let DataType::Unknown(found) = data_type {
            self.notes.push(ProblemKind::UnknownDataType { found });
        }
        let min = f32::from_le_bytes(self.bytes(record_address, 4)?);
        let max = f32::from_le_bytes(self.bytes(record_address, 8)?);
        let (min, max) = self.limits(data_type, min, max);
        let address = u16::from_le_bytes(self.bytes(record_address, 12)?);
        let (unit, length) = self.string(record_address, UNIT, "unit")?;
        let (name, _) = self.string(record_address, UNIT + length + 1, "name")?;
        Ok(DataRecord {
            record_address,
            bits,
            data_type,
            direction,
            min,
            max,
            address,
            unit,
            name,
        })
    }

    /// Manual: 7I77, "MODE DESCRIPTOR".
    fn mode(&mut self, record_address: u16) -> Result<ModeRecord, ProblemKind> {
        let [index, mode_type] = self.bytes(record_address, 1)?;
        let (name, _) = self.string(record_address, MODE_NAME, "name")?;
        Ok(ModeRecord {
            record_address,
            index,
            mode_type: ModeType::from_byte(mode_type),
            name,
        })
    }

    /// Limits mean something for numbers only. Manual: 7I77, "PARAMETER_MIN".
    fn limits(&mut self, data_type: DataType, min: f32, max: f32) -> (f32, f32) {
        use DataType::{Float, NonvolFloat, NonvolSigned, NonvolUnsigned, Signed, Unsigned};
        let is_float = matches!(data_type, Float | NonvolFloat);
        let is_whole = matches!(data_type, Unsigned | Signed | NonvolUnsigned | NonvolSigned);
        let is_finite = min.is_finite() && max.is_finite();
        // FACTS 11.10: a floating-point number without limits has infinite ones.
        if !is_finite && (is_whole || is_float && (min.is_nan() || max.is_nan())) {
            self.notes.push(ProblemKind::LimitsNotFinite { min, max });
        }
        if is_finite && (is_whole || is_float) && min > max {
            self.notes.push(ProblemKind::LimitsReversed { min, max });
        }
        if is_finite { (min, max) } else { (0.0, 0.0) }
    }

    /// The string at `offset`, and its length without its end.
    fn string(
        &mut self,
        record: u16,
        offset: u16,
        field: &'static str,
    ) -> Result<(String, u16), ProblemKind> {
        let mut text = String::new();
        for length in 0..=CHARACTERS {
            match self.byte(record, offset + length)? {
                0 => {
                    if length > KEPT {
                        self.notes.push(ProblemKind::StringTooLong {
                            field,
                            characters: length,
                            kept: KEPT,
                        });
                    }
                    return Ok((text, length));
                }
                byte if length < KEPT => text.push(character(byte)),
                _ => {}
            }
        }
        Err(ProblemKind::StringWithoutEnd {
            field,
            characters: CHARACTERS,
        })
    }

    fn bytes<const N: usize>(&mut self, base: u16, offset: u16) -> Result<[u8; N], ProblemKind> {
        let mut bytes = [0; N];
        for (offset, byte) in (offset..).zip(&mut bytes) {
            *byte = self.byte(base, offset)?;
        }
        Ok(bytes)
    }

    /// The byte at `offset` from an address.
    pub fn byte(&mut self, base: u16, offset: u16) -> Result<u8, ProblemKind> {
        let address = base.checked_add(offset).ok_or(ProblemKind::PastEnd)?;
        if !self.known.contains_key(&address) {
            self.fetch(address)?;
        }
        let byte = self.known.get(&address);
        byte.copied().ok_or(ProblemKind::ReadFailed { address })
    }

    /// Reads ahead from `address` on; with smaller accesses if a large one fails, because the
    /// remote's memory may end there.
    fn fetch(&mut self, address: u16) -> Result<(), ProblemKind> {
        loop {
            if self.failures >= FAILURES || self.accesses >= self.most_accesses {
                let accesses = self.accesses;
                return Err(ProblemKind::GaveUp { accesses });
            }
            self.accesses += 1;
            let size = self.size;
            let first = address.min(u16::MAX - u16::from(size.bytes() - 1));
            match self.memory.read(None, first, size) {
                Ok(value) => {
                    let bytes = value.to_le_bytes().into_iter();
                    self.known
                        .extend((first..=u16::MAX).zip(bytes).take(size.bytes().into()));
                    return Ok(());
                }
                Err(error) => self.error = Some(error.to_string()),
            }
            self.size = match size {
                AccessSize::Double => AccessSize::Word,
                AccessSize::Long | AccessSize::Word => AccessSize::Byte,
                AccessSize::Byte => {
                    self.failures += 1;
                    self.size = AccessSize::Double;
                    return Err(ProblemKind::ReadFailed { address });
                }
            };
        }
    }
}

/// Latin-1, as far as it can be shown.
fn character(byte: u8) -> char {
    let character = char::from(byte);
    if character.is_control() {
        '_'
    } else {
        character
    }
}
