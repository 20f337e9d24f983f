//! What the interop tests share: the simulated board as a program, commands and answers.
//!
//! The simulated board is `mesa sim`.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test that includes this uses what it needs"
)]

pub mod board;
pub mod console;
pub mod mesaflash;
pub mod tools;

use std::{
    fmt::Display,
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Output},
    time::{Duration, Instant},
};

/// How long anything may take on a slow and busy machine.
pub const PATIENCE: Duration = Duration::from_secs(90);

/// Waits until something is so.
pub fn wait_until(what: impl Display, mut is_so: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is_so() {
        assert!(begun.elapsed() < PATIENCE, "never: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The program `mesa`, as it was built with this test.
pub fn mesa() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_mesa"))
}

/// An example of any package in the profile of this test, as `cargo test --all-features` has built it;
/// built if it is not there or is old.
pub fn example(name: &str) -> PathBuf {
    let (target, profile) = (target(), profile());
    build(&["--all-features", "--example", name], profile, &target);
    target.join(profile).join("examples").join(name)
}

/// Where this test was built.
fn target() -> PathBuf {
    let test = std::env::current_exe().expect("a test knows where it is");
    // target/PROFILE/deps/test-hash
    test.ancestors().nth(3).expect("target").to_owned()
}

fn profile() -> &'static str {
    let test = std::env::current_exe().expect("a test knows where it is");
    let profile = test.ancestors().nth(2).expect("target/PROFILE");
    if profile.ends_with("release") {
        "release"
    } else {
        "debug"
    }
}

fn build(what: &[&str], profile: &str, target: &Path) {
    let mut build = Command::new(env!("CARGO"));
    build.args(["build", "--quiet"]).args(what);
    if profile == "release" {
        build.arg("--release");
    }
    build.arg("--target-dir").arg(target);
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let status = build.current_dir(root).status();
    assert!(status.expect("cargo runs").success(), "{what:?} builds");
}

/// A program that does not outlive its test.
pub struct Process(Option<Child>);

impl Process {
    pub fn new(child: Child) -> Self {
        Self(Some(child))
    }

    pub fn child(&mut self) -> &mut Child {
        self.0.as_mut().expect("it runs")
    }

    /// Sends it a signal, as soon as it catches it: before, it would just die. One that has ended
    /// already gets none.
    pub fn signal(&mut self, name: &str) {
        let signal = match name {
            "HUP" => Some(1),
            "INT" => Some(2),
            "TERM" => Some(15),
            // Nobody catches it.
            "KILL" => None,
            _ => panic!("no program here catches SIG{name}"),
        };
        wait_until(format_args!("SIG{name} is caught"), || {
            self.has_ended() || signal.is_none_or(|signal| self.catches(signal))
        });
        if self.has_ended() {
            return;
        }
        let kill = format!("kill -{name} {}", self.child().id());
        let killed = Command::new("sh").args(["-c", &kill]).status();
        assert!(killed.expect("a shell").success());
    }

    pub fn has_ended(&mut self) -> bool {
        self.child().try_wait().expect("a child").is_some()
    }

    fn catches(&mut self, signal: u32) -> bool {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child().id()));
        let status = status.unwrap_or_default();
        let mut caught = status
            .lines()
            .filter_map(|line| line.strip_prefix("SigCgt:"));
        let caught = caught
            .next()
            .map(|mask| u64::from_str_radix(mask.trim(), 16));
        matches!(caught, Some(Ok(mask)) if mask & (1 << (signal - 1)) != 0)
    }

    /// Closes the end that it prints to.
    pub fn stop_reading(&mut self) {
        drop(self.child().stdout.take());
    }

    /// Waits for its end: how it ended, and what it printed until then.
    pub fn output(mut self) -> Output {
        let child = self.0.take().expect("it runs");
        child.wait_with_output().expect("it is a child")
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if let Some(mut child) = self.0.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// A file that is not there at first, and is removed at the end.
pub struct Scratch(pub PathBuf);

impl Scratch {
    pub fn new(name: &str) -> Self {
        let directory = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
        let path = directory.join(format!("{}-{name}", std::process::id()));
        let _ = fs::remove_file(&path);
        Self(path)
    }

    pub fn path(&self) -> &str {
        self.0.to_str().expect("UTF-8")
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}
