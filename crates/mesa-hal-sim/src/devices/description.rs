//! The text that describes a remote.

use thiserror::Error;

/// The description of a remote.
///
/// One statement per line; `#` begins a comment; words are separated by blanks:
///
/// ```text
/// remote NAME                 four characters, once, first
/// unit NUMBER                 factory unit number (0x.. or decimal)
/// revision NUMBER             software revision (D5)
/// hardware INDEX NAME         hardware mode
/// mode INDEX NAME             a software mode; its process data follows
///   data NAME BITS TYPE DIRECTION [MIN MAX [UNIT]]
/// parameter NAME BITS TYPE DIRECTION [MIN MAX [UNIT]] [= VALUE]
/// working NAME BITS FROM      copy of the non-volatile parameter FROM, loaded at power-up; a
///                             parameter of that name, or memory without a record
/// watchdog NAME               the 16-bit working copy that holds the watchdog time in ms
/// baud-rate NAME              the non-volatile parameter with the index of the baud rate
/// unit-number NAME            the 32-bit parameter that holds the unit number
/// no-discovery                answers neither BB nor E6; mode 0 defines the process data
/// no-fault-byte               its process data is data only, without a fault byte (7I64)
/// clear-faults BYTE BIT       this bit of the process data clears the faults (7I64)
/// ```
///
/// TYPE: pad bits unsigned signed nonvol-unsigned nonvol-signed stream boolean encoder float
/// nonvol-float encoder-high encoder-low. DIRECTION: in out both.
///
/// Process data of one name is one value in all modes; where a later mode has fewer bits of it,
/// they are the low ones.
///
/// At power-up the EEPROM holds the factory values; writes of the host to it survive power cycles.
/// A parameter named `SwRevision` holds the revision of the running program, like D5, whatever its
/// VALUE is.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// The four characters of its name.
    pub name: [u8; 4],
    /// Factory unit number.
    pub unit: u32,
    /// Software revision.
    pub revision: u8,
    /// Hardware mode: index and name.
    pub hardware: (u8, String),
    /// Software modes.
    pub modes: Vec<SimMode>,
    /// Parameters, in the order of the GTOC.
    pub parameters: Vec<SimParameter>,
    /// Working copies.
    pub working: Vec<Working>,
    /// Name of the working watchdog time.
    pub watchdog: Option<String>,
    /// Name of the baud rate's parameter.
    pub baud_rate: Option<String>,
    /// Name of the unit number's parameter.
    pub unit_number: Option<String>,
    /// True if it has no discovery.
    pub no_discovery: bool,
    /// True if its process data has no fault byte.
    pub no_fault_byte: bool,
    /// Byte and bit of the outputs that clear the faults.
    pub clear_faults: Option<(u8, u8)>,
}

/// A software mode.
#[derive(Clone, Debug, PartialEq)]
pub struct SimMode {
    /// Its number.
    pub index: u8,
    /// Its name.
    pub name: String,
    /// Process data, in order.
    pub data: Vec<Record>,
}

/// The contents of a process-data record.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Its name.
    pub name: String,
    /// Size in bits.
    pub bits: u8,
    /// Type byte.
    pub kind: u8,
    /// Direction byte.
    pub direction: u8,
    /// Smallest value.
    pub min: f32,
    /// Largest value.
    pub max: f32,
    /// Unit.
    pub unit: String,
}

impl Record {
    /// Number of bytes of the value in memory.
    pub fn bytes(&self) -> usize {
        usize::from(self.bits).div_ceil(8)
    }

    /// True if the remote sends the value.
    pub const fn is_input(&self) -> bool {
        self.direction != OUT
    }

    /// True if the remote receives the value.
    pub const fn is_output(&self) -> bool {
        self.direction != IN
    }

    /// True if the value is stored in the EEPROM.
    pub const fn is_nonvolatile(&self) -> bool {
        matches!(self.kind, 0x04 | 0x05 | 0x11)
    }
}

/// A parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct SimParameter {
    /// Its record.
    pub record: Record,
    /// Raw factory value.
    pub value: u64,
}

/// Memory that is loaded from the EEPROM at power-up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Working {
    /// Its name.
    pub name: String,
    /// Size in bits.
    pub bits: u8,
    /// The non-volatile parameter from which it is loaded.
    pub from: String,
}

const IN: u8 = 0x00;
const BOTH: u8 = 0x40;
const OUT: u8 = 0x80;

