//! `mesa update`, over a serial port and over a board: at the end the simulated card runs the
//! program of the file.

use std::fs;
use std::net::Ipv4Addr;

use mesa_hal_sim::devices::{FieldIo, Outputs48};
use mesa_hal_sim::remote::firmware_file;

use crate::interop::board::Board;
use crate::interop::{Process, Scratch, wait_until};
use crate::pty::Card;
use crate::run::{Run, command, done, json, run};

/// A firmware file for a card.
fn file(name: &str, card: [u8; 4], revision: u8, body: usize) -> Scratch {
    let scratch = Scratch::new(name);
    fs::write(scratch.path(), firmware_file(card, revision, body)).unwrap();
    scratch
}

fn revision(card: &Card) -> u8 {
    card.with(|device, _| device.revision())
}

/// Starts an update, and waits until it has begun to erase.
fn begun(card: &Card, arguments: &[&str]) -> Process {
    card.with(|device, _| assert!(device.is_program_whole()));
    let child = Process::new(command(arguments).spawn().expect("mesa starts"));
    wait_until("it erases", || {
        card.with(|device, _| !device.is_program_whole())
    });
    child
}

fn ended(child: Process) -> Run {
    child.output().into()
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn card_on_a_serial_port_is_updated_and_verified() {
    let card = Card::start(FieldIo::i7i77().unwrap());
    let file = file("7I77-31.BIN", *b"7I77", 31, 5000);
    let update = ["update", "7i77", file.path(), "--serial", &card.path];
    let plan = json(&[&update[..], &["--dry-run"]].concat());
    assert_eq!(
        (&plan["blocks"], &plan["different"]),
        (&2.into(), &2.into())
    );
    let asked = run(&update);
    assert_eq!(asked.code, Some(2), "not a terminal: {asked:?}");
    assert!(
        asked.err.contains("--yes") && asked.err.contains("field I/O"),
        "{asked:?}"
    );
    card.with(|device, _| assert!(device.is_program_whole(), "nothing was done"));
    let text = done(&[&update[..], &["--yes"]].concat());
    assert!(
        text.contains("2 of 2 blocks") && text.contains("verified"),
        "{text}"
    );
    assert_eq!(revision(&card), 14, "the old one runs until then");
    card.power_cycle();
    assert_eq!(revision(&card), 31);
    let again = json(&[&update[..], &["--yes"]].concat());
    assert_eq!(
        (&again["different"], &again["written"]),
        (&0.into(), &0.into())
    );
    assert!(done(&update).contains("has this firmware already"));
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn update_that_a_power_cut_ends_is_found_and_finished() {
    let card = Card::start(Outputs48::i7i72().unwrap());
    let file = file("7I72-32.BIN", *b"7I72", 32, 5000);
    let update = [
        "update",
        "7i72",
        file.path(),
        "--serial",
        &card.path,
        "--yes",
    ];
    let child = begun(&card, &update);
    card.with(|device, now| device.set_power(now, false));
    let cut = ended(child);
    assert_eq!(cut.code, Some(1), "{cut:?}");
    assert!(cut.err.contains("the same command finishes"), "{cut:?}");
    card.power_cycle();
    assert!(card.with(|device, _| device.is_in_bootloader()));
    let list = run(&["param", "list", "--serial", &card.path]);
    assert_eq!(list.code, Some(1), "{list:?}");
    assert!(list.err.contains("mesa update"), "{list:?}");
    let finished = json(&update);
    assert_eq!(finished["was_cut_off"], true);
    assert_eq!(finished["verified"], true);
    card.power_cycle();
    assert_eq!(revision(&card), 32);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn update_ended_by_a_signal_is_reported_and_can_be_finished() {
    let card = Card::start(FieldIo::i7i77().unwrap());
    let file = file("7I77-33.BIN", *b"7I77", 33, 9000);
    let update = [
        "update",
        "7i77",
        file.path(),
        "--serial",
        &card.path,
        "--yes",
    ];
    let mut child = begun(&card, &update);
    child.signal("INT");
    let stopped = ended(child);
    assert_eq!(stopped.code, Some(130), "{stopped:?}");
    assert!(
        stopped.err.contains("of 3 blocks to be written"),
        "{stopped:?}"
    );
    assert!(stopped.out.is_empty(), "{stopped:?}");
    let finished = json(&update);
    assert_eq!(finished["verified"], true);
    card.power_cycle();
    assert_eq!(revision(&card), 33);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn card_on_a_board_is_updated_at_the_baud_rate_of_its_jumper() {
    let state = Scratch::new("updated.state");
    let kept = ["--board", "7i97", "--port", "0", "--state", state.path()];
    let remotes = ["--remote", "0=7i77-io", "--remote", "1=7i72:setup"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &[&kept[..], &remotes].concat());
    let address = board.address.to_string();
    let file = Scratch::new("7I72-34.BIN");
    board.console.run(&format!("firmware 1 34 {}", file.path()));
    let update = ["update", "7i72", file.path(), "--addr", &address];
    let update = [&update[..], &["--at", "0.1", "--yes"]].concat();
    let done = json(&update);
    assert_eq!(
        (&done["place"], &done["verified"]),
        (&"0.1".into(), &true.into())
    );
    assert_eq!(board.console.show("1")["remote.1.revision"], "14");
    board.console.run("jumper 1 operate");
    let shown = board.console.show("1");
    assert_eq!(shown["remote.1.revision"], "34");
    assert_eq!(shown["remote.1.bootloader"], "0");
    // The parameter that hosts read shows the new revision, too.
    let get = json(&["param", "get", "0.1.swrevision", "--addr", &address]);
    assert_eq!(get["parameter"]["value"], 34);
    // In operate mode the card has another baud rate.
    let operating = run(&update);
    assert_eq!(operating.code, Some(1), "{operating:?}");
    assert!(operating.err.contains("setup position"), "{operating:?}");
    // The port works as before.
    let list = run(&["param", "list", "--addr", &address]);
    assert_eq!(list.code, Some(0), "{list:?}");
    assert!(
        list.out.contains("7I77") && list.out.contains("7I72"),
        "{list:?}"
    );
    // The stored state has the new firmware, and the other card its own.
    board.stop("TERM");
    let remotes = ["--remote", "0=7i77-io", "--remote", "1=7i72"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &[&kept[..], &remotes].concat());
    assert_eq!(board.console.show("1")["remote.1.revision"], "34");
    assert_eq!(board.console.show("0")["remote.0.revision"], "14");
    // A state without programs, as of older versions: 64 + 65536 bytes for each remote.
    board.stop("TERM");
    let bytes = fs::read(&state.0).unwrap();
    let (eeprom, program) = (64 + 0x1_0000, 64 + 0x8000);
    let own = bytes.len() - 2 * (eeprom + program);
    let older = [
        &bytes[..own + eeprom],
        &bytes[own + eeprom + program..][..eeprom],
    ];
    fs::write(&state.0, older.concat()).unwrap();
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &[&kept[..], &remotes].concat());
    assert_eq!(board.console.show("1")["remote.1.revision"], "14");
    drop(board);
    fs::write(&state.0, &bytes[..bytes.len() - 1]).unwrap();
    let damaged = [&["sim", "--listen", "127.0.0.1"], &kept[..], &remotes].concat();
    let damaged = run(&damaged);
    assert_eq!(damaged.code, Some(1), "{damaged:?}");
    assert!(damaged.err.contains("delete the file"), "{damaged:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn file_for_another_card_is_refused_before_anything_is_erased() {
    let card = Card::start(FieldIo::i7i77().unwrap());
    let own = file("7I77-own.BIN", *b"7I77", 40, 3000);
    let other = file("7I72-other.BIN", *b"7I72", 40, 3000);
    let short = file("7I77-short.BIN", *b"7I77", 40, 3000);
    fs::write(short.path(), [1; 100]).unwrap();
    let long = file("7I77-long.BIN", *b"7I77", 40, 0x8000);
    let at = ["--serial", &card.path, "--yes"];
    for (arguments, code, said) in [
        (["7i77", other.path()], 1, "for a 7I72"),
        (["7i72", own.path()], 1, "for a 7I77"),
        (["7i72", other.path()], 1, "this is a 7I77"),
        (["7i77", short.path()], 1, "no firmware for this card"),
        (
            ["7i77", long.path()],
            1,
            "the file has 36884 bytes, and the flash memory of this card ends after 32768",
        ),
        (["7i77", "/nowhere/7I77.BIN"], 2, "/nowhere/7I77.BIN"),
        (["7i77x", own.path()], 2, "four characters"),
    ] {
        let run = run(&[&["update"], &arguments[..], &at].concat());
        assert_eq!(run.code, Some(code), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
    }
    let at = ["--sim", "7i97,0=7i77-io:setup", "--at", "0.0", "--dry-run"];
    let plan = json(&[&["update", "7i77", own.path()], &at[..]].concat());
    assert_eq!(
        (&plan["blocks"], &plan["dry_run"]),
        (&1.into(), &true.into())
    );
    let nowhere = run(&["update", "7i77", own.path(), "--sim", "7i97"]);
    assert_eq!(nowhere.code, Some(2), "it needs a place: {nowhere:?}");
    card.with(|device, _| assert!(device.is_program_whole()));
}
