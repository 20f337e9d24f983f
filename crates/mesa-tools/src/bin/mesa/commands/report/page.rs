//! The page.

use mesa_hal::hal::{PinInfo, Place, Role};
use mesa_tools::inventory::{
    ChannelContent, Inventory, InventoryEthernet, InventoryFirmware, InventoryParameter,
    InventoryRemote,
};

use super::html::{Html, code, place as at, text};
use super::wiring::WiringReport;
use crate::board::place;
use crate::commands::info;
use crate::commands::latency::Picture;
use crate::ui::number;
use mesa_tools::Counted;

const STYLE: &str = include_str!("style.css");

/// Content of the page.
pub struct Page<'a> {
    pub date: String,
    pub address: String,
    pub host: &'a str,
    pub inventory: &'a Inventory,
    pub terminals: Vec<Card>,
    pub wiring: Option<&'a WiringReport>,
    pub latency: Option<&'a Picture>,
}

/// Terminals of a card.
#[derive(Debug)]
pub struct Card {
    name: String,
    /// Terminals, signals, direction and pins.
    pub rows: Vec<[String; 4]>,
}

/// The terminals of all cards, with the pins at each of them. Parameters are left out.
pub fn terminals(pins: &[PinInfo]) -> Vec<Card> {
    let mut cards: Vec<Card> = Vec::new();
    for pin in pins {
        if pin.role.is_param() || pin.place.terminal.is_empty() {
            continue;
        }
        let name = place::card(&pin.name);
        if let Some(card) = cards.iter_mut().find(|card| card.name == name) {
            card.add(pin);
            continue;
        }
        let mut card = Card {
            name,
            rows: Vec::new(),
        };
        card.add(pin);
        cards.push(card);
    }
    cards
}

impl Card {
    fn add(&mut self, pin: &PinInfo) {
        let terminal = place::short(&Place {
            signal: String::new(),
            ..Place::clone(&pin.place)
        });
        let direction = match pin.role {
            Role::Input => "in",
            Role::Output => "out",
            _ => "in/out",
        };
        let short = match pin.name.split_once(&format!("{}.", self.name)) {
            Some((_, short)) => short,
            None => &pin.name,
        };
        let mut rows = self.rows.iter_mut();
        let known = rows.find(|[at, signal, ..]| *at == terminal && *signal == pin.place.signal);
        match known {
            Some([_, _, directions, names]) => {
                if !directions.split(", ").any(|known| known == direction) {
                    *directions += ", ";
                    *directions += direction;
                }
                *names += ", ";
                *names += short;
            }
            None => self.rows.push([
                terminal,
                pin.place.signal.clone(),
                direction.to_owned(),
                short.to_owned(),
            ]),
        }
    }
}

impl Page<'_> {
    /// Name of the board.
    pub fn board(&self) -> &str {
        let ethernet = self.inventory.ethernet.as_ref();
        ethernet.map_or(&self.inventory.firmware.board, |ethernet| {
            &ethernet.identity.card
        })
    }

    pub fn html(&self) -> String {
        let title = format!("{} at {}", self.board(), self.address);
        let mut html = Html::default();
        html.element("h1", &title);
        self.summary(&mut html);
        self.remotes(&mut html);
        self.terminals(&mut html);
        self.parameters(&mut html);
        firmware(&mut html, &self.inventory.firmware);
        if let Some(wiring) = self.wiring {
            wiring.write(&mut html);
        }
        if let Some(latency) = self.latency {
            html.element("h2", "Latency");
            html.picture("Histograms of the latency of cycles", &latency.svg);
            html.element("pre", latency.text.trim_end());
        }
        Html::page(&title, STYLE, &html)
    }

    fn summary(&self, html: &mut Html) {
        let mut facts = vec![("Date", self.date.clone())];
        if !self.host.is_empty() {
            facts.push(("Host", self.host.to_owned()));
        }
        facts.extend(self.inventory.ethernet.iter().flat_map(ethernet));
        facts.push(("Firmware for", self.inventory.firmware.board.clone()));
        facts.push(("Made by", format!("mesa {}", env!("CARGO_PKG_VERSION"))));
        html.facts(&facts);
        let verdict = self.inventory.judgement().to_string();
        html.classed("p", Some("verdict"), verdict);
        html.list(&self.inventory.findings);
    }

    fn remotes(&self, html: &mut Html) {
        html.element("h2", "Remotes");
        let rows = self.inventory.remotes().map(|(label, remote)| {
            let name = remote.name.to_string();
            [
                label.to_string(),
                remote.known_as.map_or(name, str::to_owned),
                format!("0x{:08X}", remote.unit_number),
                mode(remote),
                faults(remote),
            ]
        });
        let rows: Vec<_> = rows.collect();
        if !rows.is_empty() {
            let columns = [
                code("Place"),
                text("Card"),
                code("Unit number"),
                text("Software mode"),
                text("Faults"),
            ];
            html.table(columns, &rows);
        }
        html.list(&self.empty_channels());
        if rows.is_empty() && self.inventory.serial_ports.is_empty() {
            html.element("p", "The firmware has no smart serial port.");
        }
    }

    /// Channels on which no remote has started, with the reasons.
    fn empty_channels(&self) -> Vec<String> {
        let ports = self.inventory.serial_ports.iter();
        let channels = ports.flat_map(|port| {
            let channels = port.channels.iter();
            channels.filter_map(move |channel| match &channel.found {
                ChannelContent::Remote(_) => None,
                ChannelContent::NotStarted(reason) => {
                    Some(format!("{}.{}: {reason}", port.port, channel.channel))
                }
            })
        });
        channels.collect()
    }

    fn terminals(&self, html: &mut Html) {
        html.element("h2", "Terminals");
        if self.terminals.is_empty() {
            html.element("p", "No terminal of this board or its remotes is known.");
        }
        for card in &self.terminals {
            html.element("h3", &card.name);
            let columns = [
                at("Terminal"),
                at("Signal"),
                text("Direction"),
                code("Pins"),
            ];
            html.table(columns, &card.rows);
        }
    }

    fn parameters(&self, html: &mut Html) {
        html.element("h2", "Parameters of the remotes");
        let remotes = self.inventory.remotes();
        let with_some = remotes.filter(|(_, remote)| !remote.parameters.is_empty());
        let mut is_empty = true;
        for (label, remote) in with_some {
            is_empty = false;
            html.element("h3", label);
            let rows: Vec<_> = remote.parameters.iter().map(parameter).collect();
            let columns = [
                code("Parameter"),
                text("Value"),
                code("Raw"),
                text("Range"),
                text("Non-volatile"),
            ];
            html.table(columns, &rows);
        }
        if is_empty {
            html.element("p", "No remote has any.");
        }
    }
}

