//! `mesa raw`.

use std::net::Ipv4Addr;

use crate::interop::{PATIENCE, Process, board::Board};
use crate::run::{Run, command, done, json, run};
use crate::setup::restart::{Between, between};

/// Manual: 7I97, "ELBPCOM": the cookie of HostMot2, and the IP address in the EEPROM.
const QUESTIONS: [&str; 2] = ["01420001", "82492000"];

#[test]
fn questions_of_the_manual_are_answered_and_taken_apart() {
    let text = done(&["raw", QUESTIONS[0], QUESTIONS[1], "--sim", "7i97"]);
    let expected = "\
sent      0142000182492000
received  fecaaa550100007f
read  1 x 32 bits, space 0 (HostMot2) at 0x0100 (one place): 0x55AACAFE
read  2 x 16 bits, space 2 (EEPROM) at 0x0020: 0x0001 0x7F00
";
    assert_eq!(text, expected);
    let value = json(&["raw", "0142 0001 82492000", "--sim", "7i97"]);
    assert_eq!(value["commands"][0]["values"][0], 0x55AA_CAFE_u32);
    assert_eq!(value["commands"][1]["increment"], true);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn raw_write_needs_consent_and_is_executed_once() {
    let board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    let address = board.address.to_string();
    // Manual: 7I97, "ELBPCOM": the IP address in the EEPROM becomes 192.168.0.1.
    let write = ["raw", "01D91A00025A82C920000100a8C0", "--addr", &address];
    let shown = |code| {
        let text = done(&["raw", QUESTIONS[1], "--addr", &address]);
        assert!(text.contains(code), "{text}");
    };
    let refused = run(&write);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    for said in ["--yes", "space 2 (EEPROM) at 0x0020", "space 6 (control)"] {
        assert!(refused.err.contains(said), "{said}: {refused:?}");
    }
    let planned = json(&[&write[..], &["--dry-run"]].concat());
    assert_eq!(planned["received"], serde_json::Value::Null);
    assert_eq!(planned["dry_run"], true);
    let text = done(&[&write[..], &["--dry-run"]].concat());
    assert!(
        text.starts_with("not sent  01d91a") && !text.contains("received"),
        "{planned}"
    );
    assert_eq!(planned["commands"][1]["command"], "write");
    shown("0x0001 0x7F00");

    let text = done(&[&write[..], &["--yes"]].concat());
    assert!(text.contains("received  nothing"), "{text}");
    shown("0x0001 0xC0A8");
}

#[test]
fn invalid_packet_is_refused_and_nothing_is_sent() {
    let long = "01420001".repeat(369);
    for (hex, said) in [
        ("0142000", "odd number of digits"),
        ("014200zz", "`z` is no hexadecimal digit"),
        ("014200", "byte 0: 1 byte left of the 2 of an address"),
        ("004200 01", "for 0 elements"),
        (long.as_str(), "a packet has 1 to 1472"),
        ("ff420000 ff420000 ff420000", "the reply would have 1524"),
        ("", "0 bytes"),
    ] {
        let run = run(&["raw", hex, "--addr", "127.93.0.9"]);
        assert_eq!(run.code, Some(2), "{hex}: {run:?}");
        assert!(run.err.contains(said), "{hex}: {run:?}");
    }
    for timeout in ["0", "11", "soon", "NaN"] {
        let run = run(&["raw", QUESTIONS[0], "--sim", "7i97", "--timeout", timeout]);
        assert_eq!(run.code, Some(2), "{timeout}: {run:?}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn missing_reply_is_reported_and_ctrl_c_ends_the_wait() {
    let board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    // The board answers the identification, and nothing after it.
    let Between { address, losses } = between(&board, &[0x01, 0x42, 0x00, 0x01], false);
    let ask = ["raw", QUESTIONS[0], "--addr", &address, "--timeout"];
    let silent = run(&[&ask[..], &["0.2"]].concat());
    assert_eq!(silent.code, Some(1), "{silent:?}");
    assert!(silent.err.contains("no reply within 200 ms"), "{silent:?}");

    while losses.try_recv().is_ok() {}
    let waiting = command(&[&ask[..], &["10"]].concat()).spawn();
    let mut waiting = Process::new(waiting.expect("mesa starts"));
    losses.recv_timeout(PATIENCE).expect("it asks");
    waiting.signal("INT");
    let ended = Run::from(waiting.output());
    assert_eq!(ended.code, Some(130), "{ended:?}");
}
