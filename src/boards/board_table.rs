//! Tables of the supported boards.

use super::{BoardTable, DB25, FlashLayout, ModuleTerminals, PwmTable, i7i76, i7i77, i7i97};
use crate::hal::Terminals;
use crate::hostmot2::{Gtag, HostMot2, TickRate};

impl BoardTable {
    /// A board with connectors for cards and no further known functions.
    pub const CONNECTORS: Self = Self {
        name: "",
        encoder_rate: None,
        pwm: PwmTable::PLAIN,
        terminals: &[],
        cards: &[
            &i7i77::CARD,
            &i7i76::CARD,
            &i7i76::CARD_MUXED,
            &i7i76::CARD_BESIDE_7I77,
        ],
        flash: None,
    };

    /// The 7I92: two connectors, P2 before P1 (FACTS 9.3). Its multiplexed encoders are those of a
    /// 7I77, and run at the rate for which that is designed: manual 7I77, "MAXIMUM ENCODER COUNT
    /// RATE".
    pub const I7I92: Self = Self {
        name: "7I92",
        encoder_rate: Some(TickRate::MUX_7I77),
        terminals: &[ModuleTerminals {
            modules: &[Gtag::IO_PORT],
            terminals: &[
                Terminals::new("P2 DB25 pin ", 0, &["IO#"], &DB25),
                Terminals::new("P1 DB25 pin ", 17, &["IO#"], &DB25),
            ],
        }],
        flash: Some(&FlashLayout::I7I92),
        ..Self::CONNECTORS
    };

    /// The 5I25: two connectors, P3 before P2. FACTS 15.1.
    pub const I5I25: Self = Self {
        name: "5I25",
        encoder_rate: Some(TickRate::MUX_7I77),
        terminals: &[ModuleTerminals {
            modules: &[Gtag::IO_PORT],
            terminals: &[
                Terminals::new("P3 DB25 pin ", 0, &["IO#"], &DB25),
                Terminals::new("P2 DB25 pin ", 17, &["IO#"], &DB25),
            ],
        }],
        flash: Some(&FlashLayout::I5I25),
        ..Self::CONNECTORS
    };

    /// The 6I25, a 5I25 on PCI Express.
    pub const I6I25: Self = Self {
        name: "6I25",
        flash: Some(&FlashLayout::I6I25),
        ..Self::I5I25
    };

    /// The built-in tables.
    pub const KNOWN: [&'static Self; 4] = [&i7i97::BOARD, &Self::I7I92, &Self::I5I25, &Self::I6I25];

    /// The table for a firmware: the first matching one of `added` and then of the built-in ones;
    /// [`CONNECTORS`](Self::CONNECTORS) if none matches.
    pub fn for_firmware(firmware: &HostMot2, added: &[&'static Self]) -> &'static Self {
        let mut tables = added.iter().copied().chain(Self::KNOWN);
        tables
            .find(|table| table.fits(firmware))
            .unwrap_or(&Self::CONNECTORS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hal::Place;

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
    fn first_connector_of_a_7i92_is_p2() {
        let [io] = BoardTable::I7I92.terminals else {
            panic!("one kind");
        };
        let at = |number| Terminals::of(io.terminals, number).terminal;
        // As reported by a real 7I92 (mesaflash, `--readhmid`).
        for (number, terminal) in [
            (0, "P2 DB25 pin 1"),
            (1, "P2 DB25 pin 14"),
            (16, "P2 DB25 pin 13"),
            (17, "P1 DB25 pin 1"),
            (25, "P1 DB25 pin 5"),
            (33, "P1 DB25 pin 13"),
            (34, ""),
        ] {
            assert_eq!(at(number), terminal, "{number}");
        }
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
