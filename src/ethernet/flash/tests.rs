use super::super::BitfileError;
use super::*;
use alloc::{vec, vec::Vec};

/// A chip as its data sheet describes it: erasing sets bits, writing clears them.
#[derive(Debug)]
struct Chip {
    id: u32,
    bytes: Vec<u8>,
    written: Vec<u32>,
    erased: Vec<u32>,
    stuck: Option<usize>,
    /// Power fails after so many pages.
    pages_left: usize,
}

impl Chip {
    fn new() -> Self {
        let mut bytes = vec![0xFF; 0x20_0000];
        bytes[..4].copy_from_slice(&[0x55, 0x99, 0xAA, 0x66]);
        Self {
            id: 0x14,
            bytes,
            written: Vec::new(),
            erased: Vec::new(),
            stuck: None,
            pages_left: usize::MAX,
        }
    }
}

/// The power has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no power; switch it on")]
struct NoPower;

impl FlashMemory for &mut Chip {
    type Error = NoPower;

    fn id(&mut self) -> Result<u32, EthernetError<NoPower>> {
        Ok(self.id)
    }

    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError<NoPower>> {
        bytes.copy_from_slice(&self.bytes[address as usize..][..bytes.len()]);
        Ok(())
    }

    fn erase_sector(&mut self, address: u32) -> Result<(), EthernetError<NoPower>> {
        assert!(address.is_multiple_of(SECTOR));
        self.erased.push(address);
        self.bytes[address as usize..][..SECTOR as usize].fill(0xFF);
        Ok(())
    }

    fn write_page(
        &mut self,
        address: u32,
        page: &[u8; PAGE],
    ) -> Result<(), EthernetError<NoPower>> {
        assert!(address.is_multiple_of(PAGE as u32));
        self.pages_left = self
            .pages_left
            .checked_sub(1)
            .ok_or(EthernetError::Bus(NoPower))?;
        self.written.push(address);
        for (at, byte) in (address as usize..).zip(page) {
            self.bytes[at] &= byte;
            if self.stuck == Some(at) {
                self.bytes[at] |= 1;
            }
        }
        Ok(())
    }
}

fn configuration(len: usize) -> Vec<u8> {
    let mut data = vec![0xAA, 0x99, 0x55, 0x66];
    data.extend((4..len).map(|n| (n * 7 + n / 256) as u8));
    data
}

fn bitfile(configuration: &[u8]) -> Bitfile<'_> {
    Bitfile {
        design: "d",
        part: FlashLayout::I7I97.part,
        date: "",
        time: "",
        configuration,
    }
}

#[test]
fn a_configuration_is_written_verified_and_touches_its_own_area_only() {
    let mut chip = Chip::new();
    chip.bytes[0x10_0000..0x16_0000].fill(0x00);
    chip.bytes[0x16_0000] = 0x12;
    let data = configuration(340_001);
    let mut stages = Vec::new();
    let mut flash = Flash::open(&mut chip, FlashLayout::I7I97).unwrap();
    flash
        .program(&bitfile(&data), Area::User, |stage, done| {
            stages.push((stage, done));
        })
        .unwrap();
    flash
        .verify(&bitfile(&data), Area::User, |_, _| {})
        .unwrap();
    assert_eq!(stages.last(), Some(&(Stage::Verify, 340_001)));
    assert_eq!(
        chip.erased,
        [
            0x10_0000, 0x11_0000, 0x12_0000, 0x13_0000, 0x14_0000, 0x15_0000
        ]
    );
    assert_eq!(chip.bytes[0x10_0000..0x10_0004], [0xAA, 0x99, 0x55, 0x66]);
    assert_eq!((chip.bytes[0], chip.bytes[0x16_0000]), (0x55, 0x12));
    assert!(
        chip.bytes[0x10_0000 + 340_001..0x16_0000]
            .iter()
            .all(|&byte| byte == 0xFF)
    );
}

#[test]
fn nothing_is_erased_for_a_file_that_does_not_fit_the_board() {
    let mut chip = Chip::new();
    let large = configuration(0x6_0001);
    let small = configuration(100);
    let mut flash = Flash::open(&mut chip, FlashLayout::I7I97).unwrap();
    let error = flash
        .program(&bitfile(&large), Area::User, |_, _| {})
        .unwrap_err();
    assert!(matches!(
        error,
        EthernetError::Bitfile(BitfileError::TooLarge { .. })
    ));
    let other = Bitfile {
        part: "6slx16ftg256",
        ..bitfile(&small)
    };
    let error = flash.program(&other, Area::User, |_, _| {}).unwrap_err();
    assert!(matches!(
        error,
        EthernetError::Bitfile(BitfileError::WrongPart { .. })
    ));
    let error = flash
        .write(Area::User, 0x0F_0000, &small, |_, _| {})
        .unwrap_err();
    assert!(matches!(error, EthernetError::OutsideArea { .. }));
    let error = flash
        .write(Area::User, 0x15_FF00, &[0; 300], |_, _| {})
        .unwrap_err();
    assert!(matches!(error, EthernetError::OutsideArea { .. }));
    assert!(chip.erased.is_empty() && chip.written.is_empty());
}

#[test]
fn a_missing_boot_block_and_a_wrong_chip_are_said_first() {
    let mut chip = Chip::new();
    chip.bytes[..PAGE].fill(0xFF);
    let data = configuration(100);
    let mut flash = Flash::open(&mut chip, FlashLayout::I7I97).unwrap();
    let error = flash
        .program(&bitfile(&data), Area::User, |_, _| {})
        .unwrap_err();
    assert_eq!(error, EthernetError::NoBootBlock { address: 0 });
    chip.id = 0x15;
    let error = Flash::open(&mut chip, FlashLayout::I7I97).unwrap_err();
    assert_eq!(
        error,
        EthernetError::WrongChip {
            found: 0x15,
            expected: 0x14
        }
    );
    assert!(chip.erased.is_empty());
}

