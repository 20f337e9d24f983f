//! What is known of a kind of board beforehand: what its firmware does not tell.

use super::remote_id::RemoteId;
use alloc::format;
use alloc::vec::Vec;

use super::{Gtag, HostMot2, PinDescriptor, TickRate};
use crate::hal::{Place, Terminals};

/// A kind of board: rates that it is made for, and where its modules come out.
///
/// Boards with connectors for cards need none of their own: see [`BoardTable::CONNECTORS`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardTable {
    /// Its name, for example `7I97`: what its firmware has as board name after `MESA`.
    pub name: &'static str,
    /// The rate of the encoders' multiplexer or filters.
    pub encoder_rate: TickRate,
    /// Its PWM generators.
    pub pwm: PwmTable,
    /// The terminals of its modules.
    pub terminals: &'static [ModuleTerminals],
    /// The cards that encoders may be on: they are recognised by the pins of a connector.
    pub cards: &'static [&'static CardTable],
    /// Its flash memory, where that is known.
    pub flash: Option<&'static FlashLayout>,
}

/// What the PWM generators of a board are for.
///
/// The frequency is one for all generators of a firmware. All else is of the first
/// [`generators`](Self::generators) of them, which drive circuits on the board; what a firmware has
/// beyond them is on connectors, and starts as [`PLAIN`](Self::PLAIN).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PwmTable {
    /// The usual frequency in Hz.
    pub hz: u32,
    /// The same of firmware whose generators dither, and so keep their resolution at a higher one:
    /// the first of these at which the firmware's clock leaves 11 bits, or else the last.
    pub hz_dither: &'static [u32],
    /// How many generators, from 0 on, drive circuits on the board.
    pub generators: u8,
    /// Full scale, at first.
    pub full_scale: f64,
    /// The unit of the value.
    pub unit: &'static str,
    /// 0 is half scale on the wire, at first: for analog outputs of both signs.
    pub is_offset: bool,
    /// The terminals of the outputs, by generator.
    pub outputs: &'static [Terminals],
    /// The terminals of the enable outputs, by generator.
    pub enables: &'static [Terminals],
    /// Generators whose drives the enable output of the first of them switches together.
    pub common_enable: &'static [u8],
}

/// The terminals of all instances of a module, numbered as its pins are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModuleTerminals {
    /// The modules that may be there: the first of them that a firmware has is the one.
    pub modules: &'static [Gtag],
    /// Encoder, input, output or I/O pin by its number; of an encoder those of A, B and index, as
    /// many of each ([`Terminals::of_signal`]).
    pub terminals: &'static [Terminals],
}

impl ModuleTerminals {
    /// Terminals of the first of these modules.
    pub const fn new(modules: &'static [Gtag], terminals: &'static [Terminals]) -> Self {
        Self { modules, terminals }
    }
}

/// A card with encoders, on a connector whose pins it fills.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CardTable {
    /// Its name.
    pub name: &'static str,
    /// Module and secondary pin of each pin of the connector.
    pub pins: &'static [(Gtag, u8)],
    /// Where on the connector those of the encoders begin: three for each pair of encoders.
    pub first_encoder_pin: usize,
    /// The terminals of its encoders.
    pub encoders: &'static [Terminals],
}

/// Where things are in a board's flash memory.
///
/// Source: manual 7I97, "EEPROM LAYOUT"; that of the 7I92, whose manual is not at hand, is what
/// mesaflash uses for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashLayout {
    /// The board, as it names itself.
    pub board: &'static str,
    /// The FPGA on the board, as its bitfiles call it.
    pub part: &'static str,
    /// What the chip's identification must be.
    pub id: u32,
    /// Size of the chip.
    pub size: u32,
    /// What makes the FPGA load the user configuration, or the fallback when that is damaged.
    pub boot_block: (u32, u32),
    /// The configuration that is loaded when the user's is damaged.
    pub fallback: (u32, u32),
    /// The configuration in use.
    pub user: (u32, u32),
    /// Free for applications.
    pub application: (u32, u32),
}

impl PwmTable {
    /// Generators of which nothing is known start as LinuxCNC's do: sign and magnitude, scale 1,
    /// 20 kHz.
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

    /// What a generator is for: this, or a connector.
    pub fn of(&self, generator: u8) -> &Self {
        if generator < self.generators {
            self
        } else {
            &Self::PLAIN
        }
    }

    /// The generator whose enable output switches the drive of generator `n`, if that has none of
    /// its own.
    pub fn switched_by(&self, n: u8) -> Option<u8> {
        let leader = *self.common_enable.first()?;
        (n != leader && self.common_enable.contains(&n)).then_some(leader)
    }
}

impl BoardTable {
    /// Whether a firmware says that it is for this kind of board.
    pub fn fits(&self, firmware: &HostMot2) -> bool {
        !self.name.is_empty() && firmware.idrom.board().eq_ignore_ascii_case(self.name)
    }

    /// Where encoder, input, output or I/O pin `number` of an instance of a module comes out. Of
    /// several instances, the first one is on the board.
    pub fn place(&self, firmware: &HostMot2, (gtag, instance): (Gtag, u8), number: u16) -> Place {
        match instance {
            0 => Terminals::of(self.ranges(firmware, gtag), number),
            _ => Place::default(),
        }
    }

    /// The terminals of a module, if it is the one on the board.
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

    /// Where A, B and index of encoder `number` come out: on the board itself, or on the card whose
    /// pins it has. Where the board has terminals for encoders as well, those of a card begin with its
    /// name: `7I77 TB3 pin 1`.
    pub fn encoder_places(&self, firmware: &HostMot2, gtag: Gtag, number: u16) -> [Place; 3] {
        let own = self.ranges(firmware, gtag);
        let on_card = |card: &&'static CardTable| Some((card.encoder(firmware, number)?, *card));
        let Some((on_card, card)) = self.cards.iter().find_map(on_card) else {
            return [0, 1, 2].map(|signal| Terminals::of_signal(own, number, signal).collect());
        };
        [0, 1, 2].map(|signal| {
            let places = Terminals::of_signal(card.encoders, on_card, signal);
            let named = places.map(|place| match own {
                [] => place,
                _ => Place {
                    terminal: format!("{} {}", card.name, place.terminal),
                    ..place
                },
            });
            named.collect()
        })
    }
}

impl CardTable {
    /// Which encoder of its card encoder `number` of a firmware is: its pins, and all others of
    /// their connector, have to be those of this card.
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

    /// The encoders of the card whose first serial channel is `first`: their numbers in
    /// the firmware, in the order of the card. `None` if no connector with that channel has the pins
    /// of this card.
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

    /// The pins of a connector, if they are those of this card.
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
            // The low half of a serial pin is its channel, which differs from card to card.
            let mask = if is_serial { 0xF0 } else { 0xFF };
            is_kind && pin.secondary_pin & mask == signal & mask
        });
        is_card.then_some(pins)
    }
}
