//! External tools, and the treatment of missing ones.

use std::path::PathBuf;

/// Prints that a test is skipped, and the reason. In CI nothing may be missing: there the test
/// fails.
pub fn skip(what: &str) {
    let why =
        format!("{what}; needed for this test: apt-get install mesaflash linuxcnc-uspace tmux");
    assert!(
        std::env::var_os("CI").is_none_or(|ci| ci != "true"),
        "missing in CI: {why}"
    );
    println!("SKIPPED: {why}");
}

/// True if a program is installed.
pub fn has_program(name: &str) -> bool {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&paths)
        .chain([PathBuf::from("/usr/sbin"), PathBuf::from("/sbin")])
        .any(|directory| directory.join(name).is_file())
}
