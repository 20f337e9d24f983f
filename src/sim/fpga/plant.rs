//! What hangs on the FPGA besides the remotes: drives, motors and their encoders.

use super::Firmware;
use crate::sim::modules::{IoPorts, SmartSerial, Watcher};
use crate::sim::wire::{Nanos, RemoteEnd};

/// How often motors move and remotes age when nobody looks.
const GRAIN: Nanos = 1_000_000;

/// What a drive is told at the moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveSignal {
    /// The analog signal in volts.
    pub volts: f64,
    /// Whether the drive is enabled.
    pub enabled: bool,
}

/// Reads output number `1` of a remote as a drive sees it.
pub type Readout = fn(&dyn RemoteEnd, u8) -> DriveSignal;

/// Drives, motors and encoders.
#[derive(Debug)]
pub(crate) struct Plant {
    due: Nanos,
}

#[expect(clippy::unused_self, reason = "motors come next")]
impl Plant {
    pub(crate) fn new(_firmware: &Firmware) -> Self {
        Self { due: 0 }
    }

    pub(crate) fn is_due(&self, now: Nanos) -> bool {
        now >= self.due
    }

    pub(crate) fn advance(&mut self, to: Nanos) {
        self.due = to + GRAIN;
    }

    pub(crate) fn pins_changed(&mut self, _io: &IoPorts) {}

    pub(crate) fn refresh_remotes(&mut self, _serial: &[SmartSerial]) {}

    pub(crate) fn age_remotes(&mut self, _serial: &mut [SmartSerial], _now: Nanos) {}
}

/// Keeps the motors in step with what the remotes are told.
pub(crate) struct PortWatcher<'a> {
    plant: &'a mut Plant,
    port: usize,
}

impl<'a> PortWatcher<'a> {
    pub(crate) fn new(plant: &'a mut Plant, port: usize) -> Self {
        Self { plant, port }
    }
}

impl Watcher for PortWatcher<'_> {
    fn before(&mut self, now: Nanos) {
        let _ = self.port;
        self.plant.advance(now);
    }

    fn after(&mut self, _channel: usize, _remote: &dyn RemoteEnd) {}
}
