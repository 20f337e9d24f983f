//! What a driver that has been built, or is dropped, writes to the log. Never in the cycle.

use super::Driver;
use crate::bus::{Clock, RegisterBus};
use crate::sslbp::PortError;

/// What was found, and what is odd about it.
pub(super) fn found<B: RegisterBus + Clock>(driver: &Driver<B>) {
    let firmware = driver.firmware();
    log::info!(
        "{}: firmware for {} with {}",
        driver.name(),
        firmware.idrom.board_name,
        firmware.gtags()
    );
    for warning in &firmware.warnings {
        log::warn!("{}: {warning}", driver.name());
    }
    for (number, port) in driver.ports().iter().enumerate() {
        for remote in port.remotes() {
            log::info!("{} port {number}: {}", driver.name(), remote.started);
        }
    }
    for remark in driver.remarks().iter().chain(driver.missing()) {
        log::warn!("{}: {remark}", driver.name());
    }
}

/// What a driver that nobody has stopped could not stop: what `stop` returns, and `not_reached`.
pub(super) fn dropped<B: RegisterBus + Clock>(
    driver: &Driver<B>,
    stopped: &Result<(), PortError<B::Error>>,
) {
    if let Err(error) = stopped {
        log::error!(
            "{}: was dropped, and not all of it could be stopped: {error}",
            driver.name()
        );
    }
    for remote in driver.not_reached() {
        log::error!("{}: {remote}", driver.name());
    }
}
