//! The inventory of a board, for operators and programs.

use std::{
    net::Ipv4Addr,
    process::{Command, Output, Stdio},
};

use crate::interop::{Scratch, board::Board, mesa, mesaflash::free_address, realtime_thread};
use crate::run::{done, hold_against_schema};
use serde_json::Value;

fn info(arguments: &[&str]) -> Output {
    Command::new(mesa())
        .arg("info")
        .args(arguments)
        .output()
        .expect("mesa starts")
}

/// A 7I92 with a 7I77 and, on its expansion connector, a 7I72.
const SIM: &str = "7i92-7i77,2=7i72";

/// JSON of `mesa info`.
fn json(arguments: &[&str]) -> Value {
    let output = info(&[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{output:?}");
    let value = serde_json::from_slice(&output.stdout).expect("JSON");
    hold_against_schema("info", &value);
    value
}

#[test]
fn step_and_direction_have_the_terminals_of_the_connected_card() {
    let of = |machine: &str, pin: &str| {
        let text = done(&["info", "--sim", machine]);
        let mut lines = text.lines().filter(|line| line.contains(pin));
        lines.next().unwrap_or_default().to_owned()
    };
    let on_7i92 = of("7i92-7i76", "StepGen 1 Step ");
    assert!(
        on_7i92.ends_with("P2 DB25 pin 15 IO3, TB2 pin 8, TB2 pin 9 STEP1-, STEP1+"),
        "{on_7i92}"
    );
    // A 7I97 has terminals of its own with these names.
    let on_7i97 = of("7i97-7i76", "StepGen 4 Dir ");
    assert!(
        on_7i97.contains("7I76 TB3 pin 4, TB3 pin 5 DIR4-, DIR4+"),
        "{on_7i97}"
    );
    let images = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/transcripts/firmwares/"
    );
    let public = of(
        &format!("{images}7I76E-7I76x1_BSTECHx2D_51.txt"),
        "StepGen 0 Step ",
    );
    assert!(
        public.contains("TB2 pin 2, TB2 pin 3 STEP0-, STEP0+"),
        "{public}"
    );
    // The pins of another connector are no 7I76's.
    let other = of(&format!("{images}7I96S-7I96S_G540D.txt"), "StepGen 0 Step ");
    assert!(!other.contains("TB2 pin 2"), "{other}");
}

#[test]
fn each_serial_port_of_a_firmware_takes_remotes() {
    let image = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/transcripts/firmwares/7I92-7I74x2_34.txt"
    );
    let found = json(&["--sim", &format!("{image},0=7i72,1.0=7i71,1.3=7i84u")]);
    let on_port = |port: usize| {
        let channels = found["serial_ports"][port]["channels"].as_array();
        let named = channels.into_iter().flatten().map(|channel| {
            let name = channel["remote"]["name"].as_str();
            (channel["channel"].as_u64(), name.map(str::to_owned))
        });
        named.filter(|(_, name)| name.is_some()).collect::<Vec<_>>()
    };
    let is = |channel, name: &str| (Some(channel), Some(name.to_owned()));
    assert_eq!(on_port(0), [is(0, "7I72")], "{found}");
    assert_eq!(on_port(1), [is(0, "7I71"), is(3, "7I84")]);
}

