//! The library does not depend on anything that only the command `mesa` needs, and the simulator is
//! independent of the driver.

use std::collections::BTreeSet;
use std::process::Command;

/// All packages of the library with its default features.
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

/// The simulator shares wire formats, register addresses and the bus with the driver, and nothing
/// else, so that the two cannot have the same error. The same holds for its tests.
#[test]
fn simulator_knows_nothing_of_the_driver() {
    let text = tree("mesa-hal-sim", "all");
    let packages = packages(&text);
    let own: Vec<_> = packages
        .iter()
        .filter(|name| name.starts_with("mesa"))
        .collect();
    assert_eq!(own, [&"mesa-hal-sim", &"mesa-wire"], "{text}");
}

/// The socket enters the kernel without the C library, whose send and recv are cancellation points.
#[test]
fn system_calls_do_not_go_through_the_c_library() {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--workspace", "--all-features"])
        .args([
            "--edges", "normal", "--prefix", "none", "--format", "{p} {f}",
        ])
        .current_dir(crate::root())
        .output()
        .expect("cargo runs");
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let mut rustix = text.lines().filter(|line| line.starts_with("rustix v1"));
    assert!(text.contains("rustix v1"), "{text}");
    assert!(rustix.all(|line| !line.contains("use-libc")), "{text}");
}

/// All packages that a package of this workspace depends on, one on each line.
fn tree(package: &str, edges: &str) -> String {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--prefix", "none", "--offline", "--format", "{p}"])
        .args(["--package", package, "--edges", edges])
        .current_dir(crate::root())
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
