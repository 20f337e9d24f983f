//! End of `mesa wiring`: by refusal, by the operator, by a signal, by the board.

use std::fs;

use serde_json::Value;

use crate::check::set::board;
use crate::check::wiring::{Guided, INPUTS, entry};
use crate::interop::{Process, Scratch};
use crate::run::{Run, command, hold_against_schema, run};
use crate::terminal::Terminal;

#[test]
fn invalid_arguments_are_refused_before_anything_starts() {
    let sim = ["--sim", "7i92-7i77"];
    for (arguments, code, said) in [
        (&["TB8"][..], 2, "--timeout"),
        (&["--timeout", "0.1"], 2, "0.5 to 3600"),
        (&["--timeout", "nan"], 2, "0.5 to 3600"),
        (&["--timeout", "1", "--for", "1"], 2, "--outputs"),
        (
            &["--timeout", "1", "--outputs", "--for", "11"],
            2,
            "0.1 to 10",
        ),
        (&["TB99", "--timeout", "1"], 1, "no terminal fits"),
        // Drive enables and analog outputs are never driven.
        (
            &["TB5", "--timeout", "1", "--outputs", "--yes"],
            1,
            "no terminal fits",
        ),
        (
            &["output", "--timeout", "1", "--outputs"],
            2,
            "TB7 pin 17, 18, 19, 20, 21, 22, 23, 24 of 7i77.0.0; nothing was done: add --yes",
        ),
        (
            &["--timeout", "1", "--report", "/nowhere/a.txt"],
            1,
            "/nowhere/a.txt",
        ),
        (
            &["--timeout", "1", "--report", "/dev/null"],
            2,
            "no regular file",
        ),
    ] {
        let run = run(&[&["wiring"], arguments, &sim[..]].concat());
        assert_eq!(run.code, Some(code), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
        assert_eq!(run.out, "", "{arguments:?}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn file_that_is_there_is_replaced_only_with_consent() {
    let file = Scratch::new("wiring-old.txt");
    fs::write(&file.0, "the old report").expect("written");
    let all = ["wiring", "input-00", "--sim", "7i97", "--timeout", "0.5"];
    let all = [&all[..], &["--report", file.path()]].concat();
    let refused = run(&all);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("already exists"), "{refused:?}");
    assert_eq!(fs::read_to_string(&file.0).expect("kept"), "the old report");
    let replaced = run(&[&all[..], &["--yes"]].concat());
    assert_eq!(replaced.code, Some(1), "{replaced:?}");
    assert_eq!(fs::read_to_string(&file.0).expect("new"), replaced.out);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn signal_ends_it_with_the_report_so_far() {
    for (signal, code) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
        let mut board = board();
        let file = Scratch::new(&format!("wiring-{signal}.json"));
        let mut guided = Guided::begin(&board, &[INPUTS, "--report", file.path()]);
        guided.actuates(&mut board, 0);
        guided.says("[2/10] ");
        guided.process.signal(signal);
        guided.says(&format!("ended by SIG{signal}"));
        let run = guided.ended();
        assert_eq!(run.code, Some(code), "{run:?}");
        assert!(
            run.out
                .contains("1 of 10 terminals in order; ended by a signal"),
            "{run:?}"
        );
        let report = fs::read_to_string(&file.0).expect("a report");
        let report: Value = serde_json::from_str(&report).expect("JSON");
        hold_against_schema("wiring", &report);
        assert_eq!(report["outcome"], "stopped");
        assert_eq!(entry(&report, "input-00")["verdict"], "ok");
        assert_eq!(entry(&report, "input-01")["verdict"], "not_checked");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn board_that_dies_is_no_change_and_the_report_is_kept() {
    let mut board = board();
    let file = Scratch::new("wiring-dead.txt");
    let mut guided = Guided::begin(&board, &[INPUTS, "--report", file.path()]);
    guided.actuates(&mut board, 0);
    guided.says("[2/10] ");
    board.kill();
    guided.says("NOT VALID, and waited for: the board does not answer any more");
    guided.types("");
    guided.says("  NOT VALID: the board does not answer any more");
    guided.types("q");
    guided.says("not all of it could be stopped");
    let run = guided.ended();
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(run.out.contains("1 of 10 terminals in order"), "{run:?}");
    assert_eq!(fs::read_to_string(&file.0).expect("a report"), run.out);
}

/// The terminal breaks lines anywhere, so that the command breaks them at spaces before.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn no_terminal_is_broken_on_a_narrow_screen() {
    for columns in [40, 80, 120] {
        let name = format!("wiring-{columns}");
        let arguments = "wiring '*7i77.0.0.input-0?' --sim 7i92-7i77";
        let Some(terminal) = Terminal::start_with(&name, arguments, [columns, 70]) else {
            return;
        };
        let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let asked = "[1/10] TB8 pin 1 INPUT0 (7i77.0.0.input-00): actuate it now; it is off";
        terminal.wait_for(asked, |text| words(text).contains(asked));
        terminal.type_keys(&["q", "Enter"]);
        let text = words(&terminal.wait_for_text("exit code 1"));
        for n in 0..10 {
            let line = format!(
                "TB8 pin {} INPUT{n} (7i77.0.0.input-0{n}) not checked",
                n + 1
            );
            assert!(text.contains(&line), "{columns}: {line}: {text}");
        }
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn wiring_goes_on_if_its_output_is_not_read() {
    let mut board = board();
    let file = Scratch::new("wiring-pipe.txt");
    let mut guided = Guided::begin(&board, &["*7i77.0.0.input-00", "--report", file.path()]);
    guided.process.stop_reading();
    guided.actuates(&mut board, 0);
    let run = guided.ended();
    assert_eq!(run.code, Some(0), "{run:?}");
    let report = fs::read_to_string(&file.0).expect("a report");
    assert!(report.contains("1 of 1 terminal in order"), "{report}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn board_that_another_program_drives_is_left_alone() {
    let mut board = board();
    let address = board.address.to_string();
    let other = ["pins", "--addr", &address, "--seconds", "600"];
    let mut other = Process::new(command(&other).spawn().expect("mesa starts"));
    board.wait_for_packets(1000);
    let refused = run(&["wiring", "--addr", &address, "--timeout", "1"]);
    other.signal("INT");
    let other = Run::from(other.output());
    assert_eq!(refused.code, Some(1), "{refused:?}");
    // Where a busy computer has held the other one back, its watchdog has bitten meanwhile.
    let reasons = [
        "another program or host drives",
        "no other program drives it",
    ];
    assert!(
        reasons.iter().any(|reason| refused.err.contains(reason)),
        "{refused:?}"
    );
    assert!(other.err.contains("outputs were never on"), "{other:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn guide_in_a_terminal_ends_with_the_report_on_the_screen() {
    let mut board = board();
    let arguments = format!("wiring '{INPUTS}' --addr {}", board.address);
    let Some(terminal) = Terminal::start("wiring", &arguments) else {
        return;
    };
    let text = terminal
        .wait_for_text("[1/10] TB8 pin 1 INPUT0 (7i77.0.0.input-00): actuate it now; it is off");
    assert!(
        text.contains("10 terminals. Enter skips one, b and Enter goes back"),
        "{text}"
    );
    board.console.run("input 0 0 on");
    terminal.wait_for_text("  on; let it go");
    board.console.run("input 0 0 off");
    terminal.wait_for_text("[2/10] ");
    terminal.type_keys(&["Enter"]);
    terminal.wait_for_text("[3/10] ");
    terminal.type_keys(&["b", "Enter"]);
    let again = |text: &str| text.matches("[2/10] ").count() == 2;
    terminal.wait_for("the second one again", again);
    board.console.run("input 0 2 on");
    terminal.wait_for_text("TB8 pin 3 INPUT2 (7i77.0.0.input-02) changed instead: exchanged?");
    terminal.type_keys(&["q", "Enter"]);
    let text = terminal.wait_for_text("exit code 1");
    let lines = [
        "mesa: outputs were never on; the ports are stopped",
        "1 of 10 terminals in order; ended before all were checked",
        "TB8 pin 1 INPUT0 (7i77.0.0.input-00)   ok: off to on",
        "TB8 pin 2 INPUT1 (7i77.0.0.input-01)   skipped",
        "TB8 pin 3 INPUT2 (7i77.0.0.input-02)   not checked",
    ];
    for line in lines {
        assert!(text.contains(line), "{line}:\n{text}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn control_c_in_a_terminal_ends_it_with_the_report() {
    let arguments = format!("wiring '{INPUTS}' --sim 7i92-7i77");
    let Some(terminal) = Terminal::start("wiring-c", &arguments) else {
        return;
    };
    terminal.wait_for_text("[1/10] ");
    terminal.type_keys(&["C-c"]);
    let text = terminal.wait_for_text("exit code 130");
    assert!(text.contains("ended by SIGINT"), "{text}");
    assert!(
        text.contains("0 of 10 terminals in order; ended by a signal"),
        "{text}"
    );
}
