//! Recordings of the gateware's modules. The format is described in
//! `tests/transcripts/modules/index.txt`; times are nanoseconds.

use mesa_hal_sim::wire::Nanos;

use crate::common::recording::{self, Recording, decimal, hexadecimal, split};
use crate::register::Register;

pub type Entry = recording::Entry<Event>;

/// A recorded file.
#[derive(Clone, Debug)]
pub struct Transcript {
    /// File name without directory and extension.
    pub name: String,
    /// Its comments, without `#`; the first one describes the file.
    pub comments: Vec<String>,
    /// All lines, in order.
    pub entries: Vec<Entry>,
    /// The duty lines of a PWM file, in order.
    pub duties: Vec<Duty>,
}

/// The level of a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// 0.
    Low,
    /// 1.
    High,
    /// Not driven, pulled up.
    Released,
    /// Bench and FPGA drive against each other.
    Conflict,
}

/// A word of which some digits are not driven by any module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusWord {
    /// The driven digits; the others are 0.
    pub value: u32,
    /// F in each driven digit.
    pub driven: u32,
}

/// The content of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A register takes a value.
    Write { register: Register, value: u32 },
    /// A register is read.
    Read { register: Register, word: BusWord },
    /// Level of an FPGA pin after this time.
    Pin { pin: String, level: Level },
    /// The bench drives a pin, or releases it.
    Drive { pin: String, level: Level },
    /// The lines A, B, Z of an encoder, in front of the multiplexer.
    Encoder { encoder: u8, abz: [bool; 3] },
    /// An input at the external multiplexer.
    Input { input: u8, level: bool },
    /// A remark.
    Note(String),
}

/// Time for which a pin was high in a window.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Duty {
    /// Line number in the file, from 1.
    pub line: usize,
    /// End of the window.
    pub end: Nanos,
    /// The pin.
    pub pin: String,
    /// Time at 1.
    pub high: Nanos,
    /// Length of the window.
    pub of: Nanos,
    /// Rising edges in the window.
    pub rising: u64,
    /// VALUE of generators 0 to 3.
    pub values: [u32; 4],
}

impl Recording for Transcript {
    type Event = Event;

    fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            comments: Vec::new(),
            entries: Vec::new(),
            duties: Vec::new(),
        }
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn take(&mut self, line: usize, text: &str) -> Result<(), String> {
        if let Some(comment) = text.strip_prefix('#') {
            self.comments.push(comment.trim().to_owned());
            return Ok(());
        }
        let (time, rest) = split(text)?;
        let time = number(time)?;
        let (what, rest) = split(rest)?;
        if what == "duty" {
            self.duties.push(parse_duty(line, time, rest)?);
            return Ok(());
        }
        if !self.duties.is_empty() {
            return Err("an event behind the duty lines".to_owned());
        }
        self.push(line, time, parse_event(what, rest)?)
    }

    fn is_complete(&self) -> bool {
        !self.comments.is_empty() && !self.entries.is_empty()
    }

    fn entries_mut(&mut self) -> &mut Vec<Entry> {
        &mut self.entries
    }
}

fn parse_event(what: &str, rest: &str) -> Result<Event, String> {
    if what == "note" {
        return Ok(Event::Note(rest.to_owned()));
    }
    let (first, second) = split(rest)?;
    match what {
        "write" => Ok(Event::Write {
            register: Register::parse(first)?,
            value: Some(word(second)?)
                .filter(|word| word.driven == u32::MAX)
                .map(|word| word.value)
                .ok_or_else(|| format!("not a value to write: {second:?}"))?,
        }),
        "read" => Ok(Event::Read {
            register: Register::parse(first)?,
            word: word(second)?,
        }),
        "pin" => Ok(Event::Pin {
            pin: pin_name(first)?,
            level: level(second)?,
        }),
        "drive" => Ok(Event::Drive {
            pin: pin_name(first)?,
            level: Some(level(second)?)
                .filter(|&level| level != Level::Conflict)
                .ok_or_else(|| format!("not a level to drive: {second:?}"))?,
        }),
        "input" => Ok(Event::Input {
            input: small_number(first, 32)?,
            level: bit(second)?,
        }),
        _ => {
            let encoder = what
                .strip_prefix("enc")
                .filter(|_| first == "ABZ")
                .ok_or_else(|| format!("unknown kind of line: {what:?}"))?;
            let bits = second.split("").filter(|bit| !bit.is_empty()).map(bit);
            let bits = bits.collect::<Result<Vec<_>, _>>()?;
            Ok(Event::Encoder {
                encoder: small_number(encoder, 32)?,
                abz: bits
                    .try_into()
                    .map_err(|_| format!("not the levels of A, B and Z: {second:?}"))?,
            })
        }
    }
}

