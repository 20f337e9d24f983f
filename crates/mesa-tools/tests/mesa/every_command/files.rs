//! Unusual files and terminals, for every command that uses one.

use std::fs::{self, File, OpenOptions, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::process::Stdio;

use crate::interop::{Process, Scratch, wait_until};
use crate::run::{Run, command, done, run};

/// Every command that reads a file, with the arguments before and after the file's name.
const READERS: [(&[&str], &[&str]); 6] = [
    (
        &["update", "7i77"],
        &["--at", "0.0", "--sim", "7i97,0=7i77-io:setup"],
    ),
    (&["param", "restore"], &["--sim", "7i97,0=7i77-io"]),
    (&["flash", "write"], &["--sim", "7i97"]),
    (&["flash", "verify"], &["--sim", "7i97"]),
    (&["flash", "restore"], &["--sim", "7i97"]),
    (
        &["sim", "--listen", "127.0.0.1", "--port", "0", "--machine"],
        &[],
    ),
];

/// Result of a command that might read for ever.
fn ended(arguments: &[&str]) -> Run {
    let mut process = Process::new(command(arguments).spawn().expect("mesa starts"));
    wait_until(format_args!("{arguments:?} ends"), || process.has_ended());
    process.output().into()
}

/// A file that no command can use, with a name as of a firmware for a 7I77.
fn hostile(kind: &str) -> (Scratch, &'static str) {
    let scratch = Scratch::new(&format!("7I77-{kind}.toml"));
    let path = scratch.path();
    let said = match kind {
        "huge" => {
            let file = File::create(path).expect("a scratch file");
            file.set_len(1 << 30).expect("a sparse file");
            "longer than"
        }
        "directory" => {
            fs::create_dir_all(path).expect("a directory");
            "no regular file"
        }
        "pipe" => {
            let made = std::process::Command::new("mkfifo").arg(path).status();
            assert!(made.expect("mkfifo").success());
            "no regular file"
        }
        _ => {
            fs::write(path, "").expect("a scratch file");
            ""
        }
    };
    (scratch, said)
}

#[test]
fn file_that_is_none_is_refused_by_every_command_that_reads_one() {
    for kind in ["huge", "directory", "pipe", "empty"] {
        let (scratch, said) = hostile(kind);
        for (before, behind) in READERS {
            let run = ended(&[before, &[scratch.path()], behind, &["--yes"]].concat());
            let is_refused = matches!(run.code, Some(1 | 2)) && run.out.is_empty();
            assert!(is_refused, "{kind}: {before:?}: {run:?}");
            for said in [said, scratch.path()] {
                assert!(
                    run.err.contains(said),
                    "{kind}: {before:?}: {said}: {run:?}"
                );
            }
        }
        let _ = fs::remove_dir(scratch.path());
    }
}

#[test]
fn cabinet_that_an_editor_of_another_system_has_saved_is_read() {
    let machine = ["--sim", "7i97,0=7i77-io"];
    for name in ["crlf.toml", "crlf.json"] {
        let scratch = Scratch::new(name);
        done(&[&["param", "save", scratch.path()], &machine[..]].concat());
        let text = fs::read_to_string(scratch.path()).expect("it was saved");
        let text = format!("\u{feff}{}", text.replace('\n', "\r\n"));
        fs::write(scratch.path(), text).expect("a scratch file");
        let restore = ["param", "restore", scratch.path(), "--dry-run"];
        let text = done(&[&restore[..], &machine].concat());
        assert!(text.contains(" 0 differ"), "{text}");
    }
}

#[test]
fn invalid_file_path_is_refused_before_a_board_is_accessed() {
    let nowhere = ["--addr", "127.0.0.1:1"];
    let directory = env!("CARGO_MANIFEST_DIR");
    for before in [
        &["flash", "backup"][..],
        &["param", "save"],
        &["latency", "--plot"],
        &["wiring", "--timeout", "1", "--report"],
        &["scope", "input-02", "--trigger", "input-02", "--csv"],
        &["doctor", "--passive", "--report"],
        &["report"],
    ] {
        for (place, code, said) in [
            (directory, 2, "no regular file"),
            ("/nowhere/at/all", 1, "No such file"),
            ("/proc/file", 1, "/proc/file"),
        ] {
            let run = run(&[before, &[place], &nowhere].concat());
            assert_eq!(run.code, Some(code), "{before:?} {place}: {run:?}");
            assert!(run.err.contains(said), "{before:?} {place}: {run:?}");
        }
    }
}

/// Where a terminal is asked for its width by `tput`, a line of a simulator costs two programs.
#[test]
fn line_that_goes_to_a_pipe_starts_no_program() {
    let folder = Scratch::new("programs");
    fs::create_dir_all(&folder.0).expect("a folder");
    let (program, started) = (folder.0.join("tput"), folder.0.join("started"));
    let script = format!("#!/bin/sh\necho \"$*\" >> {}\n", started.display());
    fs::write(&program, script).expect("a program");
    fs::set_permissions(&program, Permissions::from_mode(0o755)).expect("its own file");
    let mut mesa = command(&["info", "--sim", "7i97"]);
    let run = Run::from(mesa.env("PATH", &folder.0).output().expect("mesa runs"));
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(run.out.lines().count() > 10, "{run:?}");
    let asked = fs::read_to_string(&started).unwrap_or_default();
    assert_eq!(asked, "", "a line asks for the width of a terminal");
}

/// Every command that writes a file of its own, with the arguments before the file's name.
const WRITERS: [&[&str]; 7] = [
    &["flash", "backup"],
    &["report"],
    &["param", "save"],
    &["latency", "--seconds", "0.1", "--plot"],
    &["doctor", "--passive", "--report"],
    &["wiring", "input-0?", "--timeout", "0.5", "--report"],
    &["scope", "input-02", "--trigger", "input-02", "--csv"],
];

#[test]
fn file_that_is_there_is_replaced_only_after_a_question() {
    let scratch = Scratch::new("kept.txt");
    fs::write(scratch.path(), "mine").expect("a scratch file");
    for before in WRITERS {
        let sim = ["--sim", "7i92-7i77"];
        let refused = run(&[before, &[scratch.path()], &sim].concat());
        assert_eq!(refused.code, Some(2), "{before:?}: {refused:?}");
        let said = "which already exists; nothing was done: add --yes";
        assert!(refused.err.contains(said), "{before:?}: {refused:?}");
        assert_eq!(refused.out, "", "{before:?}");
    }
    assert_eq!(
        fs::read_to_string(scratch.path()).expect("it is there"),
        "mine"
    );
}

#[test]
fn neighbours_of_a_written_file_and_link_targets_are_unchanged() {
    let (saved, beside) = (
        Scratch::new("cabinet.toml"),
        Scratch::new("cabinet.toml.new"),
    );
    let elsewhere = Scratch::new("elsewhere");
    let save = ["param", "save", saved.path(), "--sim", "7i92-7i77", "--yes"];
    fs::write(beside.path(), "mine").expect("a scratch file");
    done(&save);
    assert_eq!(
        fs::read_to_string(beside.path()).expect("it is there"),
        "mine"
    );
    fs::write(elsewhere.path(), "mine").expect("a scratch file");
    fs::remove_file(saved.path()).expect("it was saved");
    std::os::unix::fs::symlink(elsewhere.path(), saved.path()).expect("a link");
    done(&save);
    assert_eq!(
        fs::read_to_string(elsewhere.path()).expect("it is there"),
        "mine"
    );
    assert!(
        fs::read_to_string(saved.path())
            .expect("it is saved")
            .contains("7I77")
    );
}

#[test]
fn csv_and_plot_with_the_same_file_by_any_path_are_refused() {
    let scratch = Scratch::new("a.csv");
    let path = &scratch.0;
    let folder = path.parent().expect("a folder");
    let name = path.file_name().expect("a name");
    let other = folder
        .join(".")
        .join("..")
        .join(folder.file_name().expect("a name"));
    let other = other.join(name).display().to_string();
    let scope = [
        "scope",
        "input-02",
        "--trigger",
        "input-02",
        "--addr",
        "127.0.0.1:1",
    ];
    let refused = run(&[&scope[..], &["--csv", scratch.path(), "--plot", &other]].concat());
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("need a file each"), "{refused:?}");
}

