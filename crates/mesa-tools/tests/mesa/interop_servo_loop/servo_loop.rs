//! The servo loop over Ethernet in real use: two programs, real sockets, the clock. On both boards,
//! at the host's pace and at the board's.
//!
//! Where the user may have no realtime priority, a busy computer is late: then the loops are
//! repeated with longer periods. `tests/ethernet/bad_network.rs` verifies on virtual time that
//! every packet fault is counted and none reaches a pin.

use std::net::Ipv4Addr;

use crate::interop::{board::Board, example, realtime};

/// Rate in Hz and time of the watchdog in ms of each run: loops may fail because the computer is
/// busy.
const TRIES: [[&str; 2]; 5] = [
    ["1000", "50"],
    ["1000", "50"],
    ["500", "100"],
    ["250", "200"],
    ["125", "400"],
];

const I7I92: [&str; 4] = ["--board", "7i92-7i77", "--remote", "2=7i72"];
const I7I97: [&str; 2] = ["--board", "7i97"];

/// Runs the loops with `arguments` on the board that `board` describes, until they hold.
fn holds(address: Ipv4Addr, board: &[&str], arguments: &[&str]) -> String {
    let program = example("servo_bench");
    let mut printed = String::new();
    for [rate, watchdog] in TRIES {
        let board = Board::start(address, board);
        let output = realtime(&program)
            .args(["--addr", &address.to_string()])
            .args(["--seconds", "3", "--rate", rate, "--watchdog", watchdog])
            .args(arguments)
            .output()
            .expect("servo_bench starts");
        drop(board);
        printed = String::from_utf8_lossy(&output.stdout).into_owned();
        if output.status.success() {
            assert!(printed.contains("All loops held."), "{printed}");
            return printed;
        }
    }
    panic!(
        "the loops did not hold in {} tries; the last:\n{printed}",
        TRIES.len()
    );
}

/// The sum of the numbers before `what` in the line of packets: of reads, and of writes where it
/// has both.
fn count(printed: &str, what: &str) -> u32 {
    let line = printed.lines().find(|line| line.starts_with("Packets:"));
    let parts: Vec<_> = line.expect("a line").split(what).collect();
    let (_, before) = parts.split_last().expect("a part");
    assert!(!before.is_empty(), "{what}: {printed}");
    let numbers = before.iter().map(|part| {
        let number = part.split_whitespace().last().expect("a number");
        number.parse::<u32>().expect("a number")
    });
    numbers.sum()
}

#[test]
fn six_loops_hold_over_ethernet() {
    let printed = holds(Ipv4Addr::new(127, 92, 0, 1), &I7I92, &[]);
    assert!(
        printed.contains("7I72, unit number 0x72000001"),
        "{printed}"
    );
    assert_eq!(count(&printed, " foreign"), 0, "{printed}");
}

#[test]
fn six_loops_hold_while_packets_are_lost_late_and_duplicate() {
    let mishaps = [
        "--loss", "0.01", "--late", "0.01", "--dup", "0.02", "--seed", "77",
    ];
    let board: Vec<&str> = I7I92.into_iter().chain(mishaps).collect();
    let printed = holds(Ipv4Addr::new(127, 92, 0, 2), &board, &[]);
    for what in [" lost", " late", " twice"] {
        assert!(count(&printed, what) > 0, "{what}: {printed}");
    }
}

#[test]
fn six_loops_hold_on_a_7i97_alone_and_with_remotes_at_any_pace() {
    let address = Ipv4Addr::new(127, 97, 0, 4);
    let printed = holds(address, &I7I97, &[]);
    assert!(printed.contains("analog outputs of the 7I97"), "{printed}");
    let remotes = [
        "--remote",
        "0=7i77-io",
        "--remote",
        "1=7i77-analog",
        "--remote",
        "2=7i72",
    ];
    let board: Vec<&str> = I7I97.into_iter().chain(remotes).collect();
    let printed = holds(address, &board, &["--pace", "board"]);
    assert!(printed.contains("Paced by the board:"), "{printed}");
    assert!(printed.contains("channel 2 7I72: "), "{printed}");
}
