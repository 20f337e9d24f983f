//! Reads a transcript of the gateware: one event for each line, times in nanoseconds.
//!
//! The format is described in `tests/transcripts/index.txt`. Nothing is skipped: a line that does
//! not parse is an error that names file and line.

use std::fmt;
use std::path::Path;

use mesa_hal::sim::sslbp::Register;
use mesa_hal::sim::wire::Nanos;

/// One file.
#[derive(Clone, Debug)]
pub struct Transcript {
    /// File name without directory and extension.
    pub name: String,
    /// Channels of the recorded build, from the second header line.
    pub channels: u8,
    /// ClockLow in hertz, from the second header line.
    pub clock_hz: u32,
    /// All lines after the header, in order.
    pub entries: Vec<Entry>,
}

/// One line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Line number in the file, from 1.
    pub line: usize,
    /// The time at the beginning of the line.
    pub time: Nanos,
    /// What happened.
    pub event: Event,
}

/// What a line says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// The host wrote a register.
    Write { register: Register, value: u32 },
    /// The host read a register.
    Read { register: Register, value: u32 },
    /// The host waited for COMMAND to read 0.
    Poll {
        value: u32,
        waited: Nanos,
        timed_out: bool,
    },
    /// The FPGA sent a burst; the entry's time is its end.
    FromFpga {
        channel: u8,
        start: Nanos,
        bytes: Vec<u8>,
    },
    /// The remote sent a burst (or a break of the same length); the entry's time is its end.
    ToFpga {
        channel: u8,
        start: Nanos,
        is_break: bool,
        bytes: Vec<u8>,
    },
    /// Set-up of a remote, or an event in it: what follows `sim remote<n> `.
    Remote { remote: u8, text: String },
    /// From here on chatter on the wire is not written down.
    WireLogOff,
    /// A remark.
    Note(String),
}

/// A line that could not be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unreadable {
    /// File name.
    pub file: String,
    /// Line number, from 1.
    pub line: usize,
    /// What is wrong with it.
    pub reason: String,
}

impl fmt::Display for Unreadable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, line {}: {}", self.file, self.line, self.reason)
    }
}

impl Transcript {
    /// Reads the file at `path`.
    pub fn load(path: &Path) -> Result<Self, Unreadable> {
        let name = path
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let text = std::fs::read_to_string(path).map_err(|error| Unreadable {
            file: name.clone(),
            line: 0,
            reason: error.to_string(),
        })?;
        Self::parse(&name, &text)
    }

    /// Parses the text of a transcript.
    pub fn parse(name: &str, text: &str) -> Result<Self, Unreadable> {
        let mut transcript = Self {
            name: name.to_owned(),
            channels: 0,
            clock_hz: 0,
            entries: Vec::new(),
        };
        let mut previous = 0;
        for (index, line) in text.lines().enumerate() {
            let line_number = index + 1;
            let fail = |reason: String| Unreadable {
                file: name.to_owned(),
                line: line_number,
                reason,
            };
            if let Some(comment) = line.strip_prefix('#') {
                if line_number == 2 {
                    transcript.header(comment).map_err(fail)?;
                }
            } else if !line.trim().is_empty() {
                let (time, event) = parse_line(line).map_err(fail)?;
                if time < previous {
                    return Err(fail(
                        "its time is before that of the line before".to_owned(),
                    ));
                }
                previous = time;
                transcript.entries.push(Entry {
                    line: line_number,
                    time,
                    event,
                });
            }
        }
        let complete = text.ends_with('\n') && transcript.channels != 0;
        if complete && !transcript.entries.is_empty() {
            return Ok(transcript);
        }
        Err(Unreadable {
            file: name.to_owned(),
            line: text.lines().count(),
            reason: "the file has no header, no entries, or ends in the middle of a line"
                .to_owned(),
        })
    }

