//! Completion in a shell: commands, machines, and pins, terminals and signals of a machine.

use std::env;
use std::net::Ipv4Addr;
use std::path::Path;

use crate::every_command::manual::commands;
use crate::interop::board::Board;
use crate::interop::mesa;
use crate::run::{Run, command, done};

/// Sources the script, and completes the last word of a line. Prints a candidate on each line.
const SESSION: &str = r#"
source <(mesa completions bash) || exit 1
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMP_TYPE=9
_clap_complete_mesa mesa "${!#}" ""
printf '%s\n' "${COMPREPLY[@]}"
"#;

/// Candidates of bash for the last word of a line.
fn candidates(line: &[&str]) -> Vec<String> {
    let mut bash = std::process::Command::new("bash");
    bash.args(["-c", SESSION, "bash"])
        .args(line)
        .env_remove("MESA_ADDR");
    let folder = mesa().parent().expect("a folder").to_owned();
    let path = env::var_os("PATH").unwrap_or_default();
    let folders = std::iter::once(folder).chain(env::split_paths(&path));
    bash.env("PATH", env::join_paths(folders).expect("a search path"));
    bash.current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
    let run = Run::from(bash.output().expect("bash runs"));
    assert_eq!((run.code, &*run.err), (Some(0), ""), "{line:?}: {run:?}");
    run.out
        .lines()
        .filter(|line| !line.is_empty())
        .map(str::to_owned)
        .collect()
}

#[test]
fn commands_options_and_machines_are_completed() {
    let all = candidates(&["mesa", ""]);
    for command in commands() {
        assert!(all.contains(&command), "{command}: {all:?}");
    }
    assert_eq!(candidates(&["mesa", "wir"]), ["wiring"]);
    assert_eq!(candidates(&["mesa", "set", "--drive"]), ["--drive-enable"]);
    let machines = candidates(&["mesa", "info", "--sim", "7i9"]);
    let named = ["7i97", "7i97-7i77", "7i97t", "7i92-7i77", "7i92-7i76"];
    assert_eq!(machines, [&named[..], &["7i97-7i76"]].concat());
    let files = candidates(&["mesa", "info", "--sim", "examples/"]);
    assert!(
        files.contains(&"examples/mill.toml".to_owned()),
        "{files:?}"
    );
    assert!(
        !files.contains(&"examples/linuxcnc.sh".to_owned()),
        "{files:?}"
    );
}

#[test]
fn pins_terminals_and_signals_of_a_simulation_are_completed() {
    let set = ["mesa", "set", "--sim", "7i92-7i77"];
    let of = |typed: &str| candidates(&[&set[..], &[typed]].concat());
    let outputs: Vec<_> = (0..16).map(|n| format!("7i77.0.0.output-{n:02}")).collect();
    assert_eq!(of("7i77.0.0.output-"), outputs);
    // Outputs 0 to 7 are at pins 17 to 24.
    assert_eq!(
        of("tb8-2"),
        ["TB8-20", "TB8-21", "TB8-22", "TB8-23", "TB8-24"]
    );
    assert_eq!(
        of("OUTPUT1"),
        [
            "OUTPUT1", "OUTPUT10", "OUTPUT11", "OUTPUT12", "OUTPUT13", "OUTPUT14", "OUTPUT15"
        ]
    );
    assert_eq!(of("7i77.0.0.input"), [""; 0], "no outputs");
    let pins = [
        "mesa",
        "pins",
        "--sim",
        "examples/mill.toml",
        "7i77.0.0.input-3",
    ];
    let inputs = ["input-30", "input-30-not", "input-31", "input-31-not"];
    assert_eq!(
        candidates(&pins),
        inputs.map(|input| format!("7i77.0.0.{input}"))
    );
    let scope = [
        "mesa",
        "scope",
        "--sim",
        "7i97",
        "--trigger",
        "encoder.00.pos",
    ];
    assert!(candidates(&scope).contains(&"encoder.00.position".to_owned()));
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn no_board_is_asked_for_candidates() {
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    let before = board.received();
    let address = board.address.to_string();
    let line = ["mesa", "set", "--addr", &address, "gpio"];
    assert_eq!(candidates(&line), [""; 0]);
    assert_eq!(board.received(), before);
}

#[test]
fn other_shells_get_the_same_candidates() {
    for shell in ["zsh", "fish", "elvish"] {
        let script = done(&["completions", shell]);
        assert!(
            script.contains("MESA_COMPLETE") && script.contains("mesa"),
            "{script}"
        );
        let line = ["--", "mesa", "set", "--sim", "7i92-7i77", "TB8-2"];
        let mut ask = command(&line);
        ask.env("MESA_COMPLETE", shell)
            .env("_CLAP_COMPLETE_INDEX", "4");
        let run = Run::from(ask.output().expect("mesa starts"));
        let lines = run.out.lines().filter(|line| !line.is_empty());
        let found: Vec<&str> = lines.collect();
        assert_eq!(
            found,
            ["TB8-20", "TB8-21", "TB8-22", "TB8-23", "TB8-24"],
            "{shell}: {run:?}"
        );
    }
}
