//! Text of the inventory.

use std::fmt::{self, Display, Formatter};

use mesa_hal::ethernet::LedMode;
use mesa_hal::lbp::RemoteFaults;
use mesa_hal::remote::Scaling;
use mesa_tools::inventory::{
    ChannelContent as OnChannel, InventoryChannel, InventoryData, InventoryElement,
    InventoryEthernet, InventoryFirmware, InventoryParameter, InventoryPin, InventoryPort,
    InventoryRemote, PinDirection,
};

use super::Found;
use crate::ui::colours::Tone;
use mesa_tools::Counted;

impl Display for Found {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let inventory = &self.0;
        print_verdict(f, &inventory.judgement().to_string(), &inventory.findings)?;
        if let Some(ethernet) = &inventory.ethernet {
            print_ethernet(f, ethernet)?;
        }
        print_firmware(f, &inventory.firmware)?;
        inventory
            .serial_ports
            .iter()
            .try_for_each(|port| print_port(f, port))
    }
}

/// Prints the judgement, and the findings that it is about.
pub fn print_verdict(f: &mut Formatter<'_>, judgement: &str, findings: &[String]) -> fmt::Result {
    let tone = if findings.is_empty() {
        Tone::Good
    } else {
        Tone::Doubt
    };
    writeln!(f, "{}", tone.of(judgement))?;
    for finding in findings {
        writeln!(f, "  {}", tone.of(finding))?;
    }
    writeln!(f)
}

pub fn print_ethernet(f: &mut Formatter<'_>, ethernet: &InventoryEthernet) -> fmt::Result {
    let (identity, counters) = (&ethernet.identity, &ethernet.counters);
    writeln!(f, "Ethernet board {}", identity.card)?;
    if let Some(t_board) = &ethernet.t_board {
        writeln!(f, "  {t_board}")?;
    }
    writeln!(f, "  MAC          {}", identity.mac)?;
    let source = identity.address_from.of_card(&identity.card);
    writeln!(f, "  IP address   {source}")?;
    writeln!(f, "  EEPROM IP    {}", identity.eeprom_ip)?;
    if let Some(netmask) = identity.eeprom_netmask {
        writeln!(f, "  EEPROM mask  {netmask}")?;
    }
    writeln!(f, "  LBP version  {}", identity.lbp_version)?;
    writeln!(f, "  Firmware     {}", identity.firmware_version)?;
    writeln!(f, "  Jumpers      0x{:04X}", identity.jumpers)?;
    let (now, later) = (leds(ethernet.leds), leds(ethernet.leds_at_start));
    writeln!(f, "  LEDs         {now}; after a restart {later}")?;
    writeln!(
        f,
        "  Packets      {} received, {} of them damaged; {} sent, {} failed",
        counters.received, counters.received_bad, counters.sent, counters.sent_bad
    )?;
    writeln!(
        f,
        "  Errors       {} parse, {} memory, {} write",
        counters.parse_errors, counters.memory_errors, counters.write_errors
    )?;
    for memory in &ethernet.memory {
        let access = if memory.writable { "" } else { ", read only" };
        writeln!(
            f,
            "  Space {}      {}, {} bytes{access}",
            memory.space, memory.name, memory.bytes
        )?;
    }
    writeln!(f)
}

fn leds(mode: LedMode) -> &'static str {
    match mode {
        LedMode::HostMot2 => "show HostMot2's LED pins",
        LedMode::Debug => "count packets (debug)",
    }
}

pub fn print_firmware(f: &mut Formatter<'_>, firmware: &InventoryFirmware) -> fmt::Result {
    let mhz = |hz: u32| f64::from(hz) / 1e6;
    writeln!(
        f,
        "HostMot2 firmware for {}: {} on {}, ClockLow {:.3} MHz, ClockHigh {:.3} MHz",
        firmware.board,
        Counted::of(firmware.io_pins as usize, "I/O pin"),
        Counted::of(firmware.connectors as usize, "connector"),
        mhz(firmware.clock_low_hz),
        mhz(firmware.clock_high_hz),
    )?;
    writeln!(f, "\nModules")?;
    writeln!(
        f,
        "  {:<28} {:>7} {:>9}   base    clock",
        "", "version", "instances"
    )?;
    for module in &firmware.modules {
        writeln!(
            f,
            "  {:<28} {:>7} {:>9}   0x{:04X}  {:.3} MHz",
            module.module,
            module.version,
            module.instances,
            module.base,
            mhz(module.clock_hz),
        )?;
    }
    if !firmware.trailing.is_empty() {
        writeln!(
            f,
            "  and behind their end: {}",
            firmware.trailing.join("; ")
        )?;
    }
    writeln!(f, "\nI/O pins")?;
    print_pins(f, &firmware.pins)?;
    if firmware.local_pins.is_empty() {
        return Ok(());
    }
    writeln!(f, "\nLocal I/O pins, which end on the board")?;
    print_pins(f, &firmware.local_pins)
}

fn print_pins(f: &mut Formatter<'_>, pins: &[InventoryPin]) -> fmt::Result {
    for pin in pins {
        let way = match pin.direction {
            PinDirection::Out => "out",
            PinDirection::In => "in",
            PinDirection::Either => "in/out",
        };
        let line = format!(
            "  {:>3}  {way:<6}  {:<24} {}",
            pin.number, pin.function, pin.terminals,
        );
        writeln!(f, "{}", line.trim_end())?;
    }
    Ok(())
}

fn print_port(f: &mut Formatter<'_>, port: &InventoryPort) -> fmt::Result {
    writeln!(
        f,
        "\nSmart serial port {}: SSLBP {}, {}, clock {:.3} MHz",
        port.port,
        port.sslbp,
        Counted::of(port.channels.len(), "channel"),
        f64::from(port.clock_hz) / 1e6,
    )?;
    port.channels
        .iter()
        .try_for_each(|channel| print_channel(f, channel))
}

