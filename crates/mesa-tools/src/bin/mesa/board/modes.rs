//! The software modes that remotes are started in.

use std::collections::BTreeMap;

use clap::Args;
use mesa_hal::{RemoteId, Settings};

/// The software modes that remotes are started in.
#[derive(Clone, Debug, Args)]
pub struct Modes {
    /// Software mode (1 to 255) of the remote on a serial port (0 to 3) and channel (0 to 7),
    /// instead of mode 0; repeat for more
    #[arg(long = "mode", value_name = "PORT.CHANNEL=MODE", value_parser = parse)]
    modes: Vec<(RemoteId, u8)>,
}

impl Modes {
    /// Modes by remote; of two for the same remote, the last one counts.
    pub fn by_remote(&self) -> BTreeMap<RemoteId, u8> {
        self.modes.iter().copied().collect()
    }

    /// Adds the modes to the settings of a driver.
    pub fn put(&self, settings: &mut Settings) {
        for (&RemoteId { port, channel }, &mode) in &self.by_remote() {
            let port = settings.serial_ports.entry(port).or_default();
            port.channels.entry(channel).or_default().mode = mode;
        }
    }
}

fn parse(text: &str) -> Result<(RemoteId, u8), String> {
    let parts = || {
        let (place, mode) = text.split_once('=')?;
        let (port, channel) = place.split_once('.')?;
        let remote = RemoteId::new(port.parse().ok()?, channel.parse().ok()?);
        Some((remote, mode.parse().ok()?))
    };
    parts().ok_or_else(|| format!("`{text}` is no PORT.CHANNEL=MODE, for example 0.1=2"))
}
