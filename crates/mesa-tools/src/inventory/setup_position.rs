//! Remotes whose jumper is in the setup position: silent at the usual baud rate.

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::discovery::{DiscoveryOptions, discover_port};
use mesa_hal::sslbp::{Channel, DEFAULT_BAUD_RATE, Port};

use super::InventoryRemote;
use super::error::Taken;
use super::remote::take_remote;
use crate::setup::SETUP_BAUD_RATE;

/// Asks silent channels at the baud rate of the setup position, and takes the remotes that answer
/// there. Restores the usual baud rate.
pub(super) fn take_silent<B: RegisterBus + Clock>(
    bus: &mut B,
    port: &mut Port,
    silent: &[(Channel, u8)],
    options: &DiscoveryOptions<'_>,
) -> Taken<Vec<(Channel, InventoryRemote)>> {
    if silent.is_empty() {
        return Ok(Vec::new());
    }
    let taken = take_at_setup_rate(bus, port, silent, options);
    // After a failure as well, so that a later program finds the port as usual.
    let restored = set_rate(bus, port, silent, DEFAULT_BAUD_RATE);
    let remotes = taken?;
    restored?;
    Ok(remotes)
}

fn take_at_setup_rate<B: RegisterBus + Clock>(
    bus: &mut B,
    port: &mut Port,
    silent: &[(Channel, u8)],
    options: &DiscoveryOptions<'_>,
) -> Taken<Vec<(Channel, InventoryRemote)>> {
    set_rate(bus, port, silent, SETUP_BAUD_RATE)?;
    let outcomes = discover_port(port, bus, silent, options)?;
    let mut remotes = Vec::new();
    for (&(channel, _), outcome) in silent.iter().zip(outcomes) {
        if let Ok(found) = outcome {
            let remote = take_remote(bus, port, found);
            remotes.push((
                channel,
                InventoryRemote {
                    in_setup_position: true,
                    ..remote
                },
            ));
        }
    }
    Ok(remotes)
}

/// Sets the baud rate of channels, which are stopped.
fn set_rate<B: RegisterBus + Clock>(
    bus: &mut B,
    port: &mut Port,
    channels: &[(Channel, u8)],
    baud: u32,
) -> Taken<()> {
    let mut port = port.on(bus);
    port.stop_all()?;
    for &(channel, _) in channels {
        port.set_baud_rate(channel, baud)?;
    }
    Ok(port.stop_all()?)
}

/// Finding about a remote in the setup position.
pub(super) fn finding(remote: &InventoryRemote) -> String {
    format!(
        "the jumper of this {} is in the setup position ({SETUP_BAUD_RATE} baud): it takes parameters and \
         firmware, but no process data; put it back (7I77: W12 for field I/O, W4 for analog, to the left; \
         7I72: W6 up), and switch the card off and on",
        remote.name
    )
}
