//! mesaflash and `mesa-hal` write and verify the same flash memory.

use std::fs;

use mesa_hal::boards::FlashLayout;
use mesa_hal::ethernet::{self, Area, Bitfile};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};

use super::*;
use crate::interop::mesaflash::{bitfile, configuration};

const PART: &str = "6slx9tqg144";

/// A bitfile for the board, with `len` bytes of invented data.
fn made_up(len: u32) -> Vec<u8> {
    bitfile("made_up.ncd", PART, &configuration(len))
}

/// The whole flash memory, from a backup by mesaflash.
fn backed_up(board: &Board) -> Vec<u8> {
    let backup = Scratch::new(&format!("backup-{}.bin", board.address()));
    let text = board.mesaflash(&["--backup-flash", backup.path()]);
    says(&text, "created successfully");
    let flash = fs::read(&backup.0).unwrap();
    let _ = fs::remove_file(format!("{}.sha256", backup.path()));
    flash
}

#[test]
fn bitfile_is_written_verified_and_backed_up() {
    if skipped() {
        return;
    }
    let board = Board::i7i97(&[]);
    let file = Scratch::new("made-up.bit");
    let data = configuration(70_000);
    fs::write(&file.0, bitfile("made_up.ncd", PART, &data)).unwrap();

    let before = backed_up(&board);
    let text = board.mesaflash(&["--write", file.path()]);
    assert!(!text.contains("BootSector is invalid"), "{text}");
    says(
        &text,
        "FLASH memory sectors to write: 2, max sectors in area: 16",
    );
    says(&text, "Board configuration updated successfully");
    says(&text, "Board FLASH memory verified successfully");
    let text = board.mesaflash(&["--verify", file.path()]);
    says(&text, "Boot sector OK");
    says(&text, "Board FLASH memory verified successfully");

    let flash = backed_up(&board);
    assert_eq!(flash.len(), 2 << 20);
    assert_eq!(
        flash[10..14],
        [0xAA, 0x99, 0x55, 0x66],
        "sync word of the boot block"
    );
    let written = &flash[0x10_0000..0x10_0000 + data.len()];
    assert!(
        written == data,
        "the data of the bitfile, without its header"
    );
    for (range, what) in [
        (0..0x1_0000, "the boot block"),
        (0x1_0000..0x10_0000, "the fallback area"),
        (0x12_0000..0x20_0000, "what is behind the user area"),
    ] {
        assert!(
            flash[range.clone()] == before[range],
            "{what} is left alone"
        );
    }

    // The boot block that mesaflash itself writes is the same.
    let text = board.mesaflash(&["--fix-boot-block", "--write", file.path()]);
    says(&text, "Board FLASH memory verified successfully");
    assert!(backed_up(&board) == flash, "the boot block that comes");

    fs::write(&file.0, made_up(70_001)).unwrap();
    let (good, text) = board.its_mesaflash().attempt(&["--verify", file.path()]);
    // The byte behind the data: 70000 is 0x11170.
    assert!(!good && text.contains("Error at 0x111170"), "{text}");
    let other = bitfile("made_up.ncd", "6slx25ftg256", &[0; 1000]);
    fs::write(&file.0, other).unwrap();
    let (good, text) = board.its_mesaflash().attempt(&["--write", file.path()]);
    assert!(!good && text.contains("wrong"), "{text}");
}

