//! Failures with `--json`: one JSON object, the last line of standard error.

use serde_json::Value;

use crate::every_command::manual::commands;
use crate::run::{Run, hold_against_schema, run};

/// A failure of each command by its board or its files, with the exit code.
const FAILING: [(&[&str], i32); 25] = [
    (&["report", "/nowhere/a.html", "--sim", "7i97"], 1),
    (&["list", "127.0.0.1/33"], 2),
    (&["info", "--addr", "127.0.0.1:1"], 1),
    (&["pins", "--addr", "127.0.0.1:1"], 1),
    (&["pins", "no-such-pin", "--sim", "7i97"], 1),
    (&["watch", "--addr", "127.0.0.1:1"], 2),
    (
        &[
            "scope",
            "in",
            "--trigger",
            "in",
            "--csv",
            "/nowhere/a.csv",
            "--sim",
            "7i97",
        ],
        1,
    ),
    (&["doctor", "--sim", "7i97"], 2),
    (&["wiring", "--timeout", "1", "--addr", "127.0.0.1:1"], 1),
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
        2,
    ),
    (&["latency", "--addr", "127.0.0.1:1"], 1),
    (&["hal", "--addr", "127.0.0.1:1"], 1),
    (&["param", "list", "--addr", "127.0.0.1:1"], 1),
    (
        &[
            "update",
            "7i77",
            "/nowhere/a.bin",
            "--at",
            "0.0",
            "--sim",
            "7i92-7i77",
        ],
        2,
    ),
    (&["flash", "write", "/nowhere/a.bit", "--sim", "7i97"], 1),
    (&["ip", "10.10.10.11", "--sim", "7i97"], 2),
    (&["led"], 2),
    (&["reload", "--sim", "7i97"], 2),
    (&["reset", "--sim", "7i97"], 2),
    (&["peek", "5:0", "--sim", "7i97"], 2),
    (&["poke", "6:0x14", "0", "--sim", "7i97"], 2),
    (&["raw", "0", "--sim", "7i97"], 2),
    (
        &[
            "sim",
            "--machine",
            "/nowhere/a.toml",
            "--listen",
            "127.0.0.1",
        ],
        2,
    ),
    (&["man", "/proc/no/such/folder"], 1),
    (&["completions", "no-shell"], 2),
];

/// The failure of a run, which has to be what the run without `--json` has printed.
fn failure(arguments: &[&str], code: i32) -> Value {
    let run: Run = run(&[arguments, &["--json"]].concat());
    assert_eq!(run.code, Some(code), "{arguments:?}: {run:?}");
    let last = run.err.lines().last().unwrap_or_default();
    let failure: Value = serde_json::from_str(last)
        .unwrap_or_else(|error| panic!("{arguments:?}: {error}: {run:?}"));
    hold_against_schema("failure", &failure);
    assert_eq!(failure["exit_code"], code, "{arguments:?}");
    let other = run.err.lines().filter(|line| line.starts_with('{'));
    assert_eq!(other.count(), 1, "{arguments:?}: {run:?}");
    if !run.out.is_empty() {
        serde_json::from_str::<Value>(&run.out).expect("nothing but JSON");
    }
    failure
}

#[test]
fn failing_command_prints_one_json_object_with_its_exit_code() {
    for (arguments, code) in FAILING {
        let json = failure(arguments, code);
        let message = json["message"].as_str().expect("a text");
        let text = run(arguments).err;
        // The time of an answer differs, and a screen fails without `--json` in another way.
        let differs = [" after the request", "a full screen has no JSON output"];
        let differs = differs.iter().any(|part| message.contains(part));
        if !text.starts_with("error: ") && !differs {
            assert!(text.contains(message), "{arguments:?}: {message}: {text}");
        }
        if let Some(advice) = json["advice"].as_str() {
            assert!(message.contains(advice), "{arguments:?}: {message}");
        }
    }
}

#[test]
fn command_list_is_complete_and_unknown_options_fail_as_json() {
    for command in commands() {
        let fails = |(arguments, _): &(&[&str], i32)| arguments.first() == Some(&&*command);
        assert!(FAILING.iter().any(fails), "{command}");
        let json = failure(&[&command, "--no-such-option"], 2);
        let message = json["message"].as_str().expect("a text");
        assert!(message.contains("--no-such-option"), "{command}: {json}");
        assert!(
            json["advice"].to_string().contains("--help"),
            "{command}: {json}"
        );
    }
    let json = failure(&[], 2);
    assert!(json["advice"].to_string().contains("--help"), "{json}");
}

#[test]
fn advice_is_a_member_of_its_own() {
    let json = failure(&["led", "hostmot2", "--sim", "7i97"], 2);
    assert_eq!(json["advice"], "add --yes");
    let json = failure(&["pins", "no-such-pin", "--sim", "7i97"], 1);
    assert_eq!(json["advice"], "`mesa pins` without a pattern has all");
    let json = failure(&["set", "no-such", "on", "--for", "1s", "--sim", "7i97"], 2);
    assert!(json["advice"].to_string().contains("mesa pins"), "{json}");
}
