//! Prints what was found.

use mesa_hal::bus::RegisterBus;
use mesa_hal::discovery::ModeType;
use mesa_hal::driver::{Driver, RemoteStatus};
use mesa_hal::hal::Role;
use mesa_hal::sslbp::Channel;

pub fn print<B: RegisterBus>(driver: &Driver<B>, every_pin: bool) {
    let idrom = driver.firmware().idrom();
    println!(
        "Board {} ({}), {} MHz, {} I/O pins; modules: {}",
        driver.name(),
        idrom.board_name,
        idrom.clock_low_hz / 1_000_000,
        idrom.io_width,
        driver.firmware().gtags()
    );
    for (number, port) in driver.ports().iter().enumerate() {
        let time = port.expected_time();
        println!(
            "\nSerial port {number}: {} channels; a transfer takes up to {:?}, with a lost reply {:?}",
            port.layout().channels(),
            time.usual,
            time.with_timeout
        );
        for remote in port.remotes() {
            print_remote(driver, &remote);
        }
    }
    for missing in driver.missing() {
        println!(
            "  missing: port {}, channel {}: {}",
            missing.port, missing.channel, missing.reason
        );
    }
    let size = driver.image_size();
    println!(
        "\nA cycle reads {} registers and writes {}; over Ethernet {} bytes out and {} back, then {} out.",
        size.read_words,
        size.write_words,
        size.request_bytes(),
        size.reply_bytes(),
        size.write_bytes()
    );
    if every_pin {
        print_every_pin(driver);
    }
}

/// The remote on a channel of the first serial port.
pub fn remote<B: RegisterBus>(driver: &Driver<B>, channel: u8) -> Option<RemoteStatus<'_>> {
    driver.ports().first()?.remote(Channel::new(channel)?)
}

fn print_remote<B: RegisterBus>(driver: &Driver<B>, remote: &RemoteStatus<'_>) {
    let descriptor = remote.descriptor();
    println!("  {}", remote.started());
    for mode in &descriptor.modes {
        let is_software = mode.mode_type == ModeType::Software;
        let current = if is_software && mode.index == descriptor.software_mode {
            ", running"
        } else {
            ""
        };
        println!(
            "    mode {} {} ({:?}{current})",
            mode.index, mode.name, mode.mode_type
        );
    }
    print_terminals(driver, remote);
}

/// The pins that are at a terminal, four to a line.
fn print_terminals<B: RegisterBus>(driver: &Driver<B>, remote: &RemoteStatus<'_>) {
    let prefix = remote.pins().prefix();
    println!("    pins {prefix}.* with their terminals:");
    let pins: Vec<String> = driver
        .pins()
        .infos()
        .iter()
        .filter(|pin| pin.group == remote.group() && !pin.role.is_param())
        .filter(|pin| !pin.terminal.is_empty() && !pin.name.ends_with("-not"))
        .map(|pin| {
            let name = pin.name.strip_prefix(prefix).unwrap_or(&pin.name);
            format!("{} = {}", name.trim_start_matches('.'), pin.terminal)
        })
        .collect();
    for line in pins.chunks(4) {
        let line: Vec<_> = line.iter().map(|pin| format!("{pin:<27}  ")).collect();
        println!("      {}", line.concat().trim_end());
    }
}

fn print_every_pin<B: RegisterBus>(driver: &Driver<B>) {
    println!("\nAll pins and parameters:");
    for pin in driver.pins().infos() {
        let kind = if pin.role.is_param() { "param" } else { "pin" };
        println!(
            "  {kind:<6} {:<6} {:<4} {:<44} {}",
            pin.hal_type.as_str(),
            Role::hal_direction(pin.role),
            pin.name,
            pin.terminal
        );
    }
}
