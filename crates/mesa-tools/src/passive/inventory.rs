//! The inventory of a board that another program drives.

use core::time::Duration;

use mesa_hal::RemoteId;
use mesa_hal::bus::{Clock, Instant, RegisterBus};
use mesa_hal::hostmot2::HostMot2;
use mesa_hal::lbp16::Space;
use mesa_hal::lbp16::registers::control;
use mesa_hal::modules::watchdog::WatchdogRegisters;
use mesa_hal::sslbp::{ComState, CsStatus, PortLayout, PortPlace};
use mesa_hal::transport::udp::PacketLink;

use super::{PassiveBus, PassiveError, PassiveStatistics, Read};
use crate::Counted;
use crate::diagnosis::board::t_board;
use crate::inventory::{InventoryError, InventoryEthernet, InventoryFirmware, of_firmware};

/// What can be known of a board without a command to it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PassiveInventory {
    /// Findings that need attention, one sentence each; empty if all is in order.
    pub findings: Vec<String>,
    /// What cannot be known, one sentence each, with the reason.
    pub unknown: Vec<String>,
    /// Packets that the board received from other programs, per second.
    pub others_per_second: f64,
    /// The Ethernet side.
    pub ethernet: InventoryEthernet,
    /// The FPGA's firmware.
    pub firmware: InventoryFirmware,
    /// Its smart-serial ports.
    pub serial_ports: Vec<PassivePort>,
    /// Packets of this look.
    pub look: PassiveStatistics,
}

/// A smart-serial port, as its registers show it.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PassivePort {
    /// Number of the port.
    pub port: u8,
    /// Channels of the port.
    pub channels: Vec<PassiveChannel>,
}

/// A channel of a port.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PassiveChannel {
    /// Number of the channel, 0 to 7.
    pub channel: u8,
    /// State and faults of the channel, in words.
    pub state: String,
    /// Content of CS.
    pub cs: u32,
    /// Content of the interface registers: the last process data from the remote.
    pub interfaces: Vec<u32>,
}

/// Interval over which packets of other programs are counted, at least.
const COUNTED: Duration = Duration::from_millis(200);

impl PassiveInventory {
    /// Takes the inventory of a board whose [Ethernet side](InventoryEthernet::read) was read over
    /// the same bus. Writes nothing.
    ///
    /// # Errors
    /// [`InventoryError`]: no board answers, or its firmware cannot be used.
    pub fn take<L: PacketLink>(
        bus: &mut PassiveBus<L>,
        mut ethernet: InventoryEthernet,
    ) -> Result<Self, InventoryError> {
        let before = Received::read(bus)?;
        let firmware = bus.identify()?;
        if firmware.idrom.is_7i97t() {
            ethernet.identity.set_7i97t();
        }
        ethernet.t_board = t_board(&ethernet.identity.card, &firmware.idrom);
        let mut findings: Vec<String> = ethernet.findings().collect();
        let warnings = firmware.warnings.iter();
        findings.extend(warnings.map(|warning| format!("the firmware: {warning}")));
        findings.extend(bite(bus, &firmware)?);
        let mut serial_ports = Vec::new();
        for PortPlace { layout, .. } in PortLayout::ports(&firmware) {
            serial_ports.push(port(bus, layout)?);
        }
        findings.extend(serial_ports.iter().flat_map(faults));
        let left = COUNTED.saturating_sub(bus.now().since(before.at));
        bus.sleep(left);
        let after = Received::read(bus)?;
        Ok(Self {
            findings,
            unknown: unknown(!serial_ports.is_empty()),
            others_per_second: after.others_since(before),
            ethernet,
            firmware: of_firmware(&firmware),
            serial_ports,
            look: bus.packets(),
        })
    }

    /// Verdict in one line: `in order: MESA7I97, other programs send 2000 packets a second`.
    pub fn judgement(&self) -> String {
        let driven = match self.others_per_second {
            rate if rate < 1.0 => "no other program sends packets".to_owned(),
            rate => format!("other programs send {rate:.0} packets a second"),
        };
        let what = format!("{}, {driven}", self.firmware.board);
        match self.findings.len() {
            0 => format!("in order: {what}"),
            n => format!("{} to look at: {what}", Counted::of(n, "thing")),
        }
    }
}

