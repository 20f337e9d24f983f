//! A fake bus that replays the host's side of a gateware transcript at register level: the writes
//! of the driver must equal the recorded ones, and its reads return the recorded values.
//!
//! Local reads and stops of single channels that are not in the transcript are answered from a
//! small table, because the driver reads more than the recording host did.

use mesa_hal::hostmot2::{Gtag, ModuleDescriptor};
use mesa_hal::sslbp::{Channel, ChannelMask, PortLayout};
use mesa_hal_sim::sslbp::Register;
use mesa_hal_sim::wire::Nanos;
use std::collections::{BTreeMap, HashMap};

use super::bus::{FakeBus, Registers};
use crate::common::recording::Recording;
use crate::common::recording::sslbp::{Entry, Event, Transcript};

/// FACTS 2.1.
pub const MODULE: ModuleDescriptor = ModuleDescriptor {
    gtag: Gtag::SSERIAL,
    version: 0,
    clock_hz: 100_000_000,
    base: 0x5A00,
    registers: 6,
    register_stride: 0x100,
    instance_stride: 0x40,
    multiple_registers: 0x3C,
    instances: 1,
};

/// A recording of the project.
pub fn recording(name: &str) -> Transcript {
    Transcript::own("transcripts", name)
}

/// The memory of a remote as set up in a recording.
pub fn memory_of(recording: &Transcript, remote: u8) -> BTreeMap<u16, u8> {
    let mut memory = BTreeMap::new();
    for setting in settings_of(recording, remote) {
        let Some(setting) = setting.strip_prefix("mem 0x") else {
            continue;
        };
        let (address, bytes) = setting.split_once(' ').expect("address and bytes");
        let address = u16::from_str_radix(address, 16).expect("an address");
        for (n, pair) in (0..).zip(bytes.as_bytes().chunks(2)) {
            let pair = std::str::from_utf8(pair).expect("digits");
            memory.insert(address + n, u8::from_str_radix(pair, 16).expect("digits"));
        }
    }
    memory
}

/// The lines that set a remote up.
pub fn settings_of(recording: &Transcript, remote: u8) -> impl Iterator<Item = &str> {
    recording
        .entries
        .iter()
        .filter_map(move |entry| match &entry.event {
            Event::Remote { remote: of, text } if *of == remote => Some(text.as_str()),
            _ => None,
        })
}

/// The section from one write of COMMAND to the next.
#[derive(Clone, Debug, Default)]
pub struct Segment {
    pub command: u32,
    /// Writes before COMMAND.
    pub writes: Vec<(Register, u32)>,
    /// Time until COMMAND read 0.
    pub cleared: Option<Nanos>,
    /// Values read, with the time since COMMAND was written.
    pub values: HashMap<Register, Vec<(Nanos, u32)>>,
}

impl Segment {
    /// The last recorded value of a register.
    pub fn last(&self, register: Register) -> Option<u32> {
        self.values.get(&register)?.last().map(|&(_, value)| value)
    }
}

