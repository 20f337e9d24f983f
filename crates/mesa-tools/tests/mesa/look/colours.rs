//! Colours of verdicts: on a terminal only, and never in a pipe.

use std::fs::{File, OpenOptions};
use std::io::Read;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};

use crate::interop::Process;
use crate::run::{command, run};

/// Output of a command on a terminal of 200 columns, without the carriage returns that it adds.
fn on_a_terminal(arguments: &[&str], no_color: &str) -> String {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudoterminal");
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap();
    let size = Winsize {
        ws_row: 50,
        ws_col: 200,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    tcsetwinsize(&master, size).unwrap();
    let path = path.into_string().unwrap();
    let slave = OpenOptions::new().read(true).write(true).open(path);
    let slave = slave.unwrap();
    let mut command = command(arguments);
    let child = command.env("NO_COLOR", no_color).stdout(slave).spawn();
    // The command keeps the terminal open as well.
    drop(command);
    let process = Process::new(child.expect("mesa starts"));
    let mut shown = Vec::new();
    // The end of the command is an error of the terminal.
    let _ = File::from(master).read_to_end(&mut shown);
    process.output();
    String::from_utf8(shown).expect("UTF-8").replace('\r', "")
}

/// A text without the sequences that set a colour.
fn without_colours(text: &str) -> String {
    let mut parts = text.split('\x1b');
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |plain, part| {
        plain + part.split_once('m').expect("a colour").1
    })
}

#[test]
fn verdicts_are_coloured_on_a_terminal_with_the_words_of_a_pipe() {
    let info = ["info", "--sim", "7i97"];
    let coloured = on_a_terminal(&info, "");
    assert!(coloured.starts_with("\x1b[32min order"), "{coloured}");
    assert!(without_colours(&coloured).starts_with("in order: MESA7I97"));
    for plain in [on_a_terminal(&info, "1"), run(&info).out] {
        assert!(plain.starts_with("in order: MESA7I97"), "{plain}");
        assert!(!plain.contains('\x1b'), "{plain}");
    }

    let passive = ["--passive", "--exchanges", "10", "--period", "10000"];
    let doctor = [&["doctor", "--sim", "7i97"][..], &passive].concat();
    let coloured = on_a_terminal(&doctor, "");
    assert!(
        coloured.contains("\x1b[32mok      \x1b[0m network route"),
        "{coloured}"
    );
    assert!(coloured.contains("\x1b[33m"), "{coloured}");
    let plain = run(&doctor).out;
    assert!(!plain.contains('\x1b'), "{plain}");
    // Verdicts of measured figures may differ from run to run.
    let checks = |text: &str| -> Vec<String> {
        let lines = text.lines().filter(|line| !line.starts_with(' '));
        let checks = lines.map(|line| line.get(9..).unwrap_or_default());
        let checks = checks.map(|line| line.split(": ").next().unwrap_or_default().to_owned());
        checks.skip(1).collect()
    };
    assert_eq!(checks(&without_colours(&coloured)), checks(&plain));
}
