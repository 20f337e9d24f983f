//! A look at each firmware beside a program that drives it.

use std::collections::BTreeSet;

use mesa_hal::driver::Defaults;
use mesa_hal::transport::{BusLog, RecordedEntry, Recording, RegisterMap};
use mesa_hal::{Board, Settings};
use mesa_hal_sim::{FirmwareImage, SimFpga};

use super::{Image, each, same};

/// The names of the pins that a look shows.
fn shown(image: &Image) -> Result<usize, String> {
    let parsed = FirmwareImage::parse(&image.text).map_err(|error| error.to_string())?;
    let fpga = SimFpga::from_image(&parsed).map_err(|error| error.to_string())?;
    let mut bus = Recording::new(fpga, BusLog::new(10_000));
    let settings = Settings {
        defaults: Defaults::LinuxCnc,
        ..Settings::default()
    };
    let board = Board::identify(&mut bus, settings).map_err(|error| error.to_string())?;
    let mut listener = board.listen().map_err(|error| error.to_string())?;
    listener.bus_mut().log.resume();
    listener.read().map_err(|error| error.to_string())?;
    let map = RegisterMap::of(listener.firmware());
    let count = listener.shown().count();
    let mut refused = BTreeSet::new();
    for entry in bus.log.entries() {
        match *entry {
            RecordedEntry::Read { address, .. } => {
                if let Err(refusal) = map.at(address) {
                    refused.insert(format!("0x{address:04X}: {refusal}"));
                }
            }
            ref other => _ = refused.insert(other.to_string()),
        }
    }
    same("accesses with an effect", &refused, &BTreeSet::new())?;
    Ok(count)
}

#[test]
fn look_at_every_firmware_reads_what_has_no_effect() {
    each(|image| {
        let count = shown(image)?;
        println!("{}: {count} pins", image.name);
        // The lines of its I/O pins, and the watchdog.
        same("few pins", &(count < image.truth.pins.len() / 2), &false)
    });
}
