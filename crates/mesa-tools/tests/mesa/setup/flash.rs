//! `mesa flash`.

use std::fs;
use std::net::{Ipv4Addr, SocketAddrV4};

use mesa_hal::boards::FlashLayout;
use mesa_hal::ethernet::{Area, EthernetBoard};
use mesa_hal::transport::udp::UdpBus;

use crate::every_command::signals::{Network, Relay};
use crate::interop::mesaflash::{Mesaflash, bitfile, configuration, free_address};
use crate::interop::tools::{has_program, skip};
use crate::interop::{Process, Scratch, board::Board, wait_until};
use crate::run::{Run, command, done, json, patient, run};

pub const USER: usize = 0x10_0000;
pub const FALLBACK: usize = 0x1_0000;
pub const PART: &str = "6slx9tqg144";

/// A 7I97 at an address and port that mesaflash can reach.
pub fn board() -> (Board, String) {
    let address = free_address();
    let board = Board::start(address, &["--board", "7i97"]);
    erase(&board);
    (board, address.to_string())
}

pub fn file(name: &str, bytes: &[u8]) -> Scratch {
    let file = Scratch::new(name);
    fs::write(&file.0, bytes).expect("a scratch file");
    file
}

/// Writes an area as a JTAG programmer does.
pub fn put(board: &Board, area: Area, data: &[u8]) {
    put_at(board, area, 0, data);
}

fn put_at(board: &Board, area: Area, offset: u32, data: &[u8]) {
    let mut bus = UdpBus::connect(board.address, patient()).expect("a board");
    let flash = EthernetBoard::new(&mut bus).into_flash(FlashLayout::I7I97);
    let mut flash = flash.expect("a 7I97");
    let start = flash.layout().addresses(area).start + offset;
    let written = flash.write(area, start, data, |_, _| {});
    written.expect("it is written");
}

/// Erases the memory: a simulated board has its configurations in one sector each.
fn erase(board: &Board) {
    for area in [Area::User, Area::Fallback, Area::BootBlock] {
        put(board, area, &[0xFF; 256]);
    }
}

/// Writes a boot block and a fallback, as in new boards: without them nothing is written.
fn give_boot_block_and_fallback(board: &Board) {
    put(board, Area::BootBlock, &FlashLayout::I7I97.boot_page());
    put(board, Area::Fallback, &configuration(300));
}

pub fn backup(address: &str, name: &str) -> (Scratch, Vec<u8>) {
    let file = Scratch::new(name);
    done(&["flash", "backup", file.path(), "--addr", address]);
    let bytes = fs::read(&file.0).expect("a backup");
    (file, bytes)
}