#[test]
fn output_that_cannot_be_printed_is_reported_once_as_an_error() {
    for arguments in [
        &["--help"][..],
        &["flash", "write", "--help"],
        &["--version"],
        &["completions", "bash"],
        &["peek", "0:0x100", "--sim", "7i97"],
        &["peek", "0:0x100", "--sim", "7i97", "--json"],
        &["reset", "--dry-run", "--sim", "7i97"],
    ] {
        let full = OpenOptions::new().write(true).open("/dev/full");
        let mut command = command(arguments);
        command.stdout(Stdio::from(full.expect("a full disk")));
        let run = Run::from(command.output().expect("mesa starts"));
        assert_eq!(run.code, Some(1), "{arguments:?}: {run:?}");
        let said = run.err.matches("No space left").count();
        assert_eq!(said, 1, "{arguments:?}: {run:?}");
    }
}

#[test]
fn colours_are_off_with_no_color() {
    let help = |wanted: bool| {
        let mut command = command(&["--help"]);
        command.env("CLICOLOR_FORCE", "1");
        if wanted {
            command.env_remove("NO_COLOR");
        }
        Run::from(command.output().expect("mesa starts")).out
    };
    assert!(help(true).contains('\x1b'));
    assert!(!help(false).contains('\x1b'));
}
