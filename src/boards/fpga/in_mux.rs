//! Filtered inputs and MPGs: InMux and InM.

use alloc::format;
use alloc::vec::Vec;

use super::Maker;
use crate::boards::Terminal;
use crate::hal::{DigitalIn, GroupId, Input, Output, Param, PinError, PinStore};

/// Which of the two modules: they differ in names and wiring only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InMuxKind {
    /// Multiplexed.
    InMux,
    /// A pin for each input.
    InM,
}

/// The pins of one input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InMuxInput {
    /// Filtered.
    pub filtered: DigitalIn,
    /// As it is.
    pub raw: DigitalIn,
    /// Filtered for long, and not for short.
    pub slow: Output<bool>,
}

/// The pins of one instance: `hm2_7i97.0.inmux.00.input-00` and so on.
///
/// After the board was set up, at start and again after a bite or a reset, inputs are not valid
/// before they have been scanned (raw), or scanned as often as their filter takes (filtered, and the
/// MPG counts on them): 0.5 ms with the short filter, 26 ms with the long one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct InMuxPins {
    /// How often all inputs are scanned, in Hz.
    pub scan_rate: Param<u32>,
    /// The long filter, in scans: 1 to 1023.
    pub slow_scans: Param<u32>,
    /// The short filter, in scans: 1 to 63.
    pub fast_scans: Param<u32>,
    /// An MPG counts all four edges, and not one.
    pub mpg_4x: [Param<bool>; 4],
    /// How many inputs there are.
    pub scan_width: Param<u32>,
    /// The inputs.
    pub inputs: Vec<InMuxInput>,
    /// The counts of the MPGs; MPG k is on inputs 2k and 2k+1.
    pub mpg_counts: [Input<i32>; 4],
    /// Keep the counts at 0.
    pub mpg_resets: [Output<bool>; 4],
}

impl InMuxPins {
    /// Makes the pins of instance `number` with `count` inputs, the first of which are at
    /// `terminals`.
    pub fn new(
        pins: &mut PinStore,
        group: GroupId,
        board: &str,
        kind: InMuxKind,
        number: usize,
        (count, terminals): (usize, &[Terminal]),
    ) -> Result<Self, PinError> {
        let module = match kind {
            InMuxKind::InMux => "inmux",
            InMuxKind::InM => "inm",
        };
        let stem = format!("{board}.{module}.{number:02}.");
        let mut make = Maker::new(pins, group, stem.clone());
        let mut all = Self {
            scan_rate: make.setting("scan_rate", 20_000)?,
            slow_scans: make.setting("slow_scans", 500)?,
            fast_scans: make.setting("fast_scans", 5)?,
            scan_width: make.property("scan_width", count as u32)?,
            ..Self::default()
        };
        for (k, param) in all.mpg_4x.iter_mut().enumerate() {
            *param = make.setting(&format!("enc{k}_4xmode"), false)?;
        }
        for n in 0..count {
            let terminal = terminals.get(n..=n).unwrap_or(&[]);
            let mut make = Maker::new(pins, group, stem.clone()).at(terminal);
            all.inputs.push(InMuxInput {
                filtered: DigitalIn {
                    pin: make.input(&format!("input-{n:02}"))?,
                    not: make.input(&format!("input-{n:02}-not"))?,
                },
                raw: DigitalIn {
                    pin: make.input(&format!("raw-input-{n:02}"))?,
                    not: make.input(&format!("raw-input-{n:02}-not"))?,
                },
                slow: make.switch(&format!("input-{n:02}-slow"), false)?,
            });
        }
        for k in 0..4 {
            let mpg = terminals.get(2 * k..2 * k + 2).unwrap_or(&[]);
            let mut make = Maker::new(pins, group, stem.clone()).at(mpg);
            let count = make.input(&format!("enc{k}-count"))?;
            let reset = make.switch(&format!("enc{k}-reset"), false)?;
            if let (Some(c), Some(r)) = (all.mpg_counts.get_mut(k), all.mpg_resets.get_mut(k)) {
                (*c, *r) = (count, reset);
            }
        }
        Ok(all)
    }

    /// After a read: the filtered and the raw inputs, bit n for input n.
    ///
    /// # Real time
    /// Grows with the number of inputs; no allocation.
    pub fn publish(&self, pins: &mut PinStore, filtered: u32, raw: u32) {
        for (n, input) in self.inputs.iter().enumerate() {
            for (pair, word) in [(input.filtered, filtered), (input.raw, raw)] {
                let level = word >> (n & 31) & 1 != 0;
                pins.publish(pair.pin, level);
                pins.publish(pair.not, !level);
            }
        }
    }

    /// After a read of a module that has not gone on for long enough since its set-up: the filtered
    /// inputs in `filtered`, the raw ones in `raw`, and the MPGs in `mpgs` can not be told yet.
    ///
    /// # Real time
    /// Grows with the number of inputs; no allocation.
    pub fn withhold(&self, pins: &mut PinStore, filtered: u32, raw: u32, mpgs: [bool; 4]) {
        for (n, input) in self.inputs.iter().enumerate() {
            for (pair, word) in [(input.filtered, filtered), (input.raw, raw)] {
                if word >> (n & 31) & 1 != 0 {
                    pins.withhold(pair.pin);
                    pins.withhold(pair.not);
                }
            }
        }
        for (&pin, withheld) in self.mpg_counts.iter().zip(mpgs) {
            if withheld {
                pins.withhold(pin);
            }
        }
    }

    /// After a read: the counts of the MPGs since their start.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn publish_counts(&self, pins: &mut PinStore, counts: [i64; 4]) {
        for (&pin, count) in self.mpg_counts.iter().zip(counts) {
            pins.publish(pin, count as i32);
        }
    }

    /// The filter register: bit n for the long filter of input n.
    ///
    /// # Real time
    /// Grows with the number of inputs; no allocation.
    pub fn slow(&self, pins: &mut PinStore) -> u32 {
        self.inputs
            .iter()
            .enumerate()
            .filter(|(n, _)| *n < 32)
            .fold(0, |word, (n, input)| {
                word | u32::from(pins.fetch(input.slow)) << n
            })
    }
}