/// `PIN high=<ns> of=<ns> ratio=<part> rising=<n> ; <four values>`
fn parse_duty(line: usize, end: Nanos, rest: &str) -> Result<Duty, String> {
    let words: Vec<&str> = rest.split(' ').collect();
    let [pin, high, of, ratio, rising, ";", values @ ..] = words.as_slice() else {
        return Err(format!("not a duty line: {rest:?}"));
    };
    let field = |text: &str, name: &str| {
        let value = text
            .strip_prefix(name)
            .and_then(|text| text.strip_prefix('='));
        value
            .map(str::to_owned)
            .ok_or_else(|| format!("not {name}=: {text:?}"))
    };
    let values = values.iter().map(|digits| hexadecimal(digits, 8));
    let values = values.collect::<Result<Vec<_>, _>>()?;
    let duty = Duty {
        line,
        end,
        pin: pin_name(pin)?,
        high: number(&field(high, "high")?)?,
        of: number(&field(of, "of")?)?,
        rising: number(&field(rising, "rising")?)?,
        values: values
            .try_into()
            .map_err(|_| "not four values behind the semicolon".to_owned())?,
    };
    let ratio: f64 = field(ratio, "ratio")?
        .parse()
        .map_err(|error| format!("{error}"))?;
    let consistent = duty.of > 0
        && duty.of <= duty.end
        && duty.high <= duty.of
        && (ratio - duty.high as f64 / duty.of as f64).abs() < 1e-6;
    consistent
        .then_some(duty)
        .ok_or_else(|| "high, of and ratio contradict each other".to_owned())
}

/// A number in decimal, nothing else.
fn number(text: &str) -> Result<u64, String> {
    decimal(text, 0)
}

fn small_number(text: &str, limit: u64) -> Result<u8, String> {
    let number = number(text)?;
    Some(number)
        .filter(|&number| number < limit)
        .map(|number| number as u8)
        .ok_or_else(|| format!("{text} must be below {limit}"))
}

fn bit(text: &str) -> Result<bool, String> {
    match text {
        "0" => Ok(false),
        "1" => Ok(true),
        _ => Err(format!("not a level: {text:?}")),
    }
}

fn level(text: &str) -> Result<Level, String> {
    match text {
        "0" => Ok(Level::Low),
        "1" => Ok(Level::High),
        "z" => Ok(Level::Released),
        "X" => Ok(Level::Conflict),
        _ => Err(format!("not the level of a pin: {text:?}")),
    }
}

/// Names of pins: the text before the number, and its number of digits.
const PINS: [(&str, usize); 25] = [
    ("IO", 2),
    ("PWM", 1),
    ("PWMB", 1),
    ("/ENA", 1),
    ("LED", 1),
    ("SSR", 1),
    ("SSRREF", 0),
    ("MUXSEL", 0),
    ("MUXSEL_A", 0),
    ("MUXSEL_B", 0),
    ("MUXADR", 1),
    ("MASK", 1),
    ("PROBE", 0),
    ("IN", 2),
    ("TIMER", 1),
    ("STEP", 1),
    ("DIR", 1),
    ("TABLE2_", 1),
    ("TABLE3_", 1),
    ("TABLE4_", 1),
    ("TABLE5_", 1),
    ("INDEX", 1),
    ("A", 2),
    ("B", 2),
    ("Z", 2),
];

