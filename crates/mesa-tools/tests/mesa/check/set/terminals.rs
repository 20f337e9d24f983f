//! `mesa set`: outputs by terminal and signal, and the announcements. The truth comes from the
//! simulated board's console.

use std::io::{BufRead, BufReader};

use crate::check::set::{OUTPUT, begin, board, ended, lit, wait_for};
use crate::interop::PATIENCE;
use crate::run::{done, run};
use crate::terminal::Terminal;

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn output_is_named_by_its_terminal_or_its_signal() {
    let mut board = board();
    for name in [
        "TB8-20",
        "tb8.20",
        "TB8 pin 20",
        "TB8 20",
        "OUTPUT3",
        "output3 of 7i77.0.0",
    ] {
        let mut jog = begin(&board, &[name, "on", "--for", "60s"]);
        wait_for(&mut board, 0, "output-03", "1");
        assert_eq!(lit(&mut board), ["remote.0.output-03"], "{name}");
        jog.signal("INT");
        let run = ended(jog);
        assert_eq!(run.code, Some(130), "{name}: {run:?}");
        assert_eq!(lit(&mut board), [""; 0]);
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn ambiguous_terminal_is_refused_with_both_until_card_is_given() {
    let two = [
        "--for",
        "100ms",
        "--sim",
        "7i97,0=7i77-io,1=7i77-io",
        "--yes",
        "--json",
    ];
    for name in ["TB8-20", "OUTPUT3", "output-03"] {
        let refused = run(&[&["set", name, "on"], &two[..]].concat());
        assert_eq!(refused.code, Some(2), "{refused:?}");
        for candidate in [
            "hm2_7i97.0.7i77.0.0.output-03 (TB8 pin 20 OUTPUT3 of 7i77.0.0)",
            "hm2_7i97.0.7i77.0.1.output-03 (TB8 pin 20 OUTPUT3 of 7i77.0.1)",
        ] {
            assert!(refused.err.contains(candidate), "{candidate}: {refused:?}");
        }
        if name == "TB8-20" {
            let form = "as `TB8-20 of 7i77.0.0`";
            assert!(refused.err.contains(form), "{refused:?}");
        }
        assert_eq!(refused.out, "");
    }
    for name in ["TB8-20 of 7i77.0.1", "7i77.0.1.output-03"] {
        let text = done(&[&["set", name, "on"], &two[..]].concat());
        let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(report["pin"], "hm2_7i97.0.7i77.0.1.output-03");
    }
}

/// Each output of a 7I97 is at two terminals, with a pin that inverts it beside it.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn terminal_of_a_7i97_names_its_output_alone() {
    let of_7i97 = ["on", "--for", "100ms", "--sim", "7i97", "--yes", "--json"];
    for (name, pin) in [
        ("TB5-14", "ssr.00.out-00"),
        ("TB5-23", "ssr.00.out-05"),
        ("OUT0", "ssr.00.out-00"),
        ("out5+", "ssr.00.out-05"),
    ] {
        let text = done(&[&["set", name], &of_7i97[..]].concat());
        let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(report["pin"], format!("hm2_7i97.0.{pin}"), "{name}");
    }
    let unknown = run(&[&["set", "OUT9"], &of_7i97[..]].concat());
    assert_eq!(unknown.code, Some(2), "{unknown:?}");
    let alike = "hm2_7i97.0.ssr.00.out-00 (TB5 pin 13, 14 OUT0-, OUT0+ of hm2_7i97.0) to hm2_7i97.0.ssr.00.out-05";
    assert!(unknown.err.contains(alike), "{unknown:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn terminal_without_an_output_is_refused_with_what_is_there() {
    let sim = ["on", "--for", "1s", "--sim", "7i92-7i77", "--yes"];
    for (name, said) in [
        (
            "TB8-3",
            "`TB8-3` is not an output: hm2_7i92.0.7i77.0.0.input-02 (TB8 pin 3 INPUT2 of 7i77.0.0)",
        ),
        ("input2", "`input2` is not an output: "),
        ("TB8-99", "no terminal `TB8-99`; `mesa pins` lists"),
        ("TB8", "no pin or parameter `TB8`"),
        (
            "OUTPUT77",
            "no output `output77`; the outputs with such a signal are ",
        ),
        // Not the pin with the nearest name, which is at another terminal.
        (
            "OUT0",
            "no output `out0`; the outputs with such a signal are hm2_7i92.0.7i77.0.0.output-00",
        ),
        ("", "no pin or parameter ``"),
        ("TB8-20 of 7i77.0.1", "no "),
    ] {
        let run = run(&[&["set", name], &sim[..]].concat());
        assert_eq!(run.code, Some(2), "{name}: {run:?}");
        assert!(run.err.contains(said), "{name}: {run:?}");
    }
    // The card of the terminal takes no part.
    let mut board = board();
    board.console.run("field 0 0");
    let address = board.address.to_string();
    let run = run(&[
        "set", "TB8-20", "on", "--for", "1s", "--addr", &address, "--yes",
    ]);
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(
        run.err.contains("its remote on 0.0 is offline: "),
        "{run:?}"
    );
}

#[test]
fn remote_is_started_in_the_mode_that_is_given() {
    let sim = ["1", "--for", "1s", "--sim", "7i97,0=7i77-io", "--yes"];
    let count = ["set", "7i77.0.0.analogin0"];
    let without = run(&[&count[..], &sim].concat());
    let said = "analogin0` is a read-only parameter";
    assert!(without.err.contains(said), "{without:?}");
    let with = run(&[&count[..], &sim, &["--mode", "0.0=2"]].concat());
    assert_eq!(with.code, Some(2), "{with:?}");
    assert!(with.err.contains("analogin0` is an input"), "{with:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn set_reports_output_on_counts_down_and_reports_it_off() {
    let mut board = board();
    let mut jog = begin(&board, &[OUTPUT, "on", "--for", "3s"]);
    let err = jog.child().stderr.take().expect("its messages");
    let name = "hm2_7i92.0.7i77.0.0.output-03 (TB8 pin 20 OUTPUT3 of 7i77.0.0)";
    let mut said = Vec::new();
    let begun = std::time::Instant::now();
    for line in BufReader::new(err).lines() {
        let line = line.expect("text");
        assert!(begun.elapsed() < PATIENCE, "{said:?}");
        // The console is asked while the announcement is new.
        if line == format!("mesa: {name} is on, for 3 s") {
            assert_eq!(lit(&mut board), ["remote.0.output-03"], "{line}");
        } else if line == format!("mesa: {name} is off again") {
            assert_eq!(lit(&mut board), [""; 0], "{line}");
        } else if !line.ends_with(" s left") {
            continue;
        }
        said.push(line);
    }
    let run = ended(jog);
    assert_eq!(run.code, Some(0), "{said:?}: {run:?}");
    let [on, left @ .., off] = &said[..] else {
        panic!("{said:?}");
    };
    assert!(on.ends_with("is on, for 3 s"), "{said:?}");
    assert!(off.ends_with("is off again"), "{said:?}");
    assert_eq!(left, ["mesa: 2 s left", "mesa: 1 s left"]);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn countdown_seconds_replace_each_other_on_a_terminal() {
    let jog = "set TB8-20 on --for 30s --sim 7i92-7i77 --yes";
    let Some(terminal) = Terminal::start("countdown", jog) else {
        return;
    };
    terminal.wait_for_text("mesa: 29 s left");
    let text = terminal.wait_for_text("mesa: 27 s left");
    assert_eq!(text.matches(" s left").count(), 1, "{text}");
    terminal.signal("INT");
    let text = terminal.wait_for_text("exit code 130");
    assert!(!text.contains(" s left"), "{text}");
    assert!(text.contains("mesa: ended by SIGINT"), "{text}");
}
