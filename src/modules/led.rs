//! The LEDs of the board: `hm2_7i97.0.led.CR01` and so on.
//!
//! As delivered, Ethernet boards count packets on these LEDs, and the pins have no visible effect:
//! give the LEDs to the FPGA first, with
//! [`EthernetBoard::set_led_mode`](crate::ethernet::EthernetBoard::set_led_mode).
//! Manual: 7I97, "BOARD STATUS LEDS".

use alloc::format;
use alloc::vec::Vec;

use super::registrar::DrivenModule;
use super::{Module, RegisterError, Registrar, WriteCycle, bits_of};
use crate::bus::{Setting, Stage};
use crate::hal::Output;
use crate::hostmot2::{Gtag, HostMot2Error, ModuleDescriptor};

/// Number of user LEDs: CR01 to CR04 of the Ethernet boards.
pub(crate) const LEDS: usize = 4;

/// The LEDs of a board.
#[derive(Debug)]
pub struct Leds {
    /// The pins, CR01 first.
    pub leds: Vec<Output<bool>>,
    word: Setting,
}

impl Leds {
    /// Registers the LEDs of a firmware, if it has any.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
        let Some(DrivenModule { descriptor, .. }) = r.driven(&[Gtag::LED]).first().copied() else {
            return Ok(());
        };
        let data = descriptor.register(0, 0)?;
        let limit = r.settings.limit(Gtag::LED).map(usize::from);
        let mut make = r.maker("led.");
        let leds = (1..=LEDS)
            .take(limit.unwrap_or(LEDS))
            .map(|n| make.output(format!("CR{n:02}"), false));
        let module = Self {
            leds: leds.collect::<Result<_, _>>()?,
            word: r.image.setting(Stage::Configure, data, 0),
        };
        r.add(module);
        Ok(())
    }
}

/// Checks the layout, in any version.
pub(super) fn check(module: &ModuleDescriptor) -> Result<(), HostMot2Error> {
    module.check_layout(1, 0)
}

impl Module for Leds {
    /// Writes the word when it changes: the LEDs are not worth eight bytes in every packet.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if !cycle.changed {
            return;
        }
        // LED 0 is bit 31 (FACTS 13.9).
        let leds = (0..32).rev().zip(self.leds.iter().copied());
        let word = bits_of(cycle.pins, leds);
        cycle.words.set(self.word, word);
    }
}
