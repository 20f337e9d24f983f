//! Moves of all of LinuxCNC with either driver, on the same simulated machine: LinuxCNC's sample
//! configuration for servos, and what `mesa hal` writes. One word of the files changes.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc::Receiver;

use crate::halcmd::{Halcmd, LOADS, PATIENCE, Started, alone, lines_of, skipped};
use crate::session::built;
use crate::tools::{realtime, skip};

/// Where the Debian package has the sample.
const SAMPLE: &str = "/usr/share/doc/linuxcnc/examples/sample-configs/by_interface/mesa/hm2-servo";
const JOINT: usize = 1;
const COUNTS_PER_UNIT: f64 = 81_920.0;
/// All of it is acceleration, in which an axis falls behind by what the cycle is late.
const JOG: f64 = 0.25;
/// Number of jogs there and back of a run, and the most that a busy computer may spoil.
const JOGS: usize = 2;
const MAX_JOGS: usize = 20;
/// Permitted ratio of the following errors. One cycle more between an encoder and its drive, which
/// is as fast as a cycle, makes 1.5 of them.
const NO_LARGER: f64 = 1.15;

/// The texts of a configuration by name.
type Files = BTreeMap<String, String>;

/// What a driver made of the machine.
#[derive(Debug)]
struct Moves {
    /// Counts of the motor at the joint's zero.
    zero: f64,
    /// Upper quartile of the following error of the best jog there and back, in units. A pause of the
    /// computer spoils some of its moments, and some jogs.
    following: f64,
}

#[test]
fn the_sample_configuration_homes_and_follows_with_one_word_changed() {
    if skipped() {
        return;
    }
    let Some(files) = sample() else {
        skip(&format!("{SAMPLE} is not installed with LinuxCNC"));
        return;
    };
    // The sample is in inches.
    compare(
        "sample",
        &files,
        ["DRIVER=hm2_eth", "DRIVER=mesa_eth"],
        25.4,
    );
}

#[test]
fn what_mesa_hal_writes_homes_and_follows_with_one_word_changed() {
    if skipped() {
        return;
    }
    compare("written", &written(), ["hm2_eth", "mesa_eth"], 1.0);
}

/// Runs a configuration with both drivers. `unit` is in mm.
fn compare(name: &str, files: &Files, words: [&str; 2], unit: f64) {
    let _alone = alone();
    let changed = with_one_word_changed(files, words);
    let theirs = drive(&format!("{name}-hm2_eth"), files, |_| false);
    let ours = drive(&format!("{name}-mesa_eth"), &changed, |following| {
        following > NO_LARGER * theirs.following
    });
    let apart = (ours.zero - theirs.zero) / COUNTS_PER_UNIT * unit;
    let ratio = ours.following / theirs.following;
    println!("{name}: {theirs:?}, {ours:?}: homed {apart:.5} mm apart, following {ratio:.2}");
    assert!(apart.abs() < 0.01, "homed {apart} mm apart");
    assert!(ratio <= NO_LARGER, "following error: {ratio}");
}

/// LinuxCNC's sample for the simulated board; `None` if it is not installed.
fn sample() -> Option<Files> {
    let text = |name: &str| fs::read_to_string(Path::new(SAMPLE).join(name)).ok();
    // The sample is for boards on PCI: hm2_eth wants an address.
    let line = "loadrt [HOSTMOT2](DRIVER) config=[HOSTMOT2](CONFIG)";
    let hal = text("hm2-servo.hal")?;
    assert!(hal.contains(line), "{hal}");
    let hal = hal.replace(line, &format!("{line} board_ip=[HOSTMOT2](BOARD_IP)"));
    let ini = merged(&text("5i20.ini")?, include_str!("servo/sample.ini"));
    let files = [
        ("machine.ini", ini),
        ("hm2-servo.hal", hal),
        ("tool.tbl", text("tool.tbl")?),
    ];
    Some(files.map(|(name, text)| (name.to_owned(), text)).into())
}

/// What `mesa hal` writes for the simulated machine.
fn written() -> Files {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("written");
    let _ = fs::remove_dir_all(&folder);
    let mut hal = Command::new(mesa());
    hal.args(["hal", "--sim"]).arg(machine());
    let done = hal.arg("--out").arg(&folder).output().expect("mesa runs");
    assert!(done.status.success(), "{done:?}");
    let names = ["machine.ini", "board.hal", "motion.hal"];
    let text = |name| fs::read_to_string(folder.join(name)).expect("it is written");
    let mut files: Files = names.map(|name| (name.to_owned(), text(name))).into();
    let ini = merged(&files["machine.ini"], include_str!("servo/written.ini"));
    files.insert("machine.ini".into(), ini);
    files
}

/// An INI file with other values; `HALCMD` is added, not replaced.
fn merged(ini: &str, values: &str) -> String {
    let mut lines: Vec<String> = ini.lines().map(str::to_owned).collect();
    let mut section = "";
    for line in values.lines() {
        if line.starts_with('[') {
            section = line;
            continue;
        }
        let Some(key) = key_of(line) else { continue };
        let begin = lines.iter().position(|line| line.trim() == section);
        let begin = begin.unwrap_or_else(|| panic!("no {section}")) + 1;
        let rest = lines[begin..].iter();
        let end = begin + rest.take_while(|line| !line.starts_with('[')).count();
        let mut old = (begin..end).filter(|&at| key_of(&lines[at]) == Some(key));
        match old.next() {
            Some(at) if key != "HALCMD" => line.clone_into(&mut lines[at]),
            _ => lines.insert(end, line.to_owned()),
        }
    }
    lines.join("\n") + "\n"
}

fn key_of(line: &str) -> Option<&str> {
    let (key, _) = line.split_once('=')?;
    let key = key.trim();
    (!key.starts_with('#')).then_some(key)
}

