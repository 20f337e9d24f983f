mod backup;

use super::super::BitfileError;
use super::*;
use crate::bus::{BusError, BusErrorKind, Clock, Instant};
use crate::lbp16::registers::{control, flash};
use crate::lbp16::{Operations, Space};
use alloc::{vec, vec::Vec};

/// A chip as described in its data sheet: erasing sets bits, writing clears them.
#[derive(Debug)]
struct Chip {
    id: u32,
    bytes: Vec<u8>,
    written: Vec<u32>,
    erased: Vec<u32>,
    stuck: Option<usize>,
    /// Power fails after this many pages.
    pages_left: usize,
}

impl Chip {
    fn new() -> Self {
        let mut bytes = vec![0xFF; 0x20_0000];
        bytes[..PAGE].copy_from_slice(&FlashLayout::I7I97.boot_page());
        bytes[0x1_0000..][..4].copy_from_slice(&[0xAA, 0x99, 0x55, 0x66]);
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
const NO_POWER: BusError = BusError::custom(BusErrorKind::Lost, "no power; switch it on");

impl Clock for Chip {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(0)
    }

    fn wait(&mut self, _: Duration) {}
}

/// The registers of the flash memory only. Manual: 7I97, "SPACE 3: FPGA FLASH EEPROM CHIP ACCESS".
impl Lbp16Board for Chip {
    fn run_commands(
        &mut self,
        commands: &[u8],
        reply: &mut [u8],
        _: Duration,
    ) -> Result<(), BusError> {
        let (mut answer, mut address, mut page) = (Vec::new(), 0, None);
        for operation in Operations::new(commands).map(Result::unwrap) {
            let register = operation.address.expect("of every command");
            match (operation.command.space, operation.command.write, register) {
                (Space::Flash, true, flash::ADDRESS) => {
                    address = operation.elements().next().unwrap() as usize;
                }
                (Space::Flash, true, flash::SECTOR_ERASE) => {
                    assert!(address.is_multiple_of(SECTOR));
                    self.erased.push(address as u32);
                    self.bytes[address..][..SECTOR].fill(0xFF);
                }
                (Space::Flash, true, flash::DATA) => page = Some(operation.data),
                (Space::Flash, false, flash::DATA) => {
                    let len = operation.command.data_len();
                    answer.extend(&self.bytes[address..][..len]);
                    address += len;
                }
                (Space::Flash, false, flash::ID) => answer.extend(self.id.to_le_bytes()),
                (Space::Flash, false, flash::ADDRESS) => {
                    if let Some(page) = page.take() {
                        self.write_page(address, page)?;
                    }
                    answer.extend((address as u32).to_le_bytes());
                }
                (space, write, _) => {
                    let enable = [control::ENABLE_FLASH.to_le_bytes()];
                    assert_eq!((space, write), (Space::Control, true));
                    assert_eq!(operation.data, enable.as_flattened());
                }
            }
        }
        reply.copy_from_slice(&answer);
        Ok(())
    }

