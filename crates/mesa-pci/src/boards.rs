//! The boards that are on the PCI bus themselves.

use core::fmt;

/// Mesa's vendor number.
pub const MESA: u16 = 0x2718;

/// Kinds of boards whose FPGA is on the PCI bus itself, without a bridge chip that a host has to
/// program first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum BoardKind {
    /// 4I74.
    I4i74,
    /// 5I24.
    I5i24,
    /// 5I25.
    I5i25,
    /// 6I24.
    I6i24,
    /// 6I25, a 5I25 on PCI Express.
    I6i25,
}

/// The numbers of a kind of boards in its PCI configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PciBoard {
    /// Device number; the vendor is [`MESA`].
    pub device: u16,
    /// Kind of the board.
    pub kind: BoardKind,
    /// Mesa's name of the board.
    pub name: &'static str,
}

/// All boards that [`search`](crate::search) finds. FACTS 15.1.
///
/// Boards behind a PLX bridge (5I20, 5I22, 5I23, 4I65, 4I68, 4I69, 3X20) are not among them: their
/// FPGA has no configuration before a host has loaded one through the bridge.
pub const BOARDS: [PciBoard; 5] = [
    PciBoard::new(0x4174, BoardKind::I4i74, "4I74"),
    PciBoard::new(0x5124, BoardKind::I5i24, "5I24"),
    PciBoard::new(0x5125, BoardKind::I5i25, "5I25"),
    PciBoard::new(0x6124, BoardKind::I6i24, "6I24"),
    PciBoard::new(0x6125, BoardKind::I6i25, "6I25"),
];

impl PciBoard {
    const fn new(device: u16, kind: BoardKind, name: &'static str) -> Self {
        Self { device, kind, name }
    }

    /// The board with these numbers; `None` for other devices.
    pub fn of(vendor: u16, device: u16) -> Option<Self> {
        let mut boards = BOARDS.into_iter();
        boards.find(|board| (MESA, board.device) == (vendor, device))
    }
}

impl BoardKind {
    /// The numbers and the name of this kind.
    pub fn board(self) -> PciBoard {
        let mut boards = BOARDS.into_iter();
        let board = boards.find(|board| board.kind == self);
        board.unwrap_or(PciBoard::new(0, self, ""))
    }
}

impl fmt::Display for BoardKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.board().name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_a_name_and_numbers_of_its_own() {
        for board in BOARDS {
            assert_eq!(board.kind.board(), board);
            assert_eq!(PciBoard::of(MESA, board.device), Some(board));
            assert_eq!(board.kind.to_string(), board.name);
        }
        assert_eq!(PciBoard::of(0x8086, 0x5125), None);
        assert_eq!(PciBoard::of(MESA, 0x9030), None);
    }
}
