//! Recordings of the SSLBP gateware. The format is described in `tests/transcripts/index.txt`;
//! times are nanoseconds.

use mesa_hal_sim::sslbp::Register;
use mesa_hal_sim::wire::Nanos;

use super::{Recording, decimal, hexadecimal, split};

pub type Entry = super::Entry<Event>;

/// A recorded file.
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

/// The content of a line.
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
    /// Set-up of a remote, or an event in it: the text after `sim remote<n> `.
    Remote { remote: u8, text: String },
    /// Chatter on the wire is not recorded from here on.
    WireLogOff,
    /// A remark.
    Note(String),
}

impl Recording for Transcript {
    type Event = Event;

    fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            channels: 0,
            clock_hz: 0,
            entries: Vec::new(),
        }
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn take(&mut self, line: usize, text: &str) -> Result<(), String> {
        if let Some(comment) = text.strip_prefix('#') {
            return if line == 2 {
                self.header(comment)
            } else {
                Ok(())
            };
        }
        let (time, event) = parse_line(text)?;
        self.push(line, time, event)
    }

    fn is_complete(&self) -> bool {
        self.channels != 0 && !self.entries.is_empty()
    }

    fn entries_mut(&mut self) -> &mut Vec<Entry> {
        &mut self.entries
    }
}

impl Transcript {
    /// Parses channels and clock from `gateware ..., 8 channels, ClockLow=ClockMed=100 MHz, ...`.
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
