//! A board is refused with the reason and the advice.

use std::fs;
use std::os::unix::fs::{FileExt, PermissionsExt, symlink};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use mesa_hal::MesaError;
use mesa_pci::simulated::SimulatedDevice;
use mesa_pci::{BoardKind, PciDevice, PciOpenError, search};

use crate::folder::{Folder, address, device, plain, poke};

fn refused(root: &Path) -> PciOpenError {
    device(root).open().expect_err("refused")
}

#[test]
fn boards_are_found_in_address_order_and_other_devices_are_not() {
    let root = Folder::new();
    assert_eq!(search(root.path()).expect("no bus").len(), 0);
    let make = |address: &str, kind| {
        let address = address.parse().expect("an address");
        SimulatedDevice::new(root.path(), address, kind).expect("a board")
    };
    let _boards = [
        make("0000:0a:00.0", BoardKind::I6i25),
        make("0000:05:01.0", BoardKind::I5i25),
        make("0001:01:00.0", BoardKind::I4i74),
    ];
    let other = make("0000:00:1f.3", BoardKind::I5i25);
    fs::write(other.folder().join("vendor"), "0x8086\n").expect("written");
    let found = search(root.path()).expect("boards");
    let found: Vec<_> = found
        .iter()
        .map(|device| format!("{} {}", device.address(), device.board().name))
        .collect();
    assert_eq!(
        found,
        [
            "0000:05:01.0 5I25",
            "0000:0a:00.0 6I25",
            "0001:01:00.0 4I74"
        ]
    );
}

#[test]
fn device_that_is_not_there_or_is_no_board_is_named() {
    let root = Folder::new();
    let error = PciDevice::at(root.path(), address()).expect_err("nothing there");
    assert!(matches!(error, PciOpenError::NoDevice { .. }));
    assert!(
        error
            .with_advice()
            .to_string()
            .contains("lspci -D -d 2718:")
    );
    let folder = plain(root.path(), BoardKind::I5i25);
    fs::write(folder.join("vendor"), "0x10b5\n").expect("written");
    fs::write(folder.join("device"), "0x9030\n").expect("written");
    let error = PciDevice::at(root.path(), address()).expect_err("a bridge");
    assert!(error.to_string().contains("10b5:9030"), "{error}");
    assert!(error.with_advice().to_string().contains("PLX"));
}

#[test]
fn driver_of_the_kernel_is_named_with_the_way_to_unbind_it() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    symlink("../../../bus/pci/drivers/vfio-pci", folder.join("driver")).expect("a link");
    let error = refused(root.path());
    assert!(error.to_string().contains("`vfio-pci`"), "{error}");
    let text = error.with_advice().to_string();
    let way = "echo 0000:05:00.0 > /sys/bus/pci/drivers/vfio-pci/unbind";
    assert!(text.contains(way), "{text}");
}

#[test]
fn region_that_is_no_64_kib_of_memory_is_refused() {
    for (line, found) in [
        ("0xfe900000 0xfe900fff 0x40200", "4096 bytes of memory"),
        ("0xe000 0xefff 0x40101", "4096 bytes that are no memory"),
        ("0x0 0x0 0x0", "no addresses"),
        ("0xfe900000 0xfe91ffff 0x40200", "131072 bytes of memory"),
    ] {
        let root = Folder::new();
        let folder = plain(root.path(), BoardKind::I5i25);
        fs::write(folder.join("resource"), format!("{line}\n")).expect("written");
        let error = refused(root.path());
        assert!(matches!(error, PciOpenError::WrongRegion { .. }));
        assert!(
            error.to_string().contains(&format!("has {found},")),
            "{error}"
        );
    }
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    fs::write(folder.join("resource"), "nothing\n").expect("written");
    assert!(matches!(refused(root.path()), PciOpenError::Sysfs { .. }));
}

#[test]
fn disabled_memory_is_refused_with_the_command_that_enables_it() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    let config = fs::File::options().write(true).open(folder.join("config"));
    let written = config.and_then(|file| file.write_all_at(&[0x05, 0x00], 4));
    written.expect("written");
    let error = refused(root.path());
    assert!(error.to_string().contains("0x0005"), "{error}");
    assert!(
        error
            .with_advice()
            .to_string()
            .contains("setpci -s 0000:05:00.0 COMMAND=0x2:0x2")
    );
}

#[test]
fn missing_rights_are_refused_with_the_udev_rule() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    let path = folder.join("resource0");
    // Root may open all files; a folder it may not open as a file.
    fs::set_permissions(&path, fs::Permissions::from_mode(0o0)).expect("rights");
    if fs::File::options().read(true).open(&path).is_ok() {
        fs::remove_file(&path).expect("removed");
        fs::create_dir(&path).expect("a folder");
    }
    let error = refused(root.path());
    assert!(matches!(error, PciOpenError::NoAccess { .. }), "{error}");
    let text = error.with_advice().to_string();
    assert!(
        text.contains("/etc/udev/rules.d/") && text.contains("2718"),
        "{text}"
    );
}