/// The host's side of a recording.
pub fn segments(recording: &Transcript) -> Vec<Segment> {
    let mut segments: Vec<Segment> = Vec::new();
    let mut writes = Vec::new();
    let mut begin = 0;
    for Entry { time, event, .. } in &recording.entries {
        match *event {
            Event::Write {
                register: Register::Command,
                value,
            } => {
                begin = *time;
                segments.push(Segment {
                    command: value,
                    writes: std::mem::take(&mut writes),
                    ..Segment::default()
                });
            }
            Event::Write { register, value } => writes.push((register, value)),
            Event::Poll {
                timed_out: false, ..
            } => {
                if let Some(segment) = segments.last_mut() {
                    segment.cleared = Some(time - begin);
                }
            }
            Event::Read { register, value } if register != Register::Command => {
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
pub fn size_replies(recording: &Transcript) -> Vec<(u8, u8)> {
    let mut asked = false;
    let mut sizes = Vec::new();
    for entry in &recording.entries {
        match &entry.event {
            Event::FromFpga {
                channel: 0, bytes, ..
            } => asked = bytes[0] == 0xBB,
            Event::ToFpga {
                channel: 0, bytes, ..
            } if asked => sizes.push((bytes[0], bytes[1])),
            _ => {}
        }
    }
    sizes
}

pub type Replay = FakeBus<Recorded>;

/// The recorded registers of a port.
#[derive(Debug)]
pub struct Recorded {
    segments: Vec<Segment>,
    next: usize,
    now: u64,
    /// Time at which the running command was written.
    begin: u64,
    busy: u32,
    cleared: Option<Nanos>,
    current: Option<Segment>,
    held: HashMap<Register, u32>,
    written: HashMap<Register, u32>,
    pub local: BTreeMap<u16, u8>,
    /// All writes to COMMAND, and whether it was busy at the time.
    pub commands: Vec<(u32, bool)>,
}

impl Replay {
    pub fn of(name: &str) -> Self {
        Self::new(segments(&recording(name)))
    }

    pub fn new(segments: Vec<Segment>) -> Self {
        let mut bus = Self::over(Recorded::new(segments));
        bus.now = bus.registers.now;
        bus
    }

    /// Removes segments that the test does not play.
    pub fn without(mut self, mut leave_out: impl FnMut(&Segment) -> bool) -> Self {
        self.segments.retain(|segment| !leave_out(segment));
        self
    }
}

impl Recorded {
    fn new(segments: Vec<Segment>) -> Self {
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
            cleared: Some(0),
            current: None,
            held: HashMap::new(),
            written: HashMap::new(),
            local,
            commands: Vec::new(),
        }
    }

    /// Starts as if another program had already written the command of the next segment.
    pub fn begin_inside(&mut self) {
        let segment = self.segments[self.next].clone();
        self.next += 1;
        self.begin = self.now;
        self.busy = segment.command & 0xFFFF;
        self.cleared = segment.cleared;
        self.current = Some(segment);
    }

    /// Sets RXSize and TXSize that the port keeps for a channel.
    pub fn set_sizes(&mut self, channel: u8, rx: u8, tx: u8) {
        let start = 0x70 + 0x32 * u16::from(channel);
        self.local.insert(start + 0x2E, rx);
        self.local.insert(start + 0x2F, tx);
    }

    /// The next command, and the values that it reads.
    pub fn upcoming(&self) -> Option<&Segment> {
        self.segments.get(self.next)
    }

    fn elapsed(&self) -> Nanos {
        self.now - self.begin
    }

    fn is_busy(&self) -> bool {
        self.busy != 0 && self.cleared.is_none_or(|cleared| self.elapsed() < cleared)
    }

    fn decode(address: u16) -> Register {
        let layout = PortLayout::new(&MODULE, 0, 8).unwrap();
        if address == layout.command {
            return Register::Command;
        }
        if address == layout.data() {
            return Register::Data;
        }
        for channel in Channel::ALL {
            if layout.cs(channel) == Some(address) {
                return Register::Cs(channel.index());
            }
            for (n, interface) in (0..).zip(layout.interfaces(channel)) {
                if interface == address {
                    return Register::Interface(channel.index(), n);
                }
            }
        }
        panic!("access to {address:#06X}, which is no register of the port");
    }

    fn read_register(&self, register: Register) -> u32 {
        if register == Register::Command {
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
            .unwrap_or(if matches!(register, Register::Cs(_)) {
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

    /// Ends the running segment: its last values are kept.
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
        self.fill_in_transferred(&mut segment);
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
                    value == 0 || matches!(register, Register::Interface(..)),
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

    /// Adds the CS values of a DOIT. Not every recording reads CS after the first DOIT: a channel
    /// without a DATA bit has changed from chatter to process data (FACTS 4.6).
    fn fill_in_transferred(&self, segment: &mut Segment) {
        let failed = segment.last(Register::Data).unwrap_or(0);
        let good = ChannelMask::from_bits((segment.command & !failed) as u8);
        for channel in good.iter().filter(|_| segment.command >> 8 == 0x10) {
            let cs = Register::Cs(channel.index());
            let before = self.held.get(&cs).copied().unwrap_or(0);
            let values = segment.values.entry(cs).or_default();
            if values.is_empty() && before & 0x00FF_0000 == 0x003A_0000 {
                values.push((0, before & !0x00FF_0000 | 0x0042_0000));
            }
        }
    }

    fn improvise(&mut self, command: u32) {
        let address = (command & 0x0FFF) as u16;
        match command & 0xF000 {
            0xA000 => self.store_local(address),
            0x2000 => {
                let value = self.local.get(&address).copied().unwrap_or(0);
                self.held.insert(Register::Data, value.into());
            }
            0 if (0x0801..=0x08FF).contains(&command) => {
                for channel in ChannelMask::from_bits(command as u8).iter() {
                    self.held.insert(Register::Cs(channel.index()), 0xC100);
                }
            }
            _ => panic!(
                "COMMAND {command:04X}, but the transcript goes on with {:04X?}",
                self.upcoming().map(|next| next.command)
            ),
        }
        self.begin = self.now;
        self.busy = command;
        self.cleared = Some(550);
    }

    fn store_local(&mut self, address: u16) {
        let value = self.written.get(&Register::Data).copied().unwrap_or(0) as u8;
        self.local.insert(address, value);
    }

    fn write_register(&mut self, register: Register, value: u32) {
        if register == Register::Command {
            self.write_command(value);
        } else {
            self.written.insert(register, value);
        }
    }
}

/// Adds the CS values of a START. Not every recording reads CS after START: a channel without a
/// DATA bit has started.
fn fill_in_started(segment: &mut Segment) {
    let ready = match segment.command >> 8 {
        0x09 => 0x003A_0000,
        0x0F => 0x0040_0000,
        _ => return,
    };
    let failed = segment.last(Register::Data).unwrap_or(0);
    let started = ChannelMask::from_bits((segment.command & !failed) as u8);
    for channel in started.iter() {
        let values = segment
            .values
            .entry(Register::Cs(channel.index()))
            .or_default();
        if values.is_empty() {
            values.push((0, ready));
        }
    }
}

impl Registers for Recorded {
    fn read(&mut self, address: u16, now: u64) -> u32 {
        self.now = now;
        self.read_register(Self::decode(address))
    }

    fn write(&mut self, address: u16, word: u32, now: u64) {
        self.now = now;
        self.write_register(Self::decode(address), word);
    }
}
