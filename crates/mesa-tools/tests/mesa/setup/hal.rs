//! `mesa hal`: content of the files, conditions for writing them, and a run of the generated
//! program. `tests/mesa/interop_linuxcnc` loads them in LinuxCNC.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read};
use std::net::Ipv4Addr;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::interop::board::Board;
use crate::interop::{Process, Scratch, example};
use crate::run::{Run, command, done, json, run};

const NAMES: [&str; 6] = [
    "machine.ini",
    "board.hal",
    "motion.hal",
    "tool.tbl",
    "bench.hal",
    "main.rs",
];

fn text(found: &Value, name: &str) -> String {
    let files = found["files"].as_array().expect("files");
    let mut named = files.iter().filter(|file| file["path"] == name);
    let file = named.next().unwrap_or_else(|| panic!("no {name}"));
    file["text"].as_str().expect("a text").to_owned()
}

fn has(text: &str, lines: &[&str]) {
    for line in lines {
        assert!(text.contains(line), "{line}:\n{text}");
    }
}

#[test]
fn all_pins_except_drive_enables_have_a_signal_and_terminal() {
    let found = json(&[
        "hal",
        "--sim",
        "7i92-7i77,0=7i77-io:2,2=7i72",
        "--mode",
        "0.0=2",
    ]);
    assert_eq!(found["board"], "hm2_7i92.0");
    let board = text(&found, "board.hal");
    has(
        &board,
        &[
            "\n# 7i77.0.0: mode 2\n# 7i77.0.1: mode 0\n# 7i72.0.2",
            "\nloadrt hm2_eth board_ip=[HOSTMOT2]BOARD_IP config=[HOSTMOT2]CONFIG\n",
            "\nsetp hm2_7i92.0.encoder.05.scale [JOINT_5]ENCODER_SCALE\n",
            "\nnet encoder-00-index-enable <=> hm2_7i92.0.encoder.00.index-enable  # TB3 pin 7, 8 IDX0, /IDX0",
            "\nnet 7i77-0-0-input-02 <= hm2_7i92.0.7i77.0.0.input-02  # TB8 pin 3 INPUT2\n",
            "\nnet 7i77-0-0-output-10 => hm2_7i92.0.7i77.0.0.output-10  # TB7 pin 19 OUTPUT10\n",
            "\nnet 7i77-0-0-fieldvoltage <= hm2_7i92.0.7i77.0.0.fieldvoltage  # in ",
            "\nnet 7i77-0-1-analogout0 => hm2_7i92.0.7i77.0.1.analogout0  # TB5 pin 4 AOUT0 in ",
            "\nsetp hm2_7i92.0.7i77.0.1.analogout0-minlim -10\n",
            "\nnet 7i72-0-2-output-47 => hm2_7i92.0.7i72.0.2.output-47  # TB2 pin 24 OUTPUT47\n",
            "\n# net joint-0-enable => hm2_7i92.0.7i77.0.1.analogena  # TB5 pin 1, 2, 5",
            "\n# net joint-5-enable => hm2_7i92.0.7i77.0.1.spinena  # TB5 pin 21, 22 ENA5-, ENA5+\n",
        ],
    );
    for pin in ["analogena", "spinena", "-not", "fault-", "running", "gpio"] {
        let mut nets = board.lines().filter(|line| line.starts_with("net "));
        assert!(!nets.any(|line| line.contains(pin)), "{pin}:\n{board}");
    }
    let other = json(&["hal", "--sim", "7i92-7i77", "--driver", "mesa_eth"]);
    let other = text(&other, "board.hal");
    let line = "\n\nloadrt mesa_eth board_ip=[HOSTMOT2]BOARD_IP config=[HOSTMOT2]CONFIG\n";
    has(&other, &[line]);
    assert!(
        !other.contains("hostmot2\n") && !other.contains("hm2_eth"),
        "{other}"
    );
    has(
        &text(&found, "machine.ini"),
        &[
            "\n# TODO: these files were made from a simulated board\nBOARD_IP = 10.10.10.10\n",
            "\nCONFIG = \"sserial_port_0=200xxxxx\"\n",
            "\nJOINTS = 6\nKINEMATICS = trivkins coordinates=XYZABC\n",
            "\n[JOINT_3]\nTYPE = ANGULAR\n",
        ],
    );
    has(
        &text(&found, "motion.hal"),
        &[
            "\nnet estop-pressed => estop-button.fault-in\n",
            "\nsets estop-pressed true\n",
            "\n# net estop-pressed <= hm2_7i92.0.7i77.0.0.input-00-not  # TB8 pin 1 INPUT0\n",
            "\nnet 7i77-0-1-analogout5 <= pid.5.output\n",
        ],
    );
}

