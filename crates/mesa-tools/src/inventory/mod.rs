//! The inventory of a board: what it is, and what is plugged into it. Plain data, to be shown or sent.
//!
//! With the feature `serde` everything here is `Serialize`: it is what `mesa info --json` prints.

mod error;
mod take;
mod terminals;

pub use error::InventoryError;
pub use take::take;

use core::fmt;

use mesa_hal::driver::RemoteWatchdog;
use mesa_hal::ethernet::{Counters, EthernetBoard, EthernetError, Identity, Lbp16Board};
use mesa_hal::ethernet::{LedMode, LedTime};
use mesa_hal::lbp16::Space;

/// A board and everything on it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Inventory {
    /// What a person should look at, one sentence each; empty where all is well.
    pub findings: Vec<String>,
    /// The Ethernet side, if the board has one.
    pub ethernet: Option<Ethernet>,
    /// The FPGA's firmware.
    pub firmware: Firmware,
    /// Its smart-serial ports.
    pub serial_ports: Vec<SerialPort>,
}

/// The Ethernet side of a board.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Ethernet {
    /// Who it is.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub identity: Identity,
    /// What the user LEDs show.
    pub leds: LedMode,
    /// What they show after a restart.
    pub leds_at_start: LedMode,
    /// What it counted since it was reset.
    pub counters: Counters,
    /// Its memory spaces.
    pub memory: Vec<Memory>,
}

/// A memory space.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Memory {
    /// Its number, 0 to 7.
    pub space: u8,
    /// Its own name.
    pub name: String,
    /// Its size in bytes.
    pub bytes: u64,
    /// Whether it can be written.
    pub writable: bool,
}

/// What the firmware of the FPGA says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Firmware {
    /// The board it is for: `MESA7I97`.
    pub board: String,
    /// I/O pins.
    pub io_pins: u32,
    /// Connectors that they are on.
    pub connectors: u32,
    /// The slow clock, in hertz.
    pub clock_low_hz: u32,
    /// The fast clock, in hertz.
    pub clock_high_hz: u32,
    /// What is odd about it.
    pub warnings: Vec<String>,
    /// Its modules.
    pub modules: Vec<Module>,
    /// What stands behind the end of its module descriptors, in words: widths of input modules, and
    /// modules that a host has nothing to do with.
    pub trailing: Vec<String>,
    /// Its pins, by number.
    pub pins: Vec<Pin>,
    /// Its local I/O pins, by number: they end on the board.
    pub local_pins: Vec<Pin>,
}

/// A kind of module.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Module {
    /// Its name.
    pub module: String,
    /// Its number.
    pub gtag: u8,
    /// Its version.
    pub version: u8,
    /// How many there are.
    pub instances: u8,
    /// Address of its registers.
    pub base: u16,
    /// Its clock, in hertz.
    pub clock_hz: u32,
}

/// A pin of the FPGA.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Pin {
    /// Its number.
    pub number: u16,
    /// The terminals it is at, for example `TB3 pin 4 AOUT0`; empty if it does not leave the board as
    /// it is.
    pub terminals: String,
    /// The module that uses it, or that none does.
    pub function: String,
    /// Which way it goes.
    pub direction: PinDirection,
    /// Whether a module drives it.
    pub driven_by_module: bool,
}

/// Which way a pin of the FPGA goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum PinDirection {
    /// A module reads it.
    In,
    /// A module drives it.
    Out,
    /// It belongs to no module.
    Either,
}

/// A smart-serial port.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct SerialPort {
    /// Its number.
    pub port: u8,
    /// Version of its SSLBP firmware: `1.43`.
    pub sslbp: String,
    /// Its clock, in hertz.
    pub clock_hz: u32,
    /// Its channels.
    pub channels: Vec<Channel>,
}

/// A channel of a port.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Channel {
    /// Its number, 0 to 7.
    pub channel: u8,
    /// What is there.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub found: Found,
}

