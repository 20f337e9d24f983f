//! All of LinuxCNC with either driver, on the same simulated machine, and a program on LinuxCNC's
//! python module as its operator. One word of the files changes.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use crate::halcmd::{Halcmd, LOADS, PATIENCE, Started, lines_of};
use crate::session::built;
use crate::tools::realtime;

/// Where the Debian package has LinuxCNC's sample configurations for boards of Mesa.
pub const SAMPLES: &str = "/usr/share/doc/linuxcnc/examples/sample-configs/by_interface/mesa";

/// Number of jogs there and back of a run, and the most that a busy computer may spoil.
const JOGS: usize = 2;
const MAX_JOGS: usize = 20;
/// Looks at a number until it has settled: 5 s.
const MAX_LOOKS: usize = 50;

/// The texts of a configuration by name.
pub type Files = BTreeMap<String, String>;

/// A simulated machine.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    /// Its description, below `tests/linuxcnc`.
    pub toml: &'static str,
    /// The name of its board in HAL.
    pub prefix: &'static str,
}

impl Machine {
    fn path(self) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/linuxcnc")
            .join(self.toml)
    }
}

/// A file of LinuxCNC's sample configurations; `None` if it is not installed.
pub fn sample_text(name: &str) -> Option<String> {
    fs::read_to_string(Path::new(SAMPLES).join(name)).ok()
}

/// The HAL file of a sample. The samples are for boards on PCI: hm2_eth wants an address.
pub fn with_address(hal: &str) -> String {
    let line = "loadrt [HOSTMOT2](DRIVER) config=[HOSTMOT2](CONFIG)";
    assert!(hal.contains(line), "{hal}");
    hal.replace(line, &format!("{line} board_ip=[HOSTMOT2](BOARD_IP)"))
}

/// What `mesa hal` writes for a simulated machine, with other values in the INI file.
pub fn written(machine: Machine, values: &str) -> Files {
    written_for(machine, &[], values)
}

/// What `mesa hal` writes with these options.
pub fn written_for(machine: Machine, options: &[&str], values: &str) -> Files {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("written-by-mesa");
    let folder = folder.join(machine.toml.replace('/', "-"));
    let _ = fs::remove_dir_all(&folder);
    let mut hal = Command::new(mesa());
    hal.args(["hal", "--sim"]).arg(machine.path());
    hal.args(options);
    let done = hal.arg("--out").arg(&folder).output().expect("mesa runs");
    assert!(done.status.success(), "{done:?}");
    let names = ["machine.ini", "board.hal", "motion.hal", "tool.tbl"];
    let text = |name| fs::read_to_string(folder.join(name)).expect("it is written");
    let mut files: Files = names.map(|name| (name.to_owned(), text(name))).into();
    let ini = merged(&files["machine.ini"], values);
    files.insert("machine.ini".into(), ini);
    files
}

/// An INI file with other values; `HALCMD` is added, not replaced.
pub fn merged(ini: &str, values: &str) -> String {
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
pub fn with_one_word_changed(files: &Files, [from, to]: [&str; 2]) -> Files {
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

/// The value that a quarter of the values exceed.
pub fn upper_quartile(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() * 3 / 4]
}

/// All of LinuxCNC with `screen.py`, and the console of `mesa sim`.
pub struct LinuxCnc {
    pub halcmd: Halcmd,
    to_board: File,
    of_board: Receiver<String>,
}

impl LinuxCnc {
    /// hm2_eth is retried where it never retries itself.
    pub fn load(name: &str, files: &Files, machine: Machine) -> Self {
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
            let mut linuxcnc = Self::start(&folder, machine);
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

    fn start(folder: &Path, machine: Machine) -> Self {
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        let here = package.join("tests/linuxcnc");
        let mut sandbox = realtime(package.join("../../examples/linuxcnc.sh"));
        sandbox.arg("--machine").arg(machine.path()).arg("--");
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
        } = Halcmd::start(machine.prefix, sandbox, pipes);
        Self {
            halcmd,
            to_board,
            of_board: lines_of(from_board),
        }
    }

    pub fn hal(&mut self, command: &str) -> Vec<String> {
        let answer = self.halcmd.hal(command);
        let messages = answer.iter().filter(|line| line.starts_with('!'));
        messages.for_each(|message| println!("{command}: {message}"));
        answer
    }

    /// Following errors of the moments of a jog, without their signs.
    pub fn jog(&mut self, joint: usize, distance: f64) -> Vec<f64> {
        let answer = self.hal(&format!("jog {joint} {distance} 1"));
        let words = answer.iter().filter(|line| !line.starts_with('!'));
        let words = words.flat_map(|line| line.split_whitespace());
        let errors: Vec<f64> = words
            .map(|word| word.parse::<f64>().expect("a number").abs())
            .collect();
        assert!(errors.len() > 20, "{answer:?}");
        errors
    }

    /// Upper quartile of the following error of the best of some jogs there and back, which are
    /// repeated while it is `too_large`. A pause of the computer spoils some moments, and some
    /// jogs.
    pub fn following(
        &mut self,
        joint: usize,
        distance: f64,
        too_large: impl Fn(f64) -> bool,
    ) -> f64 {
        let mut best = f64::INFINITY;
        for jog in 0..MAX_JOGS {
            if jog >= JOGS && !too_large(best) {
                break;
            }
            let errors = [distance, -distance].map(|distance| self.jog(joint, distance));
            best = best.min(upper_quartile(errors.concat()));
        }
        best
    }

    /// A number that does not change any more: one that LinuxCNC shows can be older than one of the
    /// board.
    pub fn settled(&mut self, mut number: impl FnMut(&mut Self) -> f64) -> f64 {
        let mut before = number(self);
        for _ in 0..MAX_LOOKS {
            std::thread::sleep(Duration::from_millis(100));
            let now = number(self);
            if now == before {
                break;
            }
            before = now;
        }
        before
    }

    /// The number of joints.
    pub fn joints(&mut self) -> usize {
        let count = self.halcmd.value("joints");
        count.parse().expect("a number")
    }

    /// The position of a joint.
    pub fn position(&mut self, joint: usize) -> f64 {
        let position = self.halcmd.value(&format!("getp joint.{joint}.pos-fb"));
        position.parse().expect("a number")
    }

    /// A command for the board, and the lines of its answer.
    pub fn board(&mut self, command: &str) -> Vec<String> {
        writeln!(self.to_board, "{command}").expect("the board runs");
        let mut lines = Vec::new();
        loop {
            let line = self.of_board.recv_timeout(PATIENCE);
            let line = line.expect("the board answers");
            if line == "ok" {
                return lines;
            }
            assert!(!line.starts_with("error"), "{command}: {line}");
            lines.push(line);
        }
    }

    /// What the board shows of its motors.
    pub fn motors(&mut self) -> BTreeMap<String, String> {
        let lines = self.board("show motors");
        let pairs = lines.iter().filter_map(|line| line.split_once(' '));
        let pairs = pairs.map(|(name, value)| (name.to_owned(), value.to_owned()));
        pairs.collect()
    }

    /// A number of a motor.
    pub fn motor(&mut self, joint: usize, what: &str) -> f64 {
        let name = format!("motor.{joint}.{what}");
        let value = self.motors().remove(&name);
        let value = value.and_then(|value| value.parse().ok());
        value.unwrap_or_else(|| panic!("no {name}"))
    }
}
