//! Log messages of a driver that has been built. None in the cycle.

use super::Driver;
use crate::advice::MesaError;
use crate::bus::{Clock, RegisterBus};

/// Logs the firmware and the remotes, and the remarks about them.
pub(super) fn found<B: RegisterBus + Clock>(driver: &Driver<B>) {
    let firmware = driver.firmware();
    log::info!(
        target: "mesa_hal",
        "{}: firmware for {} with {}",
        driver.name(),
        firmware.idrom.board_name,
        firmware.gtags()
    );
    for warning in &firmware.warnings {
        log::warn!(target: "mesa_hal", "{}: {warning}", driver.name());
    }
    for (number, port) in driver.ports().iter().enumerate() {
        for remote in port.remotes() {
            log::info!(target: "mesa_hal", "{} port {number}: {}", driver.name(), remote.started);
        }
    }
    for remark in driver.remarks().iter().chain(driver.missing()) {
        let remark = remark.with_advice();
        log::warn!(target: "mesa_hal", "{}: {remark}", driver.name());
    }
}