/// What is on a channel.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Found {
    /// A remote.
    Remote(Box<Remote>),
    /// Nothing that started, and why.
    NotStarted(String),
}

/// A remote, and what it tells of itself.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Remote {
    /// Its name: `7I77`.
    pub name: String,
    /// The part of a card that it is known as: `7I77 field I/O`.
    pub known_as: Option<&'static str>,
    /// Its unit number, which is on the card's label.
    pub unit_number: u32,
    /// The software mode it was started in.
    pub software_mode: u8,
    /// Bytes it receives in a cycle.
    pub rx_size: u8,
    /// Bytes it sends in a cycle.
    pub tx_size: u8,
    /// It does not describe itself: what is here is from a table of `mesa-hal`.
    pub built_in_table: bool,
    /// What it reports now, in words: faults of field power, outputs, watchdog; its watchdog bites
    /// while it is not driven.
    pub faults: Vec<String>,
    /// Its modes.
    pub modes: Vec<Mode>,
    /// What a cycle transfers.
    pub process_data: Vec<Element>,
    /// What it keeps.
    pub parameters: Vec<Parameter>,
    /// Where it differs from the table of its kind.
    pub differences: Vec<String>,
    /// What is wrong with what it says of itself.
    pub problems: Vec<String>,
    /// Accesses that this took.
    pub memory_accesses: u32,
}

/// A mode of a remote.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Mode {
    /// Its number.
    pub index: u8,
    /// `hardware`, `software` or `other`: who sets it.
    #[cfg_attr(feature = "serde", serde(rename = "type"))]
    pub set_by: &'static str,
    /// Its name.
    pub name: String,
}

/// An element of a remote's process data.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Element {
    /// What it is.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub data: Data,
    /// Where its bits are on the card.
    pub terminals: Vec<Terminal>,
}

/// A screw terminal.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Terminal {
    /// Connector and pin: `TB8 pin 3`.
    pub place: String,
    /// The manual's name: `INPUT2`.
    pub signal: String,
}

/// A parameter of a remote.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Parameter {
    /// What it is.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub data: Data,
    /// Its value in its unit; `None` if it could not be read.
    pub value: Option<f64>,
    /// The same as the remote keeps it.
    pub raw: Option<u64>,
    /// Why it could not be read.
    pub error: Option<String>,
}

/// A record of a remote, see [`DataRecord`](mesa_hal::discovery::DataRecord).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Data {
    /// Its name.
    pub name: String,
    /// Its bits.
    pub bits: u8,
    /// How they are meant.
    #[cfg_attr(feature = "serde", serde(rename = "type"))]
    pub data_type: String,
    /// Whether it survives a power cycle.
    pub nonvolatile: bool,
    /// `input`, `output` or `bidirectional`, seen from the host.
    pub direction: &'static str,
    /// The least value.
    pub min: f32,
    /// The largest value.
    pub max: f32,
    /// The unit.
    pub unit: String,
    /// Where it is in the remote's memory.
    pub address: u16,
}

