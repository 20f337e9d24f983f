//! Commands that ask before they act: what they would do, and that nothing was done.

use crate::interop::Scratch;
use crate::run::{done, run};
use crate::terminal::Terminal;

/// Commands that ask, with a part of what they would do.
const ASKING: [(&[&str], &str); 13] = [
    (
        &["poke", "6:0x14", "0", "--sim", "7i97"],
        "write 0x0 to 0x0014",
    ),
    (
        &["raw", "01D91A00025A", "--sim", "7i97"],
        "write 1 x 16 bits",
    ),
    (
        &["led", "hostmot2", "--sim", "7i97"],
        "set what the user LEDs show",
    ),
    (&["reload", "--sim", "7i97"], "make the FPGA load"),
    (&["reset", "--sim", "7i97"], "restart the network side"),
    (&["ip", "10.10.10.11", "--sim", "7i97"], "write 10.10.10.11"),
    (
        &[
            "param",
            "set",
            "0.0.NVWatchDogTimeout",
            "80",
            "--sim",
            "7i92-7i77",
        ],
        "write NVWatchDogTimeout = 80",
    ),
    (
        &["doctor", "--sim", "7i97"],
        "start the machine with all outputs off",
    ),
    (
        &[
            "set",
            "7i77.0.0.output-03",
            "on",
            "--for",
            "1s",
            "--sim",
            "7i92-7i77",
        ],
        "set hm2_7i92.0.7i77.0.0.output-03 (TB8 pin 20 OUTPUT3 of 7i77.0.0) to on for 1 s",
    ),
    (
        &[
            "set",
            "pwmgen.00.value",
            "1",
            "--for",
            "1s",
            "--analog",
            "--drive-enable",
            "--sim",
            "7i97",
        ],
        "of hm2_7i97.0",
    ),
    (
        &[
            "wiring",
            "output",
            "--outputs",
            "--timeout",
            "1",
            "--sim",
            "7i92-7i77",
        ],
        "drive 16 digital outputs one after the other",
    ),
    (
        &[
            "wiring",
            "output-03",
            "--outputs",
            "--timeout",
            "1",
            "--sim",
            "7i92-7i77",
        ],
        "drive 1 digital output for",
    ),
    (
        &[
            "wiring",
            "output-03",
            "--outputs",
            "--timeout",
            "1",
            "--sim",
            "7i97,0=7i77-io,1=7i77-io",
        ],
        "TB8 pin 20 of 7i77.0.0; TB8 pin 20 of 7i77.0.1",
    ),
];

#[test]
fn command_without_a_terminal_shows_the_plan_and_needs_yes() {
    for (arguments, would) in ASKING {
        let run = run(arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {run:?}");
        assert_eq!(run.out, "", "{arguments:?}");
        let last = run.err.lines().last().unwrap_or_default();
        assert!(last.starts_with("mesa: "), "{last}");
        assert!(last.contains(": would "), "{last}");
        assert!(last.contains(would), "{would}: {last}");
        assert!(last.ends_with("; nothing was done: add --yes"), "{last}");
    }
}

#[test]
fn action_with_yes_is_announced_before_it_is_done() {
    let poke = ["poke", "6:0x14", "0", "--sim", "7i97", "--yes"];
    let run = run(&poke);
    let said = "127.0.0.1:27181: will write 0x0 to 0x0014 of space 6";
    assert!(run.err.contains(said), "{run:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn no_is_answered_with_what_was_not_done() {
    let Some(terminal) = Terminal::start("consent", "led hostmot2 --sim 7i97") else {
        return;
    };
    let asked = terminal.wait_for_text("Go on? [y/N]");
    let will =
        "mesa: 127.0.0.1:27181: will set what the user LEDs show until the next restart. Go on?";
    assert!(asked.contains(will), "{asked}");
    terminal.type_keys(&["n", "Enter"]);
    let ended = terminal.wait_for_text("exit code 1").replace('\n', "");
    let would = "would set what the user LEDs show until the next restart; nothing was done: the answer was not y";
    assert!(ended.contains(would), "{ended}");
}

#[test]
fn file_that_is_not_replaced_is_named() {
    let scratch = Scratch::new("consent.toml");
    let save = ["param", "save", scratch.path(), "--sim", "7i92-7i77"];
    done(&save);
    let refused = run(&save);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    let path = scratch.path();
    let would = format!("would replace {path}, which already exists; nothing was done: add --yes");
    assert!(refused.err.contains(&would), "{refused:?}");
}
