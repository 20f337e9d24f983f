//! What is known of a kind of board beforehand: what its firmware does not tell.

use super::{FlashLayout, i7i77, i7i97};
use crate::hal::{Place, Terminals};
use crate::hostmot2::{Gtag, HostMot2, TickRate};

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
    /// The cards that encoders may be on: they are told by the pins of a connector.
    pub cards: &'static [&'static CardTable],
    /// Its flash memory, where that is known.
    pub flash: Option<&'static FlashLayout>,
}

/// What the PWM generators of a board are for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PwmTable {
    /// The usual frequency.
    pub hz: u32,
    /// The same of firmware whose generators dither, and so keep their resolution at a higher one.
    pub hz_dither: u32,
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
    /// Encoder, input, output or I/O pin by its number.
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

impl PwmTable {
    /// Generators of which nothing is known: LinuxCNC's frequency.
    pub const PLAIN: Self = Self {
        hz: 20_000,
        hz_dither: 20_000,
        full_scale: 1.0,
        unit: "",
        is_offset: false,
        outputs: &[],
        enables: &[],
        common_enable: &[],
    };

    /// The generator whose enable output switches the drive of generator `n`, if that has none of
    /// its own.
    pub fn switched_by(&self, n: u8) -> Option<u8> {
        let leader = *self.common_enable.first()?;
        (n != leader && self.common_enable.contains(&n)).then_some(leader)
    }
}

impl BoardTable {
    /// A board with connectors for cards, of which nothing else is known. Its encoders run at the
    /// rate that the 7I77 is made for: manual 7I77, "MAXIMUM ENCODER COUNT RATE".
    pub const CONNECTORS: Self = Self {
        name: "",
        encoder_rate: TickRate::MUX_7I77,
        pwm: PwmTable::PLAIN,
        terminals: &[],
        cards: &[&i7i77::CARD],
        flash: None,
    };

    /// The 7I92: two connectors.
    pub const I7I92: Self = Self {
        name: "7I92",
        flash: Some(&FlashLayout::I7I92),
        ..Self::CONNECTORS
    };

    /// The tables that are built in.
    pub const KNOWN: [&'static Self; 2] = [&i7i97::BOARD, &Self::I7I92];

    /// The table for a firmware: the first of `added` and of those that are built in that fits;
    /// [`CONNECTORS`](Self::CONNECTORS) if none does.
    pub fn for_firmware(firmware: &HostMot2, added: &[&'static Self]) -> &'static Self {
        let mut tables = added.iter().copied().chain(Self::KNOWN);
        tables
            .find(|table| table.fits(firmware))
            .unwrap_or(&Self::CONNECTORS)
    }

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

    /// Where encoder `number` comes out: on the board itself, or on the card whose pins it has.
    pub fn encoder_place(&self, firmware: &HostMot2, gtag: Gtag, number: u16) -> Place {
        let on_card = |card: &&CardTable| Some((card.encoder(firmware, number)?, card.encoders));
        match self.cards.iter().find_map(on_card) {
            Some((encoder, terminals)) => Terminals::of(terminals, encoder),
            None => self.place(firmware, (gtag, 0), number),
        }
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
        if width == 0 || firmware.idrom.port_width as usize != width {
            return None;
        }
        let (connector, place) = (usize::from(a) / width, usize::from(a) % width);
        let pins = firmware.pins.iter().skip(connector * width);
        let is_card = pins.zip(self.pins).all(|(pin, &(kind, signal))| {
            let is_serial = kind == Gtag::SSERIAL;
            let is_kind = pin.secondary == kind || is_serial && pin.secondary == Gtag::SSERIAL_B;
            // The low half of a serial pin is its channel, which differs from card to card.
            let mask = if is_serial { 0xF0 } else { 0xFF };
            is_kind && pin.secondary_pin & mask == signal & mask
        });
        let pair = place.checked_sub(self.first_encoder_pin)? / 3;
        is_card.then_some(pair as u16 * 2 + number % 2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminals_are_those_of_the_connector_tables() {
        let [encoders, _, outputs, io, _] = i7i97::BOARD.terminals else {
            panic!("five kinds");
        };
        let at = |ranges, number| Terminals::of(ranges, number);
        let encoder = at(encoders.terminals, 4);
        assert!(
            encoder
                .terminal
                .starts_with("TB2 pin 9, TB2 pin 10, TB2 pin 12")
        );
        assert_eq!(encoder.signal, "QA4, /QA4, QB4, /QB4, IDX4, /IDX4");
        assert_eq!(at(outputs.terminals, 5).signal, "OUT5-, OUT5+");
        let expansion = at(io.terminals, 43);
        assert_eq!(expansion.terminal, "P1 pin 11, DB25 pin 6");
        assert_eq!(expansion.signal, "IO43");
        assert_eq!(at(io.terminals, 33), Place::default());
        assert_eq!(at(io.terminals, 51), Place::default());
    }

    #[test]
    fn one_enable_of_the_7i97_switches_four_drives() {
        let pwm = &i7i97::BOARD.pwm;
        let leaders = [0, 1, 2, 3, 4, 5].map(|n| pwm.switched_by(n));
        assert_eq!(leaders, [None, Some(0), Some(0), Some(0), None, None]);
        assert_eq!(
            Terminals::of(pwm.enables, 0).signal.matches("ENA").count(),
            8
        );
        assert_eq!(Terminals::of(pwm.enables, 2), Place::default());
    }
}
