//! What the interop tests share: the simulated board as a program, commands and answers.
//!
//! The simulated board is the example `sim_board`. `cargo test` builds examples in the same
//! profile as the tests, so it lies beside them; a run that leaves the examples out
//! (`cargo test --test ...`) builds it here.
#![allow(dead_code, reason = "each test that includes this uses what it needs")]

pub mod board;
pub mod console;
pub mod tools;

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

/// The example `sim_board` in the profile of this test, built if it is not there or is old.
pub fn sim_board() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| example("sim_board"))
}

/// An example in the profile of this test, built if it is not there or is old.
pub fn example(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("a test knows where it is");
    // target/PROFILE/deps/test-hash
    let profile = test.ancestors().nth(2).expect("target/PROFILE");
    let is_release = profile.ends_with("release");
    example_in(if is_release { "release" } else { "debug" }, name)
}

/// An example in a profile, built if it is not there or is old.
pub fn example_in(profile: &str, name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("a test knows where it is");
    let target = test.ancestors().nth(3).expect("target");
    let mut build = Command::new(env!("CARGO"));
    build.args(["build", "--quiet", "--example", name]);
    if profile == "release" {
        build.arg("--release");
    }
    build.arg("--target-dir").arg(target);
    let status = build.current_dir(env!("CARGO_MANIFEST_DIR")).status();
    assert!(status.expect("cargo runs").success(), "{name} builds");
    target.join(profile).join("examples").join(name)
}