#[test]
fn mesaflash_and_mesa_write_and_refuse_the_same_boot_blocks() {
    if skipped() {
        return;
    }
    let board = Board::i7i97(&[]);
    let address = board.address().to_string();
    let file = Scratch::new("boot-block.bit");
    fs::write(&file.0, made_up(130_004)).unwrap();
    let put = |first: &[u8]| {
        let mut bus = UdpBus::connect(board.board.address, UdpConfig::default()).unwrap();
        let mut flash = ethernet::EthernetBoard::new(&mut bus)
            .into_flash(FlashLayout::I7I97)
            .unwrap();
        flash.write(Area::BootBlock, 0, first, |_, _| {}).unwrap();
    };
    let write = ["flash", "write", file.path(), "--addr", &address, "--yes"];
    let ours = |more: &[&str]| {
        let mut command = Command::new(mesa());
        let output = command.args([&write[..], more].concat()).output().unwrap();
        output.status.success()
    };
    let theirs = |more: &[&str]| {
        let arguments = [more, &["--write", file.path()]].concat();
        let (good, text) = board.its_mesaflash().attempt(&arguments);
        (good, text.contains("BootSector is invalid"))
    };
    let good = FlashLayout::I7I97.boot_page();
    let with = |at: usize, byte: u8| {
        let mut page = good;
        page[at] = byte;
        page
    };
    // Erased, leading elsewhere, and a difference at the last byte that is compared.
    for bad in [[0xFF; 256], with(25, 0x08), with(63, 0x01)] {
        put(&bad);
        assert!(!ours(&[]), "mesa refuses it");
        // mesaflash may give up before it asks for the boot block.
        let refused = (0..20)
            .map(|_| theirs(&[]))
            .any(|(good, said)| !good && said);
        assert!(refused, "mesaflash refuses it");
        assert_eq!(backed_up(&board)[..256], bad, "neither has written");
        assert!(ours(&["--fix-boot-block"]));
        let by_us = backed_up(&board);
        put(&bad);
        board.mesaflash(&["--fix-boot-block", "--write", file.path()]);
        assert!(backed_up(&board) == by_us, "the same memory");
    }
    // Behind the 64 bytes neither looks.
    put(&with(64, 0xFF));
    assert!(ours(&[]) && theirs(&[]).0);
}

#[test]
fn mesaflash_and_this_crate_verify_each_others_writes() {
    if skipped() {
        return;
    }
    let board = Board::i7i97(&[]);
    let file = Scratch::new("both-ways.bit");
    let bytes = made_up(70_000);
    fs::write(&file.0, &bytes).unwrap();
    board.mesaflash(&["--fallback", "--write", file.path()]);
    board.mesaflash(&["--write", file.path()]);

    let address = board.board.address;
    let mut bus = UdpBus::connect(address, UdpConfig::default()).unwrap();
    let mut flash = ethernet::EthernetBoard::new(&mut bus)
        .into_flash(FlashLayout::I7I97)
        .unwrap();
    let written = Bitfile::parse(&bytes).unwrap();
    flash.verify(&written, Area::User, |_, _| {}).unwrap();

    // Not whole pages: mesaflash also compares its own buffer behind the end of the file.
    let bytes = made_up(130_004);
    fs::write(&file.0, &bytes).unwrap();
    let ours = Bitfile::parse(&bytes).unwrap();
    flash.program(&ours, Area::User, |_, _| {}).unwrap();
    let text = board.mesaflash(&["--verify", file.path()]);
    says(&text, "Board FLASH memory verified successfully");

    let mut board_itself = ethernet::EthernetBoard::new(&mut bus);
    let layout = FlashLayout::I7I97;
    board_itself
        .reload(layout.user.0, layout.fallback.0)
        .unwrap();
    assert_eq!(board_itself.identity().unwrap().card, "7I97");
    assert_eq!(board.stop()["board.reloads"], "1");
}

#[test]
fn fallback_area_is_written_when_it_is_asked_for() {
    if skipped() {
        return;
    }
    let board = Board::i7i97(&[]);
    let file = Scratch::new("fallback.bit");
    fs::write(&file.0, made_up(3_000)).unwrap();
    let text = board.mesaflash(&["--fallback", "--write", file.path()]);
    says(&text, "starting from 0x10000...");
    let text = board.mesaflash(&["--fallback", "--verify", file.path()]);
    says(&text, "Board FLASH memory verified successfully");
}
