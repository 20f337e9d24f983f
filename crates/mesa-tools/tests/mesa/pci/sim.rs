//! `mesa sim --pci`.

use std::path::Path;

use super::PciBoard;
use crate::interop::Scratch;
use crate::run::{hold_against_schema, run};

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn simulator_creates_a_board_folder_and_removes_it_at_its_end() {
    let board = PciBoard::start(&["--board", "5i25-7i77"]);
    let device = format!("{}/bus/pci/devices/0000:05:00.0", board.folder());
    let text = std::fs::read_to_string(format!("{device}/device"));
    assert_eq!(text.expect("a device"), "0x5125\n");
    let (values, folder) = board.stop();
    assert_eq!(values["board.name"], "5I25");
    assert_eq!(values["network.pci.accesses"], "0");
    assert!(!Path::new(&device).exists());
    drop(folder);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn several_boards_have_an_address_each() {
    let folder = Scratch::new("machine.toml");
    std::fs::write(&folder.0, "board = \"5i25-7i77\"\n").expect("written");
    let board = PciBoard::start(&["--machine", folder.path(), "--machine", folder.path()]);
    let listed = run(&["list", "--pci", board.folder()]);
    let addresses: Vec<_> = listed.out.lines().collect();
    assert_eq!(
        addresses,
        [
            "0000:05:00.0  5I25, simulated",
            "0000:06:00.0  5I25, simulated"
        ]
    );
    let json = run(&["list", "--pci", board.folder(), "--json"]);
    hold_against_schema("list_pci", &serde_json::from_str(&json.out).expect("JSON"));
    let which = run(&["info", "--pci", board.folder()]);
    assert_eq!(which.code, Some(2), "{which:?}");
    assert!(
        which
            .err
            .contains("0000:05:00.0 (5I25), 0000:06:00.0 (5I25)"),
        "{which:?}"
    );
    let second = format!("{}/0000:06:00.0", board.folder());
    assert_eq!(run(&["info", "--pci", &second]).code, Some(0));
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn non_pci_board_and_a_folder_in_use_are_refused() {
    let board = PciBoard::start(&["--board", "5i25-7i77x2"]);
    let again = run(&["sim", "--board", "5i25-7i77", "--pci", board.folder()]);
    assert_eq!(again.code, Some(1), "{again:?}");
    assert!(
        again.err.contains("another simulator has 0000:05:00.0"),
        "{again:?}"
    );
    let folder = Scratch::new("no-pci");
    let other = run(&["sim", "--board", "7i97", "--pci", folder.path()]);
    assert_eq!(other.code, Some(1), "{other:?}");
    assert!(
        other.err.contains("a 7I97 is no board on the PCI bus"),
        "{other:?}"
    );
    let udp = run(&[
        "sim",
        "--board",
        "5i25-7i77",
        "--listen",
        "127.0.0.1",
        "--port",
        "0",
    ]);
    assert_eq!(udp.code, Some(2), "{udp:?}");
    assert!(udp.err.contains("--pci FOLDER"), "{udp:?}");
}
