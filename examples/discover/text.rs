//! The inventory for people.

use mesa_hal::discovery::{DataDirection, DataRecord, ModeType};
use mesa_hal::process_data::Scaling;

use crate::report::{ChannelReport, PortReport, RemoteReport, Report};
use crate::terminals;

pub fn print(report: &Report) {
    if let Some(identity) = &report.identity {
        println!("Ethernet board {}", identity.card_name());
        println!("  MAC          {}", identity.mac);
        println!("  EEPROM IP    {}", identity.eeprom_ip);
        if let Some(netmask) = identity.eeprom_netmask {
            println!("  EEPROM mask  {netmask}");
        }
        println!("  LBP version  {}", identity.lbp_version);
        println!("  Firmware     {}", identity.firmware_version);
        println!("  Jumpers      0x{:04X}", identity.jumpers);
        println!();
    }
    print_firmware(report);
    for port in &report.ports {
        print_port(port);
    }
}

fn print_firmware(report: &Report) {
    let idrom = report.firmware.idrom();
    println!(
        "HostMot2 firmware for {}: {} I/O pins on {} connectors, ClockLow {:.3} MHz, ClockHigh {:.3} MHz",
        idrom.board_name,
        idrom.io_width,
        idrom.io_ports,
        f64::from(idrom.clock_low_hz) / 1e6,
        f64::from(idrom.clock_high_hz) / 1e6,
    );
    for warning in report.firmware.warnings() {
        println!("  Warning: {warning}");
    }
    println!("\nModules");
    println!(
        "  {:<28} {:>7} {:>9}   base    clock",
        "", "version", "instances"
    );
    for module in report.firmware.modules() {
        println!(
            "  {:<28} {:>7} {:>9}   0x{:04X}  {:.3} MHz",
            module.gtag.to_string(),
            module.version,
            module.instances,
            module.base,
            f64::from(module.clock_hz) / 1e6,
        );
    }
    println!("\nI/O pins");
    let width = idrom.port_width.max(1) as usize;
    for (number, pin) in report.firmware.pins().iter().enumerate() {
        let way = match (pin.has_module(), pin.is_output()) {
            (true, true) => "out",
            (true, false) => "in",
            (false, _) => "in/out",
        };
        println!(
            "  {number:>3}  connector {} pin {:>2}  {way:<6}  {:<24} {}",
            number / width,
            number % width,
            pin.to_string(),
            terminals::of(&report.firmware, number, *pin),
        );
    }
}

fn print_port(port: &PortReport) {
    println!(
        "\nSmart serial port {}: SSLBP {}.{}, {} channels, clock {:.3} MHz",
        port.number,
        port.parameters.major,
        port.parameters.minor,
        port.channels.len(),
        f64::from(port.parameters.clock_hz) / 1e6,
    );
    for channel in &port.channels {
        print_channel(channel);
    }
}

fn print_channel(channel: &ChannelReport) {
    match &channel.remote {
        Ok(remote) => print_remote(channel.number, remote),
        Err(reason) => println!("\n  Channel {}: nothing started: {reason}", channel.number),
    }
}

fn print_remote(channel: u8, remote: &RemoteReport) {
    let descriptor = &remote.descriptor;
    let title = remote
        .table
        .map(|table| format!(" ({})", table.title))
        .unwrap_or_default();
    println!(
        "\n  Channel {channel}: {}{title}, unit number 0x{:08X}, software mode {}, RX {} TX {} bytes",
        descriptor.name,
        descriptor.unit_number,
        descriptor.software_mode,
        remote.sizes.0,
        remote.sizes.1,
    );
    if remote.built_in {
        println!("    has no discovery of its own; this is the built-in table");
    }
    for mode in remote.modes() {
        let (kind, current) = match mode.mode_type {
            ModeType::Hardware => ("hardware", ""),
            ModeType::Software if mode.index == descriptor.software_mode => {
                ("software", " (current)")
            }
            _ => ("software", ""),
        };
        println!("    {kind} mode {}: {}{current}", mode.index, mode.name);
    }
    println!("    Process data");
    for record in &descriptor.process_data {
        println!("      {}", describe(record).trim_end());
        print_terminals(remote, record);
    }
    if !remote.parameters.is_empty() {
        println!("    Parameters");
    }
    for (record, value) in &remote.parameters {
        match value {
            Ok(value) => println!(
                "      {:<44} = {} (raw 0x{:X})",
                describe(record),
                value.value,
                value.raw
            ),
            Err(error) => println!("      {:<44}   {error}", describe(record)),
        }
    }
    for problem in &remote.problems {
        println!("    Problem: {problem}");
    }
}

/// Where the bits of an element are on the card, several to a line.
fn print_terminals(remote: &RemoteReport, record: &DataRecord) {
    let element = remote
        .table
        .and_then(|table| table.element(&record.name, record.direction));
    let places: Vec<String> = element
        .map_or(&[][..], |element| element.terminals)
        .iter()
        .map(|terminal| format!("{} {}", terminal.place, terminal.signal))
        .collect();
    for line in places.chunks(4) {
        println!("          {}", line.join(", "));
    }
}

fn describe(record: &DataRecord) -> String {
    let way = match record.direction {
        DataDirection::Input => "in",
        DataDirection::Output => "out",
        DataDirection::Bidirectional => "in/out",
    };
    let (min, max) = (f64::from(record.min), f64::from(record.max));
    let limits_are_its_bits = [Scaling::unsigned, Scaling::signed]
        .iter()
        .filter_map(|scaling| scaling(record.bits, min, max))
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
