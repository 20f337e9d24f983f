//! Simulated remotes.

use std::error::Error;

use mesa_hal_sim::{
    SimFpga,
    devices::{
        Analog, DescriptionError, FieldIo, Outputs48, Plain, SimDevice, find_cable, find_mut,
    },
    remote::Cable,
    wire::RemoteEnd,
};

use super::slot::Slot;
use crate::ui::files::bounded;

/// Field I/O part of a 7I77.
pub const FIELD_IO: &str = "7i77-io";
/// Analog part of a 7I77.
pub const ANALOG: &str = "7i77-analog";
/// Field I/O and spindle of a 7I76.
pub const I7I76: &str = "7i76";

/// Makes a remote.
type Make = fn() -> Result<Box<dyn RemoteEnd>, DescriptionError>;

/// Devices that are known by name.
const KNOWN: [(&str, Make); 18] = [
    (FIELD_IO, || Ok(Box::new(FieldIo::i7i77()?))),
    (ANALOG, || Ok(Box::new(Analog::i7i77()?))),
    ("7i64", || Ok(Box::new(Plain::i7i64()?))),
    ("7i69", || Ok(Box::new(Plain::i7i69()?))),
    ("7i70", || Ok(Box::new(Plain::i7i70()?))),
    ("7i71", || Ok(Box::new(Outputs48::i7i71()?))),
    ("7i72", || Ok(Box::new(Outputs48::i7i72()?))),
    ("7i73", || Ok(Box::new(Plain::i7i73()?))),
    ("7i73-display", || Ok(Box::new(Plain::i7i73_display()?))),
    (I7I76, || Ok(Box::new(FieldIo::i7i76()?))),
    ("7i76-r14", || {
        Ok(Box::new(FieldIo::i7i76_of_revision_14()?))
    }),
    ("7i76e", || Ok(Box::new(FieldIo::i7i76e()?))),
    ("7i76eu", || Ok(Box::new(FieldIo::i7i76eu()?))),
    ("7i76u", || Ok(Box::new(FieldIo::i7i76u()?))),
    ("7i83", || Ok(Box::new(Plain::i7i83()?))),
    ("7i84", || Ok(Box::new(FieldIo::i7i84()?))),
    ("7i84u", || Ok(Box::new(FieldIo::i7i84u()?))),
    ("7i87", || Ok(Box::new(Plain::i7i87()?))),
];

/// Size limit of a description; no real one comes near it.
const MAX_BYTES: u64 = 1 << 20;

/// True for a device that is known by name.
pub fn is_known(device: &str) -> bool {
    KNOWN.iter().any(|(name, _)| *name == device)
}

/// Builds a remote on a cable, from its name or from a description file.
pub fn build(device: &str, mode: Option<u8>, seed: u64) -> Result<Cable, Box<dyn Error>> {
    let mut end = match KNOWN.iter().find(|(name, _)| *name == device) {
        Some((_, make)) => make()?,
        None => from_file(device).map_err(|error| format!("device {device}: {error}"))?,
    };
    if let Some(mode) = mode {
        let has_mode = find_mut(end.as_mut()).is_some_and(|d| d.set_initial_mode(0, mode));
        if !has_mode {
            return Err(format!("device {device} has no mode {mode}").into());
        }
    }
    Ok(Cable::new(end, seed))
}

fn from_file(path: &str) -> Result<Box<dyn RemoteEnd>, Box<dyn Error>> {
    let bytes = bounded(path.as_ref(), MAX_BYTES).map_err(|error| {
        let known = KNOWN.map(|(name, _)| name).join(", ");
        format!("{error}; there are {known}, or a description file")
    })?;
    Ok(Box::new(Plain::from_description(str::from_utf8(&bytes)?)?))
}

/// The cable of a remote.
pub fn cable(fpga: &mut SimFpga, slot: Slot) -> Result<&mut Cable, String> {
    let (port, channel) = slot.indices();
    let end = fpga.remote_mut(port, channel);
    end.and_then(|end| find_cable(end))
        .ok_or_else(|| nothing_on(slot))
}

/// The device of a slot, plugged in or not.
pub fn device(fpga: &mut SimFpga, slot: Slot) -> Result<&mut dyn SimDevice, String> {
    let (port, channel) = slot.indices();
    let end = fpga.remote_mut(port, channel);
    end.and_then(|end| find_mut(end))
        .ok_or_else(|| nothing_on(slot))
}

fn nothing_on(slot: Slot) -> String {
    format!("no remote belongs to channel {slot}")
}
