//! Isolated outputs and LEDs.

use alloc::format;
use alloc::vec::Vec;

use super::Maker;
use crate::boards::Terminal;
use crate::hal::{GroupId, Output, PinError, Pins};

/// The pins of one isolated output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SsrOutput {
    /// Closes the output.
    pub out: Output<bool>,
    /// Turns it round: closed for false.
    pub invert: Output<bool>,
}

/// The pins of one SSR instance: `hm2_7i97.0.ssr.00.out-00` and so on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SsrPins {
    /// The frequency of the isolation's drive in Hz; 0 switches all outputs off.
    pub rate: Output<u32>,
    /// The outputs.
    pub outputs: Vec<SsrOutput>,
}

impl SsrPins {
    /// Makes the pins of instance `number`, an output for each of `terminals`.
    pub fn new(
        pins: &mut Pins,
        group: GroupId,
        board: &str,
        number: usize,
        terminals: &[&[Terminal]],
    ) -> Result<Self, PinError> {
        let stem = format!("{board}.ssr.{number:02}.");
        let rate = Maker::new(pins, group, stem.clone()).switch("rate", 1_000_000)?;
        let mut outputs = Vec::with_capacity(terminals.len());
        for (n, terminals) in terminals.iter().enumerate() {
            let mut make = Maker::new(pins, group, stem.clone()).at(terminals);
            outputs.push(SsrOutput {
                out: make.output(&format!("out-{n:02}"))?,
                invert: make.switch(&format!("invert-{n:02}"), false)?,
            });
        }
        Ok(Self { rate, outputs })
    }

    /// The data register: bit n for output n, 1 is closed.
    ///
    /// # Real time
    /// Grows with the number of outputs; no allocation.
    pub fn data(&self, pins: &mut Pins) -> u32 {
        self.outputs
            .iter()
            .enumerate()
            .filter(|(n, _)| *n < 32)
            .fold(0, |word, (n, output)| {
                let closed = pins.fetch(output.out) != pins.fetch(output.invert);
                word | u32::from(closed) << n
            })
    }
}

/// The LEDs of a board: `hm2_7i97.0.led.CR01` and so on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LedPins {
    /// The LEDs, CR01 first.
    pub leds: Vec<Output<bool>>,
}

impl LedPins {
    /// Makes the pins of `count` LEDs.
    pub fn new(
        pins: &mut Pins,
        group: GroupId,
        board: &str,
        count: usize,
    ) -> Result<Self, PinError> {
        let mut make = Maker::new(pins, group, format!("{board}.led."));
        let leds = (1..=count).map(|n| make.output(&format!("CR{n:02}")));
        Ok(Self {
            leds: leds.collect::<Result<_, _>>()?,
        })
    }

    /// The LED register: the top bit for the first one.
    ///
    /// # Real time
    /// Grows with the number of LEDs; no allocation.
    pub fn word(&self, pins: &mut Pins) -> u32 {
        self.leds
            .iter()
            .enumerate()
            .filter(|(n, _)| *n < 32)
            .fold(0, |word, (n, led)| {
                word | u32::from(pins.fetch(*led)) << (31 - n)
            })
    }
}
