//! The files that `mesa hal` writes for a board run in LinuxCNC on that board: the driver, every
//! pin's signal, the emergency stop, and the drives, which nothing enables.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::linuxcnc::{Machine, SETTLE, alone, skipped};

/// Values of the board that stay off whatever LinuxCNC does.
type Drives = &'static [(&'static str, &'static str)];

const DRIVES_7I77: Drives = &[
    ("1", "remote.1.analogena"),
    ("1", "remote.1.spinena"),
    ("1", "remote.1.analogout0"),
    ("1", "remote.1.analogout5"),
];

const DRIVES_7I97: Drives = &[
    ("board", "board.enable0"),
    ("board", "board.enable4"),
    ("board", "board.enable5"),
    ("board", "board.analogout0"),
    ("board", "board.analogout5"),
];

fn directory(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("skeleton-{name}"))
}

fn is(expected: &'static str) -> impl Fn(&str) -> bool {
    move |value| value == expected
}

/// Asserts that every signal of a written file exists, on the pins that the file names.
fn check_signals(machine: &mut Machine, directory: &Path, file: &str, at_least: usize) {
    let text = fs::read_to_string(directory.join(file)).expect("it was written");
    let shown = machine.hal("show sig");
    // A signal's line ends with its name; the lines of its pins follow.
    let mut linked = Vec::new();
    let mut signal = "";
    for line in &shown {
        let words: Vec<_> = line.split_whitespace().collect();
        match words[..] {
            ["==>" | "<==" | "<=>", pin] => linked.push((signal, pin)),
            [_, _, name] => signal = name,
            _ => {}
        }
    }
    let mut count = 0;
    for line in text.lines().filter(|line| line.starts_with("net ")) {
        let (line, _) = line.split_once("  #").unwrap_or((line, ""));
        let mut words = line.split_whitespace().skip(1);
        let signal = words.next().expect("a signal");
        for pin in words.filter(|word| !["<=", "=>", "<=>"].contains(word)) {
            assert!(linked.contains(&(signal, pin)), "{line}: {shown:#?}");
            count += 1;
        }
    }
    println!("{count} pins on signals in {file}");
    assert!(count > at_least, "{text}");
}

/// Asserts that an input of the board shows on its signal, a hand-turned encoder in its own units,
/// and that a signal switches an output.
fn check_signals_follow(machine: &mut Machine, (input, signal): (&str, &str)) {
    for _ in 0..2 {
        machine.expect_signal(signal, is("FALSE"));
        machine.board.run(&format!("input {input} on"));
        machine.expect_signal(signal, is("TRUE"));
        machine.board.run(&format!("input {input} off"));
    }
    machine.expect_signal(signal, is("FALSE"));
    machine.board.run("turn 2 20");
    // The file's 1000 counts per unit.
    machine.expect_signal("encoder-02-velocity", |velocity| {
        let velocity: f64 = velocity.parse().expect("a number");
        (velocity - 20.0).abs() < 2.0
    });
    machine.board.run("turn 2 0");
    machine.hal("sets 7i77-0-0-output-03 true");
    machine.expect_board("0", "remote.0.output-03", |on| on == 1.0);
    machine.hal("sets 7i77-0-0-output-03 false");
    machine.expect_board("0", "remote.0.output-03", |on| on == 0.0);
}

fn check_drives_are_off(machine: &mut Machine, drives: Drives) {
    for (what, name) in drives {
        // An analog output of a 7I97 is a PWM: a few millivolts of 10 V.
        machine.expect_board(what, name, |value| value.abs() < 0.02);
    }
}

/// The unwired button counts as pressed. When it is released, LinuxCNC goes on, and no drive is
/// enabled; when it is pressed, everything stops.
fn check_emergency_stop(machine: &mut Machine, drives: Drives) {
    press(machine, "estop.reset", "estop-network-ok");
    machine.expect_signal("estop-ok", is("FALSE"));
    machine.hal("sets estop-pressed false");
    press(machine, "estop.reset", "estop-ok");
    machine.expect_signal("joint-0-enable", is("FALSE"));
    press(machine, "machine.on", "joint-0-enable");
    check_drives_are_off(machine, drives);
    machine.hal("sets estop-pressed true");
    machine.expect_signal("estop-ok", is("FALSE"));
    machine.expect_signal("joint-0-enable", is("FALSE"));
    machine.hal("sets estop-pressed false");
    machine.expect_signal("estop-ok", is("FALSE"));
}

