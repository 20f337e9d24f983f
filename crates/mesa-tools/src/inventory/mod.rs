//! Inventory of a board: its identity, its firmware and its remotes, as plain data to be shown or
//! sent.
//!
//! With the feature `serde` all types here implement `Serialize`; `mesa info --json` prints them.

mod error;
mod remote;
mod setup_position;
mod take;
pub(crate) mod terminals;

pub use error::InventoryError;
pub(crate) use take::of_firmware;
pub use take::take;

use core::fmt;

use crate::Counted;
use mesa_hal::RemoteLabel;
use mesa_hal::driver::RemoteWatchdog;
use mesa_hal::ethernet::{Counters, EthernetBoard, EthernetError, Identity, Lbp16Board};
use mesa_hal::ethernet::{LedMode, LedTime};
use mesa_hal::lbp16::Space;
use mesa_hal::sslbp::RemoteName;

/// A board and everything on it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Inventory {
    /// Findings that need attention, one sentence each; empty if all is in order.
    pub findings: Vec<String>,
    /// The Ethernet side, if the board has one.
    pub ethernet: Option<InventoryEthernet>,
    /// The FPGA's firmware.
    pub firmware: InventoryFirmware,
    /// Its smart-serial ports.
    pub serial_ports: Vec<InventoryPort>,
}

/// The Ethernet side of a board.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryEthernet {
    /// Identity of the board.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub identity: Identity,
    /// Description of a board of the T generation, which has another FPGA and flash layout; `None`
    /// for any other.
    pub t_board: Option<String>,
    /// Source of the user LEDs.
    pub leds: LedMode,
    /// Source of the user LEDs after a restart.
    pub leds_at_start: LedMode,
    /// Counters since the last reset of the board.
    pub counters: Counters,
    /// Its memory spaces.
    pub memory: Vec<InventoryMemory>,
}

/// A memory space.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryMemory {
    /// Number of the space, 0 to 7.
    pub space: u8,
    /// Name of the space.
    pub name: String,
    /// Size in bytes.
    pub bytes: u64,
    /// True if the space can be written.
    pub writable: bool,
}

/// Description of the FPGA's firmware, as the firmware contains it.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryFirmware {
    /// Name of the board that the firmware is for: `MESA7I97`.
    pub board: String,
    /// Number of I/O pins.
    pub io_pins: u32,
    /// Number of connectors of these pins.
    pub connectors: u32,
    /// The slow clock, in hertz.
    pub clock_low_hz: u32,
    /// The fast clock, in hertz.
    pub clock_high_hz: u32,
    /// Anomalies of the description.
    pub warnings: Vec<String>,
    /// Modules of the firmware.
    pub modules: Vec<InventoryModule>,
    /// Readable content behind the end of the module descriptors: widths of input modules, and
    /// modules without a function for a host.
    pub trailing: Vec<String>,
    /// Pins by number.
    pub pins: Vec<InventoryPin>,
    /// Local I/O pins by number, which end on the board.
    pub local_pins: Vec<InventoryPin>,
}

/// A kind of module.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryModule {
    /// Name of the module.
    pub module: String,
    /// Number of the module (its general function tag).
    pub gtag: u8,
    /// Version of the module.
    pub version: u8,
    /// Number of instances.
    pub instances: u8,
    /// Base address of the module's registers.
    pub base: u16,
    /// Clock of the module, in hertz.
    pub clock_hz: u32,
}

/// A pin of the FPGA.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryPin {
    /// Number of the pin.
    pub number: u16,
    /// Terminals of the pin, for example `TB3 pin 4 AOUT0`; empty for a pin without a direct way to
    /// a terminal.
    pub terminals: String,
    /// Function of the pin in the module that uses it; `I/O` for a pin without a module.
    pub function: String,
    /// Direction of the pin.
    pub direction: PinDirection,
    /// True if a module drives the pin.
    pub driven_by_module: bool,
}

/// Direction of a pin of the FPGA.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum PinDirection {
    /// Read by a module.
    In,
    /// Driven by a module.
    Out,
    /// Used by no module.
    Either,
}

/// A smart-serial port.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryPort {
    /// Number of the port.
    pub port: u8,
    /// Version of its SSLBP firmware: `1.43`.
    pub sslbp: String,
    /// Clock of the port, in hertz.
    pub clock_hz: u32,
    /// Channels of the port.
    pub channels: Vec<InventoryChannel>,
}

/// A channel of a port.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryChannel {
    /// Number of the channel, 0 to 7.
    pub channel: u8,
    /// The remote, or the reason for its absence.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub found: ChannelContent,
}

/// Result of a channel's discovery.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum ChannelContent {
    /// A remote.
    Remote(Box<InventoryRemote>),
    /// No remote started, and the reason.
    NotStarted(String),
}

/// A remote, as it describes itself.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryRemote {
    /// Name of the remote: `7I77`.
    pub name: RemoteName,
    /// Title of the known card part that the remote matches: `7I77 field I/O`.
    pub known_as: Option<&'static str>,
    /// Unit number, which is on the card's label.
    pub unit_number: u32,
    /// True if its jumper is in the setup position: it answers at 115200 baud only.
    pub in_setup_position: bool,
    /// Software mode that the remote was started in.
    pub software_mode: u8,
    /// Bytes that the remote receives in a cycle.
    pub rx_size: u8,
    /// Bytes that the remote sends in a cycle.
    pub tx_size: u8,
    /// True if the remote does not describe itself, so that the data are from a table of
    /// `mesa-hal`.
    pub built_in_table: bool,
    /// Readable faults that the remote reports now: field power, outputs, watchdog. The watchdog
    /// bites while the remote is not driven.
    pub faults: Vec<String>,
    /// Readable faults that the remote kept from before, and that are not present now. This look
    /// has cleared them. A bite of its watchdog is usual among them: the remote powers up with one,
    /// and nothing feeds the watchdog between two programs.
    pub faults_before: Vec<String>,
    /// Modes of the remote.
    pub modes: Vec<InventoryMode>,
    /// Process data that a cycle transfers.
    pub process_data: Vec<InventoryElement>,
    /// Parameters of the remote.
    pub parameters: Vec<InventoryParameter>,
    /// Differences from the table of its kind.
    pub differences: Vec<String>,
    /// Problems in the remote's own description.
    pub problems: Vec<String>,
    /// Number of memory accesses for the discovery.
    pub memory_accesses: u32,
}