#[test]
fn simulated_machine_is_listed_with_terminals_and_parameters() {
    let output = info(&["--sim", SIM]);
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8_lossy(&output.stdout);
    for line in [
        "HostMot2 firmware for MESA7I92",
        "Channel 0: 7I77 (7I77 field I/O), unit number 0x12000001, software mode 0",
        "TB8 pin 3 INPUT2",
        "P2 DB25 pin 1 IO0\n",
        "P1 DB25 pin 13 IO33\n",
        "software mode 0: output_only (current)",
        "= 301989889 (raw 0x12000001)",
    ] {
        assert!(text.contains(line), "{line}:\n{text}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn ethernet_board_is_listed_for_programs() {
    let address = free_address();
    let board = Board::start(address, &["--board", "7i97", "--remote", "0=7i77-io:2"]);
    let inventory = json(&["--addr", &address.to_string(), "--mode", "0.0=2"]);
    drop(board);

    assert_eq!(inventory["ethernet"]["card"], "7I97");
    assert_eq!(inventory["ethernet"]["mac"], "00:60:1b:1b:00:97");
    assert_eq!(inventory["ethernet"]["address_from"], "eeprom");
    assert_eq!(inventory["ethernet"]["leds"], "debug");
    assert_eq!(inventory["ethernet"]["counters"]["parse_errors"], 0);
    assert_eq!(inventory["findings"].as_array().map(Vec::len), Some(0));
    let pins = inventory["firmware"]["pins"].as_array().expect("pins");
    assert_eq!(pins.len(), 51);
    assert_eq!(pins[0]["terminals"], "TB3 pin 4 AOUT0");
    let remote = &inventory["serial_ports"][0]["channels"][0]["remote"];
    assert_eq!(remote["software_mode"], 2);
    let data = remote["process_data"].as_array().expect("process data");
    let names: Vec<_> = data
        .iter()
        .filter_map(|record| record["name"].as_str())
        .collect();
    assert_eq!(names.last(), Some(&"FieldVoltage"), "{names:?}");
    assert_eq!(remote["problems"].as_array().map(Vec::len), Some(0));
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn findings_for_the_user_are_at_the_top() {
    let arguments = ["--board", "7i97", "--remote", "0=7i77-io", "--port", "0"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &arguments);
    let address = board.address.to_string();
    let text = |arguments: &[&str]| {
        let output = info(arguments);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let good = text(&["--addr", &address]);
    assert!(
        good.starts_with("in order: MESA7I97, 1 remote\n\n"),
        "{good}"
    );
    for line in [
        "  IP address   from EEPROM (W16 down, W17 up)\n",
        "  LEDs         count packets (debug); after a restart count packets (debug)\n",
        "  Errors       0 parse, 0 memory, 0 write\n",
        "  Space 2      EtherEEP, 128 bytes\n",
        "    faults: ",
    ] {
        assert!(good.contains(line), "{line}:\n{good}");
    }
    board.console.run("field 0 4");
    // An invalid command.
    let socket = std::net::UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("free");
    socket.send_to(&[1], board.address).expect("sent");
    let bad = text(&["--addr", &address]);
    assert!(
        bad.starts_with("2 things to look at: MESA7I97, 1 remote\n"),
        "{bad}"
    );
    assert!(
        bad.contains("\n  the board counted commands that it could not parse: 1\n"),
        "{bad}"
    );
    assert!(
        bad.contains("\n  7i77.0.0: field voltage too low or missing\n"),
        "{bad}"
    );
    let found = json(&["--addr", &address]);
    assert_eq!(found["findings"].as_array().map(Vec::len), Some(2));
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn state_after_a_kill_is_reported_once_and_a_slow_watchdog_too() {
    let mut board = crate::check::set::board();
    let address = board.address.to_string();
    let found = |address: &str| json(&["--addr", address])["findings"].to_string();
    assert_eq!(found(&address), "[]", "no client has begun");
    done(&["param", "list", "--addr", &address]);
    assert_eq!(found(&address), "[]", "what only read leaves nothing");
    let jog = [crate::check::set::OUTPUT, "on", "--for", "60s"];
    let mut killed = crate::check::set::begin(&board, &jog);
    crate::check::set::wait_for(&mut board, 0, "output-03", "1");
    killed.signal("KILL");
    let _ = killed.output();
    crate::check::set::wait_until(&mut board, "board", "board.watchdog-bitten", "1");
    let left = found(&address);
    assert!(left.contains("it was not stopped"), "{left}");
    assert!(left.contains("watchdog has bitten"), "{left}");
    assert_eq!(found(&address), "[]", "it is stopped by now");
    // An output of the board that no program stops.
    done(&["poke", "0:0x1100", "1", "--addr", &address, "--yes"]);
    let left = found(&address);
    assert!(left.contains("outputs may have been on"), "{left}");
    assert_eq!(found(&address), "[]", "it is an input by now");

    let name = "0.0.NVWatchDogTimeout";
    for (millis, said) in [("0", "watchdog is off"), ("5000", "stays on for 5000 ms")] {
        done(&["param", "set", name, millis, "--addr", &address, "--yes"]);
        let found = found(&address);
        assert!(found.contains(said), "{found}");
    }
}

#[test]
fn unreachable_address_is_reported_with_advice() {
    let output = info(&["--addr", "127.93.0.2"]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(
        text.contains("127.93.0.2:27181: no program listens"),
        "{text}"
    );
    assert!(text.contains("check the address and the port"), "{text}");
}

#[test]
fn silent_address_and_a_host_that_is_no_board_are_distinguished() {
    let (nobody, another) = (free_address(), free_address());
    let at = |address| std::net::UdpSocket::bind((address, mesa_hal::lbp16::PORT)).expect("free");
    let (_silent, service) = (at(nobody), at(another));
    std::thread::spawn(move || {
        realtime_thread();
        let mut buffer = [0; 2048];
        while let Ok((_, from)) = service.recv_from(&mut buffer) {
            let _ = service.send_to(b"?", from);
        }
    });
    // Both wait until no reply can come any more.
    let errors = [nobody, another].map(|address| {
        std::thread::spawn(move || {
            let output = info(&["--addr", &address.to_string()]);
            assert_eq!(output.status.code(), Some(1), "{output:?}");
            assert!(output.stdout.is_empty(), "{output:?}");
            String::from_utf8(output.stderr).expect("a text")
        })
    });
    let [silent, no_board] = errors.map(|thread| thread.join().expect("ended"));
    let said = format!("{nobody}:27181: no board answers, asked 10 times within ");
    assert!(silent.contains(&said), "{silent}");
    assert!(!silent.contains("request"), "said twice: {silent}");
    assert!(silent.contains("check the board's power"), "{silent}");
    assert!(no_board.contains("but another host does"), "{no_board}");
    assert!(no_board.contains("not from a Mesa board"), "{no_board}");
}

#[test]
fn invalid_arguments_are_refused_and_not_ignored() {
    for (arguments, code, said) in [
        (&["--addr", "somewhere"][..], 2, "is no IPv4 address"),
        (&[], 2, "which board?"),
        (
            &["--sim", SIM, "--addr", "127.93.0.2"],
            2,
            "cannot be used with",
        ),
        (&["--sim", SIM, "--mode", "0.1"], 2, "PORT.CHANNEL=MODE"),
        (
            &["--sim", SIM, "--mode", "0.7=1"],
            1,
            "channel 7 of serial port 0 does not exist: the port has 3",
        ),
        (
            &["--sim", SIM, "--mode", "0.0=77"],
            1,
            "7i77.0.0 has no software mode 77; it has 0 (",
        ),
        (
            &["--sim", SIM, "--mode", "2.0=1"],
            1,
            "serial port 2 does not exist: the firmware has 1",
        ),
    ] {
        let output = info(arguments);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
        assert!(text.contains(said), "{arguments:?}: {text}");
    }
}

#[test]
fn mode_that_a_remote_has_not_is_not_in_order() {
    for (machine, mode, place, said) in [
        (
            "7i97",
            "0.0=2",
            "port 0, channel 0",
            "nothing started in software mode 2",
        ),
        (SIM, "0.0=77", "7i77.0.0", "software mode 77 is not one of"),
    ] {
        let output = info(&["--sim", machine, "--mode", mode]);
        let text = String::from_utf8_lossy(&output.stdout);
        assert_eq!(output.status.code(), Some(1), "{text}");
        let mut lines = text.lines();
        let judgement = lines.next().expect("a line");
        assert!(judgement.contains(" to look at: MESA7I9"), "{judgement}");
        assert_eq!(
            lines
                .filter(|line| line.starts_with(&format!("  {place}: ")) && line.contains(said))
                .count(),
            1,
            "{text}"
        );
    }
    let arguments = ["--sim", "7i97", "--mode", "0.0=2"];
    let output = info(&[&arguments[..], &["--json"]].concat());
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let value: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    hold_against_schema("info", &value);
    let finding = value["findings"][0].as_str().expect("a finding");
    assert!(finding.contains("nothing started"), "{finding}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn half_a_card_and_a_card_in_its_bootloader_are_not_in_order() {
    let mut board = Board::start(
        Ipv4Addr::LOCALHOST,
        &["--board", "7i92-7i77", "--port", "0"],
    );
    let address = board.address.to_string();
    for channel in ["0", "1"] {
        board.console.run(&format!("unplug {channel}"));
        let value = json(&["--addr", &address]);
        let finding = value["findings"][0].as_str().expect("a finding");
        assert!(
            finding.contains(&format!("channel {channel}: no reply from the 7I77")),
            "{finding}"
        );
        board.console.run(&format!("plug {channel}"));
        assert_eq!(
            json(&["--addr", &address])["findings"],
            serde_json::json!([])
        );
    }
    board.stop("TERM");

    let arguments = [
        "--board",
        "7i97",
        "--port",
        "0",
        "--remote",
        "0=7i77-io:setup",
    ];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &arguments);
    let address = board.address.to_string();
    let firmware = Scratch::new("7I77-nonsense.BIN");
    let bytes: Vec<u8> = (0..9000_u32)
        .map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    std::fs::write(&firmware.0, bytes).expect("a scratch file");
    let update = [
        "update",
        "7i77",
        firmware.path(),
        "--at",
        "0.0",
        "--addr",
        &address,
    ];
    let asked = crate::run::run(&update);
    assert_eq!(asked.code, Some(2), "{asked:?}");
    for said in [
        "only the file's name",
        "another bootloader",
        "something at 9216",
    ] {
        assert!(asked.err.contains(said), "{said}: {asked:?}");
    }
    let doubts = &crate::run::json(&[&update[..], &["--yes"]].concat())["doubts"];
    assert_eq!(doubts.as_array().map(Vec::len), Some(3), "{doubts}");
    board.console.run("jumper 0 operate");
    let findings = json(&["--addr", &address])["findings"].to_string();
    assert!(findings.contains("is in its bootloader"), "{findings}");
    assert!(!findings.contains("has_discovery"), "{findings}");
}

#[test]
fn reader_that_has_seen_enough_is_no_error() {
    for arguments in [&["--sim", SIM][..], &["--sim", SIM, "--json"]] {
        let mut child = Command::new(mesa())
            .arg("info")
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("mesa starts");
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("it ends");
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), &*text), (Some(0), ""));
    }
}

/// Every board of `mesa sim --board`, with further remotes: an empty channel is no finding.
#[test]
fn every_simulated_board_is_in_order() {
    for (machine, remotes, encoders, card, bases) in [
        ("7i97,0=7i84:2,1=7i76", 2, 6, "7I97", [0x3600, 0x5B00]),
        ("7i97-7i77,0=7i76e,3=7i72", 4, 12, "7I97", [0x3600, 0x5B00]),
        ("7i97t", 0, 6, "7I97T", [0x3600, 0x5B00]),
        ("7i92-7i77", 2, 6, "7I92", [0x3600, 0x5B00]),
        ("7i80-7i77,2=7i84", 3, 6, "7I80DB-16", [0x3500, 0x5A00]),
    ] {
        let inventory = json(&["--sim", machine]);
        assert_eq!(inventory["ethernet"]["card"], card, "{machine}");
        assert_eq!(inventory["findings"], serde_json::json!([]), "{machine}");
        let channels = inventory["serial_ports"][0]["channels"].as_array();
        let found = channels.expect("channels").iter();
        let found = found.filter(|channel| channel["remote"].is_object());
        assert_eq!(found.count(), remotes, "{machine}");
        let modules = inventory["firmware"]["modules"].as_array();
        // MuxedEncoder and SSerial.
        let [muxed, serial] = [0x0C, 0xC1].map(|gtag| {
            let mut modules = modules.expect("modules").iter();
            let found = modules.find(|module| module["gtag"] == gtag);
            found.expect("a module")
        });
        assert_eq!(muxed["instances"], encoders, "{machine}");
        assert_eq!([&muxed["base"], &serial["base"]], bases, "{machine}");
    }
}

/// FACTS 9.6.
#[test]
fn a_7i97t_is_shown_with_its_own_jumpers() {
    let output = info(&["--sim", "7i97t"]);
    let text = String::from_utf8_lossy(&output.stdout);
    for line in [
        "HostMot2 firmware for MESA7I97",
        "Ethernet board 7I97T",
        "  7I97T is a T board: an Efinix FPGA (20 kgates, ClockHigh 160 MHz) and another layout of its \
         flash memory than the board without the T",
        "from EEPROM (W11 down, W12 up)",
        "ClockHigh 160.000 MHz",
    ] {
        assert!(text.contains(line), "{line}:\n{text}");
    }
}