/// Another program, which has the lock of a board when it has written its first line.
fn locked_by(folder: &Path, script: &str) -> Child {
    let mut other = Command::new("flock")
        .args(["--no-fork", "--exclusive"])
        .arg(folder.join("resource0"))
        .args(["sh", "-c", script])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("flock of util-linux");
    let mut line = String::new();
    let output = other.stdout.take().expect("its output");
    std::io::BufRead::read_line(&mut std::io::BufReader::new(output), &mut line).expect("a line");
    other
}

#[test]
fn second_program_is_refused_as_long_as_the_first_has_the_board() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    let mut other = locked_by(&folder, "echo locked; read line");
    let error = refused(root.path());
    // `flock` has become the shell.
    let expected = format!("`sh` (process {}) drives this board", other.id());
    assert!(error.to_string().contains(&expected), "{error}");
    assert!(
        error.with_advice().to_string().contains("end it"),
        "{}",
        error.with_advice().to_string()
    );
    drop(other.stdin.take());
    other.wait().expect("it ends");
    let bus = device(root.path()).open().expect("free again");
    let own = refused(root.path()).to_string();
    assert!(
        own.contains(&format!("process {}", std::process::id())),
        "{own}"
    );
    drop(bus);
    assert!(device(root.path()).open().is_ok());
}

/// `kill -9` leaves a program no time to release anything.
#[test]
fn lock_of_a_program_that_is_killed_is_gone() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    let mut other = locked_by(&folder, "echo locked; exec sleep 1000");
    let error = refused(root.path());
    assert!(matches!(error, PciOpenError::Occupied { .. }), "{error}");
    other.kill().expect("killed");
    other.wait().expect("it ends");
    assert!(device(root.path()).open().is_ok());
}

#[test]
fn linuxcnc_has_no_lock_and_is_found_by_its_mappings() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    let processes = Folder::new();
    let linuxcnc = processes.path().join("4711");
    fs::create_dir(&linuxcnc).expect("a folder");
    fs::write(linuxcnc.join("comm"), "rtapi_app\n").expect("written");
    let open = || {
        let device = device(root.path()).with_processes(processes.path());
        device.open()
    };
    // Mappings that this user may not see.
    fs::create_dir(linuxcnc.join("maps")).expect("a folder");
    let error = open().expect_err("perhaps");
    assert!(
        matches!(error, PciOpenError::PerhapsOccupied { .. }),
        "{error}"
    );
    assert!(error.with_advice().to_string().contains("halrun -U"));
    // Its mappings are those of other boards.
    fs::remove_dir(linuxcnc.join("maps")).expect("removed");
    let resource = fs::canonicalize(folder.join("resource0")).expect("a path");
    let line = "7f10-7f20 rw-s 00000000 00:15 9371    ";
    fs::write(
        linuxcnc.join("maps"),
        format!("{line}{}1\n", resource.display()),
    )
    .expect("written");
    assert!(open().is_ok(), "another file");
    fs::write(
        linuxcnc.join("maps"),
        format!("{line}{}\n", resource.display()),
    )
    .expect("written");
    let error = open().expect_err("occupied");
    assert!(
        error
            .to_string()
            .contains("LinuxCNC (rtapi_app, process 4711)"),
        "{error}"
    );
}

#[test]
fn file_that_is_too_short_is_not_mapped() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    let file = fs::File::options()
        .write(true)
        .open(folder.join("resource0"));
    file.and_then(|file| file.set_len(0xFFFC)).expect("cut");
    assert!(matches!(
        refused(root.path()),
        PciOpenError::NotMapped { .. }
    ));
}

#[test]
fn silent_board_and_other_firmware_get_different_errors() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    poke(&folder, 0x0100, u32::MAX);
    let silent = refused(root.path());
    poke(&folder, 0x0100, 0x1234_5678);
    let other = refused(root.path());
    assert!(other.to_string().contains("12345678"), "{other}");
    assert!(silent.with_advice().to_string().contains("does not answer"));
    assert!(other.with_advice().to_string().contains("firmware"));
}

#[test]
fn stale_simulator_folder_is_no_board_and_is_replaced() {
    let root = Folder::new();
    let device = SimulatedDevice::new(root.path(), address(), BoardKind::I5i25).expect("a board");
    let twice = SimulatedDevice::new(root.path(), address(), BoardKind::I5i25);
    let error = twice.expect_err("two simulators");
    assert_eq!(error.kind(), std::io::ErrorKind::AlreadyExists);
    // As after `kill -9`: the files stay, and the kernel drops the lock.
    let copy = Folder::new();
    let left = plain(copy.path(), BoardKind::I5i25);
    fs::copy(
        device.folder().join("mesa_simulated"),
        left.join("mesa_simulated"),
    )
    .expect("copied");
    let error = refused(copy.path());
    assert!(matches!(error, PciOpenError::NoSimulator { .. }), "{error}");
    assert!(error.with_advice().to_string().contains("mesa sim --pci"));
    drop(device);
    assert_eq!(search(root.path()).expect("boards"), [], "removed");
    assert!(SimulatedDevice::new(root.path(), address(), BoardKind::I5i25).is_ok());
}
