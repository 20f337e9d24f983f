//! What a driver that has been built writes to the log. Never in the cycle.

use super::Driver;
use crate::bus::{Clock, RegisterBus};

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
