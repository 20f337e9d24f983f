//! mesaflash finds a simulated board, and reads its identification: the files of the board are
//! those that the kernel makes. Its flash commands need registers that answer, which memory cannot.

use std::process::{Command, Stdio};

use super::PciBoard;
use crate::interop::tools::{has_program, skip};

/// In a mount namespace: the files of the board in the place of the kernel's, and a copy of its
/// memory at its address in the place of `/dev/mem`.
const SCRIPT: &str = r#"
set -eu
device=$1/bus/pci/devices/0000:05:00.0
read -r start _ < "$device/resource"
mount --bind "$1/bus/pci" /sys/bus/pci
mount --bind "$1/devices" /sys/devices
mount -t tmpfs tmpfs /dev
truncate -s $((start + 0x10000)) "$1/mem"
dd if="$device/resource0" of="$1/mem" bs=65536 seek=$((start / 65536)) conv=notrunc status=none
ln -s "$1/mem" /dev/mem
exec mesaflash --device 5i25 --readhmid
"#;

/// True if this user may make a mount namespace.
fn has_namespaces() -> bool {
    let mut unshare = Command::new("unshare");
    unshare.args(["--mount", "true"]).stderr(Stdio::null());
    unshare.status().is_ok_and(|status| status.success())
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn mesaflash_finds_the_board_and_reads_its_identification() {
    if !has_program("mesaflash") {
        return skip("mesaflash is not installed");
    }
    if !has_namespaces() || !std::path::Path::new("/sys/bus/pci").exists() {
        println!("SKIPPED: root and a kernel with PCI are needed to put files in its place");
        return;
    }
    let board = PciBoard::start(&["--board", "5i25-7i77-7i76"]);
    let output = Command::new("unshare")
        .args(["--mount", "sh", "-c", SCRIPT, "sh", board.folder()])
        .output()
        .expect("unshare runs");
    let text = String::from_utf8_lossy(&output.stdout);
    for line in [
        "BoardName : MESA5I25",
        "Clock Low frequency: 33.3333 MHz",
        "There are 8 of MuxedQCount in configuration",
        "There are 5 of StepGen in configuration",
        "IO Connections for P3",
        "IO Connections for P2",
    ] {
        assert!(text.contains(line), "{line}: {output:?}");
    }
}