const TYPES: [(&str, u8); 13] = [
    ("pad", 0x00),
    ("bits", 0x01),
    ("unsigned", 0x02),
    ("signed", 0x03),
    ("nonvol-unsigned", 0x04),
    ("nonvol-signed", 0x05),
    ("stream", 0x06),
    ("boolean", 0x07),
    ("encoder", 0x08),
    ("float", 0x10),
    ("nonvol-float", 0x11),
    ("encoder-high", 0x18),
    ("encoder-low", 0x28),
];

/// An error in a description, with its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DescriptionError {
    /// The first word of a line is not a statement.
    #[error(
        "line {line}: no such statement; see the list in the documentation of mesa_hal_sim::devices"
    )]
    Statement {
        /// The line, from 1.
        line: usize,
    },
    /// Too few or too many words.
    #[error("line {line}: words are missing, or there are too many")]
    Words {
        /// The line, from 1.
        line: usize,
    },
    /// A number is invalid or out of range.
    #[error("line {line}: a number is expected, within the range of its field")]
    Number {
        /// The line, from 1.
        line: usize,
    },
    /// A type or direction is invalid.
    #[error("line {line}: not a type, or not a direction (in, out, both)")]
    Kind {
        /// The line, from 1.
        line: usize,
    },
    /// The name of the remote is not four ASCII characters.
    #[error("line {line}: a remote's name has four ASCII characters")]
    Name {
        /// The line, from 1.
        line: usize,
    },
    /// `data` before any `mode`.
    #[error("line {line}: data belongs to a mode; begin one with `mode INDEX NAME`")]
    DataWithoutMode {
        /// The line, from 1.
        line: usize,
    },
    /// A required statement is missing.
    #[error("a description needs `remote NAME` and at least one mode")]
    Incomplete,
    /// A name is used without a definition.
    #[error(
        "`working`, `watchdog`, `baud-rate` or `unit-number` names a parameter that is not there"
    )]
    UnknownName,
    /// Two elements of the same name differ in more than that the later one is narrower.
    #[error("process data of the same name must be alike in all modes, or narrower in later ones")]
    Conflict,
    /// The process data exceeds a frame.
    #[error("mode {mode} has more process data than a frame holds (30 bytes each way)")]
    TooMuchData {
        /// The mode.
        mode: u8,
    },
    /// The records do not fit below 8000 in memory.
    #[error("the records do not fit into memory; use fewer or shorter names")]
    TooManyRecords,
}

/// The statements that have a fixed number of words.
const STATEMENTS: [&str; 12] = [
    "remote",
    "unit",
    "revision",
    "hardware",
    "mode",
    "working",
    "watchdog",
    "baud-rate",
    "unit-number",
    "no-discovery",
    "no-fault-byte",
    "clear-faults",
];

impl Description {
    /// Parses a description.
    pub fn parse(text: &str) -> Result<Self, DescriptionError> {
        let mut parsed = Self {
            name: *b"    ",
            unit: 0,
            revision: 14,
            hardware: (0, "standard".to_owned()),
            modes: Vec::new(),
            parameters: Vec::new(),
            working: Vec::new(),
            watchdog: None,
            baud_rate: None,
            unit_number: None,
            no_discovery: false,
            no_fault_byte: false,
            clear_faults: None,
        };
        let mut named = false;
        for (index, line) in text.lines().enumerate() {
            let words = line.split('#').next().unwrap_or_default();
            let words: Vec<&str> = words.split_whitespace().collect();
            if let Some((&statement, words)) = words.split_first() {
                parsed.statement(index + 1, statement, words)?;
                named |= statement == "remote";
            }
        }
        if named && !parsed.modes.is_empty() {
            Ok(parsed)
        } else {
            Err(DescriptionError::Incomplete)
        }
    }