/// The same files, in which exactly one word is another one.
fn with_one_word_changed(files: &Files, [from, to]: [&str; 2]) -> Files {
    let change = |word: &str| {
        let trimmed = word.trim();
        if trimmed == from {
            word.replace(from, to)
        } else {
            word.to_owned()
        }
    };
    let mut changed = Files::new();
    let mut count = 0;
    for (name, text) in files {
        let new: String = text
            .split_inclusive(char::is_whitespace)
            .map(change)
            .collect();
        let words = text.split_whitespace().zip(new.split_whitespace());
        count += words.filter(|(old, new)| old != new).count();
        changed.insert(name.clone(), new);
    }
    assert_eq!(count, 1, "words `{from}` in {:?}", files.keys());
    changed
}

fn machine() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/linuxcnc/servo/machine.toml")
}

/// The command `mesa`, as the test command of the README builds it.
fn mesa() -> PathBuf {
    let mut build = Command::new(env!("CARGO"));
    build.args(["build", "--quiet", "--all-features", "--bin", "mesa"]);
    let target = built("..");
    if target.ends_with("release/deps/..") {
        build.arg("--release");
    }
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let done = build
        .current_dir(root)
        .arg("--target-dir")
        .arg(target.join(".."))
        .status();
    assert!(done.expect("cargo runs").success(), "mesa builds");
    target.join("mesa")
}

/// Homes and jogs with a configuration; a jog that is `too_large` is repeated.
fn drive(name: &str, files: &Files, too_large: impl Fn(f64) -> bool) -> Moves {
    let mut linuxcnc = LinuxCnc::load(name, files);
    linuxcnc.hal("on");
    linuxcnc.hal(&format!("home {JOINT}"));
    let mut best = f64::INFINITY;
    for jog in 0..MAX_JOGS {
        if jog >= JOGS && !too_large(best) {
            break;
        }
        let errors = [JOG, -JOG].map(|distance| linuxcnc.jog(distance));
        best = best.min(upper_quartile(errors.concat()));
    }
    linuxcnc.hal("off");
    let zero = linuxcnc.zero();
    linuxcnc.halcmd.end();
    Moves {
        zero,
        following: best,
    }
}

fn upper_quartile(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() * 3 / 4]
}

/// All of LinuxCNC with `screen.py`, and the console of `mesa sim`.
struct LinuxCnc {
    halcmd: Halcmd,
    to_board: File,
    of_board: Receiver<String>,
}

impl LinuxCnc {
    /// hm2_eth is retried where it never retries itself.
    fn load(name: &str, files: &Files) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a folder");
        for (name, text) in files {
            fs::write(folder.join(name), text).expect("it is written");
        }
        let screen = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/linuxcnc/servo/screen.py");
        fs::copy(screen, folder.join("screen.py")).expect("a copy");
        let mut said = Vec::new();
        for attempt in 1..=LOADS {
            let mut linuxcnc = Self::start(&folder);
            match linuxcnc.halcmd.try_hal("getp .watchdog.has_bit") {
                Ok(_) => {
                    println!("{name} loaded at attempt {attempt}");
                    return linuxcnc;
                }
                Err(messages) => said = messages,
            }
            linuxcnc.halcmd.end();
        }
        panic!("{name} does not load: {said:#?}");
    }

    fn start(folder: &Path) -> Self {
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        let here = package.join("tests/linuxcnc");
        let mut sandbox = realtime(package.join("../../examples/linuxcnc.sh"));
        sandbox.arg("--machine").arg(machine()).arg("--");
        sandbox
            .arg(here.join("with_component.sh"))
            .arg(built("libmesa_eth.so"));
        sandbox.arg(here.join("servo/linuxcnc.sh")).arg(folder);
        sandbox.env("MESA", built("../mesa"));
        let pipes = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let Started {
            halcmd,
            to_board,
            from_board,
        } = Halcmd::start("hm2_7i97.0", sandbox, pipes);
        Self {
            halcmd,
            to_board,
            of_board: lines_of(from_board),
        }
    }

    fn hal(&mut self, command: &str) -> Vec<String> {
        let answer = self.halcmd.hal(command);
        let messages = answer.iter().filter(|line| line.starts_with('!'));
        messages.for_each(|message| println!("{command}: {message}"));
        answer
    }

    /// Following errors of the moments of a jog, without their signs.
    fn jog(&mut self, distance: f64) -> Vec<f64> {
        let answer = self.hal(&format!("jog {JOINT} {distance} 1"));
        let words = answer.iter().filter(|line| !line.starts_with('!'));
        let words = words.flat_map(|line| line.split_whitespace());
        let errors: Vec<f64> = words
            .map(|word| word.parse::<f64>().expect("a number").abs())
            .collect();
        assert!(errors.len() > 20, "{answer:?}");
        errors
    }

    /// Counts of the motor, which is off, at the joint's zero.
    fn zero(&mut self) -> f64 {
        let position = self.halcmd.value(&format!("getp joint.{JOINT}.pos-fb"));
        let position: f64 = position.parse().expect("a number");
        // The encoder counts against the joint.
        self.counts() + position * COUNTS_PER_UNIT
    }

    fn counts(&mut self) -> f64 {
        writeln!(self.to_board, "show motors").expect("the board runs");
        let name = format!("motor.{JOINT}.counts ");
        let mut counts = None;
        loop {
            let line = self
                .of_board
                .recv_timeout(PATIENCE)
                .expect("the board answers");
            match line.strip_prefix(&name) {
                Some(value) => counts = value.parse().ok(),
                None if line == "ok" => return counts.expect("a motor"),
                None => {}
            }
        }
    }
}
