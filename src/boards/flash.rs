//! Layouts of the flash memories of supported boards.

use super::{BoardTable, FlashLayout};

impl FlashLayout {
    /// The 7I97: M25P16, XC6SLX9.
    pub const I7I97: Self = Self {
        board: "7I97",
        part: "6slx9tqg144",
        id: 0x14,
        size: 0x20_0000,
        boot_block: (0x00_0000, 0x01_0000),
        fallback: (0x01_0000, 0x07_0000),
        user: (0x10_0000, 0x16_0000),
        application: (0x1E_0000, 0x20_0000),
    };

    /// The 7I92: 16 Mbit like the 7I97, and the same FPGA.
    pub const I7I92: Self = Self {
        board: "7I92",
        ..Self::I7I97
    };

    /// The 5I25: 8 Mbit, and the same FPGA. FACTS 15.3.
    pub const I5I25: Self = Self {
        board: "5I25",
        id: 0x13,
        size: 0x10_0000,
        user: (0x08_0000, 0x0E_0000),
        application: (0x0E_0000, 0x10_0000),
        ..Self::I7I97
    };

    /// The 6I25, like the 5I25.
    pub const I6I25: Self = Self {
        board: "6I25",
        ..Self::I5I25
    };

    /// The layout for the board with this name, as in
    /// [`Identity::card`](crate::ethernet::Identity::card). `None` for boards with an unknown
    /// layout; a 7I97T, for example, does not have the layout of a 7I97.
    pub fn for_card(name: &str) -> Option<&'static Self> {
        let mut layouts = BoardTable::KNOWN
            .into_iter()
            .filter_map(|board| board.flash);
        layouts.find(|layout| layout.board.eq_ignore_ascii_case(name))
    }
}