#[test]
fn a_7i97_has_its_own_outputs_and_those_of_a_card_beside_them() {
    let found = json(&["hal", "--sim", "7i97,0=7i77-io,1=7i77-analog"]);
    let board = text(&found, "board.hal");
    has(
        &board,
        &[
            "\nsetp hm2_7i97.0.pwmgen.00.offset-mode 1\n",
            "\nsetp hm2_7i97.0.pwmgen.05.scale 10\n",
            "\nnet pwmgen-00-value => hm2_7i97.0.pwmgen.00.value  # TB3 pin 4 AOUT0 in V\n",
            "\nnet inmux-00-input-10 <= hm2_7i97.0.inmux.00.input-10  # TB5 pin 4 IN10\n",
            "\nnet ssr-00-out-02 => hm2_7i97.0.ssr.00.out-02  # TB5 pin 17, 18 OUT2-, OUT2+\n",
            "\nnet gpio-043-in <= hm2_7i97.0.gpio.043.in  # P1 pin 11, DB25 pin 6 IO43\n",
            "\n# net joint-4-enable => hm2_7i97.0.pwmgen.04.enable  # TB3 pin 17, 18 ENA4-, ENA4+\n",
            "\n# net 7i77-0-1-analogena => hm2_7i97.0.7i77.0.1.analogena",
        ],
    );
    let motion = text(&found, "motion.hal");
    has(&motion, &["\nnet pwmgen-05-value <= pid.5.output\n"]);
    assert!(!motion.contains("7i77-0-1"), "{motion}");
}

#[test]
fn outputs_that_dither_here_do_so_in_linuxcnc() {
    let dithers = |machine| {
        let board = text(&json(&["hal", "--sim", machine]), "board.hal");
        let lines = board.lines().filter(|line| line.contains(".dither"));
        lines.map(str::to_owned).collect::<Vec<_>>()
    };
    let all = (0..6).map(|n| format!("setp hm2_7i97.0.pwmgen.{n:02}.dither 1"));
    assert_eq!(dithers("7i97t"), all.collect::<Vec<_>>());
    assert_eq!(dithers("7i97"), [""; 0]);
}

/// The drive's times, and each letter of an axis with two motors, once.
#[test]
fn given_axes_have_joints_and_no_other_output_has_one() {
    let found = json(&["hal", "--sim", "7i92-7i76", "--axes", "xyyz"]);
    let ini = text(&found, "machine.ini");
    has(
        &ini,
        &[
            "\nJOINTS = 4\nKINEMATICS = trivkins coordinates=XYYZ kinstype=BOTH\n",
            "\nTOOL_TABLE = tool.tbl\n",
            "\nHALFILE = board.hal\nHALFILE = motion.hal\n",
            "\n# HOME_SEARCH_VEL = ",
        ],
    );
    assert_eq!(ini.matches("[AXIS_Y]").count(), 1);
    assert!(!ini.contains("[JOINT_4]"), "{ini}");
    let board = text(&found, "board.hal");
    assert!(!board.contains("stepgen.04.position-scale"), "{board}");
    has(
        &board,
        &["\n# net stepgen-04-enable => hm2_7i92.0.stepgen.04.enable"],
    );
    assert!(text(&found, "tool.tbl").starts_with("T1 "));
    let refused = run(&["hal", "--sim", "7i92-7i76", "--axes", "XYZABC"]);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("outputs for 5"), "{refused:?}");
    assert_eq!(run(&["hal", "--sim", "7i97", "--axes", "XQ"]).code, Some(2));
}

