//! `mesa param` with the names of the manuals, and values that the manuals exclude.

use std::fs;
use std::net::Ipv4Addr;

use mesa_hal_sim::devices::{FieldIo, Outputs48, SignalValue, SimDevice};

use crate::interop::Scratch;
use crate::interop::board::Board;
use crate::pty::Card;
use crate::run::{done, json, run};

/// Numbers of the outputs that are on.
fn outputs_on(card: &Card) -> Vec<usize> {
    let outputs = card.with(|device, _| device.outputs());
    let on = outputs
        .iter()
        .filter(|(_, value)| *value == SignalValue::Bool(true));
    let number = |(name, _): &(String, SignalValue)| {
        let (_, number) = name.rsplit_once('-').expect("a numbered output");
        number.parse().expect("a number")
    };
    on.map(number).collect()
}

/// Manual: 7I77, "RPD, WPD, AND UFLBP".
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn words_of_rpd_and_wpd_are_understood_in_any_case() {
    for (device, wanted) in [
        (
            Box::new(FieldIo::i7i77().unwrap()) as Box<dyn SimDevice>,
            0xAAAA_u64,
        ),
        (Box::new(Outputs48::i7i72().unwrap()), 0xAAAA_AAAA_AAAA),
    ] {
        let card = Card::start_boxed(device);
        let at = ["--serial", &card.path];
        let get = |name| json(&[&["param", "get", name], &at[..]].concat());
        let set = |name, value| {
            let set = ["param", "set", name, value, "--yes"];
            done(&[&set[..], &at].concat())
        };
        // Without process data its watchdog has bitten, or it has just been switched on.
        let fault = get("fault");
        assert_eq!(fault["parameter"]["name"], "FAULT");
        assert_eq!(fault["parameter"]["hex"], "0x01", "{fault}");
        assert_eq!(get("STATUS")["parameter"]["bits"], 8);
        let time = get("NVWATCHDOGTIME");
        assert_eq!(time["parameter"]["name"], "NVWatchDogTimeout");
        assert_eq!(time["parameter"]["value"], 50);
        set("NVWatchDogTime", "0");
        assert_eq!(card.parameter("nvwatchdogtimeout"), 0);
        let list = done(&[&["param", "list"], &at[..]].concat());
        for word in ["FAULT ", "STATUS ", "OUTPUT "] {
            assert!(list.contains(word), "{word}: {list}");
        }
        // The working copy is 0 from the next power-up on.
        card.power_cycle();
        let text = format!("{wanted:#X}");
        let output = ["param", "set", "OUTPUT", &text];
        let output = [&output[..], &at].concat();
        let asked = run(&output);
        assert_eq!(asked.code, Some(2), "{asked:?}");
        assert!(
            asked.err.contains("DRIVES ITS OUTPUTS AT ONCE"),
            "{asked:?}"
        );
        let faulty = run(&[&output[..], &["--yes"]].concat());
        assert_eq!(faulty.code, Some(1), "{faulty:?}");
        assert!(faulty.err.contains("FAULT is 0x01"), "{faulty:?}");
        assert!(outputs_on(&card).is_empty());
        set("fault", "0");
        assert_eq!(card.with(|device, _| device.faults().bits()), 0);
        set("OUTPUT", "0");
        set("output", &text);
        let expected: Vec<usize> = (0..48).filter(|n| wanted >> n & 1 == 1).collect();
        assert_eq!(outputs_on(&card), expected);
        assert_eq!(get("output")["parameter"]["hex"], text);
    }
}

