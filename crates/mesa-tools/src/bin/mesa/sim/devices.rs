//! Simulated remotes.

use std::error::Error;

use mesa_hal_sim::{
    devices::{Analog, FieldIo, Outputs48, Plain, find_mut},
    remote::Cable,
    wire::RemoteEnd,
};

use crate::files::bounded;

/// Field I/O part of a 7I77.
pub const FIELD_IO: &str = "7i77-io";
/// Analog part of a 7I77.
pub const ANALOG: &str = "7i77-analog";
const I7I72: &str = "7i72";
const I7I64: &str = "7i64";
const I7I84: &str = "7i84";
/// Field I/O and spindle of a 7I76.
pub const I7I76: &str = "7i76";
const I7I76E: &str = "7i76e";
const KNOWN: [&str; 7] = [FIELD_IO, ANALOG, I7I72, I7I64, I7I84, I7I76, I7I76E];

/// Size limit of a description; no real one comes near it.
const MAX_BYTES: u64 = 1 << 20;

/// True for a device that is known by name.
pub fn is_known(device: &str) -> bool {
    KNOWN.contains(&device)
}

/// Builds a remote on a cable, from its name or from a description file.
pub fn build(device: &str, mode: Option<u8>, seed: u64) -> Result<Cable, Box<dyn Error>> {
    let mut end: Box<dyn RemoteEnd> = match device {
        FIELD_IO => Box::new(FieldIo::i7i77()?),
        ANALOG => Box::new(Analog::i7i77()?),
        I7I72 => Box::new(Outputs48::i7i72()?),
        I7I64 => Box::new(Plain::i7i64()?),
        I7I84 => Box::new(FieldIo::i7i84()?),
        I7I76 => Box::new(FieldIo::i7i76()?),
        I7I76E => Box::new(FieldIo::i7i76e()?),
        file => from_file(file).map_err(|error| format!("device {file}: {error}"))?,
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
        let known = KNOWN.join(", ");
        format!("{error}; there are {known}, or a description file")
    })?;
    Ok(Box::new(Plain::from_description(str::from_utf8(&bytes)?)?))
}
