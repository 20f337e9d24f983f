//! Errors of opening a board.

use std::fmt;
use std::io;
use std::path::PathBuf;

use mesa_wire::{Advice, MesaError};

use crate::{COOKIE, COOKIE_ADDRESS, Holder, PciAddress, REGISTERS, advice};

/// A board is refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PciOpenError {
    /// There is no such device, or no PCI bus.
    #[error("{address}: the kernel knows no PCI device here ({} does not exist)", path.display())]
    NoDevice {
        /// Address of the device.
        address: PciAddress,
        /// Its folder in sysfs.
        path: PathBuf,
    },
    /// The device is none of the [boards](crate::BOARDS) that are on the bus themselves.
    #[error(
        "{address}: this is no board of Mesa's that is on the PCI bus itself (vendor and device {vendor:04x}:{device:04x})"
    )]
    OtherDevice {
        /// Address of the device.
        address: PciAddress,
        /// Its vendor number.
        vendor: u16,
        /// Its device number.
        device: u16,
    },
    /// A file in sysfs cannot be read, or has not the form that the kernel gives it.
    #[error("{}: {error}", path.display())]
    Sysfs {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// A driver in the kernel has the board.
    #[error("{address}: the driver `{driver}` of the kernel is bound to this board")]
    DriverBound {
        /// Address of the board.
        address: PciAddress,
        /// Name of the driver.
        driver: String,
    },
    /// The registers are not where, or not as large as, they are on Mesa's boards.
    #[error(
        "{address}: region 0 has {found}, expected {REGISTERS} bytes of memory with the registers"
    )]
    WrongRegion {
        /// Address of the board.
        address: PciAddress,
        /// What the region is.
        found: String,
    },
    /// The board does not answer to accesses of memory, because its command register says so.
    #[error(
        "{address}: access to the memory of this board is off (its PCI command register is {command:#06x}, bit 1 is 0)"
    )]
    MemoryOff {
        /// Address of the board.
        address: PciAddress,
        /// Its command register.
        command: u16,
    },
    /// This user may not open the registers.
    #[error("{address}: no right to read and write {}: {error}", path.display())]
    NoAccess {
        /// Address of the board.
        address: PciAddress,
        /// The file with the registers.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// Another program has the board.
    #[error("{address}: {holder} drives this board")]
    Occupied {
        /// Address of the board.
        address: PciAddress,
        /// The program.
        holder: Holder,
    },
    /// The kernel does not lock the file with the registers, so that two programs could drive the
    /// board.
    #[error("{address}: the kernel does not lock {}: {error}", path.display())]
    NotLocked {
        /// Address of the board.
        address: PciAddress,
        /// The file with the registers.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// LinuxCNC runs, and this user may not see whether it has mapped this board. It does not lock
    /// boards.
    #[error(
        "{address}: LinuxCNC runs ({holder}), and only root can see whether it drives this board"
    )]
    PerhapsOccupied {
        /// Address of the board.
        address: PciAddress,
        /// LinuxCNC's realtime process.
        holder: Holder,
    },
    /// The kernel does not map the registers.
    #[error("{address}: the kernel does not map {}: {error}", path.display())]
    NotMapped {
        /// Address of the board.
        address: PciAddress,
        /// The file with the registers.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// The simulator that made this board has ended.
    #[error("{address}: the simulator that made {} has ended", path.display())]
    NoSimulator {
        /// Address of the board.
        address: PciAddress,
        /// Folder of the board.
        path: PathBuf,
    },
    /// Something else than HostMot2 answers.
    #[error(
        "{address}: no HostMot2 on this board: register {COOKIE_ADDRESS:#06x} reads {found:08X}, expected {COOKIE:08X}"
    )]
    NoCookie {
        /// Address of the board.
        address: PciAddress,
        /// What was read in the place of the cookie.
        found: u32,
    },
}

impl MesaError for PciOpenError {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            Self::NoDevice { .. } => advice::LIST_BOARDS,
            Self::OtherDevice { .. } => advice::GIVE_BOARD,
            Self::Sysfs { .. } => advice::CHECK_SYSFS,
            Self::DriverBound { .. } => advice::UNBIND_DRIVER,
            Self::WrongRegion { .. } => advice::CHECK_REGION,
            Self::MemoryOff { .. } => advice::SWITCH_MEMORY_ON,
            Self::NoAccess { .. } => advice::ALLOW_ACCESS,
            Self::Occupied { .. } => advice::END_HOLDER,
            Self::NotLocked { .. } => advice::USE_LOCKS,
            Self::PerhapsOccupied { .. } => advice::END_LINUXCNC,
            Self::NotMapped { error, .. } if error.kind() == io::ErrorKind::PermissionDenied => {
                advice::UNLOCK_KERNEL
            }
            Self::NotMapped { .. } => advice::READ_DMESG,
            Self::NoSimulator { .. } => advice::START_SIMULATOR,
            Self::NoCookie {
                found: u32::MAX, ..
            } => advice::RESTART_COMPUTER,
            Self::NoCookie { .. } => advice::WRITE_HOSTMOT2,
        })
    }

    fn write_advice(&self, words: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::DriverBound { address, .. } | Self::MemoryOff { address, .. }) = self else {
            return f.write_str(words);
        };
        let words = words.replace("ADDRESS", &address.to_string());
        match self {
            Self::DriverBound { driver, .. } => f.write_str(&words.replace("DRIVER", driver)),
            _ => f.write_str(&words),
        }
    }
}
