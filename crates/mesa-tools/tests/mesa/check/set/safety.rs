//! `mesa set`: an output reported as on was on at the terminal, and one reported as off is off. The
//! truth comes from the simulated board's console.

use std::net::Ipv4Addr;

use crate::check::set::{OUTPUT, begin, ended, impatient_board as board, lit, wait_until};
use crate::interop::board::Board;
use crate::run::{done, hold_against_schema, json, run};

fn board_7i97() -> Board {
    let card = ["--board", "7i97", "--port", "0"];
    Board::start(Ipv4Addr::LOCALHOST, &card)
}

/// Values of the board itself, from the console.
fn truth(board: &mut Board, names: &[&str]) -> Vec<String> {
    let values = board.console.show("board");
    let names = names
        .iter()
        .map(|name| values[&format!("board.{name}")].clone());
    names.collect()
}

const ENABLES: [&str; 6] = [
    "enable0", "enable1", "enable2", "enable3", "enable4", "enable5",
];

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn slow_or_disabled_watchdog_needs_a_flag_and_a_loss_is_named() {
    for (millis, said) in [("0", "its own watchdog is off"), ("5000", "5000 ms later")] {
        let mut board = board();
        let address = board.address.to_string();
        let name = "0.0.NVWatchDogTimeout";
        done(&["param", "set", name, millis, "--addr", &address, "--yes"]);
        board.console.run("power 0 off");
        board.console.run("power 0 on");
        let jog = [OUTPUT, "on", "--for", "60s"];
        let refused = run(&[&["set"], &jog[..], &["--addr", &address, "--yes"]].concat());
        assert_eq!(refused.code, Some(1), "{refused:?}");
        assert!(refused.err.contains("--slow-watchdog"), "{refused:?}");
        assert_eq!(refused.out, "");
        assert_eq!(lit(&mut board), [""; 0]);

        let jog = begin(&board, &[&jog[..], &["--slow-watchdog"]].concat());
        wait_until(&mut board, "0", "remote.0.output-03", "1");
        board.console.run("unplug 0");
        let run = ended(jog);
        assert_eq!(run.code, Some(1), "{run:?}");
        assert!(run.err.contains("NOT REACHED"), "{run:?}");
        assert!(run.err.contains(said), "{run:?}");
        assert!(!run.err.contains("all outputs are off"), "{run:?}");
        if millis == "0" {
            assert_eq!(lit(&mut board), ["remote.0.output-03"], "it said so");
        }
    }
}

/// A written time is used from the next power-up on: the stored value does not show the one in use.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn watchdog_that_was_written_and_is_not_in_use_is_not_believed() {
    for used in ["0", "5000"] {
        let mut board = board();
        let address = board.address.to_string();
        let to = ["--addr", &address, "--yes"];
        let name = "0.0.NVWatchDogTimeout";
        done(&[&["param", "set", name, used], &to[..]].concat());
        board.console.run("power 0 off");
        board.console.run("power 0 on");
        done(&[&["param", "set", name, "50"], &to[..]].concat());

        let jog = [OUTPUT, "on", "--for", "60s"];
        let wiring = ["wiring", OUTPUT, "--outputs", "--timeout", "1"];
        for command in [&[&["set"], &jog[..]].concat(), &wiring[..]] {
            let refused = run(&[command, &to[..]].concat());
            assert_eq!(refused.code, Some(1), "{refused:?}");
            let said = "the own watchdog of 7i77.0.0 has not shown that it bites";
            assert!(refused.err.contains(said), "{refused:?}");
            assert!(refused.err.contains("--slow-watchdog"), "{refused:?}");
            assert_eq!(refused.out, "");
            assert_eq!(lit(&mut board), [""; 0]);
        }
        let jog = begin(&board, &[&jog[..], &["--slow-watchdog", "--json"]].concat());
        wait_until(&mut board, "0", "remote.0.output-03", "1");
        board.console.run("unplug 0");
        let run = ended(jog);
        assert_eq!(run.code, Some(1), "{run:?}");
        let said = "has not bitten when it should have, so an output that was on stays on";
        assert!(run.err.contains(said), "{run:?}");
        assert!(run.err.contains("all other outputs are off"), "{run:?}");
        let told = serde_json::from_str(&run.out).expect("JSON");
        hold_against_schema("set", &told);
        assert!(
            told["not_reached"][0].to_string().contains(said),
            "{told:#}"
        );
        if used == "0" {
            assert_eq!(lit(&mut board), ["remote.0.output-03"], "it said so");
        }
    }
}

