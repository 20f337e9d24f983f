//! `mesa param`, over a board and over a serial port.

use std::fs;
use std::net::Ipv4Addr;

use mesa_hal_sim::devices::{FieldIo, Outputs48};

use crate::interop::Scratch;
use crate::interop::board::Board;
use crate::pty::Card;
use crate::run::{done, json, run};

const WATCHDOG: &str = "remote.0.parameter.nvwatchdogtimeout";

/// A 7I97 with two remotes, as a program of its own.
fn board() -> Board {
    let remotes = ["--remote", "0=7i77-io", "--remote", "1=7i72"];
    let board = ["--board", "7i97", "--port", "0"];
    Board::start(Ipv4Addr::LOCALHOST, &[&board[..], &remotes].concat())
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn parameter_of_a_board_is_listed_read_and_written_by_name() {
    let mut board = board();
    let address = board.address.to_string();
    let at = ["--addr", &address];

    let list = json(&[&["param", "list"], &at[..]].concat());
    let cards = list["remotes"].as_array().unwrap();
    let places: Vec<_> = cards
        .iter()
        .map(|card| (&card["place"], &card["card"]))
        .collect();
    assert_eq!(
        places,
        [
            (&"0.0".into(), &"7I77".into()),
            (&"0.1".into(), &"7I72".into())
        ]
    );
    let text = done(&[&["param", "list"], &at[..]].concat());
    let line = text.lines().find(|line| line.contains("NVWatchDogTimeout"));
    let line = line.expect("the parameter is listed");
    assert!(line.contains("50") && line.contains("0x0032"), "{line}");
    assert!(line.contains("non-volatile"), "{line}");
    assert!(text.contains("read only"), "{text}");
    for line in text.lines() {
        assert!(!line.contains("4294967296"), "one too many: {line}");
    }

    // Several remotes have the parameter, so one has to be named.
    let ambiguous = run(&[&["param", "get", "nvwatchdogtimeout"], &at[..]].concat());
    assert_eq!(ambiguous.code, Some(2), "{ambiguous:?}");
    assert!(ambiguous.err.contains("0.0 and 0.1"), "{ambiguous:?}");
    let get = [&["param", "get", "0.0.nvwatchdogtimeout"], &at[..]].concat();
    let before = json(&get);
    assert_eq!(before["parameter"]["value"], 50);
    assert_eq!(before["parameter"]["hex"], "0x0032");

    let set = [&["param", "set", "0.0.NVWatchDogTimeout", "0x50"], &at[..]].concat();
    let asked = run(&set);
    assert_eq!(asked.code, Some(2), "not a terminal: {asked:?}");
    assert!(
        asked.err.contains("--yes") && asked.err.contains("= 80 (now 50)"),
        "{asked:?}"
    );
    assert_eq!(board.console.show("")[WATCHDOG], "50");
    let set = [&set[..], &["--yes"]].concat();
    let written = json(&set);
    assert_eq!(
        (&written["parameter"]["value"], &written["before"]),
        (&80.into(), &50.into())
    );
    assert_eq!(board.console.show("")[WATCHDOG], "80");
    assert_eq!(json(&get)["parameter"]["value"], 80);
    assert!(done(&set).contains("was so already"));
}

#[test]
fn impossible_reads_and_writes_are_refused_with_the_reason() {
    let machine = "7i97,0=7i77-io";
    for (arguments, code, said) in [
        (&["get", "nothing"][..], 1, "param list"),
        (&["get", "0.3.nvbaudrate"], 1, "0.3"),
        (
            &["set", "nvwatchdogtimeout", "65536", "--yes"],
            2,
            "65536 does not fit: allowed is 0 to 65535",
        ),
        (
            &["set", "nvwatchdogtimeout", "-1", "--yes"],
            2,
            "-1 does not fit: allowed is 0 to 65535",
        ),
        (&["set", "nvbaudrate", "nine", "--yes"], 2, "no number"),
        (&["set", "swrevision", "1", "--yes"], 1, "read-only"),
        (
            &["restore", "/nowhere/at/all.json"],
            2,
            "/nowhere/at/all.json",
        ),
        (&["save", "/nowhere/at/all.json"], 1, "/nowhere/at/all.json"),
        (
            &["save", env!("CARGO_MANIFEST_DIR"), "--yes"],
            2,
            "no regular file",
        ),
    ] {
        let run = run(&[&["param"], arguments, &["--sim", machine]].concat());
        assert_eq!(run.code, Some(code), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
    }
    let both = run(&["param", "list", "--sim", machine, "--serial", "/dev/null"]);
    assert_eq!(both.code, Some(2), "{both:?}");
    let empty = run(&["param", "list", "--sim", "7i97"]);
    assert_eq!(empty.code, Some(1), "{empty:?}");
    assert!(empty.err.contains("no remote answers"), "{empty:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn cabinet_is_saved_and_restored() {
    let mut board = board();
    let address = board.address.to_string();
    let at = ["--addr", &address];
    for name in ["cabinet.toml", "cabinet.json"] {
        let scratch = Scratch::new(name);
        let file = scratch.path();
        let saved = json(&[&["param", "save", file], &at[..]].concat());
        assert_eq!(saved["remotes"], 2);
        assert_eq!(saved["parameters"], 5, "two of a 7I77, three of a 7I72");
        let again = run(&[&["param", "save", file], &at[..]].concat());
        assert_eq!(again.code, Some(2), "it would be replaced: {again:?}");
        assert!(
            again
                .err
                .contains("which already exists; nothing was done: add --yes"),
            "{again:?}"
        );
        let text = fs::read_to_string(file).unwrap();
        let head = &text[..text.find("NVBaudRate").expect("a parameter")];
        let year = head.find('T').and_then(|at| head.get(at - 10..at + 10));
        let year = year.expect("a date in UTC");
        assert!(year.starts_with("20") && year.ends_with('Z'), "{head}");
        for said in [
            "7I97, 00:60:1b:",
            &address,
            "MESA7I97, version 16",
            "0.0 7I77 0x12",
            "0.1 7I72 0x",
        ] {
            assert!(head.contains(said), "{said}: {head}");
        }
        // A file without it, as written before.
        let mut old: serde_json::Value = if name.ends_with("toml") {
            let table: toml::Value = toml::from_str(&text).unwrap();
            serde_json::to_value(table).unwrap()
        } else {
            serde_json::from_str(&text).unwrap()
        };
        old.as_object_mut().unwrap().remove("origin");
        let older = Scratch::new("older-cabinet.json");
        fs::write(&older.0, old.to_string()).unwrap();
        let restore = ["param", "restore", older.path(), "--dry-run"];
        assert_eq!(
            json(&[&restore[..], &at].concat())["differences"],
            serde_json::json!([])
        );

        let restore = [&["param", "restore", file], &at[..]].concat();
        assert_eq!(json(&restore)["differences"], serde_json::json!([]));
        done(
            &[
                &["param", "set", "0.0.nvwatchdogtimeout", "90", "--yes"],
                &at[..],
            ]
            .concat(),
        );
        let dry = [&restore[..], &["--dry-run"]].concat();
        let text = done(&dry);
        assert!(
            text.contains("NVWatchDogTimeout: 90 now, 50 in the file"),
            "{text}"
        );
        assert_eq!(
            board.console.show("")[WATCHDOG],
            "90",
            "nothing was written"
        );
        let asked = run(&restore);
        assert_eq!(asked.code, Some(2), "{asked:?}");
        let restored = json(&[&restore[..], &["--yes"]].concat());
        assert_eq!(restored["written"], 1);
        assert_eq!(board.console.show("")[WATCHDOG], "50");

        // A file for other cards.
        let other = ["param", "restore", file, "--sim", "7i97,0=7i72,1=7i77-io"];
        let other = run(&other);
        assert_eq!(
            other.code,
            Some(0),
            "they have only changed places: {other:?}"
        );
        let other = run(&["param", "restore", file, "--sim", "7i97,0=7i77-io"]);
        assert_eq!(other.code, Some(1), "{other:?}");
        assert!(
            other.err.contains("7I72") && other.err.contains("--by-place"),
            "{other:?}"
        );
        let text = fs::read_to_string(file).unwrap();
        fs::write(file, &text[..text.len() / 2]).unwrap();
        let cut = run(&restore);
        assert_eq!(cut.code, Some(2), "{cut:?}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn value_that_leaves_outputs_on_or_hides_a_card_has_a_warning() {
    for (name, value, said) in [
        ("nvwatchdogtimeout", "0", "SWITCHES ITS WATCHDOG OFF"),
        ("nvwatchdogtimeout", "5000", "stay on for 5000 ms"),
        ("nvunitnumber", "1", "The unit number identifies the remote"),
    ] {
        let set = ["param", "set", name, value, "--sim", "7i97,0=7i72"];
        let asked = run(&set);
        assert_eq!(asked.code, Some(2), "{asked:?}");
        assert!(asked.err.contains(said), "{asked:?}");
    }
    // Restoring a file with such a value needs consent as well.
    let board = board();
    let address = board.address.to_string();
    let at = ["--addr", &address];
    let set = |value| {
        let set = ["param", "set", "0.0.nvwatchdogtimeout", value, "--yes"];
        done(&[&set[..], &at].concat());
    };
    let scratch = Scratch::new("off.toml");
    set("0");
    done(&[&["param", "save", scratch.path()], &at[..]].concat());
    set("50");
    let asked = run(&[&["param", "restore", scratch.path()], &at[..]].concat());
    assert_eq!(asked.code, Some(2), "{asked:?}");
    let said = "0.0.NVWatchDogTimeout. 0 SWITCHES ITS WATCHDOG OFF";
    assert!(asked.err.contains(said), "{asked:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn card_in_setup_mode_is_reached_over_a_serial_port() {
    let card = Card::start(FieldIo::i7i77().unwrap());
    let at = ["--serial", &card.path];
    let list = json(&[&["param", "list"], &at[..]].concat());
    assert_eq!(list["remotes"][0]["place"], "serial");
    assert_eq!(list["remotes"][0]["card"], "7I77");
    let set = ["param", "set", "nvwatchdogtimeout", "100", "--yes"];
    let written = json(&[&set[..], &at].concat());
    assert_eq!(
        (&written["parameter"]["value"], &written["before"]),
        (&100.into(), &50.into())
    );
    assert_eq!(card.parameter("nvwatchdogtimeout"), 100);
    card.power_cycle();
    let get = done(&[&["param", "get", "nvwatchdogtimeout"], &at[..]].concat());
    assert!(get.contains("100") && get.contains("0x0064"), "{get}");

    let scratch = Scratch::new("card.toml");
    let file = scratch.path();
    done(&[&["param", "save", file], &at[..]].concat());
    done(
        &[
            &["param", "set", "nvwatchdogtimeout", "60", "--yes"],
            &at[..],
        ]
        .concat(),
    );
    done(&[&["param", "restore", file, "--yes"], &at[..]].concat());
    assert_eq!(card.parameter("nvwatchdogtimeout"), 100);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn serial_port_without_a_reply_is_reported_with_advice() {
    let card = Card::start(Outputs48::i7i72().unwrap());
    let list = ["param", "list", "--serial", &card.path];
    let wrong = run(&[&list[..], &["--baud", "9600"]].concat());
    assert_eq!(wrong.code, Some(1), "{wrong:?}");
    assert!(wrong.err.contains("baud rate"), "{wrong:?}");
    card.with(|device, now| device.set_setup_jumper(now, false));
    let operating = run(&list);
    assert_eq!(operating.code, Some(1), "{operating:?}");
    assert!(operating.err.contains("setup mode"), "{operating:?}");
    card.with(|device, now| {
        device.set_setup_jumper(now, true);
        device.set_power(now, false);
    });
    let dead = run(&list);
    assert_eq!(dead.code, Some(1), "{dead:?}");
    assert!(dead.err.contains("power"), "{dead:?}");
    card.power_cycle();
    assert!(done(&list).contains("7I72"));
    for (device, said) in [("/dev/null", "/dev/null"), ("/nowhere/tty", "/nowhere/tty")] {
        let run = run(&["param", "list", "--serial", device]);
        assert_eq!(run.code, Some(1), "{run:?}");
        assert!(run.err.contains(said), "{run:?}");
    }
    let slow = run(&["param", "list", "--serial", &card.path, "--baud", "300"]);
    assert_eq!(slow.code, Some(2), "{slow:?}");
}
