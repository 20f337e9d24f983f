//! `mesa ip`.

use std::net::Ipv4Addr;

use crate::interop::board::Board;
use crate::run::{done, json, run};

fn board() -> (Board, String) {
    let board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    let address = board.address.to_string();
    (board, address)
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn addresses_are_shown_and_set_with_consent_and_next_steps() {
    let (_board, address) = board();
    let shown = json(&["ip", "--addr", &address]);
    assert_eq!(
        (&shown["eeprom_ip"], &shown["eeprom_netmask"]),
        (&"127.0.0.1".into(), &"255.255.255.0".into())
    );
    assert_eq!(
        (&shown["address_from"], &shown["changed"]),
        (&"eeprom".into(), &false.into())
    );
    let set = [
        "ip",
        "192.168.7.1",
        "--netmask",
        "255.255.0.0",
        "--addr",
        &address,
    ];
    let refused = run(&set);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    let said = "write 192.168.7.1 with netmask 255.255.0.0 into the EEPROM, which holds 127.0.0.1";
    assert!(
        refused.err.contains(said) && refused.err.contains("--yes"),
        "{refused:?}"
    );
    let text = done(&[&set[..], &["--dry-run"]].concat());
    assert!(text.starts_with("Planned; nothing was done:"), "{text}");
    assert_eq!(json(&["ip", "--addr", &address]), shown, "nothing was done");

    let text = done(&[&set[..], &["--yes"]].concat());
    for line in [
        "EEPROM    192.168.7.1\n",
        "netmask   255.255.0.0\n",
        "`mesa reset --addr 127.0.0.1`",
        "then it is at --addr 192.168.7.1\n",
        "`sudo ip addr add 192.168.0.1/16 dev INTERFACE`",
    ] {
        assert!(text.contains(line), "{line}: {text}");
    }
    let info = json(&["peek", "2:0x20", "4", "--addr", &address]);
    let words: Vec<_> = (0..4)
        .map(|n| info["registers"][n]["value"].as_u64())
        .collect();
    assert_eq!(words, [Some(0x0701), Some(0xC0A8), Some(0), Some(0xFFFF)]);
    // The same address again needs no write, and no question.
    let again = json(&set);
    assert_eq!(again["changed"], false);
}

#[test]
fn invalid_host_address_is_refused() {
    for (arguments, said) in [
        (&["10.10.10"][..], "invalid value '10.10.10'"),
        (&["0.0.0.0"], "no address of a single host"),
        (&["127.0.0.1"], "no address of a single host"),
        (&["224.0.0.1"], "no address of a single host"),
        (&["192.168.7.255"], "broadcast"),
        (&["192.168.7.0"], "the network itself"),
        (
            &["192.168.7.4", "--netmask", "255.0.255.0"],
            "is no netmask",
        ),
        (
            &["192.168.7.4", "--netmask", "255.255.255.254"],
            "is no netmask",
        ),
        (
            &["192.168.7.4", "--netmask", "255.255.255.252"],
            "the network itself",
        ),
    ] {
        let run = run(&[&["ip", "--sim", "7i97", "--yes"], arguments].concat());
        assert_eq!(run.code, Some(2), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
    }
}