/// A board whose remote with the outputs has powered up with its watchdog off.
pub fn board_without_watchdog() -> Board {
    let mut board = board();
    let address = board.address.to_string();
    let name = "0.0.NVWatchDogTimeout";
    done(&["param", "set", name, "0", "--addr", &address, "--yes"]);
    board.console.run("power 0 off");
    board.console.run("power 0 on");
    board
}

/// The output's time is over, and the cable breaks before the remote has received the change.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn remote_that_is_lost_at_the_end_is_no_success() {
    let mut board = board_without_watchdog();
    let flags = ["--for", "60s", "--slow-watchdog", "--json"];
    let mut jog = begin(&board, &[&[OUTPUT, "on"], &flags[..]].concat());
    wait_until(&mut board, "0", "remote.0.output-03", "1");
    // Requests do not arrive.
    board.console.run("wire 0 remote lost chance 1");
    jog.signal("INT");
    let run = ended(jog);
    assert_eq!(run.code, Some(1), "{run:?}");
    let told = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("set", &told);
    assert_ne!(told["outcome"], "done");
    assert_ne!(told["outcome"], "stopped");
    let said = told["not_reached"][0].as_str().expect("it is named");
    assert!(said.contains("7i77.0.0"), "{told:#}");
    assert!(
        said.contains("switch off the power of the remote"),
        "{told:#}"
    );
    assert!(!run.err.contains("all outputs are off"), "{run:?}");
    assert_eq!(lit(&mut board), ["remote.0.output-03"], "it said so");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn shared_enable_is_used_and_the_question_names_all_drives() {
    let mut board = board_7i97();
    let drive = ["--analog", "--drive-enable", "--for", "60s"];
    let mut jog = begin(&board, &[&["pwmgen.02.value", "1"], &drive[..]].concat());
    wait_until(&mut board, "board", "board.enable2", "1");
    let on = ["1", "1", "1", "1", "0", "0"];
    assert_eq!(truth(&mut board, &ENABLES), on);
    let [volts, other] = [2, 0].map(|n| truth(&mut board, &[&format!("analogout{n}")])[0].parse());
    assert!((volts.unwrap_or(0.0) - 1.0_f64).abs() < 0.02, "it moves");
    assert!(other.unwrap_or(1.0_f64).abs() < 0.02, "the others do not");
    jog.signal("INT");
    let run = ended(jog);
    assert_eq!(run.code, Some(130), "{run:?}");
    for drive in ["pwmgen.00.enable", "ENA0+", "ENA1+", "ENA2+", "ENA3+"] {
        assert!(run.err.contains(drive), "{drive}: {run:?}");
    }
    assert!(!run.err.contains("ENA4"), "{run:?}");
    assert_eq!(truth(&mut board, &ENABLES), ["0"; 6]);
}

#[test]
fn enable_without_a_terminal_is_refused_with_the_one_that_has() {
    let jog = ["set", "pwmgen.02.enable", "on", "--for", "1s", "--yes"];
    let refused = run(&[&jog[..], &["--drive-enable", "--sim", "7i97"]].concat());
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("pwmgen.00.enable (TB3"), "{refused:?}");
    assert_eq!(refused.out, "");
}

/// Parameters of an output change the output as well: an offset, an inversion, a limit.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn pins_that_are_no_outputs_are_refused_and_nothing_moves() {
    let flags = ["--analog", "--drive-enable", "--slow-watchdog", "--yes"];
    for (mut board, pins, all) in [
        (
            board_7i97(),
            &[
                ("pwmgen.00.offset-mode", "0"),
                ("pwmgen.00.output-type", "1"),
                ("pwmgen.00.scale", "0.1"),
                ("pwmgen.pwm_frequency", "1000"),
                ("gpio.034.is_output", "on"),
                ("gpio.034.invert_output", "on"),
                ("gpio.034.is_opendrain", "on"),
                ("ssr.00.invert-00", "on"),
                ("ssr.00.rate", "1"),
                ("dpll.01.timer-us", "1"),
                ("encoder.00.scale", "2"),
            ][..],
            "board",
        ),
        (
            board(),
            &[
                ("7i77.0.1.analogena-invert", "on"),
                ("7i77.0.1.spinena-invert", "on"),
                ("7i77.0.1.analogout0-minlim", "5"),
                ("7i77.0.0.output-03-invert", "on"),
            ],
            "1",
        ),
    ] {
        let address = board.address.to_string();
        let before = board.console.show(all);
        for &(pin, value) in pins {
            let jog = ["set", pin, value, "--for", "300ms", "--addr", &address];
            let refused = run(&[&jog[..], &flags].concat());
            assert_eq!(refused.code, Some(2), "{pin}: {refused:?}");
            let said = "configures how the board makes its outputs";
            assert!(refused.err.contains(said), "{pin}: {refused:?}");
            assert_eq!(refused.out, "", "{pin}");
        }
        let after = board.console.show(all);
        let is_driven = |(name, _): &(&String, &String)| {
            ["pin-", "output", "analog", "enable"]
                .iter()
                .any(|part| name.contains(part))
        };
        let driven = before.iter().filter(is_driven);
        let driven: Vec<_> = driven.collect();
        assert!(driven.len() > 5, "{before:?}");
        assert!(driven.iter().all(|(name, value)| after[*name] == **value));
    }
}

