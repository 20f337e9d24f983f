//! A bus that replays the host's side of a gateware transcript at register level: what the driver
//! writes must be what was written there, and it reads what was read there.
//!
//! Local reads and stops of single channels that are not in the transcript are answered from a
//! small table, because the driver asks for more than the recording did.

use mesa_hal::bus::{Access, BusError, BusErrorKind, Direction, Instant, RegisterBus};
use mesa_hal::sslbp::{Channel, ChannelMask, Layout, SslbpModule};
use std::{collections::BTreeMap, path::PathBuf, time::Duration};

/// FACTS 9.2.
pub const MODULE: SslbpModule = SslbpModule {
    gtag: 0xC1,
    base: 0x5A00,
    registers: 6,
    register_stride: 0x100,
    instance_stride: 0x40,
    multiple_registers: 0x3C,
    instances: 1,
};

/// The text of a transcript.
pub fn transcript(name: &str) -> String {
    let path: PathBuf = [env!("CARGO_MANIFEST_DIR"), "tests", "transcripts", name]
        .iter()
        .collect();
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The memory of a remote as a transcript sets it up.
pub fn memory_of(text: &str, remote: &str) -> BTreeMap<u16, u8> {
    let mut memory = BTreeMap::new();
    for line in text.lines() {
        let mut words = line.split_whitespace().skip(1);
        if (words.next(), words.next(), words.next()) != (Some("sim"), Some(remote), Some("mem")) {
            continue;
        }
        let (Some(address), Some(bytes)) = (words.next(), words.next()) else {
            panic!("memory line without bytes: {line}");
        };
        let address = u16::from_str_radix(address.trim_start_matches("0x"), 16).unwrap();
        for (n, pair) in (0..).zip(bytes.as_bytes().chunks(2)) {
            let pair = std::str::from_utf8(pair).unwrap();
            memory.insert(address + n, u8::from_str_radix(pair, 16).unwrap());
        }
    }
    memory
}

/// A register as the transcripts name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reg {
    Command,
    Data,
    Cs(u8),
    Interface(u8, u8),
}

fn parse_register(name: &str) -> Reg {
    let channel = |name: &str| -> u8 { name.split(['[', ']']).nth(1).unwrap().parse().unwrap() };
    match name {
        "COMMAND" => Reg::Command,
        "DATA" => Reg::Data,
        _ if name.starts_with("CS") => Reg::Cs(channel(name)),
        _ if name.starts_with("IF") => Reg::Interface(channel(name), name[2..3].parse().unwrap()),
        _ => panic!("unknown register {name}"),
    }
}

/// From one write of COMMAND to the next.
#[derive(Clone, Debug, Default)]
pub struct Segment {
    pub command: u32,
    /// What was written before COMMAND.
    pub writes: Vec<(Reg, u32)>,
    /// Microseconds until COMMAND read 0.
    pub cleared: Option<f64>,
    /// What was read, with the microseconds since COMMAND was written.
    pub values: BTreeMap<Reg, Vec<(f64, u32)>>,
}

impl Segment {
    /// The last recorded value of a register.
    pub fn last(&self, register: Reg) -> Option<u32> {
        self.values.get(&register)?.last().map(|&(_, value)| value)
    }
}

/// The host's side of a transcript.
pub fn segments(text: &str) -> Vec<Segment> {
    let mut segments: Vec<Segment> = Vec::new();
    let mut writes = Vec::new();
    let mut begin = 0.0;
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let &[time, "host", verb, register, value, ..] = words.as_slice() else {
            continue;
        };
        let time: f64 = time.parse().unwrap();
        let value = u32::from_str_radix(&value[2..], 16).unwrap();
        match (verb, parse_register(register)) {
            ("write", Reg::Command) => {
                begin = time;
                segments.push(Segment {
                    command: value,
                    writes: std::mem::take(&mut writes),
                    ..Segment::default()
                });
            }
            ("write", register) => writes.push((register, value)),
            ("poll", Reg::Command) if !line.ends_with("TIMEOUT") => {
                if let Some(segment) = segments.last_mut() {
                    segment.cleared = Some(time - begin);
                }
            }
            ("read", register) if register != Reg::Command => {
                if let Some(segment) = segments.last_mut() {
                    let values = segment.values.entry(register).or_default();
                    values.push((time - begin, value));
                }
            }
            _ => {}
        }
    }
    segments
}

