//! A machine that runs: what every command that starts one says first.

use std::fmt::Write;

use mesa_hal::transport::udp::UdpBus;
use mesa_hal::{Board, Driver, Settings};

use crate::context::Failure;
use crate::output::complain;

/// Starts everything on a board with all outputs off, and says on standard error what was found, what
/// is missing, and what disagrees with its table.
pub fn start(bus: UdpBus, settings: Settings) -> Result<Driver<UdpBus>, Failure> {
    go(Board::identify(bus, settings)?)
}

/// The same on a board that is identified, and may be discovered.
pub fn go(board: Board<UdpBus>) -> Result<Driver<UdpBus>, Failure> {
    let driver = board.start()?;
    complain(found(&driver).trim_end());
    Ok(driver)
}

/// What a driver found on each channel, for people.
fn found(driver: &Driver<UdpBus>) -> String {
    let mut text = String::new();
    for port in driver.ports() {
        let layout = port.layout();
        for channel in 0..layout.channels {
            let mut remotes = port.remotes();
            let remote = remotes.find(|remote| remote.started.channel.index() == channel);
            let place = format_args!(
                "{}: port {}, channel {channel}",
                driver.name(),
                layout.instance
            );
            let _ = match remote {
                Some(remote) => writeln!(text, "{place}: {}", remote.descriptor.name),
                None => writeln!(text, "{place}: no remote takes part"),
            };
        }
    }
    for missing in driver.missing() {
        let _ = writeln!(text, "MISSING: {missing}");
    }
    for remark in driver.remarks() {
        let _ = writeln!(text, "Note: {remark}");
    }
    text
}
