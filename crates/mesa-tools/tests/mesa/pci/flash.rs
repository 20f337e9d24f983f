//! `mesa flash` over the registers of a board on the PCI bus.

use std::fs;

use super::PciBoard;
use crate::interop::Scratch;
use crate::interop::mesaflash::{bitfile, configuration};
use crate::run::{done, json, run};
use crate::setup::flash::{PART, file};

/// An embedded board: virtual time.
const SIM: [&str; 2] = ["--sim", "5i25-7i77"];
/// The user configuration in a memory of 8 Mbit.
const USER: usize = 0x08_0000;

#[test]
fn backup_equals_the_chip_and_is_compared_and_restored() {
    let backup = Scratch::new("pci-backup.bin");
    done(&[&["flash", "backup", backup.path()][..], &SIM].concat());
    let mut bytes = fs::read(&backup.0).expect("a backup");
    assert_eq!(bytes.len(), 0x10_0000);
    assert_eq!(bytes[10..14], [0xAA, 0x99, 0x55, 0x66], "the boot block");
    done(&[&["flash", "verify", backup.path()][..], &SIM].concat());
    bytes[USER + 0x1000] ^= 1;
    let other = file("pci-other.bin", &bytes);
    let differs = run(&[&["flash", "verify", other.path()][..], &SIM].concat());
    assert_eq!(differs.code, Some(1), "{differs:?}");
    done(&[&["flash", "restore", other.path(), "--yes"][..], &SIM].concat());
}

#[test]
fn configuration_is_written_and_one_for_ethernet_is_refused() {
    let design = |name: &str| bitfile(name, PART, &configuration(3000));
    for (name, is_own) in [
        ("fivei25_7i77x2.ncd", true),
        ("TopPCIHostMot2.ncd", true),
        ("TopEthernet16HostMot2.ncd", false),
        ("7i92_7i77.ncd", false),
    ] {
        let bit = file("pci.bit", &design(name));
        let written = run(&[&["flash", "write", bit.path(), "--yes"][..], &SIM].concat());
        assert_eq!(
            written.code,
            Some(i32::from(!is_own)),
            "{name}: {written:?}"
        );
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn bitfile_is_written_and_verified_through_mapped_memory() {
    let state = Scratch::new("pci-state");
    let board = PciBoard::start(&["--board", "5i25-7i77", "--state", state.path()]);
    let bit = file(
        "pci-mapped.bit",
        &bitfile("fivei25.ncd", PART, &configuration(700)),
    );
    let at = ["--pci", board.folder()];
    let written = json(&[&["flash", "write", bit.path(), "--yes"][..], &at].concat());
    assert_eq!(written["areas"][0]["start"], USER);
    done(&[&["flash", "verify", bit.path()][..], &at].concat());
    let (_, folder) = board.stop();
    drop(folder);
    // The state has the EEPROM before the memory.
    let kept = fs::read(&state.0).expect("a state");
    let configuration = configuration(700);
    assert!(
        kept.windows(configuration.len())
            .any(|bytes| bytes == configuration)
    );
}