/// No line of the two files names a signal or a pin that is not there yet, and each input and
/// output is used once.
#[test]
fn prepared_lines_use_each_terminal_once() {
    for (machine, axes) in [
        ("7i97,0=7i77-io", "XYZ"),
        ("7i92-7i76", "XYZA"),
        ("7i92-7i77", "XYZABC"),
    ] {
        for driver in ["hm2_eth", "mesa_eth"] {
            let found = json(&["hal", "--sim", machine, "--axes", axes, "--driver", driver]);
            let (board, motion) = (text(&found, "board.hal"), text(&found, "motion.hal"));
            let uncommented = (board + &motion).replace("\n# net ", "\nnet ");
            let nets = uncommented.lines().filter(|line| line.starts_with("net "));
            let mut linked = std::collections::BTreeMap::new();
            for net in nets {
                let net = net.split("  #").next().expect("a line");
                let mut words = net.split_whitespace().skip(1);
                let signal = words.next().expect("a signal");
                for pin in words.filter(|word| !word.contains('=')) {
                    let before = linked.insert(pin.to_owned(), signal);
                    assert!(before.is_none(), "{pin} on {before:?} and {signal}: {net}");
                }
            }
            assert!(linked.len() > 100, "{}", linked.len());
        }
    }
}

/// Inputs that keep their last value while a card is pulled, and positions that a fault has spoilt,
/// stop the machine: only this project's driver knows of them.
#[test]
fn validity_of_every_card_is_in_the_chain_of_mesa_eth() {
    let arguments = ["hal", "--sim", "7i92-7i77,2=7i72", "--axes", "XYZ"];
    let ours = json(&[&arguments[..], &["--driver", "mesa_eth"]].concat());
    let motion = text(&ours, "motion.hal");
    has(
        &motion,
        &[
            "\nnet board-valid <= hm2_7i92.0.valid => inputs-valid-0.in-00\n",
            "\nnet 7i77-0-0-valid <= hm2_7i92.0.7i77.0.0.valid => inputs-valid-0.in-01\n",
            "\nnet 7i77-0-1-valid <= hm2_7i92.0.7i77.0.1.valid => inputs-valid-0.in-02\n",
            "\nnet 7i72-0-2-valid <= hm2_7i92.0.7i72.0.2.valid => inputs-valid-0.in-03\n",
            "\nnet inputs-invalid => estop-inputs.fault-in\n",
            "\nnet position-lost => estop-position.fault-in\n",
            "\nnet joint-2-unhome <= unhome-2.and => halui.joint.2.unhome\n",
            "\nnet estop-reset => hm2_7i92.0.rearm\n",
            "\nnet estop-reset => hm2_7i92.0.7i72.0.2.rearm\n",
        ],
    );
    for word in ["port_state", "estop-ports"] {
        assert!(!motion.contains(word), "{word}: {motion}");
    }
    let theirs = text(&json(&arguments), "motion.hal");
    // hostmot2 stops the whole port of a card that fails.
    has(
        &theirs,
        &[
            "\nnet port-0-state-number <= hm2_7i92.0.sserial.port-0.port_state => port-0-state.in\n",
            "\nnet port-0-runs <= port-0-runs.out => ports-run.in-00\n",
            "\nnet ports-stopped => estop-ports.fault-in\n",
            "=> estop-ports.ok-in\n",
        ],
    );
    for word in [".valid", ".rearm", "unhome", "unsure"] {
        assert!(!theirs.contains(word), "{word}: {theirs}");
    }
}