#[test]
fn a_configuration_goes_where_configurations_are_and_nowhere_else() {
    let data = configuration(100);
    for area in [Area::BootBlock, Area::Application, Area::Whole] {
        let mut chip = Chip::new();
        let mut flash = Flash::open(&mut chip, FlashLayout::I7I97).unwrap();
        let error = flash.program(&bitfile(&data), area, |_, _| {}).unwrap_err();
        assert_eq!(error, EthernetError::NotForConfigurations { area });
        assert!(chip.erased.is_empty() && chip.written.is_empty());
    }
}

#[test]
fn the_fallback_is_written_only_where_a_boot_block_leads_to_a_user_configuration() {
    let data = configuration(1000);
    let mut chip = Chip::new();
    let program = |chip: &mut Chip, area| {
        let mut flash = Flash::open(chip, FlashLayout::I7I97).unwrap();
        flash.program(&bitfile(&data), area, |_, _| {})
    };
    let none = EthernetError::NoUserConfiguration { address: 0x10_0000 };
    assert_eq!(program(&mut chip, Area::Fallback), Err(none));
    chip.bytes[0x10_0000..0x10_0100].fill(0x00);
    assert_eq!(program(&mut chip, Area::Fallback), Err(none));
    assert!(chip.erased.is_empty() && chip.written.is_empty());
    // Power fails while the user configuration is written, wherever.
    for pages in 0..4 {
        chip.pages_left = pages;
        assert_eq!(
            program(&mut chip, Area::User),
            Err(EthernetError::Bus(NoPower))
        );
        chip.pages_left = usize::MAX;
        assert_eq!(
            program(&mut chip, Area::Fallback),
            Err(none),
            "{pages} pages"
        );
    }
    assert_eq!(program(&mut chip, Area::User), Ok(()));
    let boot_block = chip.bytes[0];
    chip.bytes[..PAGE].fill(0xFF);
    let no_boot_block = EthernetError::NoBootBlock { address: 0 };
    assert_eq!(program(&mut chip, Area::Fallback), Err(no_boot_block));
    chip.bytes[0] = boot_block;
    chip.erased.clear();
    assert_eq!(program(&mut chip, Area::Fallback), Ok(()));
    assert_eq!(chip.erased, [0x1_0000]);
}

#[test]
fn layouts_are_those_of_the_boards_that_are_known() {
    for (name, board) in [("7I97", "7I97"), ("7I92", "7I92"), ("7i92", "7I92")] {
        let layout = FlashLayout::for_card(name).expect("known");
        assert_eq!(layout.board, board);
        // 16 Mbit, and the six sectors of an XC6SLX9 at the beginning of the upper half.
        assert_eq!(
            (layout.size, layout.user),
            (0x20_0000, (0x10_0000, 0x16_0000))
        );
    }
    for name in ["7I97T", "7I92T", "7I96", ""] {
        assert_eq!(FlashLayout::for_card(name), None, "{name}");
    }
}

#[test]
fn the_whole_chip_is_not_a_name_for_a_part_of_it() {
    let mut chip = Chip::new();
    let mut flash = Flash::open(&mut chip, FlashLayout::I7I97).unwrap();
    for (address, bytes) in [(0, 100), (0x1_0000, 100), (0x1_0000, 0x1F_0000)] {
        let error = flash
            .write(Area::Whole, address, &vec![0; bytes], |_, _| {})
            .unwrap_err();
        assert_eq!(
            error,
            EthernetError::NotWhole {
                address,
                bytes,
                size: 0x20_0000
            }
        );
    }
    let backup = vec![0x5A; 0x20_0000];
    flash.write(Area::Whole, 0, &backup, |_, _| {}).unwrap();
    assert!(chip.bytes == backup);
}

#[test]
fn a_write_begins_a_sector() {
    let mut chip = Chip::new();
    let mut flash = Flash::open(&mut chip, FlashLayout::I7I97).unwrap();
    let error = flash
        .write(Area::User, 0x10_0100, &[0; 4], |_, _| {})
        .unwrap_err();
    let expected = EthernetError::NotASector {
        address: 0x10_0100,
        sector: 0x10_0000,
    };
    assert_eq!(error, expected);
    assert!(chip.erased.is_empty());
}

#[test]
fn what_was_not_parsed_is_checked_before_anything_is_erased_too() {
    let mut chip = Chip::new();
    let mut flash = Flash::open(&mut chip, FlashLayout::I7I97).unwrap();
    let error = flash
        .program(&bitfile(&[0xFF; 1000]), Area::User, |_, _| {})
        .unwrap_err();
    let expected = BitfileError::NoSync { searched: 256 };
    assert_eq!(error, EthernetError::Bitfile(expected));
    assert!(chip.erased.is_empty());
}

#[test]
fn a_bit_that_can_not_be_written_is_found() {
    let mut chip = Chip::new();
    chip.stuck = Some(0x10_0102);
    let data = vec![0; 600];
    let mut flash = Flash::open(&mut chip, FlashLayout::I7I97).unwrap();
    let error = flash
        .write(Area::User, 0x10_0000, &data, |_, _| {})
        .unwrap_err();
    let expected = EthernetError::Differs {
        address: 0x10_0102,
        expected: 0,
        found: 1,
    };
    assert_eq!(error, expected);
}
