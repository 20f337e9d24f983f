//! Who uses the library pays for nothing that the command `mesa` needs.

use std::collections::BTreeSet;
use std::process::Command;

/// All packages that the library with its default features is built of.
const PACKAGES: [&str; 16] = [
    "bitflags",
    "byteorder",
    "crc",
    "crc-catalog",
    "libc",
    "libm",
    "linux-raw-sys",
    "log",
    "proc-macro2",
    "quote",
    "rustix",
    "socket2",
    "syn",
    "thiserror",
    "thiserror-impl",
    "unicode-ident",
];

#[test]
fn default_features_need_these_packages_and_no_others() {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--edges", "normal", "--prefix", "none", "--offline"])
        .args(["--format", "{p}"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    let text = String::from_utf8_lossy(&output.stdout);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    let packages = text.lines().filter_map(|line| line.split(' ').next());
    let found: BTreeSet<&str> = packages.filter(|name| *name != "mesa-hal").collect();
    assert_eq!(found, BTreeSet::from(PACKAGES), "{text}{error}");
}
