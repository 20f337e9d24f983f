//! The spindle output of a 7I76: an analog output, an enable and a direction.

use super::{SignalValue, SimLayout};
use crate::fpga::DriveSignal;
use crate::remote::SimMemory;

/// Addresses and state of `SpinOut`, `SpinEna` and `SpinDir`. The names are those of LinuxCNC's
/// pins; type, width and range of `SpinOut` are unknown, and assumed to be those of a 7I77's analog
/// output.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Spindle {
    /// Addresses of the three elements.
    places: [u16; 3],
    raw: i16,
    enable: bool,
    reverse: bool,
}

impl Spindle {
    pub(super) fn power_up(&mut self, layout: &SimLayout) {
        let at = |name: &str| layout.address(name).unwrap_or_default();
        self.places = ["SpinOut", "SpinEna", "SpinDir"].map(at);
    }

    pub(super) fn drive(&mut self, memory: &SimMemory) {
        let [out, enable, reverse] = self.places;
        // 13 bits, sign extended.
        self.raw = (memory.word(out, 2) as u16) as i16;
        self.raw = self.raw << 3 >> 3;
        [self.enable, self.reverse] = [enable, reverse].map(|at| memory.byte(at) & 1 != 0);
    }

    pub(super) fn off(&mut self) {
        *self = Self {
            places: self.places,
            ..Self::default()
        };
    }

    /// Output voltage; 0 V while the enable is off.
    pub(super) fn volts(&self) -> f64 {
        if self.enable {
            f64::from(self.raw) / 4096.0 * 10.0
        } else {
            0.0
        }
    }

    /// The signal to a drive, which the direction output reverses.
    pub(super) fn signal(&self) -> DriveSignal {
        let volts = self.volts();
        DriveSignal {
            volts: if self.reverse { -volts } else { volts },
            enabled: self.enable,
        }
    }

    pub(super) fn outputs(&self) -> [(String, SignalValue); 3] {
        [
            ("spinout".to_owned(), SignalValue::Volts(self.volts())),
            ("spinena".to_owned(), SignalValue::Bool(self.enable)),
            ("spindir".to_owned(), SignalValue::Bool(self.reverse)),
        ]
    }
}
