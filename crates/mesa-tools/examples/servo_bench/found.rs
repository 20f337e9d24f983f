//! List of the hardware found.

use std::fmt::{self, Write};

use mesa_hal::MesaError;
use mesa_hal::bus::{Access, Clock, RegisterBus};
use mesa_hal::discovery::ModeType;
use mesa_hal::driver::{Driver, RemoteStatus};
use mesa_hal::hal::Role;

/// The board, its remotes and the registers of a cycle; with every pin if `every_pin`.
pub fn list<B: RegisterBus + Clock>(driver: &Driver<B>, every_pin: bool) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = write_all(&mut text, driver, every_pin);
    text
}

fn write_all<B: RegisterBus + Clock>(
    out: &mut String,
    driver: &Driver<B>,
    every_pin: bool,
) -> fmt::Result {
    let idrom = &driver.firmware().idrom;
    writeln!(
        out,
        "Board {} ({}), {} MHz, {} I/O pins; modules: {}",
        driver.name(),
        idrom.board_name,
        idrom.clock_low_hz / 1_000_000,
        idrom.io_width,
        driver.firmware().gtags()
    )?;
    for (number, port) in driver.ports().iter().enumerate() {
        let time = port.expected_time;
        writeln!(
            out,
            "\nSerial port {number}: {} channels; a transfer takes up to {:?}, with a lost reply {:?}",
            port.layout().channels,
            time.usual,
            time.with_timeout
        )?;
        for remote in port.remotes() {
            write_remote(out, driver, &remote)?;
        }
    }
    for remark in driver.remarks() {
        let remark = remark.with_advice();
        println!("  note: {remark}");
    }
    for missing in driver.missing() {
        let missing = missing.with_advice();
        writeln!(out, "  missing: {missing}")?;
    }
    let lists = driver.lists();
    let words = |list: &[Access]| list.iter().map(|access| access.count).sum::<u16>();
    writeln!(
        out,
        "\nA cycle reads {} registers and writes {}.",
        words(lists.read.as_ref()),
        words(lists.write.as_ref())
    )?;
    if every_pin {
        write_every_pin(out, driver)?;
    }
    Ok(())
}

fn write_remote<B: RegisterBus + Clock>(
    out: &mut String,
    driver: &Driver<B>,
    remote: &RemoteStatus<'_>,
) -> fmt::Result {
    let descriptor = remote.descriptor;
    writeln!(out, "  {}", remote.started)?;
    for mode in &descriptor.modes {
        let is_software = mode.mode_type == ModeType::Software;
        let current = if is_software && mode.index == descriptor.software_mode {
            ", running"
        } else {
            ""
        };
        writeln!(
            out,
            "    mode {} {} ({:?}{current})",
            mode.index, mode.name, mode.mode_type
        )?;
    }
    write_terminals(out, driver, remote)
}

/// The pins that are at a terminal, four to a line.
fn write_terminals<B: RegisterBus + Clock>(
    out: &mut String,
    driver: &Driver<B>,
    remote: &RemoteStatus<'_>,
) -> fmt::Result {
    let prefix = &remote.pins.prefix;
    writeln!(out, "    pins {prefix}.* with their terminals:")?;
    let pins: Vec<String> = driver
        .pins()
        .infos()
        .iter()
        .filter(|pin| pin.group == remote.pins.group && !pin.role.is_param())
        .filter(|pin| !pin.place.terminal.is_empty() && !pin.name.ends_with("-not"))
        .map(|pin| {
            let name = pin.name.strip_prefix(prefix).unwrap_or(&pin.name);
            format!("{} = {}", name.trim_start_matches('.'), pin.place.terminal)
        })
        .collect();
    for line in pins.chunks(4) {
        let line: Vec<_> = line.iter().map(|pin| format!("{pin:<27}  ")).collect();
        writeln!(out, "      {}", line.concat().trim_end())?;
    }
    Ok(())
}

fn write_every_pin<B: RegisterBus + Clock>(out: &mut String, driver: &Driver<B>) -> fmt::Result {
    writeln!(out, "\nAll pins and parameters:")?;
    for pin in driver.pins().infos() {
        let kind = if pin.role.is_param() { "param" } else { "pin" };
        writeln!(
            out,
            "  {kind:<6} {:<6} {:<4} {:<44} {}",
            pin.hal_type.as_str(),
            Role::hal_direction(pin.role),
            pin.name,
            pin.place.terminal
        )?;
    }
    Ok(())
}
