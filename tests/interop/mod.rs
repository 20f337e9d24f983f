//! What the interop tests share: finding the simulated board, missing tools, commands and answers.
//!
//! The simulated board is the example `sim_board`. `cargo test` builds examples in the same
//! profile as the tests, so it lies beside them; a run that leaves the examples out
//! (`cargo test --test ...`) builds it here.

pub mod console;

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

/// Says that a test is skipped, and why. In CI nothing may be missing: there it fails.
pub fn skip(what: &str) {
    let why = format!("{what}; needed for this test: apt-get install mesaflash linuxcnc-uspace");
    assert!(
        std::env::var_os("CI").is_none_or(|ci| ci != "true"),
        "missing in CI: {why}"
    );
    println!("SKIPPED: {why}");
}

/// Whether a program can be found.
pub fn has_program(name: &str) -> bool {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&paths)
        .chain([PathBuf::from("/usr/sbin"), PathBuf::from("/sbin")])
        .any(|directory| directory.join(name).is_file())
}

/// The example `sim_board` in the profile of this test, built if it is not there or is old.
pub fn sim_board() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let test = std::env::current_exe().expect("a test knows where it is");
        // target/PROFILE/deps/test-hash
        let profile = test.ancestors().nth(2).expect("target/PROFILE");
        let mut build = Command::new(env!("CARGO"));
        build.args(["build", "--quiet", "--example", "sim_board"]);
        if profile.ends_with("release") {
            build.arg("--release");
        }
        let target = profile.parent().expect("target");
        build.arg("--target-dir").arg(target);
        let status = build.current_dir(env!("CARGO_MANIFEST_DIR")).status();
        assert!(status.expect("cargo runs").success(), "sim_board builds");
        profile.join("examples/sim_board")
    })
}