/// A mode of a remote.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryMode {
    /// Number of the mode.
    pub index: u8,
    /// `hardware`, `software` or `other`: the way the mode is set.
    #[cfg_attr(feature = "serde", serde(rename = "type"))]
    pub set_by: &'static str,
    /// Name of the mode.
    pub name: String,
}

/// An element of a remote's process data.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryElement {
    /// The element's record.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub data: InventoryData,
    /// Terminals of the element's bits on the card.
    pub terminals: Vec<InventoryTerminal>,
}

/// A screw terminal.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryTerminal {
    /// Connector and pin: `TB8 pin 3`.
    pub place: String,
    /// Signal name in the manual: `INPUT2`.
    pub signal: String,
}

/// A parameter of a remote.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryParameter {
    /// The parameter's record.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub data: InventoryData,
    /// Value in the parameter's unit; `None` if it could not be read.
    pub value: Option<f64>,
    /// Raw value in the remote's memory.
    pub raw: Option<u64>,
    /// Reason for a failed read.
    pub error: Option<String>,
}

/// A record of a remote, see [`DataRecord`](mesa_hal::discovery::DataRecord).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct InventoryData {
    /// Name of the record.
    pub name: String,
    /// Number of bits.
    pub bits: u8,
    /// Type of the value.
    #[cfg_attr(feature = "serde", serde(rename = "type"))]
    pub data_type: String,
    /// True if the value survives a power cycle.
    pub nonvolatile: bool,
    /// `input`, `output` or `bidirectional`, seen from the host.
    pub direction: &'static str,
    /// Smallest value.
    pub min: f32,
    /// Largest value.
    pub max: f32,
    /// Unit of the value.
    pub unit: String,
    /// Address in the remote's memory.
    pub address: u16,
}

impl InventoryEthernet {
    /// Reads the Ethernet side of a board. Writes nothing.
    ///
    /// # Errors
    /// [`EthernetError`]: no board answers.
    ///
    /// # Real time
    /// Not for the cycle. Takes several exchanges.
    pub fn read<B: Lbp16Board>(board: &mut EthernetBoard<'_, B>) -> Result<Self, EthernetError> {
        let identity = board.identity()?;
        // Before any request that the board may count as an error.
        let counters = board.counters()?;
        let mut memory = Vec::new();
        let spaces = (0..8).map(Space::from_bits);
        for space in spaces.filter(|&space| space != Space::Unused) {
            // A space that the firmware does not have answers with another cookie.
            match board.space_info(space) {
                Ok(area) => memory.push(InventoryMemory {
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
            t_board: None,
            leds: board.led_mode(LedTime::Now)?,
            leds_at_start: board.led_mode(LedTime::AtStart)?,
            counters,
            memory,
        })
    }

    pub(crate) fn findings(&self) -> impl Iterator<Item = String> + '_ {
        let counters = &self.counters;
        let counted = [
            (counters.parse_errors, "commands that it could not parse"),
            (
                counters.memory_errors,
                "accesses to memory that does not exist",
            ),
            (counters.write_errors, "writes to read-only memory"),
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
        let unwritten = crate::diagnosis::board::unwritten_eeprom(&self.identity);
        let unwritten = unwritten.map(|(what, advice)| format!("{what}: {advice}"));
        counted.chain(jumpers).chain(unwritten)
    }
}

impl InventoryRemote {
    /// Finding about a watchdog that leaves outputs on.
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
    /// The remotes.
    pub fn remotes(&self) -> impl Iterator<Item = (RemoteLabel, &InventoryRemote)> {
        self.serial_ports.iter().flat_map(|port| {
            let channels = port.channels.iter();
            channels.filter_map(|channel| match &channel.found {
                ChannelContent::Remote(remote) => {
                    let label = RemoteLabel::new((port.port, channel.channel), remote.name);
                    Some((label, &**remote))
                }
                ChannelContent::NotStarted(_) => None,
            })
        })
    }

    /// Collects the findings.
    fn judge(&mut self) {
        let mut findings = core::mem::take(&mut self.findings);
        findings.extend(self.ethernet.iter().flat_map(InventoryEthernet::findings));
        let warnings = self.firmware.warnings.iter();
        findings.extend(warnings.map(|warning| format!("the firmware: {warning}")));
        for (label, remote) in self.remotes() {
            // In a remote that is not driven the watchdog has always bitten.
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
                    .map(|text| format!("{label}: {text}")),
            );
            let texts = faults.chain(&remote.problems).chain(&remote.differences);
            findings.extend(
                texts
                    .cloned()
                    .chain(unread)
                    .map(|text| format!("{label}: {text}")),
            );
        }
        self.findings = findings;
    }

    /// Verdict in one line: `in order: MESA7I97, 1 remote`.
    pub fn judgement(&self) -> impl fmt::Display {
        let remotes = Counted::of(self.remotes().count(), "remote");
        let what = format!("{}, {remotes}", self.firmware.board);
        match self.findings.len() {
            0 => format!("in order: {what}"),
            n => format!("{} to look at: {what}", Counted::of(n, "thing")),
        }
    }
}