/// 7 and 8 encoders of that firmware share inputs that are at no terminal of a 7I77.
#[test]
fn encoder_without_a_terminal_has_no_line() {
    let firmware = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/transcripts/firmwares/7I92-7I77_7I76D_34.txt"
    );
    let found = json(&["hal", "--sim", firmware, "--axes", "XYZ"]);
    let board = text(&found, "board.hal");
    has(&board, &["\nnet encoder-05-position <= "]);
    // Prepared lines are no exception.
    let all = found.to_string();
    for encoder in ["encoder-06", "encoder-07", "encoder.06", "encoder.07"] {
        assert!(!all.contains(encoder), "{encoder}: {found:#}");
    }
}

/// Mesa and LinuxCNC recommend it: jitter of the thread is no jitter of the position then.
#[test]
fn positions_are_sampled_by_a_timer_where_there_is_one() {
    let board = text(&json(&["hal", "--sim", "7i92-7i76"]), "board.hal");
    has(
        &board,
        &[
            "\nsetp hm2_7i92.0.dpll.01.timer-us -50\nsetp hm2_7i92.0.encoder.timer-number 1\nsetp hm2_7i92.0.stepgen.timer-number 1\n",
        ],
    );
}

#[test]
fn board_without_servo_outputs_has_a_joint_that_follows_itself() {
    let found = json(&["hal", "--sim", "7i92-7i77,1=7i72"]);
    let motion = text(&found, "motion.hal");
    has(
        &motion,
        &["\nnet joint-0-command <= joint.0.motor-pos-cmd => joint.0.motor-pos-fb\n"],
    );
    assert!(!motion.contains("pid"), "{motion}");
    has(
        &text(&found, "machine.ini"),
        &["\nJOINTS = 1\n", "coordinates=X\n"],
    );
    assert!(!text(&found, "main.rs").contains("Joint"));
}

#[test]
fn step_generators_are_joints_with_settings_and_not_enabled() {
    let found = json(&["hal", "--sim", "7i92-7i76"]);
    let board = text(&found, "board.hal");
    has(
        &board,
        &[
            "\n# 7i76.0.0: mode 0\n",
            "\nsetp hm2_7i92.0.stepgen.04.position-scale [JOINT_4]STEP_SCALE\n",
            "\nsetp hm2_7i92.0.stepgen.04.dirhold [JOINT_4]DIRHOLD\n",
            "\nnet stepgen-01-position-fb <= hm2_7i92.0.stepgen.01.position-fb  # TB2 pin 8, 9, 10, 11 ",
            "\n# net joint-0-enable => hm2_7i92.0.stepgen.00.enable  # TB2 pin 2, 3, 4, 5 ",
            "\nnet 7i76-0-0-spinout => hm2_7i92.0.7i76.0.0.spinout",
            "\nnet encoder-00-position <= hm2_7i92.0.encoder.00.position\n",
        ],
    );
    let mut nets = board.lines().filter(|line| line.starts_with("net "));
    assert!(!nets.any(|line| line.contains(".enable")), "{board}");
    let motion = text(&found, "motion.hal");
    has(
        &motion,
        &[
            "\nnet stepgen-04-position-cmd <= joint.4.motor-pos-cmd\n",
            "\nnet stepgen-04-position-fb => joint.4.motor-pos-fb\n",
        ],
    );
    assert!(!motion.contains("pid"), "{motion}");
    let ini = text(&found, "machine.ini");
    has(&ini, &["\nJOINTS = 5\n", "\nSTEPGEN_MAXACCEL = 1.25\n"]);
    assert!(!ini.contains("ENCODER_SCALE"), "{ini}");
    let program = text(&found, "main.rs");
    has(
        &program,
        &["stepgen_00_position_cmd: pins.output(\"hm2_7i92.0.stepgen.00.position-cmd\")?"],
    );
    // Servo axes come first, and LinuxCNC has letters for nine.
    let both = json(&["hal", "--sim", "7i97-7i76"]);
    let motion = text(&both, "motion.hal");
    has(
        &motion,
        &[
            "\nnet pwmgen-05-value <= pid.5.output\n",
            "\nnet stepgen-02-position-cmd <= joint.8.motor-pos-cmd\n",
        ],
    );
    assert!(!motion.contains("pid.6"), "{motion}");
    has(
        &text(&both, "board.hal"),
        &[
            "# 7I76 TB2 pin 2, ",
            "\n# net joint-6-enable => hm2_7i97.0.stepgen.00.enable",
        ],
    );
}