#[test]
fn simulated_board_has_contents_to_back_up_restore_and_reload() {
    for machine in ["7i97", "7i92-7i77"] {
        let file = Scratch::new("flash-of-sim.bin");
        done(&["flash", "backup", file.path(), "--sim", machine]);
        let bytes = fs::read(&file.0).expect("a backup");
        let areas = [0, FALLBACK, USER].map(|start| &bytes[start..][..3000]);
        // The synchronisation word of the boot block is behind fewer bytes than that of a bitfile.
        for (area, sync) in areas.iter().zip([10, 16, 16]) {
            assert_eq!(area[sync..sync + 4], [0xAA, 0x99, 0x55, 0x66]);
        }
        assert!(areas[1] != areas[2], "two configurations");
        done(&["flash", "verify", file.path(), "--sim", machine]);
        done(&["flash", "restore", file.path(), "--sim", machine, "--yes"]);
        // Another content of the user area.
        let mut other = bytes.clone();
        other[USER + 100] ^= 1;
        fs::write(&file.0, other).expect("a scratch file");
        let _ = fs::remove_file(format!("{}.sha256", file.path()));
        let restored = json(&["flash", "restore", file.path(), "--sim", machine, "--yes"]);
        assert_eq!(restored["areas"][0]["area"], "user");
        let text = done(&["reload", "--sim", machine, "--yes"]);
        assert!(text.contains("reload done"), "{text}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn configuration_is_written_verified_backed_up_and_restored() {
    let (board, address) = board();
    let data = configuration(70_000);
    let (good, other) = (
        file("flash-good.bit", &bitfile("7i97_made_up.ncd", PART, &data)),
        file(
            "flash-other.bit",
            &bitfile("7i97_made_up.ncd", PART, &configuration(70_001)),
        ),
    );
    let write = ["flash", "write", good.path(), "--addr", &address];
    let refused = run(&[&write[..], &["--yes"]].concat());
    assert_eq!(refused.code, Some(1), "{refused:?}");
    assert!(
        refused.err.contains("the boot block at 0x000000 is erased"),
        "{refused:?}"
    );
    give_boot_block_and_fallback(&board);

    let refused = run(&write);
    assert_eq!(refused.code, Some(2), "not a terminal: {refused:?}");
    let text = done(&[&write[..], &["--dry-run"]].concat());
    assert!(
        text.contains("would erase and write the user area (0x100000 to 0x120000)"),
        "{text}"
    );
    let (_, blank) = backup(&address, "flash-blank.bin");
    assert!(
        blank[USER..].iter().all(|&byte| byte == 0xFF),
        "nothing was done"
    );

    let written = json(&[&write[..], &["--yes"]].concat());
    assert_eq!(
        (&written["action"], &written["areas"][0]["area"]),
        (&"write".into(), &"user".into())
    );
    assert_eq!(written["bitfile"]["design"], "7i97_made_up.ncd");
    let text = done(&["flash", "verify", good.path(), "--addr", &address]);
    assert!(
        text.contains("the user area (0x100000 to 0x120000) holds this"),
        "{text}"
    );
    let differs = run(&["flash", "verify", other.path(), "--addr", &address]);
    assert_eq!(differs.code, Some(1), "{differs:?}");
    // One byte: damage.
    assert!(differs.err.contains("0x111170 reads 0x"), "{differs:?}");
    assert!(differs.err.contains("write it again"), "{differs:?}");
    // All of it: what is there is sound, and nobody has tried to write this one.
    let mut another = configuration(70_000);
    another[200..].reverse();
    let another = file(
        "flash-another.bit",
        &bitfile("7i97_other.ncd", PART, &another),
    );
    let differs = run(&["flash", "verify", another.path(), "--addr", &address]);
    assert_eq!(differs.code, Some(1), "{differs:?}");
    let said = "the user area (0x100000 to 0x120000) holds another configuration than ";
    assert!(differs.err.contains(said), "{differs:?}");
    assert!(!differs.err.contains("write it again"), "{differs:?}");

    let (kept, bytes) = backup(&address, "flash-kept.bin");
    assert!(bytes.len() == 2 << 20 && bytes[USER..USER + data.len()] == data);
    let again = run(&["flash", "backup", kept.path(), "--addr", &address]);
    assert_eq!(again.code, Some(2), "{again:?}");
    assert!(
        again
            .err
            .contains("which already exists; nothing was done: add --yes"),
        "{again:?}"
    );
    json(&["flash", "backup", kept.path(), "--addr", &address, "--yes"]);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn backup_is_restored_and_the_fallback_only_where_it_is_named() {
    let (board, address) = board();
    give_boot_block_and_fallback(&board);
    let (good, other) = (
        file(
            "flash-first.bit",
            &bitfile("7i97.ncd", PART, &configuration(3_000)),
        ),
        file(
            "flash-second.bit",
            &bitfile("7i97.ncd", PART, &configuration(3_001)),
        ),
    );
    done(&["flash", "write", good.path(), "--addr", &address, "--yes"]);
    let (kept, bytes) = backup(&address, "flash-restored.bin");

    done(&[
        "flash",
        "write",
        good.path(),
        "--fallback",
        "--addr",
        &address,
        "--yes",
    ]);
    done(&[
        "flash",
        "verify",
        good.path(),
        "--fallback",
        "--addr",
        &address,
    ]);
    done(&["flash", "write", other.path(), "--addr", &address, "--yes"]);
    let differs = run(&["flash", "verify", kept.path(), "--addr", &address]);
    assert_eq!(differs.code, Some(1), "{differs:?}");
    assert!(
        differs.err.contains("the user area") && differs.err.contains("the fallback area"),
        "{differs:?}"
    );
    let restore = ["flash", "restore", kept.path(), "--addr", &address];
    let refused = run(&[&restore[..], &["--yes"]].concat());
    assert_eq!(refused.code, Some(1), "{refused:?}");
    assert!(refused.err.contains("give --fallback"), "{refused:?}");
    let planned = json(&[&restore[..], &["--fallback", "--dry-run"]].concat());
    let areas = planned["areas"].as_array().expect("areas");
    let names: Vec<_> = areas
        .iter()
        .filter_map(|one| one["area"].as_str())
        .collect();
    assert_eq!(names, ["user", "fallback"]);
    let text = done(&[&restore[..], &["--fallback", "--yes"]].concat());
    assert!(text.contains("written and verified"), "{text}");
    let text = done(&["flash", "verify", kept.path(), "--addr", &address]);
    assert!(text.contains("all 2097152 bytes"), "{text}");
    let (_, now) = backup(&address, "flash-now.bin");
    assert!(now == bytes && now[FALLBACK..][..300] == configuration(300));
    let text = done(&[&restore[..], &["--yes"]].concat());
    assert!(
        text.contains("as ") && text.contains("already; nothing is written"),
        "{text}"
    );
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn file_for_another_board_is_refused_before_anything_is_erased() {
    let (board, address) = board();
    give_boot_block_and_fallback(&board);
    let (_, before) = backup(&address, "flash-before.bin");
    let data = configuration(3000);
    let whole = bitfile("7i97.ncd", PART, &data);
    let (mut no_start, mut empty) = (before.clone(), before.clone());
    no_start[..256].fill(0xFF);
    empty[256..].fill(0xFF);
    let multiboot = [&FlashLayout::I7I97.boot_page()[..], &data].concat();
    for (action, bytes, said) in [
        (
            "write",
            bitfile("seveni92.ncd", PART, &data),
            "is for a 7i92",
        ),
        (
            "write",
            bitfile("7i97.ncd", "6slx16ftg256", &data),
            "is for a 6slx16ftg256",
        ),
        (
            "write",
            bitfile("7i97.ncd", PART, &[0xFF; 999]),
            "no synchronisation word",
        ),
        (
            "write",
            bitfile("7i97.ncd", PART, &configuration(0x6_0001)),
            "its place in the flash",
        ),
        ("write", whole[..2000].to_vec(), "is cut off"),
        ("write", b"#!/bin/sh\n".to_vec(), "not a bitfile"),
        (
            "write",
            bitfile("7i97.ncd", PART, &multiboot),
            "a multiboot file, not a standard one",
        ),
        ("write", multiboot, "a multiboot file, not a standard one"),
        (
            "write",
            before.clone(),
            "`mesa flash restore` writes it back",
        ),
        ("restore", whole.clone(), "all of its 2097152 bytes"),
        ("restore", no_start, "the boot block at 0x000000 is erased"),
        ("restore", empty, "no user configuration"),
        ("verify", b"#!/bin/sh\n".to_vec(), "not a bitfile"),
    ] {
        let file = file("flash-refused", &bytes);
        let run = run(&["flash", action, file.path(), "--addr", &address, "--yes"]);
        assert_eq!(run.code, Some(1), "{action}, {said}: {run:?}");
        assert!(run.err.contains(said), "{action}, {said}: {run:?}");
    }
    let fallback = file("flash-fallback.bit", &whole);
    let only = run(&[
        "flash",
        "write",
        fallback.path(),
        "--fallback",
        "--addr",
        &address,
        "--yes",
    ]);
    assert_eq!(only.code, Some(1), "{only:?}");
    assert!(only.err.contains("no user configuration"), "{only:?}");
    let gone = run(&[
        "flash",
        "write",
        "/nowhere/file.bit",
        "--addr",
        &address,
        "--yes",
    ]);
    assert!(
        gone.code == Some(1) && gone.err.contains("/nowhere/file.bit"),
        "{gone:?}"
    );
    let no_place = run(&["flash", "backup", "/nowhere/file.bin", "--addr", &address]);
    assert!(
        no_place.code == Some(1) && no_place.err.contains("/nowhere/file.bin"),
        "{no_place:?}"
    );
    let (_, after) = backup(&address, "flash-after.bin");
    assert!(before == after);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn user_area_needs_a_fallback_unless_explicitly_allowed() {
    let (board, address) = board();
    put(&board, Area::BootBlock, &FlashLayout::I7I97.boot_page());
    let good = file(
        "flash-alone.bit",
        &bitfile("7i97.ncd", PART, &configuration(3_000)),
    );
    let write = ["flash", "write", good.path(), "--addr", &address, "--yes"];
    let (kept, blank) = backup(&address, "flash-without.bin");
    for arguments in [&write[..], &[&write[..], &["--dry-run"]].concat()] {
        let refused = run(arguments);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        for said in ["no fallback at 0x010000", "--without-fallback"] {
            assert!(refused.err.contains(said), "{said}: {refused:?}");
        }
    }
    let (_, after) = backup(&address, "flash-without-after.bin");
    assert!(blank == after, "nothing was erased");
    let alone = run(&[&write[..], &["--without-fallback"]].concat());
    assert_eq!(alone.code, Some(0), "{alone:?}");
    assert!(alone.err.contains("only a JTAG programmer"), "{alone:?}");
    done(&["flash", "verify", good.path(), "--addr", &address]);
    // A restore erases the area as well.
    let mut other = fs::read(&kept.0).expect("a backup");
    other[USER..][..3_001].copy_from_slice(&configuration(3_001));
    other[FALLBACK..][..3_000].copy_from_slice(&configuration(3_000));
    fs::write(&kept.0, other).expect("a scratch file");
    let restore = ["flash", "restore", kept.path(), "--addr", &address, "--yes"];
    let restore = [&restore[..], &["--fallback"]].concat();
    for arguments in [&restore[..], &[&restore[..], &["--dry-run"]].concat()] {
        let refused = run(arguments);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        assert!(refused.err.contains("no fallback"), "{refused:?}");
    }
    done(&["flash", "verify", good.path(), "--addr", &address]);
    // The alternative: the fallback first.
    done(&[&write[..], &["--fallback"]].concat());
    done(&restore);
    done(&["flash", "verify", kept.path(), "--addr", &address]);
}

/// A board with a boot block and a fallback, and a write to its user area that has begun to erase.
fn begun(name: &str) -> (Board, Process, Scratch, String) {
    let (board, process, file, ()) = begun_over(name, |board| (board.address, ()));
    let address = board.address.ip().to_string();
    (board, process, file, address)
}

/// The same over a relay.
fn begun_over<R>(
    name: &str,
    relay: impl FnOnce(&Board) -> (SocketAddrV4, R),
) -> (Board, Process, Scratch, R) {
    let state = Scratch::new(&format!("{name}.state"));
    let path = state.0.clone();
    let address = free_address();
    let board = Board::start_from(state, address, &["--board", "7i97"]);
    erase(&board);
    give_boot_block_and_fallback(&board);
    // Data behind the first sector, which an erase removes.
    put_at(&board, Area::User, 0x1_0000, &[0x5A; 256]);
    let is_filled = || {
        let state = fs::read(&path).unwrap_or_default();
        state.windows(256).any(|part| part == [0x5A; 256])
    };
    wait_until("its state is kept", is_filled);
    let new = bitfile("7i97.ncd", PART, &configuration(200_000));
    let file = file(&format!("{name}.bit"), &new);
    let (address, relay) = relay(&board);
    let address = address.to_string();
    let write = ["flash", "write", file.path(), "--addr", &address, "--yes"];
    let mut process = Process::new(command(&write).spawn().expect("mesa starts"));
    wait_until("it erases", || !is_filled());
    assert!(!process.has_ended(), "it still writes");
    (board, process, file, relay)
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn ctrl_c_during_a_write_finishes_the_area_and_reports_it() {
    let (_board, mut process, good, address) = begun("flash-ctrl-c");
    process.signal("INT");
    let ended = Run::from(process.output());
    assert_eq!(ended.code, Some(130), "{ended:?}");
    assert!(ended.err.contains("is finished first"), "{ended:?}");
    done(&["flash", "verify", good.path(), "--addr", &address]);
}

/// A write that did not end says what the memory holds, and what to do.
fn assert_names_the_state(ended: &Run) {
    assert_eq!(ended.code, Some(1), "{ended:?}");
    for said in [
        "was cut off",
        "the FPGA loads the fallback",
        "leave the board switched on",
    ] {
        assert!(ended.err.contains(said), "{said}: {ended:?}");
    }
}

/// A signal does not cut off a write. Where the board does not answer any more after it, the state
/// of the memory is named.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn signal_then_silence_ends_a_write_with_the_memory_state() {
    let (_board, mut process, _file, relay) = begun_over("flash-signal", |board| {
        let relay = Relay::start(board.address, Network::Good);
        (relay.address, relay)
    });
    process.signal("TERM");
    relay.set(Network::Silent);
    let ended = Run::from(process.output());
    assert_names_the_state(&ended);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn cut_off_write_shows_memory_state_and_a_backup_leaves_no_file() {
    let (mut board, process, ..) = begun("flash-cut");
    board.kill();
    let ended = Run::from(process.output());
    assert_names_the_state(&ended);

    // A network with a loss that makes a backup last longer than it takes to press Ctrl-C.
    let bad = &["--board", "7i97", "--port", "0", "--loss", "0.2"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, bad);
    let (half, address) = (Scratch::new("flash-half.bin"), board.address.to_string());
    let backup = ["flash", "backup", half.path(), "--addr", &address];
    let mut process = Process::new(command(&backup).spawn().expect("mesa starts"));
    board.wait_for_packets(20);
    process.signal("INT");
    let ended = Run::from(process.output());
    assert_eq!(ended.code, Some(130), "{ended:?}");
    assert!(ended.err.contains("no file was written"), "{ended:?}");
    assert!(!half.0.exists());
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn mesa_and_mesaflash_verify_each_others_writes() {
    if !has_program("mesaflash") {
        return skip("mesaflash is not installed");
    }
    let (_board, address) = board();
    let mesaflash = |arguments: &[&str]| {
        let address = address.parse().expect("an address");
        let device = "7i97";
        Mesaflash { device, address }.run(arguments)
    };
    // Not whole pages: mesaflash also compares its own buffer behind the end of the file.
    let theirs = file(
        "flash-theirs.bit",
        &bitfile("made_up.ncd", PART, &configuration(76_900)),
    );
    mesaflash(&["--fix-boot-block", "--fallback", "--write", theirs.path()]);
    mesaflash(&["--write", theirs.path()]);
    done(&["flash", "verify", theirs.path(), "--addr", &address]);
    let kept = Scratch::new("flash-kept-by-mesaflash.bin");
    mesaflash(&["--backup-flash", kept.path()]);
    let _ = fs::remove_file(format!("{}.sha256", kept.path()));
    done(&["flash", "verify", kept.path(), "--addr", &address]);

    let ours = file(
        "flash-ours.bit",
        &bitfile("made_up.ncd", PART, &configuration(130_004)),
    );
    done(&["flash", "write", ours.path(), "--addr", &address, "--yes"]);
    let text = mesaflash(&["--verify", ours.path()]);
    assert!(
        text.contains("Board FLASH memory verified successfully"),
        "{text}"
    );
    done(&["flash", "restore", kept.path(), "--addr", &address, "--yes"]);
    let text = mesaflash(&["--verify", theirs.path()]);
    assert!(
        text.contains("Board FLASH memory verified successfully"),
        "{text}"
    );
    let (_, ours) = backup(&address, "flash-kept-by-mesa.bin");
    assert!(ours == fs::read(&kept.0).expect("its backup"));
}