fn ethernet(ethernet: &InventoryEthernet) -> Vec<(&'static str, String)> {
    let identity = &ethernet.identity;
    let netmask = identity
        .eeprom_netmask
        .map(|mask| format!(", netmask {mask}"));
    vec![
        ("Board", identity.card.clone()),
        ("MAC address", identity.mac.to_string()),
        ("IP address", identity.address_from.of_card(&identity.card)),
        (
            "Address in EEPROM",
            format!("{}{}", identity.eeprom_ip, netmask.unwrap_or_default()),
        ),
        (
            "Ethernet firmware",
            format!(
                "{} (LBP {})",
                identity.firmware_version, identity.lbp_version
            ),
        ),
    ]
}

/// Number and name of the software mode.
fn mode(remote: &InventoryRemote) -> String {
    let mut modes = remote.modes.iter();
    let number = remote.software_mode;
    let own = modes.find(|mode| mode.set_by == "software" && mode.index == number);
    own.map_or_else(
        || number.to_string(),
        |mode| format!("{number}: {}", mode.name),
    )
}

fn faults(remote: &InventoryRemote) -> String {
    match &remote.faults[..] {
        [] => "none".to_owned(),
        faults => faults.join(", "),
    }
}

fn parameter(parameter: &InventoryParameter) -> [String; 5] {
    let data = &parameter.data;
    let error = || {
        parameter
            .error
            .clone()
            .unwrap_or_else(|| "not read".to_owned())
    };
    let value = parameter
        .value
        .map_or_else(error, |value| format!("{value} {}", data.unit));
    let range = info::limits(data).map(|limits| {
        let [min, max] = limits.map(|end| number::end(f64::from(end)));
        format!("{min} to {max}")
    });
    let kept = if data.nonvolatile { "yes" } else { "no" };
    [
        data.name.clone(),
        value.trim_end().to_owned(),
        parameter
            .raw
            .map_or_else(String::new, |raw| format!("0x{raw:X}")),
        range.unwrap_or_default(),
        kept.to_owned(),
    ]
}

fn firmware(html: &mut Html, firmware: &InventoryFirmware) {
    html.element("h2", "Modules of the firmware");
    let mhz = |hz: u32| format!("{:.3} MHz", f64::from(hz) / 1e6);
    let [low, high] = [firmware.clock_low_hz, firmware.clock_high_hz].map(mhz);
    html.element(
        "p",
        format_args!(
            "{} on {}; ClockLow {low}, ClockHigh {high}",
            Counted::of(firmware.io_pins as usize, "I/O pin"),
            Counted::of(firmware.connectors as usize, "connector"),
        ),
    );
    let rows = firmware.modules.iter().map(|module| {
        [
            module.module.clone(),
            module.instances.to_string(),
            module.version.to_string(),
            format!("0x{:04X}", module.base),
            mhz(module.clock_hz),
        ]
    });
    let columns = [
        text("Module"),
        text("Instances"),
        text("Version"),
        code("Registers"),
        text("Clock"),
    ];
    html.table(columns, &rows.collect::<Vec<_>>());
}
