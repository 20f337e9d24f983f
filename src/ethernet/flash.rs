//! The flash memory that holds the FPGA's configurations, and what may be written where.

use core::ops::Range;

use super::{Bitfile, BitfileError};

/// One page: what is written at once.
pub const PAGE: usize = 256;
/// One sector: what is erased at once.
pub const SECTOR: u32 = 0x1_0000;

/// A flash memory, as a board gives access to it.
pub trait FlashMemory {
    /// What can go wrong on the way.
    type Error;

    /// The chip's identification.
    fn id(&mut self) -> Result<u32, Self::Error>;

    /// Reads from `address` on.
    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), Self::Error>;

    /// Erases the sector that begins at `address` to FF, and waits until it is.
    fn erase_sector(&mut self, address: u32) -> Result<(), Self::Error>;

    /// Writes the page that begins at `address`, and waits until it is.
    fn write_page(&mut self, address: u32, page: &[u8; PAGE]) -> Result<(), Self::Error>;
}

/// Where things are in a board's flash memory.
///
/// Source: manual 7I97, "EEPROM LAYOUT".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashLayout {
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

impl FlashLayout {
    /// The 7I97: M25P16, XC6SLX9.
    pub const I7I97: Self = Self {
        part: "6slx9tqg144",
        id: 0x14,
        size: 0x20_0000,
        boot_block: (0x00_0000, 0x01_0000),
        fallback: (0x01_0000, 0x07_0000),
        user: (0x10_0000, 0x16_0000),
        application: (0x1E_0000, 0x20_0000),
    };

    /// The addresses of an area.
    pub fn addresses(&self, area: Area) -> Range<u32> {
        let (start, end) = match area {
            Area::BootBlock => self.boot_block,
            Area::Fallback => self.fallback,
            Area::User => self.user,
            Area::Application => self.application,
            Area::Whole => (0, self.size),
        };
        start..end
    }
}

/// What somebody wants to write; naming it is the only way to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Area {
    /// The boot block: a mistake here needs a JTAG programmer to mend.
    BootBlock,
    /// The fallback configuration: the way back when the user configuration is damaged.
    Fallback,
    /// The user configuration: what new firmware is written to.
    User,
    /// The last two sectors, which configurations never use.
    Application,
    /// Everything, to restore a backup of the whole chip.
    Whole,
}

/// What is being done, for a progress display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Sectors are being erased.
    Erase,
    /// Pages are being written.
    Write,
    /// What was written is being read back.
    Verify,
}

/// Why the flash memory was not written, or not as wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FlashError<E> {
    /// The board did not answer.
    #[error(transparent)]
    Bus(#[from] E),
    /// The file is not for this board.
    #[error(transparent)]
    Bitfile(BitfileError),
    /// Another chip than the layout is for.
    #[error("flash id 0x{found:08X}, expected 0x{expected:08X}: this layout is not for this board")]
    WrongChip {
        /// The id read.
        found: u32,
        /// The id of the layout.
        expected: u32,
    },
    /// There is no boot block, so the FPGA would load the fallback whatever is written.
    #[error(
        "the boot block at 0x{address:06X} is erased: the FPGA would not load what is written; \
         write the boot block first"
    )]
    NoBootBlock {
        /// Where it should be.
        address: u32,
    },
    /// The data do not fit into their area.
    #[error("{bytes} bytes at 0x{address:06X} do not fit into {area:?}")]
    OutsideArea {
        /// Where they should begin.
        address: u32,
        /// How many there are.
        bytes: usize,
        /// The area.
        area: Area,
    },
    /// A byte read back is not what it should be.
    #[error(
        "at 0x{address:06X} is 0x{found:02X}, expected 0x{expected:02X}; write again, and do not restart the board before it verifies"
    )]
    Differs {
        /// Where.
        address: u32,
        /// What should be there.
        expected: u8,
        /// What is there.
        found: u8,
    },
}

/// The flash memory of a board, guarded by its layout.
#[derive(Debug)]
pub struct Flash<M> {
    memory: M,
    layout: FlashLayout,
}

impl<M: FlashMemory> Flash<M> {
    /// The memory behind a board, after checking that it is the chip that the layout is for.
    pub fn open(mut memory: M, layout: FlashLayout) -> Result<Self, FlashError<M::Error>> {
        let found = memory.id()?;
        if found != layout.id {
            return Err(FlashError::WrongChip {
                found,
                expected: layout.id,
            });
        }
        Ok(Self { memory, layout })
    }

