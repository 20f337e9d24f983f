//! The flash memory of a board on the PCI bus, through two registers of its FPGA.

use std::cell::Cell;
use std::time::Duration;

use mesa_hal::MesaError;
use mesa_hal::boards::FlashLayout;
use mesa_hal::bus::{Access, BusError, Clock, Instant, RegisterBus};
use mesa_hal::ethernet::{Area, Bitfile, EthernetError, Flash, FlashStep, SpiFlash};
use mesa_hal_sim::{BoardConfig, SimBoard, SimPciBus, machines};

/// A chip with a boot block, and with a configuration as the fallback.
fn board() -> SimPciBus {
    let fpga = machines::i5i25_7i77();
    let mut board = SimBoard::new(BoardConfig::new("5I25"), fpga);
    board.load_flash(0, &FlashLayout::I5I25.boot_page());
    board.load_flash(0x01_0000, &[0xAA, 0x99, 0x55, 0x66]);
    SimPciBus::new(board)
}

fn open(bus: &mut SimPciBus) -> Flash<SpiFlash<'_, SimPciBus>> {
    Flash::open(SpiFlash::new(bus), FlashLayout::I5I25).expect("the chip of a 5I25")
}

/// A bitfile with a configuration of `len` bytes.
fn bitfile(len: usize) -> Vec<u8> {
    let mut bytes = vec![
        0, 9, 0x0F, 0xF0, 0x0F, 0xF0, 0x0F, 0xF0, 0x0F, 0xF0, 0, 0, 1,
    ];
    let texts = [
        "fivei25_7i77x2.ncd",
        "6slx9tqg144",
        "2026/11/27",
        "02:00:00",
    ];
    for (kind, text) in (b'a'..).zip(texts) {
        bytes.push(kind);
        bytes.extend((text.len() as u16 + 1).to_be_bytes());
        bytes.extend(text.bytes());
        bytes.push(0);
    }
    bytes.push(b'e');
    bytes.extend((len as u32).to_be_bytes());
    bytes.extend([0xFF; 16]);
    bytes.extend([0xAA, 0x99, 0x55, 0x66]);
    bytes.extend((20..len).map(|n| (n * 7 + n / 256) as u8));
    bytes
}

#[test]
fn configuration_is_written_verified_and_backed_up_by_registers() {
    let mut bus = board();
    let bytes = bitfile(0x1_2345);
    let file = Bitfile::parse(&bytes).expect("a bitfile");
    let mut flash = open(&mut bus);
    let mut steps = Vec::new();
    flash
        .program(&file, Area::User, |step, done| steps.push((step, done)))
        .expect("written");
    assert_eq!(steps.first(), Some(&(FlashStep::Erase, 0x1_0000)));
    assert_eq!(steps.last(), Some(&(FlashStep::Verify, 0x1_2345)));
    flash
        .verify(&file, Area::User, |_, _| {})
        .expect("the same");
    let backup = flash.backup(|_| true).expect("read").expect("whole");
    assert_eq!(backup.len(), 0x10_0000);
    // The configuration alone is in the memory, without the header of the file, as mesaflash writes
    // it, and what is behind its last page of 256 bytes was only erased.
    assert!(&backup[0x08_0000..][..0x1_2345] == file.configuration);
    assert!(backup[..256] == FlashLayout::I5I25.boot_page());
    assert!(
        backup[0x09_2400..0x0A_0000]
            .iter()
            .all(|&byte| byte == 0xFF)
    );
    let state = bus.board.state();
    let chip = &state[state.len() - 0x20_0000..];
    assert!(&chip[0x08_0000..][..0x1_2345] == file.configuration);
}

#[test]
fn chip_that_differs_is_found_and_a_backup_is_restored() {
    let mut bus = board();
    let bytes = bitfile(0x2000);
    let file = Bitfile::parse(&bytes).expect("a bitfile");
    let mut flash = open(&mut bus);
    flash
        .program(&file, Area::User, |_, _| {})
        .expect("written");
    let backup = flash.backup(|_| true).expect("read").expect("whole");
    bus.board.load_flash(0x08_1FFF, &[0]);
    let mut flash = open(&mut bus);
    let error = flash
        .verify(&file, Area::User, |_, _| {})
        .expect_err("differs");
    assert!(
        matches!(
            error,
            EthernetError::Differs {
                address: 0x08_1FFF,
                ..
            }
        ),
        "{error}"
    );
    let different = flash
        .differences(&backup, |_| true)
        .expect("read")
        .expect("compared");
    let [part] = different[..] else {
        panic!("{different:?}");
    };
    assert_eq!((part.area, part.start), (Some(Area::User), 0x08_0000));
    flash.restore(&backup, &part, |_, _| {}).expect("restored");
    flash
        .verify(&file, Area::User, |_, _| {})
        .expect("the same");
}

#[test]
fn another_chip_is_refused_before_anything_is_read() {
    let mut bus = board();
    let error = Flash::open(SpiFlash::new(&mut bus), FlashLayout::I7I92).expect_err("16 Mbit");
    assert!(matches!(error, EthernetError::WrongBoard { .. }), "{error}");
}

/// Registers behind which no chip answers as it should; time passes with accesses.
#[derive(Debug)]
struct Broken {
    /// What the control register reads as.
    control: u32,
    now: Cell<u64>,
}

impl RegisterBus for Broken {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        for access in accesses {
            self.now.set(self.now.get() + 1_000_000);
            if access.address == 0x70 {
                words[access.words()].fill(self.control);
            } else {
                words[access.words()].fill(0x13);
            }
        }
        Ok(())
    }
}

impl Clock for Broken {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.now.get())
    }

    fn wait(&mut self, _: Duration) {}
}

#[test]
fn missing_or_busy_spi_chip_is_an_error() {
    let broken = |control| Broken {
        control,
        now: Cell::default(),
    };
    let mut silent = broken(0x0000_0001);
    let error = Flash::open(SpiFlash::new(&mut silent), FlashLayout::I5I25);
    let error = error.expect_err("no byte is ever complete");
    assert_eq!(error, EthernetError::ChipSilent { control: 1 });
    assert!(error.advice().is_some());
    // The status reads 13: busy.
    let mut busy = broken(0x0000_0004);
    let mut flash = Flash::open(SpiFlash::new(&mut busy), FlashLayout::I5I25).expect("13");
    let error = flash.write(Area::Application, 0x0E_0000, &[1], |_, _| {});
    let error = error.expect_err("busy for ever");
    assert!(matches!(error, EthernetError::ChipBusy { .. }), "{error}");
}