impl Ethernet {
    /// What the Ethernet side of a board says. Writes nothing.
    ///
    /// # Errors
    /// [`EthernetError`]: what answers is no board, or nothing does.
    ///
    /// # Real time
    /// Not for the cycle. Some exchanges.
    pub fn read<B: Lbp16Board>(
        board: &mut EthernetBoard<'_, B>,
    ) -> Result<Self, EthernetError<B::Error>> {
        let identity = board.identity()?;
        // Before anything is asked that the board may count as an error.
        let counters = board.counters()?;
        let mut memory = Vec::new();
        let spaces = (0..8).map(Space::from_bits);
        for space in spaces.filter(|&space| space != Space::Unused) {
            // A space that the firmware does not have answers with another cookie.
            match board.space_info(space) {
                Ok(area) => memory.push(Memory {
                    space: space as u8,
                    name: area.name().to_string(),
                    bytes: area.ranges.range(),
                    writable: area.sizes.writable(),
                }),
                Err(EthernetError::Lbp16(_)) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Self {
            identity,
            leds: board.led_mode(LedTime::Now)?,
            leds_at_start: board.led_mode(LedTime::AtStart)?,
            counters,
            memory,
        })
    }

    fn findings(&self) -> impl Iterator<Item = String> + '_ {
        let counters = &self.counters;
        let counted = [
            (counters.parse_errors, "commands that it could not parse"),
            (counters.memory_errors, "accesses to memory that it has not"),
            (counters.write_errors, "writes to what can not be written"),
            (counters.received_bad, "damaged packets (check the cable)"),
            (
                counters.sent_bad,
                "packets that it could not send (check the cable)",
            ),
        ];
        let counted = counted.into_iter().filter(|(count, _)| *count > 0);
        let counted = counted.map(|(count, what)| format!("the board counted {what}: {count}"));
        let invalid = self.identity.address_from == mesa_hal::ethernet::AddressSource::Invalid;
        let jumpers = invalid.then(|| "the address jumpers are both up, which is invalid".into());
        counted.chain(jumpers)
    }
}

impl Remote {
    /// What is to be said of a watchdog that leaves outputs on.
    fn slow_watchdog(&self) -> Option<String> {
        let mut parameters = self.parameters.iter();
        let name = mesa_hal::modules::serial::WATCHDOG_PARAMETER;
        let found = parameters.find(|parameter| parameter.data.name.eq_ignore_ascii_case(name));
        let millis = found.and_then(|parameter| parameter.raw)?;
        let watchdog = RemoteWatchdog::longer_of(millis, millis);
        watchdog.is_slow().then(|| match watchdog.time() {
            None => format!(
                "its own watchdog is off ({name} 0): what is on when it is lost stays on, and may be on now"
            ),
            Some(_) => format!(
                "its own watchdog is slow ({name} {millis}): what is on when it is lost stays on for {millis} ms"
            ),
        })
    }
}

impl Inventory {
    /// Its remotes, with their port and channel.
    pub fn remotes(&self) -> impl Iterator<Item = (u8, u8, &Remote)> {
        self.serial_ports.iter().flat_map(|port| {
            let channels = port.channels.iter();
            channels.filter_map(|channel| match &channel.found {
                Found::Remote(remote) => Some((port.port, channel.channel, &**remote)),
                Found::NotStarted(_) => None,
            })
        })
    }

    /// Says what a person should look at.
    fn judge(&mut self) {
        let mut findings = core::mem::take(&mut self.findings);
        findings.extend(self.ethernet.iter().flat_map(Ethernet::findings));
        let warnings = self.firmware.warnings.iter();
        findings.extend(warnings.map(|warning| format!("the firmware: {warning}")));
        for (port, channel, remote) in self.remotes() {
            let place = format!("port {port}, channel {channel}, {}", remote.name);
            // The watchdog has bitten in each remote that nobody drives.
            let faults = remote
                .faults
                .iter()
                .filter(|fault| !fault.contains("watchdog"));
            let unread = remote.parameters.iter().filter_map(|parameter| {
                let error = parameter.error.as_ref()?;
                Some(format!("{}: {error}", parameter.data.name))
            });
            findings.extend(
                remote
                    .slow_watchdog()
                    .map(|text| format!("{place}: {text}")),
            );
            let texts = faults.chain(&remote.problems).chain(&remote.differences);
            findings.extend(
                texts
                    .cloned()
                    .chain(unread)
                    .map(|text| format!("{place}: {text}")),
            );
        }
        self.findings = findings;
    }

    /// The judgement in a line: `in order: MESA7I97, 1 remote`.
    pub fn judgement(&self) -> impl fmt::Display {
        let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let what = format!(
            "{}, {}",
            self.firmware.board,
            count(self.remotes().count(), "remote")
        );
        match self.findings.len() {
            0 => format!("in order: {what}"),
            n => format!("{} to look at: {what}", count(n, "thing")),
        }
    }
}
