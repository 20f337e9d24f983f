//! Layout of a board's flash memory, if it is known.

use mesa_hal::boards::{BoardTable, FlashLayout};
use mesa_hal::ethernet::{EthernetBoard, Identity};
use mesa_hal::hostmot2::HostMot2;

use mesa_tools::diagnosis::board::has_name;

use crate::board::bus::Bus;
use mesa_tools::advice::told;

/// Size of an Efinix T20 in an IDROM, in kgates. The boards with a known layout have an XC6SLX9: 9.
const EFINIX_T20: u32 = 20;

/// The layout of a board's memory; else the reason why there is none. Changes nothing on the board.
pub fn of_board(bus: &mut Bus) -> Result<&'static FlashLayout, String> {
    if !bus.is_on_ethernet() {
        return of_firmware(bus);
    }
    let identity = EthernetBoard::new(bus).identity();
    let Identity { card, .. } = identity.map_err(|error| told(&error))?;
    // A T board can have the name of the board that it replaces.
    let size = HostMot2::identify(bus).map(|firmware| firmware.idrom.fpga_size);
    if is_t_board(&card) || size.is_ok_and(|size| size == EFINIX_T20) {
        return Err(format!(
            "this is a {card}, a T board: its FPGA is an Efinix, which loads .bin files, and the layout \
             of its flash memory is not known: use mesaflash"
        ));
    }
    if !has_name(&card) {
        return Err("its EEPROM has no card name (it was never written, or is erased), so the layout of its \
                    flash memory is not known; ask Mesa how to write the EEPROM"
            .to_owned());
    }
    FlashLayout::for_card(&card).ok_or_else(|| {
        format!("this is a {card}, whose flash memory has no known layout: use mesaflash")
    })
}

/// The layout of the memory of a board on the PCI bus, which is named in its firmware alone.
fn of_firmware(bus: &mut Bus) -> Result<&'static FlashLayout, String> {
    let firmware = HostMot2::identify(bus).map_err(|error| told(&error))?;
    let name = firmware.idrom.board().to_uppercase();
    if firmware.idrom.fpga_size == EFINIX_T20 {
        return Err(format!(
            "this is a {name} with an Efinix FPGA, which loads .bin files, and the layout of its flash \
             memory is not known: use mesaflash"
        ));
    }
    FlashLayout::for_card(&name).ok_or_else(|| {
        format!("this is a {name}, whose flash memory has no known layout: use mesaflash")
    })
}

/// True if a file of this length can be a backup of a whole memory.
pub fn is_whole(len: usize) -> bool {
    let mut layouts = BoardTable::KNOWN
        .into_iter()
        .filter_map(|board| board.flash);
    layouts.any(|layout| layout.size as usize == len)
}

/// True for the name of a board with an Efinix FPGA: 7I92T, 7I95T, 7I97T, 7I80HDT, and the 7I96S.
fn is_t_board(card: &str) -> bool {
    card == "7I96S" || card.len() > 4 && card.ends_with('T')
}