#[test]
fn word_that_does_not_fit_the_card_is_refused_with_the_reason() {
    let machine = ["--sim", "7i97,0=7i77-io"];
    for (arguments, code, said) in [
        (
            &["get", "WATCHDOGTIME"][..],
            1,
            "working copy of NVWatchDogTimeout",
        ),
        (
            &["set", "OUTPUT", "0x10000", "--yes"],
            2,
            "allowed is 0 to 65535",
        ),
        (
            &["set", "OUTPUT", "1.5", "--yes"],
            2,
            "allowed is 0 to 65535",
        ),
        (&["set", "FAULT", "1", "--yes"], 2, "allowed is 0 to 0"),
        (&["get", "OUTPUTS"], 1, "no remote has a parameter OUTPUTS"),
    ] {
        let run = run(&[&["param"], arguments, &machine].concat());
        assert_eq!(run.code, Some(code), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
    }
}

/// A card whose records have no limits, as those of real cards are not known.
const CARD: &str = "\
remote 7X99
unit 0x99000001
hardware 0 standard
mode 0 outputs
  data Output 8 bits out
parameter NVBaudRate 16 nonvol-unsigned both 0 65535 = 9
parameter WatchDogTime 16 unsigned both 0 65535
parameter NVWatchDogTimeout 16 nonvol-unsigned both 0 65535 = 50
working WatchDogTime 16 NVWatchDogTimeout
watchdog WatchDogTime
baud-rate NVBaudRate
";

/// Manual: 7I77, "OPERATE MODE BAUD RATE".
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn baud_rate_outside_the_table_is_refused_and_others_explained() {
    const BAUD: &str = "remote.0.parameter.nvbaudrate";
    let description = Scratch::new("words-7x99.remote");
    fs::write(&description.0, CARD).unwrap();
    let remote = format!("0={}", description.path());
    let board = ["--board", "7i97", "--port", "0", "--remote", &remote];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &board);
    let address = board.address.to_string();
    let at = ["--addr", &address];
    let set = |value| [&["param", "set", "NVBAUDRATE", value], &at[..]].concat();
    for value in ["12", "65535"] {
        let refused = run(&[&set(value)[..], &["--yes"]].concat());
        assert_eq!(refused.code, Some(2), "{refused:?}");
        let said = format!("{value} selects no baud rate: allowed is 0 (9600 baud) to 11");
        assert!(refused.err.contains(&said), "{refused:?}");
    }
    assert_eq!(board.console.show("")[BAUD], "9");
    assert_eq!(
        json(&[&["param", "get", "WATCHDOGTIME"], &at[..]].concat())["parameter"]["value"],
        50
    );

    let cabinet = Scratch::new("words-cabinet.toml");
    done(&[&["param", "save", cabinet.path()], &at[..]].concat());
    let saved = fs::read_to_string(&cabinet.0).unwrap();
    let restore = [&["param", "restore", cabinet.path()], &at[..]].concat();
    fs::write(
        &cabinet.0,
        saved.replace("NVBaudRate = 9", "NVBaudRate = 12"),
    )
    .unwrap();
    let refused = run(&[&restore[..], &["--yes"]].concat());
    assert_eq!(refused.code, Some(1), "{refused:?}");
    for said in ["12 selects no baud rate", "nothing was written"] {
        assert!(refused.err.contains(said), "{said}: {refused:?}");
    }
    fs::write(
        &cabinet.0,
        saved.replace("NVBaudRate = 9", "NVBaudRate = 4"),
    )
    .unwrap();
    for arguments in [&restore, &set("4")] {
        let asked = run(arguments);
        assert_eq!(asked.code, Some(2), "{asked:?}");
        for said in [
            "In operate mode it then has 115200 baud",
            "start at 2500000, does not find it any more",
            "in the setup position it has 115200 baud",
        ] {
            assert!(asked.err.contains(said), "{said}: {asked:?}");
        }
    }
    assert_eq!(board.console.show("")[BAUD], "9");
    done(&[&restore[..], &["--yes"]].concat());
    assert_eq!(board.console.show("")[BAUD], "4");
}

/// Manual: 7I77, "SETUP/OPERATE MODE".
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn cards_in_setup_mode_or_at_other_bauds_are_reached_by_fpga() {
    let remotes = ["--remote", "0=7i72", "--remote", "2=7i72:setup"];
    let board = [&["--board", "7i97", "--port", "0"], &remotes[..]].concat();
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &board);
    let address = board.address.to_string();
    let at = ["--addr", &address];
    let list = json(&[&["param", "list"], &at[..]].concat());
    let places = [0, 1].map(|n| list["remotes"][n]["place"].clone());
    assert_eq!(places, ["0.0", "0.2"]);
    let set = |name, value, more: &[&str]| {
        let set = ["param", "set", name, value, "--yes"];
        done(&[&set[..], &at, more].concat());
    };
    set("0.2.nvwatchdogtimeout", "70", &[]);
    set("0.0.nvwatchdogtimeout", "60", &[]);
    let shown = board.console.show("");
    assert_eq!(shown["remote.2.parameter.nvwatchdogtimeout"], "70");
    assert_eq!(shown["remote.0.parameter.nvwatchdogtimeout"], "60");

    let info = json(&[&["info"], &at[..]].concat());
    let remote = &info["serial_ports"][0]["channels"][2]["remote"];
    assert_eq!(
        (&remote["name"], &remote["in_setup_position"]),
        (&"7I72".into(), &true.into())
    );
    let findings = info["findings"].to_string();
    assert!(
        findings.contains("channel 2: the jumper of this 7I72 is in the setup position"),
        "{findings}"
    );
    // The port has its usual baud rate again.
    board.console.run("jumper 2 operate");
    let info = json(&[&["info"], &at[..]].concat());
    assert_eq!(info["findings"], serde_json::json!([]));

    // Another baud rate in operate mode, and the way back.
    set("0.2.NVBAUDRATE", "8", &[]);
    board.console.run("power 2 off");
    board.console.run("power 2 on");
    let lost = run(&[&["param", "get", "0.2.nvbaudrate"], &at[..]].concat());
    assert_eq!(lost.code, Some(1), "{lost:?}");
    set("0.2.NVBAUDRATE", "9", &["--baud", "1250000"]);
    assert_eq!(board.console.show("")["remote.2.parameter.nvbaudrate"], "9");
}