    /// Takes channels and clock from `gateware ..., 8 channels, ClockLow=ClockMed=100 MHz, ...`.
    fn header(&mut self, comment: &str) -> Result<(), String> {
        for part in comment.split(',').map(str::trim) {
            if let Some(channels) = part
                .strip_suffix(" channels")
                .or(part.strip_suffix(" channel"))
            {
                self.channels = channels
                    .parse()
                    .ok()
                    .filter(|n| (1..=8).contains(n))
                    .ok_or_else(|| format!("not a number of channels: {channels:?}"))?;
            } else if let Some(clock) = part.strip_suffix(" MHz") {
                let megahertz = clock.rsplit('=').next().unwrap_or(clock);
                let hertz = decimal(megahertz, 6)?;
                self.clock_hz = u32::try_from(hertz).map_err(|error| error.to_string())?;
            }
        }
        if self.channels == 0 || self.clock_hz == 0 {
            return Err("the second line does not name channels and clock".to_owned());
        }
        Ok(())
    }
}

fn parse_line(line: &str) -> Result<(Nanos, Event), String> {
    let (time, rest) = split(line)?;
    let time = decimal(time, 3)?;
    let (who, rest) = split(rest)?;
    let event = match who {
        "host" => parse_host(rest)?,
        "sim" => parse_sim(rest)?,
        "note" => Event::Note(rest.to_owned()),
        _ => {
            let channel = who
                .strip_prefix("ch")
                .ok_or_else(|| format!("unknown kind of line: {who:?}"))?;
            parse_wire(small_number(channel)?, rest)?
        }
    };
    Ok((time, event))
}

fn parse_host(rest: &str) -> Result<Event, String> {
    let words: Vec<&str> = rest.split_whitespace().collect();
    match words.as_slice() {
        ["write", register, value] => Ok(Event::Write {
            register: parse_register(register)?,
            value: word(value)?,
        }),
        ["read", register, value] => Ok(Event::Read {
            register: parse_register(register)?,
            value: word(value)?,
        }),
        ["poll", "COMMAND", value, ";", waited, end @ ..] => {
            let timed_out = match end {
                [] => false,
                ["TIMEOUT"] => true,
                _ => return Err(format!("unknown end of a poll: {end:?}")),
            };
            let waited = waited
                .strip_prefix("waited=")
                .ok_or_else(|| format!("no waiting time: {waited:?}"))?;
            let value = word(value)?;
            if timed_out == (value == 0) {
                return Err("a poll ends with 0 or times out".to_owned());
            }
            Ok(Event::Poll {
                value,
                waited: decimal(waited, 3)?,
                timed_out,
            })
        }
        _ => Err(format!("unknown host line: {rest:?}")),
    }
}

fn parse_sim(rest: &str) -> Result<Event, String> {
    let (what, text) = split(rest)?;
    if let Some(remote) = what.strip_prefix("remote") {
        return Ok(Event::Remote {
            remote: small_number(remote)?,
            text: text.to_owned(),
        });
    }
    match (what, text) {
        ("wire", "log off") => Ok(Event::WireLogOff),
        _ => Err(format!("unknown sim line: {rest:?}")),
    }
}

fn parse_wire(channel: u8, rest: &str) -> Result<Event, String> {
    let (direction, rest) = split(rest)?;
    let (data, start) = rest
        .split_once(" ; start=")
        .ok_or_else(|| "a burst without its start".to_owned())?;
    let start = decimal(start, 3)?;
    let mut words = data.split_whitespace().peekable();
    let is_break = words.next_if_eq(&"BREAK").is_some();
    let bytes = words
        .map(|byte| hexadecimal(byte, 2).map(|byte| byte as u8))
        .collect::<Result<Vec<u8>, String>>()?;
    if bytes.is_empty() {
        return Err("a burst without characters".to_owned());
    }
    match direction {
        "fpga->remote" if !is_break => Ok(Event::FromFpga {
            channel,
            start,
            bytes,
        }),
        "remote->fpga" => Ok(Event::ToFpga {
            channel,
            start,
            is_break,
            bytes,
        }),
        _ => Err(format!("unknown direction: {direction:?}")),
    }
}

fn parse_register(text: &str) -> Result<Register, String> {
    match text {
        "COMMAND" => return Ok(Register::Command),
        "DATA" => return Ok(Register::Data),
        _ => {}
    }
    let (name, channel) = text
        .strip_suffix(']')
        .and_then(|text| text.split_once('['))
        .ok_or_else(|| format!("unknown register: {text:?}"))?;
    let channel = small_number(channel)?;
    match name {
        "CS" => Ok(Register::Cs(channel)),
        "IF0" | "IF1" | "IF2" | "IF3" | "IF4" | "IF5" | "IF6" => {
            Ok(Register::Interface(channel, name.as_bytes()[2] - b'0'))
        }
        _ => Err(format!("unknown register: {text:?}")),
    }
}

