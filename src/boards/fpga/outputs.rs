//! Outputs, SSR and OutM; and LEDs.

use alloc::format;
use alloc::vec::Vec;

use super::Maker;
use crate::boards::Terminal;
use crate::hal::{GroupId, Output, PinError, PinStore};

/// Which of the two modules: they differ in names, and only SSR has a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OutputKind {
    /// Isolated by a drive of alternating current.
    Ssr,
    /// Levels on pins.
    OutM,
}

/// The pins of one output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InvertibleOutput {
    /// Its number in its module, which names and bits of the register go by. A firmware need not
    /// begin with 0.
    pub number: u8,
    /// Closes the output, or puts it high.
    pub out: Output<bool>,
    /// Turns it round: closed or high for false.
    pub invert: Output<bool>,
}

/// The pins of one instance: `hm2_7i97.0.ssr.00.out-00`, `hm2_7i97.0.outm.00.out-00` and so on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OutputPins {
    /// The frequency of the isolation's drive in Hz; 0 switches all outputs off. OutM has none.
    pub rate: Option<Output<u32>>,
    /// The outputs, by number.
    pub outputs: Vec<InvertibleOutput>,
}

impl OutputPins {
    /// Makes the pins of instance `instance`: an output for each of `wired`, which are numbers
    /// below 32 and terminals.
    pub fn new(
        pins: &mut PinStore,
        group: GroupId,
        board: &str,
        (kind, instance): (OutputKind, usize),
        wired: impl IntoIterator<Item = (u8, &'static [Terminal])>,
    ) -> Result<Self, PinError> {
        let module = match kind {
            OutputKind::Ssr => "ssr",
            OutputKind::OutM => "outm",
        };
        let stem = format!("{board}.{module}.{instance:02}.");
        let rate = match kind {
            OutputKind::Ssr => {
                let mut make = Maker::new(pins, group, stem.clone());
                Some(make.switch("rate", 1_000_000)?)
            }
            OutputKind::OutM => None,
        };
        let mut outputs = Vec::new();
        for (number, terminals) in wired {
            let mut make = Maker::new(pins, group, stem.clone()).at(terminals);
            outputs.push(InvertibleOutput {
                number,
                out: make.output(&format!("out-{number:02}"))?,
                invert: make.switch(&format!("invert-{number:02}"), false)?,
            });
        }
        Ok(Self { rate, outputs })
    }

    /// The data register: bit n for output n, 1 is closed or high.
    ///
    /// # Real time
    /// Grows with the number of outputs; no allocation.
    pub fn data(&self, pins: &mut PinStore) -> u32 {
        self.outputs
            .iter()
            .filter(|output| output.number < 32)
            .fold(0, |word, output| {
                let on = pins.fetch(output.out) != pins.fetch(output.invert);
                word | u32::from(on) << output.number
            })
    }
}

/// The LEDs of a board: `hm2_7i97.0.led.CR01` and so on.
///
/// As they come, Ethernet boards count packets on these LEDs, and the pins show nothing: give the
/// LEDs to the FPGA first, with [`EthernetBoard::set_led_mode`](crate::ethernet::EthernetBoard::set_led_mode) until
/// the board restarts, or with
/// [`EthernetBoard::set_eeprom_led_mode`](crate::ethernet::EthernetBoard::set_eeprom_led_mode) for good.
/// Manual: 7I97, "BOARD STATUS LEDS".
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LedPins {
    /// The LEDs, CR01 first.
    pub leds: Vec<Output<bool>>,
}

impl LedPins {
    /// Makes the pins of `count` LEDs.
    pub fn new(
        pins: &mut PinStore,
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
    pub fn word(&self, pins: &mut PinStore) -> u32 {
        self.leds
            .iter()
            .enumerate()
            .filter(|(n, _)| *n < 32)
            .fold(0, |word, (n, led)| {
                word | u32::from(pins.fetch(*led)) << (31 - n)
            })
    }
}
