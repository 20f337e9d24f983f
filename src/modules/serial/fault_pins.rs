//! The state of a remote, as pins.

use alloc::format;

use super::life::Life;
use crate::hal::{GroupId, Input, PinError, PinMaker, PinStore};
use crate::sslbp::{ChannelLink, RemoteFaults};

/// The state of a remote, as pins. They belong to the group of the driver's own pins, which stays
/// valid while the remote fails, so that they can report the failure.
#[derive(Debug)]
pub(crate) struct RemoteFaultPins {
    running: Input<bool>,
    faults: [Input<bool>; FAULTS.len()],
    failures: Input<u64>,
    restarts: Input<u64>,
    /// The last published values, in the order of the pins.
    shown: Option<(bool, RemoteFaults, u64, u64)>,
}

/// The faults that a remote reports, and the names of their pins.
const FAULTS: [(RemoteFaults, &str); 8] = [
    (RemoteFaults::WATCHDOG, "fault-watchdog"),
    (RemoteFaults::NO_ENABLE, "fault-no-enable"),
    (RemoteFaults::OVER_TEMPERATURE, "fault-over-temp"),
    (RemoteFaults::OVER_CURRENT, "fault-over-current"),
    (RemoteFaults::HIGH_VOLTAGE, "fault-high-voltage"),
    (RemoteFaults::LOW_VOLTAGE, "fault-low-voltage"),
    (RemoteFaults::ILLEGAL_MODE, "fault-illegal-mode"),
    (RemoteFaults::COMMUNICATION, "fault-lbp-com"),
];

impl RemoteFaultPins {
    /// Makes the pins; `group` is that of the driver's own pins.
    pub fn new(pins: &mut PinStore, group: GroupId, prefix: &str) -> Result<Self, PinError> {
        let mut make = PinMaker::new(pins, group, format!("{prefix}."));
        let mut faults = [Input::default(); FAULTS.len()];
        for (pin, (_, fault)) in faults.iter_mut().zip(FAULTS) {
            *pin = make.input(fault)?;
        }
        Ok(Self {
            running: make.input("running")?,
            faults,
            failures: make.input("failures")?,
            restarts: make.input("restarts")?,
            shown: None,
        })
    }

    pub fn publish(&mut self, pins: &mut PinStore, life: &Life, link: &ChannelLink) {
        let (running, failures) = (life.is_running(), link.failures.total());
        let shown = (running, life.faults(), failures, life.restarts());
        if self.shown.replace(shown) == Some(shown) {
            return;
        }
        pins.publish(self.running, running);
        for (&pin, (fault, _)) in self.faults.iter().zip(FAULTS) {
            pins.publish(pin, life.faults().contains(fault));
        }
        pins.publish(self.failures, failures);
        pins.publish(self.restarts, life.restarts());
    }
}
