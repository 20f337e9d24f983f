//! `mesa led`.

use std::net::Ipv4Addr;

use crate::interop::board::Board;
use crate::run::{done, json, run};

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn leds_are_given_to_hostmot2_now_and_after_a_restart() {
    let board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    let address = board.address.to_string();
    let shown = json(&["led", "--addr", &address]);
    assert_eq!(
        (&shown["now"], &shown["at_start"]),
        (&"debug".into(), &"debug".into())
    );

    let set = ["led", "--addr", &address, "hostmot2", "--at-start"];
    let refused = run(&set);
    assert_eq!(refused.code, Some(2), "not a terminal: {refused:?}");
    assert!(refused.err.contains("--yes"), "{refused:?}");
    let text = done(&[&set[..], &["--dry-run"]].concat());
    assert!(text.contains("EEPROM"), "{text}");
    let planned = json(&[&set[..], &["--dry-run"]].concat());
    assert_eq!(planned["dry_run"], true);
    assert!(
        planned["would"]
            .as_str()
            .is_some_and(|what| what.contains("EEPROM"))
    );
    assert_eq!(
        json(&["led", "--addr", &address]),
        shown,
        "nothing was done"
    );

    done(&[&set[..], &["--yes"]].concat());
    let shown = done(&["led", "--addr", &address]);
    assert_eq!(shown, "now       hostmot2\nat start  hostmot2\n");
}

#[test]
fn unknown_board_or_led_mode_is_refused() {
    for (arguments, said) in [
        (&["led"][..], "which board?"),
        (&["led", "--sim", "7i76"], "no machine `7i76`"),
        (&["led", "--sim", "7i97", "blue"], "hostmot2, debug"),
        (&["led", "--sim", "7i97", "--at-start"], "<MODE>"),
    ] {
        let run = run(arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
    }
}