/// A card that is pulled stops its port, as hostmot2 does it, and that the machine, until the port
/// is switched off and on as board.hal says.
fn check_pulled_card(machine: &mut Machine) {
    press(machine, "estop.reset", "estop-ok");
    let port = "hm2_7i92.0.sserial.port-0";
    machine.hal(&format!("setp {port}.fault-lim 200"));
    machine.board.run("unplug 2");
    machine.expect_signal("port-0-runs", is("FALSE"));
    machine.expect_signal("estop-ports-ok", is("FALSE"));
    machine.expect_signal("estop-ok", is("FALSE"));
    machine.board.run("plug 2");
    machine.hal(&format!("setp {port}.fault-lim 1000000"));
    machine.expect_signal("port-0-runs", is("FALSE"));
    // A late packet can spoil a start of hostmot2's.
    for _ in 0..30 {
        for run in ["false", "true"] {
            machine.hal(&format!("setp {port}.run {run}"));
            std::thread::sleep(Duration::from_millis(300));
        }
        if machine.signal("port-0-runs") == "TRUE" {
            break;
        }
    }
    press(machine, "estop.reset", "estop-ok");
}

/// Presses a button of LinuxCNC's screen until a signal is on: on a busy machine a thread of 1 kHz
/// can stand still for longer than LinuxCNC holds a request.
fn press(machine: &mut Machine, button: &str, signal: &str) {
    let wait = || std::thread::sleep(Duration::from_millis(300));
    let begun = Instant::now();
    while machine.signal(signal) != "TRUE" {
        assert!(
            begun.elapsed() < 4 * SETTLE,
            "{button} does not lead to {signal}"
        );
        machine.hal(&format!("setp halui.{button} true"));
        wait();
        machine.hal(&format!("setp halui.{button} false"));
        wait();
    }
}

#[test]
fn linuxcnc_runs_with_files_written_for_a_7i92_7i77_and_7i72() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let directory = directory("7i92");
    let remotes: &[_] = &["7i77.0.0", "7i77.0.1", "7i72.0.2"];
    let board = ("--board 7i92-7i77 --remote 2=7i72", remotes);
    let mut machine = Machine::load_written("hm2_7i92.0", board, ("linuxcnc", &directory));
    check_signals(&mut machine, &directory, "board.hal", 60);
    check_emergency_stop(&mut machine, DRIVES_7I77);
    check_signals_follow(&mut machine, ("0 7", "7i77-0-0-input-07"));
    machine.hal("sets 7i72-0-2-output-40 true");
    machine.expect_board("2", "remote.2.output-40", |on| on == 1.0);
    check_drives_are_off(&mut machine, DRIVES_7I77);
    check_pulled_card(&mut machine);
    machine.stop();
}

#[test]
fn all_of_linuxcnc_runs_with_what_is_written_of_a_7i97() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let directory = directory("7i97");
    let board = ("--board 7i97 --remote 0=7i77-io", &["7i77.0.0"][..]);
    let mut machine = Machine::load_written("hm2_7i97.0", board, ("linuxcnc", &directory));
    check_signals(&mut machine, &directory, "board.hal", 60);
    check_emergency_stop(&mut machine, DRIVES_7I97);
    check_signals_follow(&mut machine, ("board 9", "inmux-00-input-09"));
    machine.stop();
}

/// Every prepared line at once: the emergency stop's input, drive enables, switches, spindle,
/// coolant, probe, handwheel.
#[test]
fn prepared_lines_of_a_7i97_work_where_they_stand() {
    prepared_lines_work(
        "hm2_7i97.0",
        ("--board 7i97 --remote 0=7i77-io", &["7i77.0.0"][..]),
        ("--axes XYZ", "7i97"),
    );
}

#[test]
fn prepared_lines_of_a_7i92_with_a_7i76_work_where_they_stand() {
    prepared_lines_work(
        "hm2_7i92.0",
        ("--board 7i92-7i76", &["7i76.0.0"][..]),
        ("--axes XYYZ", "7i76"),
    );
}

fn prepared_lines_work(prefix: &'static str, board: (&str, &[&str]), (axes, name): (&str, &str)) {
    if skipped() {
        return;
    }
    let _alone = alone();
    let directory = directory(&format!("prepared-{name}"));
    let how = format!("prepared {axes}");
    let mut machine = Machine::load_written(prefix, board, (&how, &directory));
    check_signals(&mut machine, &directory, "board.hal", 60);
    check_signals(&mut machine, &directory, "motion.hal", 50);
    machine.expect_signal("estop-ok", is("FALSE"));
    machine.stop();
}

#[test]
fn a_7i97_alone_runs_on_the_bench() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let directory = directory("bench");
    let board = ("--board 7i97 --remote 0=7i77-io", &["7i77.0.0"][..]);
    let mut machine = Machine::load_written("hm2_7i97.0", board, ("bench", &directory));
    check_signals(&mut machine, &directory, "board.hal", 60);
    check_signals_follow(&mut machine, ("0 31", "7i77-0-0-input-31"));
    check_drives_are_off(&mut machine, DRIVES_7I97);
    // By hand: the signal of the voltage, and the pin without a signal, because it turns drives on.
    machine.hal("sets pwmgen-03-value 5");
    machine.hal("setp hm2_7i97.0.pwmgen.03.enable true");
    machine.expect_board("board", "board.analogout3", |volts| {
        (volts - 5.0).abs() < 0.03
    });
    machine.stop();
}
