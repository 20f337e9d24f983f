//! Data about a kind of board that its firmware does not contain.

use super::remote_id::RemoteId;
use alloc::format;
use alloc::vec::Vec;

use super::{Gtag, HostMot2, ModuleInstance, PinDescriptor, TickRate};
use crate::hal::{Place, Terminals};

/// A kind of board: the rates for which it is designed, and the terminals of its modules.
///
/// Boards with connectors for cards have no terminals of their own: see [`BoardTable::CONNECTORS`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardTable {
    /// Its name, for example `7I97`: the board name in its firmware without `MESA`.
    pub name: &'static str,
    /// The rate of the encoders' multiplexer or filters, for which the board is designed; `None` if
    /// it is not known. Multiplexers then start at LinuxCNC's rate, 8.33 MHz, and filters at that
    /// of the 7I77.
    pub encoder_rate: Option<TickRate>,
    /// Its PWM generators.
    pub pwm: PwmTable,
    /// The terminals of its modules.
    pub terminals: &'static [ModuleTerminals],
    /// The cards that its encoders and step generators may be on; a card is recognised by the pins
    /// of its connector.
    pub cards: &'static [&'static CardTable],
    /// Layout of its flash memory, if known.
    pub flash: Option<&'static FlashLayout>,
}

/// Purpose of the PWM generators of a board.
///
/// The frequency is common to all generators of a firmware. Everything else applies to the first
/// [`generators`](Self::generators) of them, which drive circuits on the board; further generators
/// of a firmware are on connectors, and start as [`PLAIN`](Self::PLAIN).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PwmTable {
    /// The usual frequency in Hz.
    pub hz: u32,
    /// Frequencies for firmware whose generators dither, and so keep their resolution at a higher
    /// one: the first of these at which the firmware's clock leaves 11 bits is used, or else the
    /// last.
    pub hz_dither: &'static [u32],
    /// Number of generators, from 0 on, that drive circuits on the board.
    pub generators: u8,
    /// Initial full scale.
    pub full_scale: f64,
    /// The unit of the value.
    pub unit: &'static str,
    /// Initially, 0 is half scale on the wire: for bipolar analog outputs.
    pub is_offset: bool,
    /// The terminals of the outputs, by generator.
    pub outputs: &'static [Terminals],
    /// The terminals of the enable outputs, by generator.
    pub enables: &'static [Terminals],
    /// Generators whose drives are all switched by the enable output of the first one listed here.
    pub common_enable: &'static [u8],
}

/// The terminals of all instances of a module, numbered like its pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModuleTerminals {
    /// Alternative modules: the first one that a firmware contains is used.
    pub modules: &'static [Gtag],
    /// Terminals of the encoder, input, output or I/O pin by its number; an encoder has the same
    /// number of terminals for each of A, B and index ([`Terminals::of_signal`]).
    pub terminals: &'static [Terminals],
}

impl ModuleTerminals {
    /// Terminals of the first of these modules that the firmware contains.
    pub const fn new(modules: &'static [Gtag], terminals: &'static [Terminals]) -> Self {
        Self { modules, terminals }
    }
}

/// A card with encoders or step generators; it occupies all pins of a connector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CardTable {
    /// Its name.
    pub name: &'static str,
    /// Module and secondary pin of each pin of the connector.
    pub pins: &'static [(Gtag, u8)],
    /// Position on the connector at which the encoders' pins begin: three pins for each pair of
    /// encoders.
    pub first_encoder_pin: usize,
    /// The terminals of its encoders.
    pub encoders: &'static [Terminals],
    /// The terminals of its step generators, in the order of their step pins: two of step, then two
    /// of direction.
    pub steps: &'static [Terminals],
}

/// Layout of a board's flash memory.
///
/// Source: manual 7I97, "EEPROM LAYOUT"; for the 7I92, whose manual is not available, the layout
/// that mesaflash uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashLayout {
    /// The board's own name.
    pub board: &'static str,
    /// The FPGA on the board, as named in its bitfiles.
    pub part: &'static str,
    /// Expected identification of the chip.
    pub id: u32,
    /// Size of the chip.
    pub size: u32,
    /// Makes the FPGA load the user configuration, or the fallback if that is damaged.
    pub boot_block: (u32, u32),
    /// The configuration that is loaded if the user's is damaged.
    pub fallback: (u32, u32),
    /// The configuration in use.
    pub user: (u32, u32),
    /// Free for applications.
    pub application: (u32, u32),
}

