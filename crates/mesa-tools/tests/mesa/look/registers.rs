//! `mesa peek` and `mesa poke`.

use std::net::Ipv4Addr;

use crate::interop::{Process, board::Board};
use crate::run::{Run, command, done, json, run};

#[test]
fn registers_of_each_space_are_read_in_their_own_size() {
    let text = done(&["peek", "0:0x100", "--sim", "7i97"]);
    assert_eq!(text, "0:0x0100  0x55AACAFE  1437256446  cookie\n");
    // Manual: 7I97, "SPACE 7: LBP READ ONLY AREA": the card's name, and the version of the
    // firmware.
    let text = done(&["peek", "7:0", "2", "--sim", "7i97"]);
    assert_eq!(text, "7:0x0000  0x4937  18743\n7:0x0002  0x3739  14137\n");
    let value = json(&["peek", "7:0x12", "--sim", "7i97"]);
    assert_eq!(
        (&value["bits"], &value["registers"][0]["value"]),
        (&16.into(), &16.into())
    );
    // More than one command, and more than one packet.
    let value = json(&["peek", "0:0", "300", "--any", "--sim", "7i97"]);
    let registers = value["registers"].as_array().expect("registers");
    assert_eq!(
        (registers.len(), &registers[64]["value"]),
        (300, &0x55AA_CAFE_u32.into())
    );
}

#[test]
fn registers_have_names_and_modules_have_all_theirs() {
    let sim = ["--sim", "7i97"];
    let named = |words: &[&str]| done(&[&["peek"], words, &sim].concat());
    assert_eq!(
        named(&["encoder.01.count"]),
        "0:0x3604  0x00000000  0  encoder.01.count\n"
    );
    assert_eq!(named(&["0x3604"]), named(&["encoder.01.count"]));
    let of_one = named(&["encoder.01"]);
    assert!(of_one.contains("encoder.01.control"), "{of_one}");
    assert_eq!(of_one.lines().count(), 2, "{of_one}");
    let six = named(&["encoder.00.count", "6"]);
    assert!(six.ends_with("encoder.05.count\n"), "{six}");
    let all = named(&[]);
    for name in ["watchdog.time", "inmux.00.input", "sserial.0.0.interface2"] {
        assert!(all.contains(&format!("  {name}\n")), "{name}: {all}");
    }
    let value = json(&["peek", "watchdog.status", "--sim", "7i97"]);
    assert_eq!(value["registers"][0]["name"], "watchdog.status");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn poke_needs_consent_is_read_back_and_takes_effect() {
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    let address = board.address.to_string();
    // Source of the LEDs, and a register for free use.
    let poke = ["poke", "6:0x16", "0x0E", "0x1234", "--addr", &address];
    let refused = run(&poke);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("--yes"), "{refused:?}");
    let text = done(&[&poke[..], &["--dry-run"]].concat());
    assert!(
        text.contains("would write 0xE 0x1234 to 0x0016 of space 6 (control)"),
        "{text}"
    );
    let planned = json(&[&poke[..], &["--dry-run"]].concat());
    let would = "write 0xE 0x1234 to 0x0016 of space 6 (control)";
    assert_eq!(planned["would"], would);
    let kept = || done(&["peek", "6:0x16", "2", "--addr", &address]);
    assert_eq!(kept(), "6:0x0016  0x0008  8\n6:0x0018  0x0000  0\n");
    let text = done(&[&poke[..], &["--yes"]].concat());
    assert_eq!(text, "6:0x0016  0x000E  14\n6:0x0018  0x1234  4660\n");
    assert_eq!(kept(), text);

    // An output pin of the FPGA: DDR of port 2, then its data; FACTS 9.2: I/O pin 50 is the last of
    // that port, bit 16.
    assert_eq!(
        board.console.show("board")["board.pin-050"],
        "1",
        "a pull-up"
    );
    let value = json(&["poke", "0:0x1108", "0x10000", "--addr", &address, "--yes"]);
    assert_eq!(value["registers"][0]["written"], 0x1_0000);
    done(&["poke", "0:0x1008", "0", "--addr", &address, "--yes"]);
    assert_eq!(board.console.show("board")["board.pin-050"], "0");

    // The EEPROM is enabled for the write, and keeps the value.
    done(&["poke", "2:0x40", "0xBEEF", "--addr", &address, "--yes"]);
    assert_eq!(
        done(&["peek", "2:0x40", "--addr", &address]),
        "2:0x0040  0xBEEF  48879\n"
    );
}

#[test]
fn invalid_registers_and_values_are_refused_with_the_reason() {
    for (arguments, code, said) in [
        (&["peek", "0"][..], 2, "no SPACE:ADDRESS"),
        (&["peek", "8:0"], 2, "`8` is no space"),
        (&["peek", "5:0"], 2, "space 5 is not used"),
        (&["peek", "0:0x102"], 2, "multiples of 4"),
        (&["peek", "2:1"], 2, "multiples of 2"),
        (&["peek", "0:65536"], 2, "is no address, 0 to 0xFFFF"),
        (&["peek", "0:0", "0"], 2, "1..=16384"),
        (
            &["peek", "0:0xFFFC", "2", "--any"],
            1,
            "a space ends at 0x10000",
        ),
        (
            &["peek", "2:0x200", "--any"],
            1,
            "the board counts an error",
        ),
        (&["peek", "0:0xFFFC", "2"], 1, "no register is known there"),
        (&["peek", "3:4"], 1, "the data port advances its address"),
        (
            &["peek", "0x7600"],
            1,
            "marks the time of the driver's cycle",
        ),
        (&["peek", "0x4100"], 1, "it can be written only"),
        (
            &["peek", "0x7600"],
            1,
            "`--any` reads it, on a board that no",
        ),
        (
            &["peek", "resolver"],
            1,
            "no pin `resolver`; `mesa peek` without a name",
        ),
        (&["peek", "encoder", "--any"], 2, "needs SPACE:ADDRESS"),
        (
            &["peek", "0:0", "--every", "10ms"],
            2,
            "no time from 0.05 s",
        ),
        (&["poke", "6:0x18"], 2, "<VALUES>"),
        (&["poke", "6:0x18", "65536", "--yes"], 2, "no 16-bit number"),
        (&["poke", "6:0x18", "-1", "--yes"], 2, "-1"),
        (
            &["poke", "0:0", "0x100000000", "--yes"],
            2,
            "no number of 32 bits",
        ),
        (&["poke", "7:0x12", "1", "--yes"], 2, "cannot be written"),
        (&["poke", "2:0x02", "1", "--yes"], 2, "from 0x20 on"),
        (&["poke", "4:0x1C", "1", "--yes"], 2, "numbers its packets"),
        (&["poke", "3:0x0C", "0", "--yes"], 2, "its own commands"),
    ] {
        let run = run(&[arguments, &["--sim", "7i97"]].concat());
        assert_eq!(run.code, Some(code), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
        assert!(!run.err.contains("write 0x"), "announced: {run:?}");
    }
}

#[test]
fn reader_that_has_seen_enough_is_no_error() {
    let child = command(&["peek", "0:0", "16384", "--any", "--sim", "7i97"]).spawn();
    let mut process = Process::new(child.expect("mesa starts"));
    process.stop_reading();
    let run = Run::from(process.output());
    assert_eq!((run.code, run.err.as_str()), (Some(0), ""));
}