fn pin_name(text: &str) -> Result<String, String> {
    let known = PINS.iter().any(|(name, digits)| {
        let number = text.strip_prefix(name);
        number.is_some_and(|n| n.len() == *digits && n.bytes().all(|b| b.is_ascii_digit()))
    });
    (known || text == "REF")
        .then(|| text.to_owned())
        .ok_or_else(|| format!("unknown pin: {text:?}"))
}

/// `0x` and eight digits, `-` for a digit that is not driven.
fn word(text: &str) -> Result<BusWord, String> {
    let digits = text
        .strip_prefix("0x")
        .ok_or_else(|| format!("not a register value: {text:?}"))?;
    let known = digits.replace('-', "0");
    let mask: String = digits
        .chars()
        .map(|digit| if digit == '-' { '0' } else { 'F' })
        .collect();
    Ok(BusWord {
        value: hexadecimal(&known, 8)?,
        driven: hexadecimal(&mask, 8)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::recording::Unreadable;

    fn parse(lines: &str) -> Result<Transcript, Unreadable> {
        Transcript::parse("test", &format!("# what it shows\n{lines}"))
    }

    #[test]
    fn every_kind_of_line_is_read() {
        let transcript = parse(concat!(
            "0 pin /ENA0 z\n",
            "20 write PORT_DATA[2] 0x0001FFFF\n",
            "40 read PORT_DATA[0] 0x0001F-FF\n",
            "40 drive IO11 1\n",
            "40 pin IO11 X\n",
            "60 enc11 ABZ 101\n",
            "80 input 15 1\n",
            "90 note text with spaces\n",
            "100 duty PWM0 high=25 of=100 ratio=0.250000 rising=2 ; 00000001 80000000 00000000 00000000\n",
        ))
        .unwrap();
        let events: Vec<_> = transcript.entries.iter().map(|e| &e.event).collect();
        assert!(matches!(
            events[2],
            Event::Read {
                word: BusWord {
                    value: 0x0001_F0FF,
                    driven: 0xFFFF_F0FF
                },
                ..
            }
        ));
        assert_eq!(
            events[5],
            &Event::Encoder {
                encoder: 11,
                abz: [true, false, true]
            }
        );
        assert_eq!(transcript.duties[0].values, [1, 0x8000_0000, 0, 0]);
    }

    #[test]
    fn damaged_line_is_named() {
        for (damaged, line) in [
            ("20 write LED 0x1234\n", 2),
            ("20 write LED 0x1234----\n", 2),
            ("20 write LED[0] 0x12345678\n", 2),
            ("20 read MENC_COUNT 0x12345678\n", 2),
            ("20 read MENC_COUNT[32] 0x12345678\n", 2),
            ("20 read MENC_COUNT[01] 0x12345678\n", 2),
            ("20 read MENC 0x12345678\n", 2),
            ("20 note one\n10 note back in time\n", 3),
            ("20 pin IO1 0\n", 2),
            ("20 pin IO11 2\n", 2),
            ("20 drive IO11 X\n", 2),
            ("20 enc1 ABZ 10\n", 2),
            ("20 enc1 AB 100\n", 2),
            ("20 input 1 z\n", 2),
            ("20 turn 1 0\n", 2),
            ("2x note\n", 2),
            ("20 note\n", 2),
            ("\n", 2),
            (
                "20 duty PWM0 high=25 of=100 ratio=0.250000 rising=2 ; 00000001\n",
                2,
            ),
            ("20 note cut off", 2),
        ] {
            let error = parse(damaged).map_err(|error| error.line).err();
            assert_eq!(error, Some(line), "{damaged}");
        }
        assert!(Transcript::parse("test", "# only a comment\n").is_err());
        assert!(Transcript::parse("test", "20 note no comment\n").is_err());
    }
}