impl PwmTable {
    /// Generators of unknown purpose start as in LinuxCNC: sign and magnitude, scale 1, 20 kHz.
    pub const PLAIN: Self = Self {
        hz: 20_000,
        hz_dither: &[20_000],
        generators: 0,
        full_scale: 1.0,
        unit: "",
        is_offset: false,
        outputs: &[],
        enables: &[],
        common_enable: &[],
    };

    /// Settings of a generator: this table, or [`PLAIN`](Self::PLAIN) for one on a connector.
    pub fn of(&self, generator: u8) -> &Self {
        if generator < self.generators {
            self
        } else {
            &Self::PLAIN
        }
    }

    /// The generator whose enable output switches the drive of generator `n`, if `n` has no enable
    /// output of its own.
    pub fn switched_by(&self, n: u8) -> Option<u8> {
        let leader = *self.common_enable.first()?;
        (n != leader && self.common_enable.contains(&n)).then_some(leader)
    }
}

impl BoardTable {
    /// True if a firmware identifies itself as one for this kind of board.
    pub fn fits(&self, firmware: &HostMot2) -> bool {
        !self.name.is_empty() && firmware.idrom.board().eq_ignore_ascii_case(self.name)
    }

    /// Terminal of encoder, input, output or I/O pin `number` of an instance of a module. Of
    /// several instances, only the first one is on the board.
    pub fn place(&self, firmware: &HostMot2, module: ModuleInstance, number: u16) -> Place {
        match module.instance {
            0 => Terminals::of(self.ranges(firmware, module.gtag), number),
            _ => Place::default(),
        }
    }

    /// The terminals of a module, if it is the one that the board uses.
    pub fn ranges(&self, firmware: &HostMot2, gtag: Gtag) -> &'static [Terminals] {
        let is_it = |entry: &&ModuleTerminals| {
            let mut there = entry
                .modules
                .iter()
                .filter(|m| firmware.find(**m).is_some());
            there.next() == Some(&gtag)
        };
        let entry = self.terminals.iter().find(is_it);
        entry.map_or(&[], |entry| entry.terminals)
    }

    /// Terminals of A, B and index of encoder `number`: on the board itself, or on the card that
    /// occupies its pins. If the board has terminals for encoders as well, or a card of another
    /// kind, those of a card begin with the card's name: `7I77 TB3 pin 1`.
    pub fn encoder_places(&self, firmware: &HostMot2, gtag: Gtag, number: u16) -> [Place; 3] {
        let own = self.ranges(firmware, gtag);
        let on_card = |card: &&'static CardTable| Some((card.encoder(firmware, number)?, *card));
        let Some((on_card, card)) = self.cards.iter().find_map(on_card) else {
            return [0, 1, 2].map(|signal| Terminals::of_signal(own, number, signal).collect());
        };
        let is_alone = own.is_empty() && !self.has_card_beside(firmware, card);
        [0, 1, 2].map(|signal| {
            let places = Terminals::of_signal(card.encoders, on_card, signal);
            let named = places.map(|mut place| {
                if !is_alone {
                    place.terminal = format!("{} {}", card.name, place.terminal);
                }
                place
            });
            named.collect()
        })
    }

    /// True if a card of another kind is on a connector as well: the terminal blocks of both have
    /// the same names.
    fn has_card_beside(&self, firmware: &HostMot2, card: &CardTable) -> bool {
        let mut others = self.cards.iter().filter(|other| other.name != card.name);
        others.any(|other| {
            let connectors = firmware.pins.len().checked_div(other.pins.len());
            (0..connectors.unwrap_or(0)).any(|n| other.connector(firmware, n).is_some())
        })
    }
}

