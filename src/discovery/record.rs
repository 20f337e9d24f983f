//! One record of a remote.

use super::{
    DataDirection, DataRecord, DataType, ModeRecord, ModeType, ProblemKind, RemoteMemory,
    StringField,
    reader::{Reader, Unreadable},
};
use alloc::string::String;

/// Record types. Manual: 7I77, "RECORD_TYPE", "MODE DESCRIPTOR".
const DATA: u8 = 0xA0;
const MODE: u8 = 0xB0;

/// Where the strings begin. FACTS 7.1.
const UNIT: u16 = 14;
const MODE_NAME: u16 = 4;

/// Characters that clients keep. FACTS 7.1.
const KEPT: u16 = 48;

/// The widest number.
const NUMBER_BITS: u8 = 64;

/// A record of either kind.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Record {
    Data(DataRecord),
    Mode(ModeRecord),
}

/// Takes note of problems that do not make the record useless.
pub(super) trait Notes {
    fn note(&mut self, kind: ProblemKind);
}

impl<F: FnMut(ProblemKind)> Notes for F {
    fn note(&mut self, kind: ProblemKind) {
        self(kind);
    }
}

/// Reads the record at `address`; an error if there is nothing to be kept of it.
pub(super) fn read<M: RemoteMemory>(
    reader: &mut Reader<'_, M>,
    address: u16,
    notes: &mut impl Notes,
) -> Result<Record, ProblemKind> {
    let mut cursor = Cursor { reader, address };
    match cursor.byte(0)? {
        DATA => read_data(&mut cursor, notes).map(Record::Data),
        MODE => read_mode(&mut cursor, notes).map(Record::Mode),
        found => Err(ProblemKind::UnknownRecordType { found }),
    }
}

/// Manual: 7I77, "PROCESS DATA DESCRIPTOR"; FACTS 7.1 for the offsets.
fn read_data<M: RemoteMemory>(
    cursor: &mut Cursor<'_, '_, M>,
    notes: &mut impl Notes,
) -> Result<DataRecord, ProblemKind> {
    let [bits, data_type, direction] = cursor.bytes(1)?;
    let found = direction;
    let direction =
        DataDirection::from_byte(found).ok_or(ProblemKind::IllegalDirection { found })?;
    let data_type = DataType::from_byte(data_type);
    check_type(data_type, bits, notes)?;
    let limits = [cursor.bytes(4)?, cursor.bytes(8)?].map(f32::from_le_bytes);
    let [min, max] = check_limits(data_type, limits, notes);
    let address = u16::from_le_bytes(cursor.bytes(12)?);
    let (unit, length) = cursor.string(UNIT, StringField::Unit, notes)?;
    let (name, _) = cursor.string(UNIT + length + 1, StringField::Name, notes)?;
    Ok(DataRecord {
        record_address: cursor.address,
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
fn read_mode<M: RemoteMemory>(
    cursor: &mut Cursor<'_, '_, M>,
    notes: &mut impl Notes,
) -> Result<ModeRecord, ProblemKind> {
    let [index, mode_type] = cursor.bytes(1)?;
    let (name, _) = cursor.string(MODE_NAME, StringField::Name, notes)?;
    Ok(ModeRecord {
        record_address: cursor.address,
        index,
        mode_type: ModeType::from_byte(mode_type),
        name,
    })
}

fn check_type(data_type: DataType, bits: u8, notes: &mut impl Notes) -> Result<(), ProblemKind> {
    if bits == 0 {
        return Err(ProblemKind::NoBits);
    }
    match data_type {
        DataType::Float | DataType::NonvolFloat if bits != 32 && bits != 64 => {
            Err(ProblemKind::FloatSize { bits })
        }
        DataType::Unsigned
        | DataType::Signed
        | DataType::NonvolUnsigned
        | DataType::NonvolSigned
        | DataType::Encoder
        | DataType::EncoderHigh
        | DataType::EncoderLow
            if bits > NUMBER_BITS =>
        {
            let limit = NUMBER_BITS;
            Err(ProblemKind::TooManyBits { bits, limit })
        }
        DataType::Unknown(found) => {
            notes.note(ProblemKind::UnknownDataType { found });
            Ok(())
        }
        _ => Ok(()),
    }
}

/// Limits mean something for numbers only. Manual: 7I77, "PARAMETER_MIN".
fn check_limits(data_type: DataType, limits: [f32; 2], notes: &mut impl Notes) -> [f32; 2] {
    let [min, max] = limits;
    let scaled = matches!(
        data_type,
        DataType::Unsigned
            | DataType::Signed
            | DataType::NonvolUnsigned
            | DataType::NonvolSigned
            | DataType::Float
            | DataType::NonvolFloat
    );
    if !(min.is_finite() && max.is_finite()) {
        // FACTS 11.10: without limits.
        let is_float = matches!(data_type, DataType::Float | DataType::NonvolFloat);
        let is_unlimited = is_float && !min.is_nan() && !max.is_nan();
        if scaled && !is_unlimited {
            notes.note(ProblemKind::LimitsNotFinite { min, max });
        }
        return [0.0; 2];
    }
    if scaled && min > max {
        notes.note(ProblemKind::LimitsReversed { min, max });
    }
    limits
}

/// The bytes of one record.
struct Cursor<'r, 'm, M: RemoteMemory> {
    reader: &'r mut Reader<'m, M>,
    address: u16,
}

impl<M: RemoteMemory> Cursor<'_, '_, M> {
    fn byte(&mut self, offset: u16) -> Result<u8, ProblemKind> {
        let address = self.address.checked_add(offset);
        let address = address.ok_or(ProblemKind::PastEnd)?;
        let byte = self.reader.byte(address);
        byte.map_err(|unreadable| problem_of(unreadable, self.reader.accesses()))
    }

    fn bytes<const N: usize>(&mut self, offset: u16) -> Result<[u8; N], ProblemKind> {
        let mut bytes = [0; N];
        for (offset, byte) in (offset..=u16::MAX).zip(&mut bytes) {
            *byte = self.byte(offset)?;
        }
        Ok(bytes)
    }

    /// The string at `offset`, and its length without its end.
    fn string(
        &mut self,
        offset: u16,
        field: StringField,
        notes: &mut impl Notes,
    ) -> Result<(String, u16), ProblemKind> {
        let limit = self.reader.limits().string;
        let mut text = String::new();
        for length in 0..=limit {
            let place = offset.checked_add(length).ok_or(ProblemKind::PastEnd)?;
            match self.byte(place)? {
                0 => {
                    if length > KEPT {
                        notes.note(ProblemKind::StringTooLong {
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
            characters: limit,
        })
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

pub(super) const fn problem_of(unreadable: Unreadable, accesses: u32) -> ProblemKind {
    match unreadable {
        Unreadable::Failed(address) => ProblemKind::ReadFailed { address },
        Unreadable::GaveUp => ProblemKind::GaveUp { accesses },
    }
}
