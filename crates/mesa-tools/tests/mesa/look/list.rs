//! `mesa list`.

use std::fs;
use std::net::{Ipv4Addr, UdpSocket};
use std::path::Path;
use std::process::Stdio;

use mesa_hal::lbp16;

use crate::interop::board::Board;
use crate::interop::mesaflash::free_address;
use crate::interop::{PATIENCE, Process};
use crate::run::{Run, command, hold_against_schema, json, run};

/// The addresses that are always queried, as in the JSON.
fn silent(found: &serde_json::Value) -> Vec<String> {
    let groups = found["silent"].as_array().expect("groups");
    let addresses = groups
        .iter()
        .filter_map(|group| group["addresses"].as_array());
    let addresses = addresses.flatten().filter_map(|address| address.as_str());
    addresses.map(str::to_owned).collect()
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn boards_in_a_range_are_found_with_who_they_are() {
    let hosts = [3, 200].map(|host| Ipv4Addr::new(127, 94, 1, host));
    let boards = ["7i97", "7i92-7i77"];
    let _boards: Vec<_> = hosts
        .iter()
        .zip(boards)
        .map(|(&host, board)| Board::start(host, &["--board", board]))
        .collect();
    let found = json(&["list", "127.94.1.0/24"]);
    let boards = found["boards"].as_array().expect("boards");
    let who: Vec<_> = boards
        .iter()
        .map(|board| [&board["address"], &board["card"], &board["address_from"]])
        .collect();
    assert_eq!(
        who,
        [
            ["127.94.1.3", "7I97", "eeprom"],
            ["127.94.1.200", "7I92", "eeprom"]
        ]
    );
    let silent = silent(&found);
    assert_eq!(silent.len(), 2 + 252, "{silent:?}");
    for factory in ["192.168.1.121", "10.10.10.10"] {
        assert!(
            silent.iter().any(|address| address == factory),
            "{silent:?}"
        );
    }

    // Nobody expects a board at each address of a range.
    let range = run(&["list", "127.94.1.3-127.94.1.4"]);
    assert!(!range.out.contains("->"), "{range:?}");
    let run = run(&["list", "127.94.1.3", "127.94.1.4"]);
    assert_eq!(run.code, Some(0), "{run:?}");
    let line = "127.94.1.3       7I97      MAC 00:60:1b:1b:00:97  firmware 16, LBP 3  \
                IP address from EEPROM (W16 down, W17 up)\n";
    assert!(run.out.contains(line), "{run:?}");
    let refused = "127.94.1.4       no simulated board listens there on this computer\n";
    assert!(run.out.contains(refused), "{run:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn board_gets_two_packets_at_most() {
    let address = Ipv4Addr::new(127, 94, 2, 1);
    let mut board = Board::start(address, &["--board", "7i97"]);
    let before = board.console.show("network");
    json(&["list", "127.94.2.1"]);
    let after = board.console.show("network");
    let received = |values: &crate::interop::console::Values| {
        let packets = &values["network.received.packets"];
        packets.parse::<u32>().expect("a number")
    };
    let packets = received(&after) - received(&before);
    assert!((1..=2).contains(&packets), "{packets} packets");
}

#[test]
fn missing_board_is_reported_with_reason_and_advice() {
    let address = free_address();
    let silent = UdpSocket::bind((address, lbp16::PORT)).expect("free");
    let run = run(&["list", &address.to_string()]);
    drop(silent);
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(run.out.starts_with("no board answers\n"), "{run:?}");
    let why = format!("{address:16} no simulated board listens there on this computer\n");
    assert!(run.out.contains(&why), "{run:?}");
    // Whatever the network of this computer, each factory address has a reason and advice.
    for factory in ["192.168.1.121", "10.10.10.10"] {
        let mut lines = run.out.lines().skip_while(|line| !line.contains(factory));
        let reason = lines.next().expect("a reason");
        assert!(reason.len() > "192.168.1.121".len() + 10, "{run:?}");
        let advice = lines.next().expect("advice").trim_start();
        assert!(advice.starts_with("-> ") && advice.len() > 10, "{run:?}");
    }
}

#[test]
#[cfg(target_endian = "little")]
fn interface_that_is_down_is_named_and_not_that_of_the_office() {
    let root = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let root = root.join(format!("{}-list", std::process::id()));
    let file = |path: &str, text: &str| {
        let path = root.join(path);
        fs::create_dir_all(path.parent().expect("a directory")).expect("a scratch directory");
        fs::write(path, text).expect("a scratch file");
    };
    for (interface, flags, carrier) in [("eth0", "0x1003", "1"), ("eth1", "0x1002", "")] {
        file(&format!("sys/class/net/{interface}/type"), "1");
        file(&format!("sys/class/net/{interface}/flags"), flags);
        file(&format!("sys/class/net/{interface}/carrier"), carrier);
        file(
            &format!("sys/class/net/{interface}/device/vendor"),
            "0x8086",
        );
    }
    let office = "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\n\
                  eth0\t00000000\t0100A8C0\t0003\t0\t0\t100\t00000000\n\
                  eth0\t0000A8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\n";
    file("proc/net/route", office);
    let found = run(&["list", "--json", "--root", root.to_str().expect("UTF-8")]);
    fs::remove_dir_all(&root).expect("it is there");
    let found: serde_json::Value = serde_json::from_str(&found.out).expect("JSON");
    hold_against_schema("list", &found);
    let groups = found["silent"].as_array().expect("groups");
    let board = groups
        .iter()
        .find(|group| group["addresses"][0] == "10.10.10.10");
    let board = board.expect("the address of the factory");
    assert_eq!(
        board["reason"],
        "no interface is in its network: packets leave by eth0 through the gateway 192.168.0.1, and the \
         interface eth1 is down"
    );
    assert_eq!(
        board["advice"],
        "`sudo ip link set eth1 up`; if it has no address in that network then, `sudo ip addr add \
         10.10.10.1/24 dev eth1`"
    );
}

#[test]
fn ranges_that_make_no_sense_are_refused() {
    for (arguments, said) in [
        (&["list", "somewhere"][..], "expected IP, IP/BITS or IP-IP"),
        (&["list", "10.0.0.0/8"], "at most 1024 are asked"),
        (&["list", "10.0.0.9-10.0.0.1"], "begins behind its end"),
        (
            &["list", "10.0.0.0/23", "10.1.0.0/22"],
            "these are 1532 addresses",
        ),
        (&["list", "--port", "0"], "0 is not in 1..=65535"),
    ] {
        let run = run(arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
        assert!(run.out.is_empty(), "{arguments:?}: {run:?}");
    }
}

#[test]
fn signal_ends_it_with_what_was_found_so_far() {
    // Silent addresses take their time.
    let silent = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).expect("free");
    let port = silent.local_addr().expect("bound").port().to_string();
    let command = command(&["list", "127.94.4.0-127.94.7.200", "--port", &port, "--json"])
        .stdout(Stdio::piped())
        .spawn();
    let mut process = Process::new(command.expect("mesa starts"));
    silent.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    silent.recv(&mut [0; 64]).expect("a board is asked");
    process.signal("INT");
    let run = Run::from(process.output());
    assert_eq!(run.code, Some(130), "{run:?}");
    let found = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("list", &found);
    assert!(run.err.contains("not all addresses were asked"), "{run:?}");
}
