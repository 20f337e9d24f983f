//! Who uses the library pays for nothing that the command `mesa` needs, and what the simulator does is
//! its own.

use std::collections::BTreeSet;
use std::process::Command;

/// All packages that the library with its default features is built of.
const PACKAGES: [&str; 17] = [
    "bitflags",
    "crc",
    "crc-catalog",
    "libc",
    "libm",
    "linux-raw-sys",
    "log",
    "mesa-hal",
    "mesa-wire",
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
    let text = tree("mesa-hal", "normal");
    assert_eq!(packages(&text), BTreeSet::from(PACKAGES), "{text}");
}

/// It shares wire formats, register addresses and the bus with the driver, so that the two can not agree
/// on the same mistake. That holds for its tests, too.
#[test]
fn the_simulator_knows_nothing_of_the_driver() {
    let text = tree("mesa-hal-sim", "all");
    let packages = packages(&text);
    let own: Vec<_> = packages
        .iter()
        .filter(|name| name.starts_with("mesa"))
        .collect();
    assert_eq!(own, [&"mesa-hal-sim", &"mesa-wire"], "{text}");
}

/// All packages that a package of this workspace is built of, one on each line.
fn tree(package: &str, edges: &str) -> String {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--prefix", "none", "--offline", "--format", "{p}"])
        .args(["--package", package, "--edges", edges])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    String::from_utf8(output.stdout).expect("UTF-8")
}

fn packages(tree: &str) -> BTreeSet<&str> {
    let names = tree.lines().filter_map(|line| line.split(' ').next());
    names.filter(|name| !name.is_empty()).collect()
}