    /// Reads from anywhere.
    pub fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), FlashError<M::Error>> {
        self.inside(address, bytes.len(), Area::Whole)?;
        Ok(self.memory.read(address, bytes)?)
    }

    /// Writes a configuration into the user or the fallback area, and verifies it.
    ///
    /// The file is checked before anything is erased.
    pub fn program(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
        progress: impl FnMut(Stage, usize),
    ) -> Result<(), FlashError<M::Error>> {
        let range = self.layout.addresses(area);
        bitfile
            .check(self.layout.part, range.len())
            .map_err(FlashError::Bitfile)?;
        if area == Area::User {
            self.need_boot_block()?;
        }
        self.write(area, range.start, bitfile.configuration, progress)
    }

    /// Compares an area with a configuration.
    pub fn verify(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
        mut progress: impl FnMut(Stage, usize),
    ) -> Result<(), FlashError<M::Error>> {
        let start = self.layout.addresses(area).start;
        self.inside(start, bitfile.configuration.len(), area)?;
        self.compare(start, bitfile.configuration, &mut progress)
    }

    /// Erases what `data` needs, writes it, and verifies it. `address` begins a sector.
    ///
    /// `progress` is told how many bytes of the stage are done.
    pub fn write(
        &mut self,
        area: Area,
        address: u32,
        data: &[u8],
        mut progress: impl FnMut(Stage, usize),
    ) -> Result<(), FlashError<M::Error>> {
        self.inside(address, data.len(), area)?;
        if !address.is_multiple_of(SECTOR) {
            return Err(FlashError::OutsideArea {
                address,
                bytes: data.len(),
                area,
            });
        }
        let end = address + data.len() as u32;
        for sector in (address..end).step_by(SECTOR as usize) {
            self.memory.erase_sector(sector)?;
            progress(Stage::Erase, (sector + SECTOR - address) as usize);
        }
        for (at, chunk) in (address..end).step_by(PAGE).zip(data.chunks(PAGE)) {
            let mut page = [0xFF; PAGE];
            for (target, byte) in page.iter_mut().zip(chunk) {
                *target = *byte;
            }
            // An erased page is all FF already.
            if page != [0xFF; PAGE] {
                self.memory.write_page(at, &page)?;
            }
            progress(Stage::Write, (at - address) as usize + chunk.len());
        }
        self.compare(address, data, &mut progress)
    }

    /// Gives the memory back.
    pub fn into_inner(self) -> M {
        self.memory
    }

    fn inside(&self, address: u32, bytes: usize, area: Area) -> Result<(), FlashError<M::Error>> {
        let range = self.layout.addresses(area);
        let end = u64::from(address) + bytes as u64;
        if range.start <= address && end <= u64::from(range.end) {
            return Ok(());
        }
        Err(FlashError::OutsideArea {
            address,
            bytes,
            area,
        })
    }

    fn need_boot_block(&mut self) -> Result<(), FlashError<M::Error>> {
        let address = self.layout.boot_block.0;
        let mut head = [0xFF; PAGE];
        self.memory.read(address, &mut head)?;
        if head == [0xFF; PAGE] {
            return Err(FlashError::NoBootBlock { address });
        }
        Ok(())
    }

    fn compare(
        &mut self,
        start: u32,
        data: &[u8],
        progress: &mut impl FnMut(Stage, usize),
    ) -> Result<(), FlashError<M::Error>> {
        const BLOCK: usize = 4 * PAGE;
        let mut buffer = [0; BLOCK];
        for (at, chunk) in (start..).step_by(BLOCK).zip(data.chunks(BLOCK)) {
            let read = buffer.get_mut(..chunk.len()).unwrap_or_default();
            self.memory.read(at, read)?;
            let pairs = (at..).zip(read.iter().zip(chunk));
            for (address, (&found, &expected)) in pairs {
                if found != expected {
                    return Err(FlashError::Differs {
                        address,
                        expected,
                        found,
                    });
                }
            }
            progress(Stage::Verify, (at - start) as usize + chunk.len());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
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
            }
        }
    }

    impl FlashMemory for &mut Chip {
        type Error = core::convert::Infallible;

        fn id(&mut self) -> Result<u32, Self::Error> {
            Ok(self.id)
        }

        fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
            bytes.copy_from_slice(&self.bytes[address as usize..][..bytes.len()]);
            Ok(())
        }

        fn erase_sector(&mut self, address: u32) -> Result<(), Self::Error> {
            assert!(address.is_multiple_of(SECTOR));
            self.erased.push(address);
            self.bytes[address as usize..][..SECTOR as usize].fill(0xFF);
            Ok(())
        }

        fn write_page(&mut self, address: u32, page: &[u8; PAGE]) -> Result<(), Self::Error> {
            assert!(address.is_multiple_of(PAGE as u32));
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
            FlashError::Bitfile(BitfileError::TooLarge { .. })
        ));
        let other = Bitfile {
            part: "6slx16ftg256",
            ..bitfile(&small)
        };
        let error = flash.program(&other, Area::User, |_, _| {}).unwrap_err();
        assert!(matches!(
            error,
            FlashError::Bitfile(BitfileError::WrongPart { .. })
        ));
        let error = flash
            .write(Area::User, 0x0F_0000, &small, |_, _| {})
            .unwrap_err();
        assert!(matches!(error, FlashError::OutsideArea { .. }));
        let error = flash
            .write(Area::User, 0x15_FF00, &[0; 300], |_, _| {})
            .unwrap_err();
        assert!(matches!(error, FlashError::OutsideArea { .. }));
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
        assert_eq!(error, FlashError::NoBootBlock { address: 0 });
        chip.id = 0x15;
        let error = Flash::open(&mut chip, FlashLayout::I7I97).unwrap_err();
        assert_eq!(
            error,
            FlashError::WrongChip {
                found: 0x15,
                expected: 0x14
            }
        );
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
        let expected = FlashError::Differs {
            address: 0x10_0102,
            expected: 0,
            found: 1,
        };
        assert_eq!(error, expected);
    }
}
