//! Configuration of a remote: name, modes, memory, and misbehaviour.

use super::SimMemory;
use crate::wire::{BIT_2M5, Nanos};
use mesa_wire::lbp::{Capabilities, DiscoveryReply, LbpStatus, RemoteFaults};

/// Maximum number of software modes of a simulated remote.
pub const MAX_MODES: usize = 16;

/// A copy at power-up: from the EEPROM into working memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorkingCopy {
    /// Address in the EEPROM.
    pub from: u16,
    /// Address in memory.
    pub to: u16,
    /// Number of bytes.
    pub bytes: u16,
}

/// Place of a parameter in working memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParameterPlace {
    /// Address of its first byte.
    pub address: u16,
    /// Number of bytes, 1 to 8.
    pub bytes: u16,
}

/// Faults of the next replies, applied one after the other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReplyFaults {
    /// Number of replies that are not sent.
    pub drop: u32,
    /// Number of replies with an inverted CRC (xor 55).
    pub bad_crc: u32,
    /// Number of bytes A5 that follow the next reply.
    pub extra: u32,
    /// Number of bytes missing at the end of the next reply.
    pub short: u32,
    /// Latency of the next reply.
    pub late: Option<Nanos>,
    /// Number of replies sent as a break: the line is low for the length of the reply.
    pub breaks: u32,
}

/// Properties and behaviour of a remote.
///
/// The defaults are those of the remote model of the gateware transcripts.
#[derive(Clone, Debug)]
#[allow(
    clippy::struct_excessive_bools,
    reason = "each is a fault of its own that a remote can have"
)]
pub struct SimRemoteConfig {
    /// True if there is a remote on the line.
    pub present: bool,
    /// The four characters D0..D3.
    pub name: [u8; 4],
    /// The unit number.
    pub unit_number: u32,
    /// Address of the unit number in memory, if it is a parameter.
    pub unit_address: Option<u16>,
    /// Reply to BB in each software mode.
    pub modes: [Option<DiscoveryReply>; MAX_MODES],
    /// The software mode after power-up.
    pub initial_mode: u8,
    /// D6.
    pub hardware_mode: u8,
    /// D5. A remote with a program in its flash memory uses the program's revision.
    pub software_revision: u8,
    /// The parameter with the revision of the running program, if there is one: it is set at
    /// power-up, so that it follows an update.
    pub revision_place: Option<ParameterPlace>,
    /// D4.
    pub capabilities: Capabilities,
    /// DA.
    pub lbp_version: u8,
    /// Contents of working memory after power-up, except for the working copies.
    pub image: SimMemory,
    /// Copies from the EEPROM at power-up.
    pub working_copies: Vec<WorkingCopy>,
    /// Duration of an access that writes the EEPROM; the reply follows afterwards.
    pub eeprom_write_time: Nanos,
    /// Time from the end of a command to the start bit of its reply.
    pub latency: Nanos,
    /// Time without process data until the watchdog bites; 0 for never.
    pub watchdog: Nanos,
    /// Address of the watchdog time in ms (16 bits) in memory, if it is a parameter.
    pub watchdog_address: Option<u16>,
    /// Length of a bit in both directions.
    pub bit: Nanos,
    /// Address of the index of the baud rate in memory, if it is a parameter: it sets `bit` at
    /// power-up. Manual: 7I77, "OPERATE MODE BAUD RATE".
    pub baud_address: Option<u16>,
    /// The jumper is in the setup position: from the next power-up on the remote uses 115200 baud,
    /// and the longest frame timeout.
    pub setup_jumper: bool,
    /// Frame timeout after power-up, in bit times.
    pub frame_timeout: u8,
    /// The fault byte after power-up.
    pub initial_faults: RemoteFaults,
    /// The fault byte after E7.
    pub stuck_faults: RemoteFaults,
    /// Number of reads of C7 that return FF after an E7.
    pub clear_delay: u32,
    /// DF.
    pub cookie: u8,
    /// The LBP status after power-up.
    pub initial_status: LbpStatus,
    /// E1 does not clear the LBP status.
    pub status_stuck: bool,
    /// No reply to BC.
    pub no_unit_number: bool,
    /// No reply to BB: a remote without discovery.
    pub no_discovery: bool,
    /// The process-data reply has only data, without a leading fault byte (7I64).
    pub no_fault_byte: bool,
    /// E6 is acknowledged without effect: a remote without software modes.
    pub ignores_modes: bool,
    /// The line towards the FPGA is low while no remote is present.
    pub idles_low: bool,
}

impl Default for SimRemoteConfig {
    fn default() -> Self {
        Self {
            present: true,
            name: *b"    ",
            unit_number: 0,
            unit_address: None,
            modes: [None; MAX_MODES],
            initial_mode: 0,
            hardware_mode: 0,
            software_revision: 0x0E,
            revision_place: None,
            capabilities: Capabilities::CRC.union(Capabilities::EEPROM),
            lbp_version: 0,
            image: SimMemory::default(),
            working_copies: Vec::new(),
            eeprom_write_time: 0,
            latency: 10_000,
            watchdog: 50_000_000,
            watchdog_address: None,
            bit: BIT_2M5,
            baud_address: None,
            setup_jumper: false,
            frame_timeout: super::parser::DEFAULT_TIMEOUT,
            initial_faults: RemoteFaults::WATCHDOG,
            stuck_faults: RemoteFaults::empty(),
            clear_delay: 0,
            cookie: mesa_wire::lbp::COOKIE,
            initial_status: LbpStatus::empty(),
            status_stuck: false,
            no_unit_number: false,
            no_discovery: false,
            no_fault_byte: false,
            ignores_modes: false,
            idles_low: false,
        }
    }
}

impl SimRemoteConfig {
    /// The reply to BB in `mode`, if the remote has that mode.
    pub fn mode(&self, mode: u8) -> Option<DiscoveryReply> {
        self.modes.get(usize::from(mode)).copied().flatten()
    }

    /// Sizes of process data in `mode`.
    pub(super) fn sizes(&self, mode: u8) -> DiscoveryReply {
        self.mode(mode).unwrap_or(DiscoveryReply {
            rx_size: 1,
            tx_size: 0,
            ptoc: 0,
            gtoc: 0,
        })
    }
}

/// Length of a bit for an index of the table of "OPERATE MODE BAUD RATE"; an index outside the
/// table gives the default of 2.5 Mbaud.
pub(super) fn bit_of_index(index: u8) -> Nanos {
    const BAUD: [Nanos; 12] = [
        9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600, 1_250_000, 2_500_000,
        5_000_000, 10_000_000,
    ];
    let baud = BAUD.get(usize::from(index));
    baud.map_or(BIT_2M5, |baud| (1_000_000_000 + baud / 2) / baud)
}
