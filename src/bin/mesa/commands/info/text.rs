//! The inventory for people.

use std::fmt::{self, Write};

use mesa_hal::discovery::{DataDirection, DataRecord, ModeType};
use mesa_hal::remote::Scaling;

use super::report::{ChannelReport, PortReport, RemoteReport, Report};
use super::terminals;

pub fn of(report: &Report) -> Result<String, fmt::Error> {
    let mut text = String::new();
    print_report(&mut text, report)?;
    Ok(text)
}

fn print_report(out: &mut String, report: &Report) -> fmt::Result {
    if let Some(identity) = &report.identity {
        writeln!(out, "Ethernet board {}", identity.card)?;
        writeln!(out, "  MAC          {}", identity.mac)?;
        writeln!(out, "  EEPROM IP    {}", identity.eeprom_ip)?;
        if let Some(netmask) = identity.eeprom_netmask {
            writeln!(out, "  EEPROM mask  {netmask}")?;
        }
        writeln!(out, "  LBP version  {}", identity.lbp_version)?;
        writeln!(out, "  Firmware     {}", identity.firmware_version)?;
        writeln!(out, "  Jumpers      0x{:04X}", identity.jumpers)?;
        writeln!(out)?;
    }
    print_firmware(out, report)?;
    for port in &report.ports {
        print_port(out, port)?;
    }
    Ok(())
}

fn print_firmware(out: &mut String, report: &Report) -> fmt::Result {
    let idrom = &report.firmware.idrom;
    writeln!(
        out,
        "HostMot2 firmware for {}: {} I/O pins on {} connectors, ClockLow {:.3} MHz, ClockHigh {:.3} MHz",
        idrom.board_name,
        idrom.io_width,
        idrom.io_ports,
        f64::from(idrom.clock_low_hz) / 1e6,
        f64::from(idrom.clock_high_hz) / 1e6,
    )?;
    for warning in &report.firmware.warnings {
        writeln!(out, "  Warning: {warning}")?;
    }
    writeln!(out, "\nModules")?;
    writeln!(
        out,
        "  {:<28} {:>7} {:>9}   base    clock",
        "", "version", "instances"
    )?;
    for module in &report.firmware.modules {
        writeln!(
            out,
            "  {:<28} {:>7} {:>9}   0x{:04X}  {:.3} MHz",
            module.gtag.to_string(),
            module.version,
            module.instances,
            module.base,
            f64::from(module.clock_hz) / 1e6,
        )?;
    }
    writeln!(out, "\nI/O pins")?;
    let width = idrom.port_width.max(1) as usize;
    for (number, pin) in report.firmware.pins.iter().enumerate() {
        let way = match (pin.has_module(), pin.is_output()) {
            (true, true) => "out",
            (true, false) => "in",
            (false, _) => "in/out",
        };
        writeln!(
            out,
            "  {number:>3}  connector {} pin {:>2}  {way:<6}  {:<24} {}",
            number / width,
            number % width,
            pin.to_string(),
            terminals::of(&report.firmware, number, *pin),
        )?;
    }
    Ok(())
}

fn print_port(out: &mut String, port: &PortReport) -> fmt::Result {
    writeln!(
        out,
        "\nSmart serial port {}: SSLBP {}.{}, {} channels, clock {:.3} MHz",
        port.number,
        port.parameters.major,
        port.parameters.minor,
        port.channels.len(),
        f64::from(port.parameters.clock_hz) / 1e6,
    )?;
    for channel in &port.channels {
        print_channel(out, channel)?;
    }
    Ok(())
}

fn print_channel(out: &mut String, channel: &ChannelReport) -> fmt::Result {
    match &channel.remote {
        Ok(remote) => print_remote(out, channel.number, remote),
        Err(reason) => writeln!(
            out,
            "\n  Channel {}: nothing started: {reason}",
            channel.number
        ),
    }
}

fn print_remote(out: &mut String, channel: u8, remote: &RemoteReport) -> fmt::Result {
    let descriptor = &remote.descriptor;
    let title = remote
        .table
        .map(|table| format!(" ({})", table.title))
        .unwrap_or_default();
    writeln!(
        out,
        "\n  Channel {channel}: {}{title}, unit number 0x{:08X}, software mode {}, RX {} TX {} bytes",
        descriptor.name,
        descriptor.unit_number,
        descriptor.software_mode,
        remote.sizes.0,
        remote.sizes.1,
    )?;
    if remote.built_in {
        writeln!(
            out,
            "    has no discovery of its own; this is the built-in table"
        )?;
    }
    for mode in remote.modes() {
        let (kind, current) = match mode.mode_type {
            ModeType::Hardware => ("hardware", ""),
            ModeType::Software if mode.index == descriptor.software_mode => {
                ("software", " (current)")
            }
            _ => ("software", ""),
        };
        writeln!(
            out,
            "    {kind} mode {}: {}{current}",
            mode.index, mode.name
        )?;
    }
    writeln!(out, "    Process data")?;
    for record in &descriptor.process_data {
        writeln!(out, "      {}", describe(record).trim_end())?;
        print_terminals(out, remote, record)?;
    }
    if !remote.parameters.is_empty() {
        writeln!(out, "    Parameters")?;
    }
    for (record, value) in &remote.parameters {
        match value {
            Ok(value) => writeln!(
                out,
                "      {:<44} = {} (raw 0x{:X})",
                describe(record),
                value.value,
                value.raw
            ),
            Err(error) => writeln!(out, "      {:<44}   {error}", describe(record)),
        }?;
    }
    for difference in &remote.differences {
        writeln!(out, "    Differs from the table: {difference}")?;
    }
    for problem in &remote.problems {
        writeln!(out, "    Problem: {problem}")?;
    }
    Ok(())
}

/// Where the bits of an element are on the card, several to a line.
fn print_terminals(out: &mut String, remote: &RemoteReport, record: &DataRecord) -> fmt::Result {
    let element = remote
        .table
        .and_then(|table| table.element(&record.name, record.direction));
    let places = element.iter().flat_map(|element| element.places(None));
    let places: Vec<String> = places
        .map(|at| format!("{} {}", at.terminal, at.signal))
        .collect();
    for line in places.chunks(4) {
        writeln!(out, "          {}", line.join(", "))?;
    }
    Ok(())
}

fn describe(record: &DataRecord) -> String {
    let way = match record.direction {
        DataDirection::Input => "in",
        DataDirection::Output => "out",
        DataDirection::Bidirectional => "in/out",
    };
    let (min, max) = (f64::from(record.min), f64::from(record.max));
    let limits_are_its_bits = [false, true]
        .map(|signed| Scaling::new(record.bits, signed, min, max))
        .into_iter()
        .any(Scaling::is_whole);
    let range = if record.min < record.max && !limits_are_its_bits {
        format!(" {}..{}", record.min, record.max)
    } else {
        String::new()
    };
    format!(
        "{:<20} {way:<6} {:>3} bits {:?}{range} {}",
        record.name, record.bits, record.data_type, record.unit
    )
}