impl BoardTable {
    /// Terminals of step and direction of step generator `unit` on the card that occupies its pins.
    /// If the board has terminals of its own besides I/O pins, or a card of another kind, those of
    /// a card begin with the card's name: `7I76 TB2 pin 2`.
    pub fn step_places(&self, firmware: &HostMot2, unit: u8) -> [Place; 2] {
        let on_card = |card: &&'static CardTable| Some((card.generator(firmware, unit)?, *card));
        let Some((on_card, card)) = self.cards.iter().find_map(on_card) else {
            return Default::default();
        };
        let is_io = |entry: &ModuleTerminals| entry.modules == [Gtag::IO_PORT];
        let is_alone = self.terminals.iter().all(is_io) && !self.has_card_beside(firmware, card);
        [0, 2].map(|first| {
            let places = Terminals::each_of(card.steps, on_card).skip(first).take(2);
            let place: Place = places.collect();
            match &*place.terminal {
                terminal if !is_alone && !terminal.is_empty() => Place {
                    terminal: format!("{} {terminal}", card.name),
                    ..place
                },
                _ => place,
            }
        })
    }
}

impl CardTable {
    /// Number on its card of step generator `unit` of a firmware: all pins of the connector must
    /// match this card.
    pub fn generator(&self, firmware: &HostMot2, unit: u8) -> Option<u16> {
        const STEP: u8 = 0x81;
        let mut pins = firmware.pins_of(Gtag::STEPGEN, unit);
        let (step, _) = pins.find(|(_, pin)| pin.secondary_pin == STEP)?;
        let connector = usize::from(step).checked_div(self.pins.len())?;
        self.connector(firmware, connector)?;
        let before = self.pins.iter().take(usize::from(step) % self.pins.len());
        Some(before.filter(|pin| **pin == (Gtag::STEPGEN, STEP)).count() as u16)
    }

    /// Number on its card of encoder `number` of a firmware: all pins of the connector, its own
    /// included, must match this card.
    ///
    /// Source: FACTS 8.1 and 12.7.
    pub fn encoder(&self, firmware: &HostMot2, number: u16) -> Option<u16> {
        let unit = u8::try_from(number / 2).ok()?;
        let mut pins = firmware.pins_of(Gtag::MUXED_ENCODER, unit);
        let (a, _) = pins.find(|(_, pin)| pin.secondary_pin == 1)?;
        let width = self.pins.len();
        let connector = usize::from(a).checked_div(width)?;
        let pair = (usize::from(a) % width).checked_sub(self.first_encoder_pin)? / 3;
        let is_card = self.connector(firmware, connector).is_some();
        is_card.then_some(pair as u16 * 2 + number % 2)
    }

    /// The encoders of the card with `first` as its first serial channel: their numbers in the
    /// firmware, in the order of the card. `None` if no connector with that channel has the pins of
    /// this card.
    pub fn encoders_at(
        &self,
        firmware: &HostMot2,
        first: RemoteId,
    ) -> Option<impl Iterator<Item = u16> + use<>> {
        let connectors = firmware.pins.len().checked_div(self.pins.len())?;
        let mut cards = (0..connectors).filter_map(|n| self.connector(firmware, n));
        let pins = cards.find(|pins| {
            let serial = pins.iter().filter(|pin| pin.unit == first.port);
            serial.filter_map(PinDescriptor::sserial_channel).min() == Some(first.channel)
        })?;
        let pairs = pins.iter().skip(self.first_encoder_pin).step_by(3);
        let pairs: Vec<_> = pairs.map(|a| 2 * u16::from(a.unit)).collect();
        Some(pairs.into_iter().flat_map(|first| [first, first + 1]))
    }

    /// The pins of a connector, if they match this card.
    fn connector<'a>(&self, firmware: &'a HostMot2, number: usize) -> Option<&'a [PinDescriptor]> {
        let width = self.pins.len();
        if firmware.idrom.port_width as usize != width {
            return None;
        }
        let first = number.checked_mul(width)?;
        let pins = firmware.pins.get(first..first.checked_add(width)?)?;
        let is_card = pins.iter().zip(self.pins).all(|(pin, &(kind, signal))| {
            let is_serial = kind == Gtag::SSERIAL;
            let is_kind = pin.secondary == kind || is_serial && pin.secondary == Gtag::SSERIAL_B;
            // The low four bits of a serial pin are its channel, which differs from card to card.
            let mask = if is_serial { 0xF0 } else { 0xFF };
            is_kind && pin.secondary_pin & mask == signal & mask
        });
        is_card.then_some(pins)
    }
}