    fn statement(
        &mut self,
        line: usize,
        statement: &str,
        words: &[&str],
    ) -> Result<(), DescriptionError> {
        match (statement, words) {
            ("remote", [name]) => {
                let name = name.as_bytes().try_into();
                self.name = name.map_err(|_| DescriptionError::Name { line })?;
            }
            ("unit", [value]) => self.unit = number(line, value, u32::MAX.into())? as u32,
            ("revision", [value]) => self.revision = number(line, value, 0xFF)? as u8,
            ("hardware", [index, name]) => {
                self.hardware = (number(line, index, 0xFF)? as u8, (*name).to_owned());
            }
            ("mode", [index, name]) => self.modes.push(SimMode {
                index: number(line, index, crate::remote::MAX_MODES as u64 - 1)? as u8,
                name: (*name).to_owned(),
                data: Vec::new(),
            }),
            ("data", words) => {
                let mode = self.modes.last_mut();
                let mode = mode.ok_or(DescriptionError::DataWithoutMode { line })?;
                mode.data.push(record(line, words)?);
            }
            ("parameter", words) => self.parameters.push(parameter(line, words)?),
            ("working", [name, bits, from]) => self.working.push(Working {
                name: (*name).to_owned(),
                bits: number(line, bits, 64)? as u8,
                from: (*from).to_owned(),
            }),
            ("watchdog", [name]) => self.watchdog = Some((*name).to_owned()),
            ("baud-rate", [name]) => self.baud_rate = Some((*name).to_owned()),
            ("unit-number", [name]) => self.unit_number = Some((*name).to_owned()),
            ("no-discovery", []) => self.no_discovery = true,
            ("no-fault-byte", []) => self.no_fault_byte = true,
            ("clear-faults", [byte, bit]) => {
                let place = (number(line, byte, 29)? as u8, number(line, bit, 7)? as u8);
                self.clear_faults = Some(place);
            }
            (statement, _) if STATEMENTS.contains(&statement) => {
                return Err(DescriptionError::Words { line });
            }
            _ => return Err(DescriptionError::Statement { line }),
        }
        Ok(())
    }
}

fn parameter(line: usize, words: &[&str]) -> Result<SimParameter, DescriptionError> {
    let (words, value) = match words {
        [words @ .., "=", value] => (words, number(line, value, u64::MAX)?),
        words => (words, 0),
    };
    let record = record(line, words)?;
    Ok(SimParameter { record, value })
}

fn record(line: usize, words: &[&str]) -> Result<Record, DescriptionError> {
    let [name, bits, kind, direction, rest @ ..] = words else {
        return Err(DescriptionError::Words { line });
    };
    let (min, max, unit) = match rest {
        [] => (0.0, 0.0, ""),
        [min, max] => (float(line, min)?, float(line, max)?, ""),
        [min, max, unit] => (float(line, min)?, float(line, max)?, *unit),
        _ => return Err(DescriptionError::Words { line }),
    };
    let kind = TYPES.iter().find(|(word, _)| word == kind);
    let &(_, kind) = kind.ok_or(DescriptionError::Kind { line })?;
    let bits = number(line, bits, 255)? as u8;
    if bits == 0 {
        return Err(DescriptionError::Number { line });
    }
    Ok(Record {
        name: (*name).to_owned(),
        bits,
        kind,
        direction: match *direction {
            "in" => IN,
            "out" => OUT,
            "both" => BOTH,
            _ => return Err(DescriptionError::Kind { line }),
        },
        min,
        max,
        unit: unit.to_owned(),
    })
}

fn number(line: usize, text: &str, max: u64) -> Result<u64, DescriptionError> {
    let value = match text.strip_prefix("0x") {
        Some(hex) => u64::from_str_radix(hex, 16).ok(),
        None => text.parse().ok(),
    };
    value
        .filter(|&value| value <= max)
        .ok_or(DescriptionError::Number { line })
}

fn float(line: usize, text: &str) -> Result<f32, DescriptionError> {
    let value = text.parse::<f32>().ok().filter(|value| !value.is_nan());
    value.ok_or(DescriptionError::Number { line })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn mistakes_are_named_with_their_line() {
        let parse = Description::parse;
        assert_eq!(parse(""), Err(DescriptionError::Incomplete));
        assert_eq!(parse("remote ABC"), Err(DescriptionError::Name { line: 1 }));
        assert_eq!(
            parse("remote ABCD\ndata X 8 bits in"),
            Err(DescriptionError::DataWithoutMode { line: 2 })
        );
        assert_eq!(
            parse("remote ABCD\nmode 0 a\n# c\ndata X 8 bit in"),
            Err(DescriptionError::Kind { line: 4 })
        );
        assert_eq!(
            parse("remote ABCD\nmode 0 a\ndata X 256 bits in"),
            Err(DescriptionError::Number { line: 3 })
        );
        assert_eq!(
            parse("remote ABCD\nfrob"),
            Err(DescriptionError::Statement { line: 2 })
        );
        assert_eq!(
            parse("remote ABCD\nmode 0"),
            Err(DescriptionError::Words { line: 2 })
        );
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "([a-z0-9= -]{0,30}\n){0,8}") {
            let _ = Description::parse(&text);
        }
    }
}
