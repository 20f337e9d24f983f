//! Shared parts of the interop tests: the simulated board (`mesa sim`) as a process, commands and
//! answers.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test that includes this uses what it needs"
)]

pub mod board;
pub mod console;
pub mod halcmd;
pub mod mesaflash;
pub mod passive;
pub mod tools;

pub use tools::{realtime, realtime_thread};

use std::{
    fmt::Display,
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Output},
    time::{Duration, Instant},
};

/// Time limit of any step, for a slow and busy machine.
pub const PATIENCE: Duration = Duration::from_secs(90);

/// Stops a test that waits for the host's clock or for another program, and is not behind the
/// feature: the README's test command would not pass on every computer.
#[expect(
    clippy::assertions_on_constants,
    reason = "the features of this build decide"
)]
pub fn behind_the_feature() {
    assert!(
        cfg!(feature = "interop"),
        "this test waits for a real clock or another program, and belongs behind the feature `interop`: \
         #[cfg_attr(not(feature = \"interop\"), ignore = \"real clock: --all-features\")]"
    );
}

/// Waits until a condition is met.
pub fn wait_until(what: impl Display, mut is_so: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is_so() {
        assert!(begun.elapsed() < PATIENCE, "never: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The program `mesa` that was built with this test.
pub fn mesa() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_mesa"))
}

/// An example of any package in the profile of this test, as `cargo test --all-features` builds it;
/// built if missing or old.
pub fn example(name: &str) -> PathBuf {
    let (target, profile) = (target(), profile());
    build(&["--all-features", "--example", name], profile, &target);
    target.join(profile).join("examples").join(name)
}

/// Target directory of this test.
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

    /// Sends a signal to the process once it catches it, because it would just die before. A
    /// process that has ended gets none.
    pub fn signal(&mut self, name: &str) {
        let signal = match name {
            "HUP" => Some(1),
            "INT" => Some(2),
            "TERM" => Some(15),
            // SIGKILL cannot be caught.
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

    /// Closes the reading end of the process's standard output.
    pub fn stop_reading(&mut self) {
        drop(self.child().stdout.take());
    }

    /// Waits for the end of the process; returns its exit status and its remaining output.
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

/// A file or folder of this process that does not exist at first, and is removed at the end.
pub struct Scratch(pub PathBuf);

impl Scratch {
    pub fn new(name: &str) -> Self {
        Self::below(Path::new(env!("CARGO_TARGET_TMPDIR")), name)
    }

    /// A file for a program that runs as another user, which cannot enter a private folder.
    pub fn public(name: &str) -> Self {
        Self::below(&std::env::temp_dir(), name)
    }

    fn below(directory: &Path, name: &str) -> Self {
        let scratch = Self(directory.join(format!("{}-{name}", std::process::id())));
        scratch.remove();
        scratch
    }

    pub fn path(&self) -> &str {
        self.0.to_str().expect("UTF-8")
    }

    fn remove(&self) {
        let _ = fs::remove_file(&self.0).or_else(|_| fs::remove_dir_all(&self.0));
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        self.remove();
    }
}