fn split(text: &str) -> Result<(&str, &str), String> {
    text.split_once(' ')
        .map(|(first, rest)| (first, rest.trim()))
        .ok_or_else(|| format!("the line ends after {text:?}"))
}

/// A channel or remote number: one digit, 0 to 7.
fn small_number(text: &str) -> Result<u8, String> {
    match text.as_bytes() {
        [digit @ b'0'..=b'7'] => Ok(digit - b'0'),
        _ => Err(format!("not a channel: {text:?}")),
    }
}

/// `0x` and eight digits.
fn word(text: &str) -> Result<u32, String> {
    let digits = text
        .strip_prefix("0x")
        .ok_or_else(|| format!("not a register value: {text:?}"))?;
    hexadecimal(digits, 8)
}

fn hexadecimal(text: &str, digits: usize) -> Result<u32, String> {
    if text.len() != digits || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return Err(format!("not {digits} hexadecimal digits: {text:?}"));
    }
    u32::from_str_radix(text, 16).map_err(|error| error.to_string())
}

/// A decimal number times 10^`scale`, exactly.
fn decimal(text: &str, scale: usize) -> Result<u64, String> {
    let bad = || format!("not a number: {text:?}");
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    if whole.is_empty() || !digits(whole) || !digits(fraction) || fraction.len() > scale {
        return Err(bad());
    }
    format!("{whole}{fraction:0<scale$}")
        .parse()
        .map_err(|_| bad())
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "# what\n# gateware x, 3 channels, ClockLow=ClockMed=100 MHz, 2.5 Mbaud\n";

    fn parse(lines: &str) -> Result<Transcript, Unreadable> {
        Transcript::parse("test", &format!("{HEADER}{lines}"))
    }

    #[test]
    fn every_kind_of_line_is_read() {
        let transcript = parse(concat!(
            "0.00 sim remote2 present=1 name=7I77\n",
            "1.50 host write IF2[7] 0xFFFF1234\n",
            "2.00 host poll COMMAND 0x00000000 ; waited=0.53\n",
            "12.06 ch1 fpga->remote EB 28 B7 ; start=2.00\n",
            "20.00 ch1 remote->fpga BREAK 00 ; start=16.00\n",
            "21.00 sim wire log off\n",
            "22.00 note text with spaces\n",
        ))
        .unwrap();
        assert_eq!((transcript.channels, transcript.clock_hz), (3, 100_000_000));
        let events: Vec<_> = transcript.entries.into_iter().map(|e| e.event).collect();
        assert_eq!(
            events[1],
            Event::Write {
                register: Register::Interface(7, 2),
                value: 0xFFFF_1234
            }
        );
        assert_eq!(
            events[2],
            Event::Poll {
                value: 0,
                waited: 530,
                timed_out: false
            }
        );
        assert_eq!(
            events[3],
            Event::FromFpga {
                channel: 1,
                start: 2_000,
                bytes: vec![0xEB, 0x28, 0xB7]
            }
        );
        assert!(matches!(events[4], Event::ToFpga { is_break: true, .. }));
        assert_eq!(events[5], Event::WireLogOff);
    }

    #[test]
    fn a_damaged_line_is_named() {
        for (damaged, line) in [
            ("1.00 host write CS[0] 0x1234\n", 3),
            ("1.00 host read CS[8] 0x00000000\n", 3),
            (
                "1.00 host write COMMAND 0x00000800\n0.50 note back in time\n",
                4,
            ),
            ("1.00 ch0 fpga->remote DG 16 ; start=0.00\n", 3),
            ("1.00 ch0 fpga->remote DF 16\n", 3),
            ("1.0x note\n", 3),
            (
                "1.00 host poll COMMAND 0x00000000 ; waited=1.00 TIMEOUT\n",
                3,
            ),
            ("1.00 guest read CS[0] 0x00000000\n", 3),
            ("1.00 note cut off", 3),
        ] {
            assert_eq!(
                parse(damaged).map_err(|error| error.line).err(),
                Some(line),
                "{damaged}"
            );
        }
        assert!(Transcript::parse("test", "# only\n# a header\n").is_err());
    }
}