/// LinuxCNC has nine joints here: no axis beyond them, and no spindle, is enabled with one of them.
#[test]
fn enable_that_belongs_to_no_joint_has_a_signal_of_its_own() {
    let found = json(&["hal", "--sim", "5i25-7i77-7i76"]);
    let board = text(&found, "board.hal");
    has(
        &board,
        &[
            "\n# net joint-8-enable => hm2_5i25.0.stepgen.02.enable",
            "\n# net stepgen-03-enable => hm2_5i25.0.stepgen.03.enable",
            "\n# net 7i76-0-3-spinena => hm2_5i25.0.7i76.0.3.spinena",
        ],
    );
    assert_eq!(board.matches("# net joint-0-enable =>").count(), 1);
}

#[test]
fn program_is_the_one_that_is_compiled_here() {
    for (machine, name) in [
        ("7i92-7i77", "hal_skeleton"),
        ("5i25-7i77", "hal_skeleton_pci"),
    ] {
        let text = text(&json(&["hal", "--sim", machine]), "main.rs");
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/mesa/setup");
        let file = format!("{folder}/{name}.rs");
        if std::env::var_os("BLESS").is_some() {
            fs::write(&file, &text).expect("it can be written");
        }
        let expected = fs::read_to_string(&file).expect("the program");
        assert_eq!(text, expected, "BLESS=1 writes {file} anew");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn program_runs_until_a_signal_and_enables_no_drive() {
    let mut board = Board::start(
        Ipv4Addr::LOCALHOST,
        &["--board", "7i92-7i77", "--port", "0"],
    );
    let cycles = |board: &mut Board| -> u64 {
        let network = board.console.show("network");
        network["network.received.packets"]
            .parse()
            .expect("a number")
    };
    let mut started = Command::new(example("hal_skeleton"))
        .arg(board.address.to_string())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts");
    let mut said = BufReader::new(started.stderr.take().expect("piped"));
    let mut program = Process::new(started);
    let mut line = String::new();
    said.read_line(&mut line).expect("it runs");
    assert_eq!(line, "hm2_7i92.0 runs; Ctrl-C ends it\n");
    let before = cycles(&mut board);
    while cycles(&mut board) < before + 100 {
        assert!(program.child().try_wait().expect("a child").is_none());
    }
    let truth = board.console.show("all");
    for name in ["analogena", "spinena", "analogout0"] {
        let value: f64 = truth[&format!("remote.1.{name}")]
            .parse()
            .expect("a number");
        assert_eq!(value, 0.0, "{name}");
    }
    program.signal("INT");
    assert_eq!(program.output().status.code(), Some(130));
    said.read_to_string(&mut line).expect("its end");
    assert!(!line.contains("rror"), "{line}");
    assert_eq!(board.console.show("all")["board.watchdog-bitten"], "1");
}

#[test]
fn files_are_replaced_only_when_that_is_asked_for() {
    let scratch = Scratch::new("hal-replaced");
    let directory = &scratch.0;
    let out = directory.to_str().expect("UTF-8");
    let printed = done(&["hal", "--sim", "7i97", "--out", out]);
    let names: Vec<_> = printed.lines().map(Path::new).collect();
    assert_eq!(names, NAMES.map(|name| directory.join(name)));
    let read = |name: &str| fs::read_to_string(directory.join(name)).expect("it is there");
    let written = read("board.hal");
    assert!(written.contains("hm2_7i97.0"), "{written}");

    fs::write(directory.join("board.hal"), "mine").expect("writable");
    fs::remove_file(directory.join("machine.ini")).expect("it is there");
    let refused = run(&["hal", "--sim", "7i97", "--out", out]);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    let there = [
        "board.hal",
        "motion.hal",
        "tool.tbl",
        "bench.hal",
        "main.rs",
    ];
    let there = there.map(|name| directory.join(name).display().to_string());
    let what = format!(
        "would replace {}, which already exist; nothing was done",
        there.join(", ")
    );
    assert!(refused.err.contains(&what), "{refused:?}");
    assert_eq!(read("board.hal"), "mine");
    assert!(!directory.join("machine.ini").exists(), "all or none");

    done(&["hal", "--sim", "7i97", "--out", out, "--yes"]);
    assert_eq!(read("board.hal"), written);
    assert!(directory.join("machine.ini").exists());

    fs::remove_file(directory.join("main.rs")).expect("it is there");
    fs::create_dir(directory.join("main.rs")).expect("a directory");
    let device = run(&["hal", "--sim", "7i97", "--out", out, "--yes"]);
    assert_eq!(device.code, Some(2), "{device:?}");
    assert!(
        device.err.contains("main.rs: no regular file"),
        "{device:?}"
    );
}

#[test]
fn all_files_are_printed_without_a_directory() {
    let printed = done(&["hal", "--sim", "7i97"]);
    let mut rest = &*printed;
    for name in NAMES {
        let (_, behind) = rest.split_once(&format!("==> {name} <==\n")).expect(name);
        rest = behind;
    }
    // The reader has closed the pipe.
    let mut started = command(&["hal", "--sim", "7i97"])
        .spawn()
        .expect("it starts");
    drop(started.stdout.take());
    let ended = Run::from(Process::new(started).output());
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(!ended.err.contains("panic"), "{ended:?}");
}

#[test]
fn unreachable_board_and_unwritable_directory_are_reported() {
    let silent = run(&["hal", "--addr", "127.93.9.1"]);
    assert_eq!(silent.code, Some(1), "{silent:?}");
    assert!(silent.err.contains("127.93.9.1:27181: "), "{silent:?}");
    let file = Scratch::new("hal-file");
    File::create(&file.0).expect("a file");
    let place = file.0.join("below");
    for place in ["/proc/nothing", place.to_str().expect("UTF-8")] {
        let place = run(&["hal", "--sim", "7i97", "--out", place]);
        assert_eq!(place.code, Some(1), "{place:?}");
        assert_eq!(place.out, "");
    }
    let mode = ["hal", "--sim", "7i92-7i77", "--mode", "0.0"];
    assert_eq!(run(&mode).code, Some(2));
    assert_eq!(run(&["hal"]).code, Some(2));
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn signal_ends_it_with_nothing_written_and_the_board_stopped() {
    // Late replies, to slow the command down.
    let slow = ["--board", "7i92-7i77", "--port", "0", "--late", "0.5"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &slow);
    let scratch = Scratch::new("hal-stopped");
    let directory = &scratch.0;
    let out = directory.to_str().expect("UTF-8");
    let address = board.address.to_string();
    let started = command(&["hal", "--addr", &address, "--out", out]).spawn();
    let mut process = Process::new(started.expect("it starts"));
    while board.console.show("network")["network.received.packets"] == "0" {}
    process.signal("INT");
    let ended = Run::from(process.output());
    assert_eq!(ended.code, Some(130), "{ended:?}");
    assert!(
        ended.err.contains("ended by SIGINT; nothing was written"),
        "{ended:?}"
    );
    assert!(!directory.exists());
    assert_eq!(board.console.show("all")["board.watchdog-bitten"], "1");
}