/// The sizes of all discovery replies (BB) of channel 0, in order.
pub fn size_replies(text: &str) -> Vec<(u8, u8)> {
    let mut asked = false;
    let mut sizes = Vec::new();
    for line in text.lines() {
        if line.contains("ch0 fpga->remote") {
            asked = line.contains("fpga->remote BB ");
        } else if let Some((_, reply)) = line.split_once("ch0 remote->fpga ").filter(|_| asked) {
            let bytes: Vec<u8> = reply
                .split_whitespace()
                .map_while(|byte| u8::from_str_radix(byte, 16).ok())
                .collect();
            sizes.push((bytes[0], bytes[1]));
        }
    }
    sizes
}

/// Replayed registers never fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the replay does not fail")]
pub struct NeverFails;

impl BusError for NeverFails {
    fn kind(&self) -> BusErrorKind {
        BusErrorKind::Other
    }
}

/// The bus.
#[derive(Debug)]
pub struct Replay {
    segments: Vec<Segment>,
    next: usize,
    now: u64,
    /// When the command that runs was written.
    begin: u64,
    busy: u32,
    cleared: Option<f64>,
    current: Option<Segment>,
    held: BTreeMap<Reg, u32>,
    written: BTreeMap<Reg, u32>,
    pub local: BTreeMap<u16, u8>,
    pub accesses: u32,
    pub exchanges: u32,
    /// Everything that was written to COMMAND, and whether it was busy then.
    pub commands: Vec<(u32, bool)>,
}

impl Replay {
    pub fn of(name: &str) -> Self {
        Self::new(segments(&transcript(name)))
    }

    pub fn new(segments: Vec<Segment>) -> Self {
        let mut local: BTreeMap<u16, u8> = (0u16..)
            .zip([0x12, 0x08, 0x01, 0x2B, 0x70, 0x32, 0xD8, 0x08])
            .collect();
        local.extend((0x230..).zip(100_000_000u32.to_le_bytes()));
        Self {
            segments,
            next: 0,
            now: 1_000_000,
            begin: 0,
            busy: 0,
            cleared: Some(0.0),
            current: None,
            held: BTreeMap::new(),
            written: BTreeMap::new(),
            local,
            accesses: 0,
            exchanges: 0,
            commands: Vec::new(),
        }
    }

    /// Leaves out segments that the test does not play.
    pub fn without(mut self, mut leave_out: impl FnMut(&Segment) -> bool) -> Self {
        self.segments.retain(|segment| !leave_out(segment));
        self
    }

    /// Another program has written the command of the next segment before.
    pub fn begin_inside(&mut self) {
        let segment = self.segments[self.next].clone();
        self.next += 1;
        self.begin = self.now;
        self.busy = segment.command & 0xFFFF;
        self.cleared = segment.cleared;
        self.current = Some(segment);
    }

    /// RXSize and TXSize that the port keeps for a channel.
    pub fn set_sizes(&mut self, channel: u8, rx: u8, tx: u8) {
        let start = 0x70 + 0x32 * u16::from(channel);
        self.local.insert(start + 0x2E, rx);
        self.local.insert(start + 0x2F, tx);
    }

    /// What the next command will be, and what it reads.
    pub fn upcoming(&self) -> Option<&Segment> {
        self.segments.get(self.next)
    }

    fn elapsed(&self) -> f64 {
        (self.now - self.begin) as f64 / 1000.0
    }

    fn is_busy(&self) -> bool {
        self.busy != 0 && self.cleared.is_none_or(|cleared| self.elapsed() < cleared)
    }

    fn decode(address: u16) -> Reg {
        let layout = Layout::new(&MODULE, 0, 8).unwrap();
        if address == layout.command() {
            return Reg::Command;
        }
        if address == layout.data() {
            return Reg::Data;
        }
        for channel in Channel::ALL {
            let registers = layout.channel(channel).unwrap();
            if registers.cs() == address {
                return Reg::Cs(channel.index());
            }
            for (n, interface) in (0..).zip(registers.interfaces()) {
                if interface == address {
                    return Reg::Interface(channel.index(), n);
                }
            }
        }
        panic!("access to {address:#06X}, which is no register of the port");
    }

