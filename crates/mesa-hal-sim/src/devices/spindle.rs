//! The spindle output of a 7I76: an analog output, an enable and a direction.

use super::{SignalValue, SimLayout};
use crate::fpga::DriveSignal;
use crate::remote::SimMemory;

/// Full scale of `SpinOut`, 13 bits unsigned. Its width is not known.
const FULL_SCALE: f64 = 8191.0;

/// Voltage at the potentiometer terminals, of which `SpinOut` is a share.
const SUPPLY: f64 = 10.0;

/// Addresses and state of `SpinOut`, `SpinEna` and `SpinDir`. The names are those of LinuxCNC's
/// pins, the range is 0 to 100.
///
/// A card with `SpinMode` has, while that is not 0, outputs for forward and reverse in place of
/// enable and direction (manual: 7I76EU, "SPINDLE ISOLATED OUTPUTS"). That the enable selects one
/// of the two is an assumption.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Spindle {
    /// Addresses of the three elements.
    places: [u16; 3],
    mode_place: Option<u16>,
    raw: u16,
    enable: bool,
    reverse: bool,
    /// True if the two outputs are forward and reverse.
    two_directions: bool,
}

impl Spindle {
    pub(super) fn power_up(&mut self, layout: &SimLayout) {
        let at = |name: &str| layout.address(name).unwrap_or_default();
        self.places = ["SpinOut", "SpinEna", "SpinDir"].map(at);
        self.mode_place = layout.address("SpinMode");
    }

    pub(super) fn drive(&mut self, memory: &SimMemory) {
        let [out, enable, reverse] = self.places;
        self.raw = memory.word(out, 2) as u16;
        [self.enable, self.reverse] = [enable, reverse].map(|at| memory.byte(at) & 1 != 0);
        let mode = self.mode_place.map_or(0, |at| memory.word(at, 2));
        self.two_directions = mode != 0;
    }

    pub(super) fn off(&mut self) {
        *self = Self {
            places: self.places,
            mode_place: self.mode_place,
            ..Self::default()
        };
    }

    /// Output voltage; 0 V while the enable is off.
    pub(super) fn volts(&self) -> f64 {
        if self.enable {
            f64::from(self.raw) / FULL_SCALE * SUPPLY
        } else {
            0.0
        }
    }

    /// True for each of the two isolated outputs that conducts.
    const fn contacts(&self) -> [bool; 2] {
        if self.two_directions {
            [self.enable && !self.reverse, self.enable && self.reverse]
        } else {
            [self.enable, self.reverse]
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

    /// Voltage, and the two isolated outputs: enable and direction, or forward and reverse.
    pub(super) fn outputs(&self) -> [(String, SignalValue); 3] {
        let names = if self.two_directions {
            ["spinfwd", "spinrev"]
        } else {
            ["spinena", "spindir"]
        };
        let [first, second] = self.contacts();
        [
            ("spinout".to_owned(), SignalValue::Volts(self.volts())),
            (names[0].to_owned(), SignalValue::Bool(first)),
            (names[1].to_owned(), SignalValue::Bool(second)),
        ]
    }
}
