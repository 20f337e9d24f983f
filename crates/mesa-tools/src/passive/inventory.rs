//! The inventory of a board that another program drives.

use mesa_hal::CycleError;
use mesa_hal::bus::Clock;
use mesa_hal::sslbp::{ComState, CsStatus};
use mesa_hal::transport::udp::PacketLink;

use super::received::COUNTED;
use super::{PassiveStatistics, Sample, Value, Watched};
use crate::Counted;
use crate::diagnosis::board::t_board;
use crate::inventory::{InventoryEthernet, InventoryFirmware, of_firmware};

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
    /// The pins and registers whose content is known.
    pub values: Vec<Value>,
    /// Packets of this look.
    pub look: PassiveStatistics,
}

impl PassiveInventory {
    /// Takes the inventory of a board whose [Ethernet side](InventoryEthernet::read) was read over
    /// the same bus. Writes nothing.
    ///
    /// # Errors
    /// Those of the bus.
    pub fn take<L: PacketLink>(
        watched: &mut Watched<L>,
        mut ethernet: InventoryEthernet,
    ) -> Result<Self, CycleError> {
        watched.sample()?;
        watched.bus().sleep(COUNTED);
        let Sample {
            values,
            others_per_second,
            look,
            ..
        } = watched.sample()?;
        let firmware = watched.listener().firmware();
        if firmware.idrom.is_7i97t() {
            ethernet.identity.set_7i97t();
        }
        ethernet.t_board = t_board(&ethernet.identity.card, &firmware.idrom);
        let mut findings: Vec<String> = ethernet.findings().collect();
        let warnings = firmware.warnings.iter();
        findings.extend(warnings.map(|warning| format!("the firmware: {warning}")));
        let bite = format!("{}.watchdog.has_bit", watched.listener().name());
        let is_bite = |value: &Value| value.name == bite && value.value.as_bool() == Some(true);
        if values.iter().any(is_bite) {
            findings.push("the watchdog has bitten: the board's own outputs are off".to_owned());
        }
        findings.extend(values.iter().filter_map(faults));
        let has_ports = values.iter().any(|value| value.text.is_some());
        Ok(Self {
            findings,
            unknown: unknown(has_ports),
            others_per_second: others_per_second.unwrap_or_default(),
            ethernet,
            firmware: of_firmware(firmware),
            values,
            look,
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

/// Finding about the faults that the remote on a channel reports.
fn faults(
    Value {
        name, value, text, ..
    }: &Value,
) -> Option<String> {
    let text = text.as_ref()?;
    let cs = CsStatus(u32::try_from(value.as_i64()?).ok()?);
    let is_running = matches!(cs.state(), ComState::ProcessData | ComState::Chatter);
    (is_running && !cs.remote_faults().is_empty()).then(|| format!("{name}: {text}"))
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