    fn read_register(&self, register: Reg) -> u32 {
        if register == Reg::Command {
            return if self.is_busy() { self.busy } else { 0 };
        }
        let recorded = self.current.as_ref().and_then(|segment| {
            let values = segment.values.get(&register)?;
            // Wiping takes a little longer than STOPALL; the recording has both states.
            if segment.command == 0x0800 {
                return values.last();
            }
            let past = values.iter().rev().find(|(at, _)| *at <= self.elapsed());
            past.or_else(|| values.first())
        });
        recorded
            .map(|&(_, value)| value)
            .or_else(|| self.held.get(&register).copied())
            .unwrap_or(if matches!(register, Reg::Cs(_)) {
                0xC100
            } else {
                0
            })
    }

    fn write_command(&mut self, value: u32) {
        let busy = self.is_busy();
        self.commands.push((value, busy));
        self.keep_current();
        let scripted = self.upcoming().is_some_and(|next| next.command == value);
        if scripted {
            self.play();
        } else {
            self.improvise(value);
        }
        self.written.clear();
    }

    /// Ends the segment that runs: its last values stay.
    fn keep_current(&mut self) {
        let Some(segment) = self.current.take() else {
            return;
        };
        for (&register, values) in &segment.values {
            if let Some(&(_, value)) = values.last() {
                self.held.insert(register, value);
            }
        }
    }

    fn play(&mut self) {
        let mut segment = self.segments[self.next].clone();
        self.next += 1;
        if segment.command == 0x0800 {
            self.held.clear();
        }
        fill_in_started(&mut segment);
        if segment.command & 0xF000 == 0xA000 {
            self.store_local((segment.command & 0x0FFF) as u16);
        }
        for &(register, value) in &segment.writes {
            match self.written.get(&register) {
                Some(&written) => assert_eq!(
                    written, value,
                    "{register:?} before COMMAND {:04X}",
                    segment.command
                ),
                // The recording host wrote more interface registers than the remote takes.
                None => assert!(
                    value == 0 || matches!(register, Reg::Interface(..)),
                    "{register:?} = {value:08X} missing before COMMAND {:04X}",
                    segment.command
                ),
            }
        }
        self.begin = self.now;
        self.busy = segment.command & 0xFFFF;
        self.cleared = segment.cleared;
        self.current = Some(segment);
    }

    fn improvise(&mut self, command: u32) {
        let address = (command & 0x0FFF) as u16;
        match command & 0xF000 {
            0xA000 => self.store_local(address),
            0x2000 => {
                let value = self.local.get(&address).copied().unwrap_or(0);
                self.held.insert(Reg::Data, value.into());
            }
            0 if (0x0801..=0x08FF).contains(&command) => {
                for channel in ChannelMask::from_bits(command as u8).iter() {
                    self.held.insert(Reg::Cs(channel.index()), 0xC100);
                }
            }
            _ => panic!(
                "COMMAND {command:04X}, but the transcript goes on with {:04X?}",
                self.upcoming().map(|next| next.command)
            ),
        }
        self.begin = self.now;
        self.busy = command;
        self.cleared = Some(0.55);
    }

    fn store_local(&mut self, address: u16) {
        let value = self.written.get(&Reg::Data).copied().unwrap_or(0) as u8;
        self.local.insert(address, value);
    }

    fn write_register(&mut self, register: Reg, value: u32) {
        if register == Reg::Command {
            self.write_command(value);
        } else {
            self.written.insert(register, value);
        }
    }
}

/// Not every recording reads CS after START: a channel without a DATA bit has started.
fn fill_in_started(segment: &mut Segment) {
    let ready = match segment.command >> 8 {
        0x09 => 0x003A_0000,
        0x0F => 0x0040_0000,
        _ => return,
    };
    let failed = segment.last(Reg::Data).unwrap_or(0);
    let started = ChannelMask::from_bits((segment.command & !failed) as u8);
    for channel in started.iter() {
        let values = segment.values.entry(Reg::Cs(channel.index())).or_default();
        if values.is_empty() {
            values.push((0.0, ready));
        }
    }
}

impl RegisterBus for Replay {
    type Error = NeverFails;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), NeverFails> {
        self.exchanges += 1;
        for access in accesses {
            for (address, index) in (access.address..).step_by(4).zip(access.words()) {
                self.accesses += 1;
                self.now += 100;
                let register = Self::decode(address);
                match access.direction {
                    Direction::Read => words[index] = self.read_register(register),
                    Direction::Write => self.write_register(register, words[index]),
                }
            }
        }
        Ok(())
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.now)
    }

    fn wait(&mut self, duration: Duration) {
        self.now += duration.as_nanos() as u64;
    }
}