#[test]
fn analog_output_that_is_not_enabled_has_0_volts_and_is_refused() {
    for (sim, pin, enable) in [
        ("7i92-7i77", "7i77.0.1.analogout0", "ENA4+"),
        ("7i92-7i77", "7i77.0.1.analogout5", "7i77.0.1.spinena"),
        ("7i97", "pwmgen.00.value", "ENA3+"),
        ("7i97", "pwmgen.04.value", "ENA4+"),
    ] {
        let jog = ["set", pin, "5", "--for", "1s", "--yes", "--sim", sim];
        for flags in [&["--analog"][..], &[]] {
            let refused = run(&[&jog[..], flags].concat());
            assert_eq!(refused.code, Some(2), "{refused:?}");
            for said in ["0 V", "--drive-enable", enable] {
                assert!(refused.err.contains(said), "{pin}: {refused:?}");
            }
            assert_eq!(refused.err.contains("--analog "), flags.is_empty());
            assert_eq!(refused.out, "");
        }
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn io_pin_is_an_output_for_its_time_and_an_input_again() {
    let mut board = board_7i97();
    assert_eq!(truth(&mut board, &["pin-034"]), ["1"], "pulled up");
    let mut jog = begin(&board, &["gpio.034.out", "off", "--for", "60s"]);
    wait_until(&mut board, "board", "board.pin-034", "0");
    jog.signal("INT");
    let run = ended(jog);
    assert_eq!(run.code, Some(130), "{run:?}");
    assert!(run.err.contains("make it an output"), "{run:?}");
    assert_eq!(truth(&mut board, &["pin-034"]), ["1"]);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn io_pin_driven_externally_is_reported_as_not_set() {
    let mut board = board_7i97();
    board.console.run("pin 34 low");
    let jog = begin(&board, &["gpio.034.out", "on", "--for", "60s", "--json"]);
    let run = ended(jog);
    assert_eq!(run.code, Some(1), "{run:?}");
    assert_eq!(truth(&mut board, &["pin-034"]), ["0"]);
    assert!(run.out.contains("\"not_set\""), "{run:?}");
    assert!(run.err.contains("something else drives it"), "{run:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn output_of_a_failed_remote_stays_off_with_the_reason_shown() {
    let mut board = board();
    let address = board.address.to_string();
    let at = ["--addr", &address];
    let jog = [&["set", OUTPUT, "on", "--for", "1s", "--yes"], &at[..]].concat();
    board.console.run("field 0 0");
    let refused = run(&jog);
    assert_eq!(refused.code, Some(1), "{refused:?}");
    assert!(refused.err.contains("on 0.0 is offline: "), "{refused:?}");
    assert_eq!(refused.out, "");
    assert_eq!(lit(&mut board), [""; 0]);
    // The inputs of the missing remote are not observed during another jog.
    let other = ["set", "gpio.020.out", "off", "--for", "1s", "--yes"];
    let told = json(&[&other[..], &at].concat());
    assert!(told["not_seen"].as_u64() >= Some(32), "{told:#}");
    assert!(!told["changes"].to_string().contains("input-"), "{told:#}");

    board.console.run("field 0 24");
    board.console.run("unplug 0");
    let scope = ["scope", "gpio.020.in", "--trigger", "7i77.0.0.input-02"];
    let scope = [&scope[..], &["--csv", "/nowhere.csv"], &at].concat();
    for command in [jog, scope] {
        let refused = run(&command);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        assert!(refused.err.contains("on 0.0 is missing: "), "{refused:?}");
        assert_eq!(refused.out, "");
    }
}
