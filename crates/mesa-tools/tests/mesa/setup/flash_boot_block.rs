//! `mesa flash` on boards without a valid boot block, and on boards with another FPGA.

use mesa_hal::boards::FlashLayout;
use mesa_hal::ethernet::Area;

use super::flash::{FALLBACK, PART, backup, board, file, put};
use crate::interop::Scratch;
use crate::interop::mesaflash::{bitfile, configuration};
use crate::run::{done, json, run};

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn invalid_boot_block_is_refused_and_written_on_request() {
    let (board, address) = board();
    let good = file(
        "flash-boot.bit",
        &bitfile("7i97.ncd", PART, &configuration(3_000)),
    );
    let write = ["flash", "write", good.path(), "--addr", &address, "--yes"];
    let refused = |said: &str| {
        let refused = run(&write);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        for said in [said, "--fix-boot-block"] {
            assert!(refused.err.contains(said), "{said}: {refused:?}");
        }
    };
    // A blank chip.
    let blank = [&write[..], &["--without-fallback"]].concat();
    let alone = run(&blank);
    assert!(
        alone.err.contains("the boot block at 0x000000 is erased"),
        "{alone:?}"
    );
    let fix = [&blank[..], &["--fix-boot-block"]].concat();
    let planned = json(&[&fix[..], &["--dry-run"]].concat());
    let areas = [&planned["areas"][0]["area"], &planned["areas"][1]["area"]];
    assert_eq!(areas, ["boot-block", "user"]);
    let written = run(&fix);
    assert_eq!(written.code, Some(0), "{written:?}");
    assert!(
        written.err.contains("only a JTAG programmer"),
        "{written:?}"
    );
    let (_, bytes) = backup(&address, "flash-boot-blank.bin");
    assert_eq!(bytes[..256], FlashLayout::I7I97.boot_page());
    assert!(bytes[256..FALLBACK].iter().all(|&byte| byte == 0xFF));
    done(&["flash", "verify", good.path(), "--addr", &address]);
    // One that leads to another address.
    put(&board, Area::Fallback, &configuration(300));
    let mut other = FlashLayout::I7I97.boot_page();
    other[25] = 0x08;
    put(&board, Area::BootBlock, &other);
    refused("0x000019 reads 0x08, expected 0x10");
    let verify = run(&["flash", "verify", good.path(), "--addr", &address]);
    assert_eq!(verify.code, Some(1), "{verify:?}");
    assert!(
        verify.err.contains("the boot block is not the one"),
        "{verify:?}"
    );
    let (_, before) = backup(&address, "flash-boot-before.bin");
    assert_eq!(before[..256], other, "nothing was written");
    done(&[&write[..], &["--fix-boot-block"]].concat());
    let (_, after) = backup(&address, "flash-boot-after.bin");
    assert_eq!(after[..256], FlashLayout::I7I97.boot_page());
    // A valid one is left as it is.
    let again = json(&[&write[..], &["--fix-boot-block", "--dry-run"]].concat());
    assert_eq!(again["areas"].as_array().map(Vec::len), Some(1), "{again}");
}

#[test]
fn t_board_is_named_as_such_and_left_to_mesaflash() {
    let backup = Scratch::new("flash-t.bin");
    let refused = run(&["flash", "backup", backup.path(), "--sim", "7i97t"]);
    assert_eq!(refused.code, Some(1), "{refused:?}");
    for said in ["a T board", "Efinix", "use mesaflash"] {
        assert!(refused.err.contains(said), "{said}: {refused:?}");
    }
}