fn print_channel(f: &mut Formatter<'_>, channel: &InventoryChannel) -> fmt::Result {
    let number = channel.channel;
    match &channel.found {
        OnChannel::Remote(remote) => print_remote(f, number, remote),
        OnChannel::NotStarted(reason) => {
            writeln!(f, "\n  Channel {number}: nothing started: {reason}")
        }
    }
}

/// The faults of a remote, now and before. A bite of its watchdog is the usual state between two
/// programs (FACTS 1.5), and nothing to look for.
fn faults(now: &[String], before: &[String]) -> String {
    let bite = RemoteFaults::WATCHDOG.to_string();
    let (bites, others): (Vec<&String>, Vec<&String>) = before.iter().partition(|it| **it == bite);
    let mut parts = match now.join(", ") {
        now if now.is_empty() => vec!["none".to_owned()],
        now => vec![now],
    };
    if !others.is_empty() {
        let others: Vec<&str> = others.iter().map(|it| it.as_str()).collect();
        parts.push(format!(
            "before, and cleared by this look: {}",
            others.join(", ")
        ));
    }
    if !bites.is_empty() {
        parts.push("its watchdog had bitten, as after each power-up and each program".to_owned());
    }
    parts.join("; ")
}

fn print_remote(f: &mut Formatter<'_>, channel: u8, remote: &InventoryRemote) -> fmt::Result {
    let title = remote
        .known_as
        .map(|title| format!(" ({title})"))
        .unwrap_or_default();
    writeln!(
        f,
        "\n  Channel {channel}: {}{title}, unit number 0x{:08X}, software mode {}, RX {} TX {} bytes",
        remote.name, remote.unit_number, remote.software_mode, remote.rx_size, remote.tx_size,
    )?;
    if remote.in_setup_position {
        writeln!(f, "    in the setup position: answers at 115200 baud only")?;
    }
    if remote.built_in_table {
        writeln!(
            f,
            "    has no discovery of its own; this is the built-in table"
        )?;
    } else {
        let faults = faults(&remote.faults, &remote.faults_before);
        writeln!(f, "    faults: {faults}")?;
    }
    for mode in &remote.modes {
        let is_current = mode.set_by == "software" && mode.index == remote.software_mode;
        let current = if is_current { " (current)" } else { "" };
        writeln!(
            f,
            "    {} mode {}: {}{current}",
            mode.set_by, mode.index, mode.name
        )?;
    }
    writeln!(f, "    Process data")?;
    for element in &remote.process_data {
        print_element(f, element)?;
    }
    if !remote.parameters.is_empty() {
        writeln!(f, "    Parameters")?;
    }
    for parameter in &remote.parameters {
        print_parameter(f, parameter)?;
    }
    for difference in &remote.differences {
        writeln!(f, "    Differs from the table: {difference}")?;
    }
    for problem in &remote.problems {
        writeln!(f, "    Problem: {problem}")?;
    }
    Ok(())
}

fn print_parameter(f: &mut Formatter<'_>, parameter: &InventoryParameter) -> fmt::Result {
    let what = describe(&parameter.data);
    match (parameter.value, parameter.raw, &parameter.error) {
        (Some(value), Some(raw), _) => {
            writeln!(f, "      {what:<44} = {value} (raw 0x{raw:X})")
        }
        (_, _, error) => {
            let error = error.as_deref().unwrap_or("not read");
            writeln!(f, "      {what:<44}   {error}")
        }
    }
}

/// Prints an element, and the terminals of its bits with several to a line.
fn print_element(f: &mut Formatter<'_>, element: &InventoryElement) -> fmt::Result {
    writeln!(f, "      {}", describe(&element.data).trim_end())?;
    let places = element.terminals.iter();
    let places: Vec<_> = places
        .map(|at| format!("{} {}", at.place, at.signal))
        .collect();
    for line in places.chunks(4) {
        writeln!(f, "          {}", line.join(", "))?;
    }
    Ok(())
}

/// The limits of a record, unless they are those of its bits.
pub fn limits(data: &InventoryData) -> Option<[f32; 2]> {
    let (min, max) = (f64::from(data.min), f64::from(data.max));
    let mut scalings = [false, true]
        .map(|signed| Scaling::new(data.bits, signed, min, max))
        .into_iter();
    let are_its_bits = scalings.any(Scaling::is_whole);
    (data.min < data.max && !are_its_bits).then_some([data.min, data.max])
}

fn describe(data: &InventoryData) -> String {
    let way = match data.direction {
        "input" => "in",
        "output" => "out",
        _ => "in/out",
    };
    let range = limits(data).map(|[min, max]| format!(" {min}..{max}"));
    let range = range.unwrap_or_default();
    format!(
        "{:<20} {way:<6} {:>3} bits {}{range} {}",
        data.name, data.bits, data.data_type, data.unit
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bite_from_before_is_usual_and_other_faults_are_not() {
        let [bite, low] =
            [RemoteFaults::WATCHDOG, RemoteFaults::LOW_VOLTAGE].map(|fault| fault.to_string());
        let usual = "its watchdog had bitten, as after each power-up and each program";
        let before = format!("before, and cleared by this look: {low}");
        for (now, kept, text) in [
            (vec![], vec![], "none".to_owned()),
            (vec![], vec![bite.clone()], format!("none; {usual}")),
            (
                vec![],
                vec![bite.clone(), low.clone()],
                format!("none; {before}; {usual}"),
            ),
            (vec![low.clone()], vec![bite], format!("{low}; {usual}")),
        ] {
            assert_eq!(faults(&now, &kept), text);
        }
    }
}