/// Packet count of the board, and the packets of the bus, at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Received {
    pub at: Instant,
    counted: u16,
    own: u64,
}

impl Received {
    /// The register with the count.
    const REGISTER: Read = Read {
        space: Space::Control,
        address: control::RX_UDP,
        count: 1,
    };

    pub fn read<L: PacketLink>(bus: &mut PassiveBus<L>) -> Result<Self, PassiveError> {
        let words = bus.read_all(&[Self::REGISTER])?;
        Ok(Self {
            at: bus.now(),
            counted: words.first().copied().unwrap_or_default() as u16,
            own: bus.packets().packets,
        })
    }

    /// Packets of other programs in a second. The count has 16 bits: correct if fewer than 65,536
    /// packets arrived in between.
    pub fn others_since(self, before: Self) -> f64 {
        let all = self.counted.wrapping_sub(before.counted);
        let others = u64::from(all).saturating_sub(self.own - before.own);
        others as f64
            / self
                .at
                .since(before.at)
                .as_secs_f64()
                .max(f64::MIN_POSITIVE)
    }
}

/// Finding about a watchdog that has bitten.
fn bite<L: PacketLink>(
    bus: &mut PassiveBus<L>,
    firmware: &HostMot2,
) -> Result<Option<String>, InventoryError> {
    let Ok(watchdog) = WatchdogRegisters::locate(firmware) else {
        return Ok(None);
    };
    let status = bus.read(watchdog.status)?;
    let has_bitten = status & WatchdogRegisters::HAS_BIT != 0;
    let text = "the watchdog has bitten: the board's own outputs are off";
    Ok(has_bitten.then(|| text.to_owned()))
}

/// Findings about faults that remotes report.
fn faults(port: &PassivePort) -> impl Iterator<Item = String> + '_ {
    port.channels.iter().filter_map(|channel| {
        let cs = CsStatus(channel.cs);
        let is_running = matches!(cs.state(), ComState::ProcessData | ComState::Chatter);
        let has_faults = is_running && !cs.remote_faults().is_empty();
        let id = RemoteId::new(port.port, channel.channel);
        has_faults.then(|| format!("{id}: {}", channel.state))
    })
}

fn port<L: PacketLink>(
    bus: &mut PassiveBus<L>,
    layout: PortLayout,
) -> Result<PassivePort, PassiveError> {
    let mut reads = Vec::new();
    for channel in layout.mask().iter() {
        let registers = layout.cs(channel).into_iter();
        let registers = registers.chain(layout.interfaces(channel));
        reads.extend(registers.map(|address| Read::hostmot2(address, 1)));
    }
    let words = bus.read_all(&reads)?;
    let each = usize::from(layout.interface_registers) + 1;
    let channels = (0..).zip(words.chunks(each)).map(|(channel, words)| {
        let (cs, interfaces) = words.split_first().unwrap_or((&0, &[]));
        PassiveChannel {
            channel,
            state: CsStatus(*cs).to_string(),
            cs: *cs,
            interfaces: interfaces.to_vec(),
        }
    });
    Ok(PassivePort {
        port: layout.instance,
        channels: channels.collect(),
    })
}

fn unknown(has_ports: bool) -> Vec<String> {
    let mut all = vec![
        "what is written to write-only registers: modes, rates and PWM values, and the open drains and \
         inversions of pins"
            .to_owned(),
    ];
    if has_ports {
        all.push(
            "names, unit numbers, modes, terminals and parameters of remotes, and the version of SSLBP: \
             each is read by a command to the port, which would stop the transfers of the program that \
             drives it. That program knows them; `mesa info` reads them when it has ended"
                .to_owned(),
        );
        all.push(
            "the outputs of remotes: the interface registers read back the inputs only".to_owned(),
        );
    }
    all
}