    fn send(&mut self, _: &[u8]) -> Result<(), BusError> {
        unreachable!("everything is answered")
    }
}

impl Chip {
    fn write_page(&mut self, address: usize, page: &[u8]) -> Result<(), BusError> {
        assert!(address.is_multiple_of(PAGE) && page.len() == PAGE);
        self.pages_left = self.pages_left.checked_sub(1).ok_or(NO_POWER)?;
        self.written.push(address as u32);
        for (at, byte) in (address..).zip(page) {
            self.bytes[at] &= byte;
            if self.stuck == Some(at) {
                self.bytes[at] |= 1;
            }
        }
        Ok(())
    }
}

fn open(chip: &mut Chip) -> Result<Flash<EthernetBoard<'_, Chip>>, EthernetError> {
    Flash::open(EthernetBoard::new(chip), FlashLayout::I7I97)
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

/// mesaflash compares its whole last page when it verifies.
#[test]
fn last_page_ends_as_mesaflash_leaves_it() {
    for len in [340_604, 340_480, 10_000, 8_192 + 100, 1_000] {
        let (mut chip, data) = (Chip::new(), configuration(len));
        let mut flash = open(&mut chip).expect("a 7I97");
        flash
            .program(&bitfile(&data), Area::User, |_, _| {})
            .expect("it is written");
        let end = len.next_multiple_of(PAGE);
        let mut expected = data.clone();
        expected.extend((len..end).map(|at| match at.checked_sub(8_192) {
            Some(before) => data[before],
            None => 0xFF,
        }));
        assert_eq!(chip.bytes[0x10_0000..][..end], expected, "{len}");
        assert_eq!(chip.bytes[0x10_0000 + end], 0xFF, "{len}");
    }
}

#[test]
fn configuration_is_written_and_verified_in_its_own_area_only() {
    let mut chip = Chip::new();
    chip.bytes[0x10_0000..0x16_0000].fill(0x00);
    chip.bytes[0x16_0000] = 0x12;
    let data = configuration(340_001);
    let mut stages = Vec::new();
    let mut flash = open(&mut chip).unwrap();
    flash
        .program(&bitfile(&data), Area::User, |stage, done| {
            stages.push((stage, done));
        })
        .unwrap();
    flash
        .verify(&bitfile(&data), Area::User, |_, _| {})
        .unwrap();
    assert_eq!(stages.last(), Some(&(FlashStep::Verify, 340_001)));
    assert_eq!(
        chip.erased,
        [
            0x10_0000, 0x11_0000, 0x12_0000, 0x13_0000, 0x14_0000, 0x15_0000
        ]
    );
    assert_eq!(chip.bytes[0x10_0000..0x10_0004], [0xAA, 0x99, 0x55, 0x66]);
    assert_eq!(chip.bytes[..PAGE], FlashLayout::I7I97.boot_page());
    assert_eq!(chip.bytes[0x16_0000], 0x12);
    assert!(
        chip.bytes[0x10_0000 + 340_001_usize.next_multiple_of(PAGE)..0x16_0000]
            .iter()
            .all(|&byte| byte == 0xFF)
    );
}

#[test]
fn no_sector_is_erased_for_a_file_that_does_not_fit_the_board() {
    let mut chip = Chip::new();
    let large = configuration(0x6_0001);
    let small = configuration(100);
    let mut flash = open(&mut chip).unwrap();
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
        EthernetError::Bitfile(BitfileError::OtherBoard { .. })
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
fn missing_boot_block_and_wrong_chip_are_reported_first() {
    let mut chip = Chip::new();
    chip.bytes[..PAGE].fill(0xFF);
    let data = configuration(100);
    let mut flash = open(&mut chip).unwrap();
    let error = flash
        .program(&bitfile(&data), Area::User, |_, _| {})
        .unwrap_err();
    assert_eq!(error, EthernetError::NoBootBlock { address: 0 });
    chip.id = 0x15;
    let error = open(&mut chip).unwrap_err();
    let expected = EthernetError::WrongBoard {
        found: "a board with flash id 0x00000015".into(),
        expected: "one with 0x00000014".into(),
    };
    assert_eq!(error, expected);
    assert!(chip.erased.is_empty());
}

#[test]
fn boot_block_that_mesaflash_refuses_is_refused_until_rewritten() {
    let data = configuration(100);
    for (at, byte) in [(0, 0x55), (25, 0x08), (63, 0x01)] {
        let mut chip = Chip::new();
        let expected = chip.bytes[at];
        chip.bytes[at] = byte;
        let mut flash = open(&mut chip).unwrap();
        let refused = EthernetError::OtherBootBlock {
            address: at as u32,
            expected,
            found: byte,
        };
        let program = |flash: &mut Flash<EthernetBoard<'_, Chip>>| {
            flash.program(&bitfile(&data), Area::User, |_, _| {})
        };
        assert_eq!(program(&mut flash), Err(refused.clone()));
        assert_eq!(flash.check_boot_block(), Err(refused));
        flash.write_boot_block(|_, _| {}).unwrap();
        assert_eq!(program(&mut flash), Ok(()));
        assert_eq!(chip.erased, [0, 0x10_0000]);
        assert_eq!(chip.bytes[..PAGE], FlashLayout::I7I97.boot_page());
    }
    // mesaflash compares no more than 64 bytes.
    let mut chip = Chip::new();
    chip.bytes[64] = 0xFF;
    assert_eq!(open(&mut chip).unwrap().check_boot_block(), Ok(()));
}

#[test]
fn multiboot_file_is_refused_before_anything_is_erased() {
    let mut chip = Chip::new();
    let mut data = FlashLayout::I7I97.boot_page().to_vec();
    data.extend(configuration(1000));
    let mut flash = open(&mut chip).unwrap();
    let refused = flash.program(&bitfile(&data), Area::User, |_, _| {});
    let Err(EthernetError::Bitfile(error)) = refused else {
        panic!("{refused:?}");
    };
    assert!(
        matches!(error, BitfileError::Multiboot { at: 22, .. }),
        "{error}"
    );
    assert!(chip.erased.is_empty());
    // The same without a header, as programming tools write it.
    let raw = Bitfile::parse(&data);
    assert!(
        matches!(raw, Err(BitfileError::Multiboot { .. })),
        "{raw:?}"
    );
    assert_eq!(Bitfile::parse(&data[256..]), Err(BitfileError::NoMark));
}

#[test]
fn configuration_goes_where_configurations_are_and_nowhere_else() {
    let data = configuration(100);
    for area in [Area::BootBlock, Area::Application, Area::Whole] {
        let mut chip = Chip::new();
        let mut flash = open(&mut chip).unwrap();
        let error = flash.program(&bitfile(&data), area, |_, _| {}).unwrap_err();
        assert_eq!(error, EthernetError::NotForConfigurations { area });
        assert!(chip.erased.is_empty() && chip.written.is_empty());
    }
}

#[test]
fn fallback_needs_a_boot_block_and_a_user_configuration() {
    let data = configuration(1000);
    let mut chip = Chip::new();
    let program = |chip: &mut Chip, area| {
        let mut flash = open(chip).unwrap();
        flash.program(&bitfile(&data), area, |_, _| {})
    };
    let none = || EthernetError::NoUserConfiguration { address: 0x10_0000 };
    assert_eq!(program(&mut chip, Area::Fallback), Err(none()));
    chip.bytes[0x10_0000..0x10_0100].fill(0x00);
    assert_eq!(program(&mut chip, Area::Fallback), Err(none()));
    assert!(chip.erased.is_empty() && chip.written.is_empty());
    // Power fails at any point while the user configuration is written.
    for pages in 0..4 {
        chip.pages_left = pages;
        assert_eq!(
            program(&mut chip, Area::User),
            Err(EthernetError::Bus(NO_POWER))
        );
        chip.pages_left = usize::MAX;
        assert_eq!(
            program(&mut chip, Area::Fallback),
            Err(none()),
            "{pages} pages"
        );
    }
    assert_eq!(program(&mut chip, Area::User), Ok(()));
    chip.bytes[..PAGE].fill(0xFF);
    let no_boot_block = EthernetError::NoBootBlock { address: 0 };
    assert_eq!(program(&mut chip, Area::Fallback), Err(no_boot_block));
    open(&mut chip)
        .unwrap()
        .write_boot_block(|_, _| {})
        .unwrap();
    chip.erased.clear();
    assert_eq!(program(&mut chip, Area::Fallback), Ok(()));
    assert_eq!(chip.erased, [0x1_0000]);
}

#[test]
fn user_configuration_needs_a_fallback_unless_allowed_without() {
    let data = configuration(1000);
    let mut chip = Chip::new();
    chip.bytes[0x1_0000..][..PAGE].fill(0xFF);
    chip.bytes[0x10_0000..][..1000].copy_from_slice(&configuration(1000));
    let mut flash = open(&mut chip).unwrap();
    let refused = flash.program(&bitfile(&data), Area::User, |_, _| {});
    let none = EthernetError::NoFallback { address: 0x1_0000 };
    assert_eq!(refused, Err(none.clone()));
    let mut backup = flash.backup(|_| true).unwrap().expect("not ended");
    backup[0x10_0100] ^= 0xFF;
    let user = flash.differences(&backup, |_| true).unwrap().expect("all");
    let refused = flash.restore(&backup, &user[0], |_, _| {});
    assert_eq!(refused, Err(none));
    // The way out: the fallback first.
    assert_eq!(
        flash.program(&bitfile(&data), Area::Fallback, |_, _| {}),
        Ok(())
    );
    assert_eq!(flash.restore(&backup, &user[0], |_, _| {}), Ok(()));
    assert_eq!(
        flash.program(&bitfile(&data), Area::User, |_, _| {}),
        Ok(())
    );
    // A chip that has neither, as after loading over JTAG.
    chip.bytes.fill(0xFF);
    let mut flash = open(&mut chip).unwrap();
    flash.without_fallback();
    assert_eq!(
        flash.check_configuration(&bitfile(&data), Area::User),
        Ok(())
    );
    flash.write_boot_block(|_, _| {}).unwrap();
    let programmed = flash.program(&bitfile(&data), Area::User, |_, _| {});
    assert_eq!(programmed, Ok(()));
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
fn whole_chip_is_not_a_name_for_a_part_of_it() {
    let mut chip = Chip::new();
    let mut flash = open(&mut chip).unwrap();
    for (address, bytes) in [(0, 100), (0x1_0000, 100), (0x1_0000, 0x1F_0000)] {
        let error = flash
            .write(Area::Whole, address, &vec![0; bytes], |_, _| {})
            .unwrap_err();
        let expected = EthernetError::OutsideArea {
            address,
            bytes,
            area: Area::Whole,
            expected: "all of its 2097152 bytes from 0 on".into(),
        };
        assert_eq!(error, expected);
    }
    let backup = vec![0x5A; 0x20_0000];
    flash.write(Area::Whole, 0, &backup, |_, _| {}).unwrap();
    assert!(chip.bytes == backup);
}

#[test]
fn write_begins_a_sector() {
    let mut chip = Chip::new();
    let mut flash = open(&mut chip).unwrap();
    let error = flash
        .write(Area::User, 0x10_0100, &[0; 4], |_, _| {})
        .unwrap_err();
    let expected = EthernetError::OutsideArea {
        address: 0x10_0100,
        bytes: 4,
        area: Area::User,
        expected: "what begins a sector, here 0x100000".into(),
    };
    assert_eq!(error, expected);
    assert!(chip.erased.is_empty());
}

#[test]
fn unparsed_configuration_is_checked_before_anything_is_erased() {
    let mut chip = Chip::new();
    let mut flash = open(&mut chip).unwrap();
    let error = flash
        .program(&bitfile(&[0xFF; 1000]), Area::User, |_, _| {})
        .unwrap_err();
    let expected = BitfileError::NoSync { searched: 256 };
    assert_eq!(error, EthernetError::Bitfile(expected));
    assert!(chip.erased.is_empty());
}

#[test]
fn bit_that_can_not_be_written_is_found() {
    let mut chip = Chip::new();
    chip.stuck = Some(0x10_0102);
    let data = vec![0; 600];
    let mut flash = open(&mut chip).unwrap();
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
