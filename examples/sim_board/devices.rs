//! The remotes that can be plugged in.

use std::{error::Error, fs};

use mesa_hal::sim::{DriveSignal, DriveSource, remote::Remote, wire::RemoteEnd};

/// Field I/O part of a 7I77.
pub const FIELD_IO: &str = "7i77-io";
/// Analog part of a 7I77.
pub const ANALOG: &str = "7i77-analog";

/// Makes a remote: one that is known by name, or one from a description file.
pub fn build(device: &str, _mode: Option<u8>) -> Result<Box<dyn RemoteEnd>, Box<dyn Error>> {
    let text = fs::read_to_string(device).map_err(|error| format!("device {device}: {error}"))?;
    let mut remote = Remote::model();
    remote.apply("present=1")?;
    for (number, line) in text.lines().enumerate() {
        remote
            .apply(line)
            .map_err(|error| format!("{device}, line {}: {error}", number + 1))?;
    }
    Ok(Box::new(remote))
}

/// What an analog output of a 7I77 gives to a drive.
pub fn drive(port: usize, channel: usize, output: u8) -> DriveSource {
    DriveSource::Remote {
        port,
        channel,
        output,
        readout: |_, _| DriveSignal::default(),
    }
}
