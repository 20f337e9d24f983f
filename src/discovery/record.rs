//! Bytes and records of a remote's memory, read with as few accesses as possible.

use super::{DataDirection, DataRecord, DataType, ModeRecord, ModeType, ProblemKind};
use crate::advice;
use crate::lbp::RemoteLink;
use crate::sslbp::{AccessSize, RemoteAccess};
use alloc::{
    collections::BTreeMap,
    format,
    string::{String, ToString},
    vec::Vec,
};

/// Number of unreadable addresses after which discovery gives up; each costs some hundred
/// milliseconds.
const FAILURES: u32 = 4;

/// Largest number of characters of a string, not counting its end.
const CHARACTERS: u16 = 255;

/// Number of characters that are kept, as in other clients. FACTS 7.1.
const KEPT: u16 = 48;

/// Record types. Manual: 7I77, "RECORD_TYPE", "MODE DESCRIPTOR".
const DATA: u8 = 0xA0;
const MODE: u8 = 0xB0;

/// Offsets of the strings. FACTS 7.1.
const UNIT: u16 = 14;
const MODE_NAME: u16 = 4;

/// A record of either kind.
pub(super) enum Record {
    Data(DataRecord),
    Mode(ModeRecord),
}

/// Reads ahead in doubles, and never reads a byte twice.
pub(super) struct Reader<'m, M> {
    memory: &'m mut M,
    most_accesses: u32,
    /// Bytes read up to now; at most eight for each access.
    known: BTreeMap<u16, u8>,
    /// The largest access size that works with this remote.
    size: AccessSize,
    pub accesses: u32,
    failures: u32,
    /// The last access that failed.
    pub error: Option<String>,
    /// Addresses of all records read or tried.
    pub seen: Vec<u16>,
    /// Problems of the present record that do not make it useless.
    pub notes: Vec<ProblemKind>,
}

impl<'m, M: RemoteLink> Reader<'m, M> {
    pub fn new(memory: &'m mut M, most_accesses: u32) -> Self {
        Self {
            memory,
            most_accesses,
            known: BTreeMap::new(),
            size: AccessSize::Double,
            accesses: 0,
            failures: 0,
            error: None,
            seen: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Reads the record at `address`; an error if nothing of it is usable.
    pub fn record(&mut self, address: u16) -> Result<Record, ProblemKind> {
        match self.byte(address, 0)? {
            DATA => self.data(address).map(Record::Data),
            MODE => self.mode(address).map(Record::Mode),
            found => {
                let expected = "A0 (data) or B0 (mode)";
                Err(ProblemKind::illegal("type", byte(found), expected))
            }
        }
    }

    /// Manual: 7I77, "PROCESS DATA DESCRIPTOR"; FACTS 7.1 for the offsets.
    fn data(&mut self, record_address: u16) -> Result<DataRecord, ProblemKind> {
        let [bits, data_type, direction] = self.bytes(record_address, 1)?;
        let direction = DataDirection::from_byte(direction).ok_or_else(|| {
            let expected = "00 (input), 40 (both) or 80 (output)";
            ProblemKind::illegal("direction", byte(direction), expected)
        })?;
        let data_type = DataType::from_byte(data_type);
        data_type.check_width(bits.into())?;
        if let DataType::Unknown(found) = data_type {
            let found = byte(found);
            self.note_odd(format!(
                "data type {found} is not known; its bits are kept as they are"
            ));
        }
        let min = f32::from_le_bytes(self.bytes(record_address, 4)?);
        let max = f32::from_le_bytes(self.bytes(record_address, 8)?);
        let (min, max) = self.limits(data_type, min, max);
        let address = self.word(record_address, 12)?;
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

    /// Checks the limits, which have a meaning for numbers only. Manual: 7I77, "PARAMETER_MIN".
    fn limits(&mut self, data_type: DataType, min: f32, max: f32) -> (f32, f32) {
        use DataType::{Float, NonvolFloat, NonvolSigned, NonvolUnsigned, Signed, Unsigned};
        let is_float = matches!(data_type, Float | NonvolFloat);
        let is_whole = matches!(data_type, Unsigned | Signed | NonvolUnsigned | NonvolSigned);
        let is_finite = min.is_finite() && max.is_finite();
        // FACTS 11.10: a float without limits has infinite ones.
        if !is_finite && (is_whole || is_float && (min.is_nan() || max.is_nan())) {
            self.notes.push(ProblemKind::Odd {
                what: format!(
                    "limits {min} to {max} are not finite; its pins have a full scale of 1 instead"
                ),
                advice: Some(advice::CHECK_SCALE),
            });
        }
        if is_finite && (is_whole || is_float) && min > max {
            let found = format!("{min} to {max}");
            let expected = "the smaller limit first";
            self.notes
                .push(ProblemKind::illegal("range", found, expected));
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
                        self.note_odd(format!(
                            "{field} has {length} characters, of which {KEPT} are kept"
                        ));
                    }
                    return Ok((text, length));
                }
                // Latin-1; control characters become `_`.
                byte if length < KEPT => text.push(match char::from(byte) {
                    character if character.is_control() => '_',
                    character => character,
                }),
                _ => {}
            }
        }
        let found = format!("without end within {CHARACTERS} characters");
        Err(ProblemKind::illegal(field, found, "a zero behind it"))
    }

    fn note_odd(&mut self, what: String) {
        let advice = None;
        self.notes.push(ProblemKind::Odd { what, advice });
    }

    /// The word at `offset` from an address.
    pub fn word(&mut self, base: u16, offset: u16) -> Result<u16, ProblemKind> {
        self.bytes(base, offset).map(u16::from_le_bytes)
    }

    fn bytes<const N: usize>(&mut self, base: u16, offset: u16) -> Result<[u8; N], ProblemKind> {
        let mut bytes = [0; N];
        for (offset, byte) in (offset..).zip(&mut bytes) {
            *byte = self.byte(base, offset)?;
        }
        Ok(bytes)
    }

    fn byte(&mut self, base: u16, offset: u16) -> Result<u8, ProblemKind> {
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
            let read = RemoteAccess::Read {
                address: first,
                size,
            };
            match self.memory.access(None, read) {
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

fn byte(found: u8) -> String {
    format!("{found:#04X}")
}
