//! `mesa wiring --outputs`: the state of an output comes from the simulated board's console.

use serde_json::Value;

use crate::check::set::safety::board_without_watchdog;
use crate::check::set::{board, lit, wait_for};
use crate::check::wiring::Guided;
use crate::interop::board::Board;
use crate::run::{done, hold_against_schema, run};
use crate::terminal::Terminal;

const OUTPUTS: &str = "*7i77.0.0.output-0?";

fn begin(board: &Board) -> Guided {
    let time = ["--for", "1.5", "--json", "--yes"];
    let guided = Guided::begin(board, &[&[OUTPUTS, "--outputs"], &time[..]].concat());
    let consent = guided.says("drive 10 digital outputs one after the other");
    assert!(
        consent.contains("no drive enables and no analog outputs"),
        "{consent}"
    );
    assert!(consent.contains("TB8 pin 17, 18, 19"), "{consent}");
    guided
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn one_output_is_on_at_a_time_and_the_answer_sets_its_verdict() {
    let mut board = board();
    let mut guided = begin(&board);
    for (n, answer, words) in [
        (0, "y", "  ok"),
        (1, "n", "  DID NOT COME ON"),
        (2, "the green lamp", "  INSTEAD CAME ON: the green lamp"),
        (3, "", "  skipped"),
    ] {
        let named = guided.says(&format!("[{}/10] ", n + 1));
        let terminal = format!(
            "TB8 pin {} OUTPUT{n} (7i77.0.0.output-0{n}): driven",
            17 + n
        );
        assert!(named.contains(&terminal), "{named}");
        wait_for(&mut board, 0, &format!("output-0{n}"), "1");
        assert_eq!(lit(&mut board), [format!("remote.0.output-0{n}")]);
        guided.types(answer);
        guided.says(words);
        assert!(!lit(&mut board).contains(&format!("remote.0.output-0{n}")));
    }
    // Output 4 is driven again, then back to output 3.
    guided.says("[5/10] ");
    wait_for(&mut board, 0, "output-04", "1");
    wait_for(&mut board, 0, "output-04", "0");
    std::thread::sleep(std::time::Duration::from_millis(500));
    guided.types("a");
    wait_for(&mut board, 0, "output-04", "1");
    guided.types("b");
    guided.says("[4/10] ");
    guided.types("y");
    guided.says("  ok");
    // A shorted load ends an output's check with the reason; the next output is driven all the
    // same.
    guided.says("[5/10] ");
    wait_for(&mut board, 0, "output-04", "1");
    board.console.run("shorted 0 4 on");
    let failed = guided.says("  FAILED: 7i77.0.0 is offline: ");
    assert!(failed.contains("output overloaded"), "{failed}");
    board.console.run("shorted 0 4 off");
    guided.says("[6/10] ");
    guided.types("");
    guided.says("[7/10] ");
    wait_for(&mut board, 0, "output-06", "1");
    guided.types("q");
    guided.says("all outputs are off, and the ports are stopped");
    let run = guided.ended();
    assert_eq!(lit(&mut board), [""; 0]);
    assert_eq!(run.code, Some(1), "{run:?}");
    let report: Value = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("wiring", &report);
    let terminals = report["terminals"].as_array().expect("a list");
    let verdicts: Vec<&Value> = terminals.iter().map(|row| &row["verdict"]).collect();
    let expected = ["ok", "no_change", "other_changed", "ok", "failed"];
    assert_eq!(verdicts[..5], expected, "{report:#}");
    assert_eq!(verdicts[6..], ["not_checked"; 4], "{report:#}");
    assert_eq!(terminals[2]["said"], "the green lamp");
    assert!(terminals.iter().all(|row| row["kind"] == "output"));
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn signal_and_a_board_that_dies_end_it_with_the_output_off() {
    let mut board = board();
    let mut guided = Guided::begin(&board, &[OUTPUTS, "--outputs", "--for", "10", "--yes"]);
    guided.says("[1/10] ");
    wait_for(&mut board, 0, "output-00", "1");
    guided.process.signal("INT");
    guided.says("ended by SIGINT");
    guided.says("all outputs are off");
    let run = guided.ended();
    assert_eq!(run.code, Some(130), "{run:?}");
    assert_eq!(lit(&mut board), [""; 0]);

    let mut guided = Guided::begin(&board, &[OUTPUTS, "--outputs", "--for", "10", "--yes"]);
    guided.says("[1/10] ");
    wait_for(&mut board, 0, "output-00", "1");
    board.kill();
    guided.says("  FAILED: the board does not answer any more");
    guided.types("q");
    let run = guided.ended();
    assert_eq!(run.code, Some(1), "{run:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn remote_lost_with_its_output_on_is_named_and_no_success() {
    let mut board = board_without_watchdog();
    let flags = ["--for", "10", "--yes", "--slow-watchdog"];
    let mut guided = Guided::begin(&board, &[&[OUTPUTS, "--outputs"], &flags[..]].concat());
    guided.says("[1/10] ");
    wait_for(&mut board, 0, "output-00", "1");
    board.console.run("unplug 0");
    guided.says("  FAILED: ");
    guided.types("q");
    let said = guided.says("7i77.0.0 was not reached");
    assert!(!said.contains("all outputs are off"), "{said}");
    assert!(
        said.contains("switch off the power of the remote"),
        "{said}"
    );
    let run = guided.ended();
    assert_eq!(run.code, Some(1), "{run:?}");
    assert_eq!(lit(&mut board), ["remote.0.output-00"], "it said so");
}

/// By then, the operator who agreed may have a hand at the plug.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn unreachable_output_is_not_driven_later_without_new_consent() {
    let mut board = board();
    let arguments = format!(
        "wiring '{OUTPUTS}' --outputs --for 1 --addr {}",
        board.address
    );
    let Some(terminal) = Terminal::start("wiring-away", &arguments) else {
        return;
    };
    terminal.wait_for_text("Go on? [y/N]");
    terminal.type_keys(&["y", "Enter"]);
    terminal.wait_for_text("[1/10] TB8 pin 17 OUTPUT0 (7i77.0.0.output-00): y and Enter drives it");
    board.console.run("unplug 0");
    terminal.wait_for_text("NOT VALID: 7i77.0.0 is offline");
    terminal.type_keys(&["y", "Enter"]);
    std::thread::sleep(std::time::Duration::from_millis(500));
    board.console.run("plug 0");
    let asked = |text: String| text.matches("y and Enter drives it").count();
    let begun = std::time::Instant::now();
    // More often on a busy computer, where the remote goes offline again by its own watchdog.
    let is_again = || asked(terminal.wait_for_text("NOT VALID")) >= 2;
    while !is_again() || begun.elapsed().as_secs() < 2 {
        assert!(begun.elapsed().as_secs() < 30, "it is not asked anew");
        assert_eq!(lit(&mut board), [""; 0], "it has to be asked anew");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    agree(&terminal);
    terminal.type_keys(&["y", "Enter"]);
    terminal.wait_for_text("[2/10] ");
    terminal.type_keys(&["q", "Enter"]);
    terminal.wait_for_text("exit code 1");
    assert_eq!(lit(&mut board), [""; 0]);
}

/// Agrees to each question until an output is driven. An agreement is discarded if the remote goes
/// offline before it is used, which happens on a busy computer.
fn agree(terminal: &Terminal) {
    let mut answered = 0;
    terminal.wait_for("an output that is driven", |text| {
        let asked = text.matches("y and Enter drives it").count();
        if asked > answered {
            answered = asked;
            terminal.type_keys(&["y", "Enter"]);
        }
        text.contains("driven; did it come on?")
    });
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn outputs_with_remote_watchdog_off_are_not_driven_without_flag() {
    let mut board = board();
    let address = board.address.to_string();
    let to = ["--addr", &address, "--yes"];
    let set = ["param", "set", "0.0.NVWatchDogTimeout", "0"];
    done(&[&set[..], &to].concat());
    let wiring = [
        "wiring",
        OUTPUTS,
        "--outputs",
        "--timeout",
        "0.5",
        "--for",
        "0.1",
    ];
    let refused = run(&[&wiring[..], &to].concat());
    assert_eq!(refused.code, Some(1), "{refused:?}");
    assert!(refused.err.contains("NVWatchDogTimeout 0"), "{refused:?}");
    assert_eq!((refused.out.as_str(), lit(&mut board)), ("", vec![]));
    let driven = run(&[&wiring[..], &to, &["--slow-watchdog"]].concat());
    assert!(
        driven.err.contains("Beware: the own watchdog"),
        "{driven:?}"
    );
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn output_in_a_terminal_is_driven_only_with_its_own_consent() {
    let mut board = board();
    let arguments = format!(
        "wiring '{OUTPUTS}' --outputs --for 5 --addr {}",
        board.address
    );
    let Some(terminal) = Terminal::start("wiring-out", &arguments) else {
        return;
    };
    terminal.wait_for_text("Go on? [y/N]");
    terminal.type_keys(&["y", "Enter"]);
    terminal.wait_for_text("[1/10] TB8 pin 17 OUTPUT0 (7i77.0.0.output-00): y and Enter drives it");
    assert_eq!(lit(&mut board), [""; 0]);
    terminal.type_keys(&["Enter"]);
    terminal.wait_for_text("[2/10] TB8 pin 18 OUTPUT1 (7i77.0.0.output-01): y and Enter drives it");
    terminal.type_keys(&["y", "Enter"]);
    wait_for(&mut board, 0, "output-01", "1");
    assert_eq!(lit(&mut board), ["remote.0.output-01"]);
    terminal.wait_for_text("driven; did it come on?");
    terminal.type_keys(&["y", "Enter"]);
    terminal.wait_for_text("[3/10] ");
    terminal.type_keys(&["q", "Enter"]);
    let text = terminal.wait_for_text("exit code 1");
    let line = "TB8 pin 18 OUTPUT1 (7i77.0.0.output-01)  ok";
    assert!(text.contains(line), "{text}");
    assert_eq!(lit(&mut board), [""; 0]);
}

#[test]
fn no_enable_or_voltage_nor_output_without_option_is_driven() {
    for arguments in [&["output"][..], &["analogena", "--outputs", "--yes"]] {
        let sim = ["--sim", "7i92-7i77", "--timeout", "0.5"];
        let run = run(&[&["wiring"], arguments, &sim[..]].concat());
        assert_eq!(run.code, Some(1), "{run:?}");
        assert!(run.err.contains("no terminal fits"), "{run:?}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn option_drives_relays_and_outputs_only() {
    let all = ["wiring", "--outputs", "--yes", "--json", "--for", "0.1"];
    let some = ["OUT?*", "--timeout", "0.5", "--sim", "7i97"];
    let run = run(&[&all[..], &some[..]].concat());
    let report: Value = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("wiring", &report);
    let terminals = report["terminals"].as_array().expect("a list");
    let names: Vec<&str> = terminals
        .iter()
        .filter_map(|row| row["pin"].as_str())
        .collect();
    assert_eq!(names.len(), 6, "{names:?}");
    let are_relays = names.iter().all(|name| name.contains(".ssr.00.out-0"));
    assert!(are_relays, "{names:?}");
    // No operator answers. On a busy computer a watchdog bites.
    let is_unknown = |row: &Value| row["verdict"] == "skipped" || row["verdict"] == "failed";
    assert!(terminals.iter().all(is_unknown), "{report:#}");
}
