//! The files of a board, as the kernel shows them.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

use super::log::{BYTES, LOG_FILE};
use crate::{BoardKind, MESA, PciAddress, REGISTERS};

/// Class of the boards: data acquisition.
const CLASS: u32 = 0x11_8000;

/// Folder of the device, which `bus/pci/devices` links to.
pub(super) fn folder(root: &Path, address: PciAddress) -> PathBuf {
    let bridge = format!("pci{:04x}:{:02x}", address.domain, address.bus);
    let folder = root.join("devices").join(bridge);
    folder.join(address.to_string())
}

/// Makes the log, and locks it: a simulator has its board for itself.
pub(super) fn lock(folder: &Path) -> io::Result<File> {
    fs::create_dir_all(folder)?;
    let file = File::options()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(folder.join(LOG_FILE))?;
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Err(Errno::WOULDBLOCK) => Err(io::ErrorKind::AlreadyExists.into()),
        result => {
            result?;
            file.set_len(BYTES)?;
            Ok(file)
        }
    }
}

/// Makes all other files.
pub(super) fn make(
    root: &Path,
    folder: &Path,
    address: PciAddress,
    kind: BoardKind,
) -> io::Result<()> {
    let board = kind.board();
    let start = base(address);
    let end = start + REGISTERS as u32 - 1;
    let mut resource = format!("0x{start:016x} 0x{end:016x} 0x0000000000040200\n");
    resource += &"0x0000000000000000 0x0000000000000000 0x0000000000000000\n".repeat(12);
    let (device, name) = (board.device, address.to_string());
    let uevent = format!(
        "PCI_CLASS={CLASS:X}\nPCI_ID={MESA:04X}:{device:04X}\nPCI_SUBSYS_ID={MESA:04X}:{device:04X}\n\
         PCI_SLOT_NAME={name}\n"
    );
    let files = [
        ("vendor", format!("{MESA:#06x}\n")),
        ("device", format!("{device:#06x}\n")),
        ("subsystem_vendor", format!("{MESA:#06x}\n")),
        ("subsystem_device", format!("{device:#06x}\n")),
        ("class", format!("{CLASS:#08x}\n")),
        ("revision", "0x01\n".to_owned()),
        ("irq", "0\n".to_owned()),
        ("enable", "1\n".to_owned()),
        ("resource", resource),
        ("uevent", uevent),
    ];
    for (name, text) in files {
        fs::write(folder.join(name), text)?;
    }
    fs::write(folder.join("config"), configuration(device, start))?;
    // Old contents would look like a board's.
    let registers = File::create(folder.join("resource0"))?;
    registers.set_len(REGISTERS as u64)?;
    link(root, folder, &name)
}

/// Removes the files of a board, and the folders around it if they are empty.
pub(super) fn remove(folder: &Path) -> io::Result<()> {
    let (Some(name), Some(bridge)) = (folder.file_name(), folder.parent()) else {
        return Ok(());
    };
    if let Some(root) = bridge.parent().and_then(Path::parent) {
        fs::remove_file(root.join("bus/pci/devices").join(name))?;
    }
    fs::remove_dir_all(folder)?;
    // Another board may be in it.
    let _ = fs::remove_dir(bridge);
    Ok(())
}

/// The links of the kernel: to the bus from the device, and back.
fn link(root: &Path, folder: &Path, name: &str) -> io::Result<()> {
    let devices = root.join("bus/pci/devices");
    fs::create_dir_all(&devices)?;
    let bridge = folder.parent().and_then(Path::file_name);
    let device = Path::new("../../../devices")
        .join(bridge.unwrap_or_default())
        .join(name);
    for (target, link) in [
        (device, devices.join(name)),
        ("../../../bus/pci".into(), folder.join("subsystem")),
    ] {
        match symlink(target, &link) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

/// Address of the registers in the computer's memory, another one for each slot.
fn base(address: PciAddress) -> u32 {
    let slot = u32::from(address.bus) << 5 | u32::from(address.device);
    0xD000_0000 + slot * REGISTERS as u32
}

/// The PCI configuration: numbers, memory on, class, and the address of the registers.
fn configuration(device: u16, base: u32) -> [u8; 256] {
    let mut bytes = [0; 256];
    let words: [(usize, u32); 5] = [
        (0x00, u32::from(device) << 16 | u32::from(MESA)),
        (0x04, 0x0280_0002),
        (0x08, CLASS << 8 | 1),
        (0x10, base),
        (0x2C, u32::from(device) << 16 | u32::from(MESA)),
    ];
    for (at, word) in words {
        if let Some(place) = bytes.get_mut(at..at + 4) {
            place.copy_from_slice(&word.to_le_bytes());
        }
    }
    bytes
}
