//! Errors of opening a board.

use std::io;
use std::path::PathBuf;

use crate::{COOKIE, COOKIE_ADDRESS, Holder, PciAddress, REGISTERS};

/// A board is refused. [`remedy`](Self::remedy) has what to do about it.
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
    /// The kernel does not lock the file with the registers, so that two programs could drive the board.
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

impl PciOpenError {
    /// What to do, for a person at the computer.
    pub fn remedy(&self) -> String {
        match self {
            Self::NoDevice { .. } => {
                "`lspci -D -d 2718:` lists Mesa's boards with their addresses; a board that is missing there \
                 is not seated, has no power, or was reloaded without a restart of the computer"
                    .to_owned()
            }
            Self::OtherDevice { .. } => {
                "give the address of a 4I74, 5I24, 5I25, 6I24 or 6I25; boards behind a PLX bridge are not \
                 supported"
                    .to_owned()
            }
            Self::Sysfs { .. } => "check that sysfs is mounted on /sys".to_owned(),
            Self::DriverBound { address, driver } => format!(
                "end the program that uses this driver and take the board from it, as root: `echo {address} > \
                 /sys/bus/pci/drivers/{driver}/unbind`"
            ),
            Self::WrongRegion { .. } => {
                "the firmware of this board is not Mesa's, or the computer has given it no addresses: look at \
                 `lspci -vv -d 2718:` and `dmesg`"
                    .to_owned()
            }
            Self::MemoryOff { address, .. } => {
                format!("switch it on, as root: `setpci -s {address} COMMAND=0x2:0x2`")
            }
            Self::NoAccess { .. } => {
                "run it as root, or give the boards to a group that you are in, by a file \
                 /etc/udev/rules.d/50-mesa-pci.rules with the line `ACTION==\"add\", SUBSYSTEM==\"pci\", \
                 ATTR{vendor}==\"0x2718\", RUN+=\"/bin/chgrp plugdev /sys%p/resource0\", RUN+=\"/bin/chmod \
                 0660 /sys%p/resource0\"`, and restart the computer"
                    .to_owned()
            }
            Self::Occupied { holder, .. } => {
                format!("end it first (process {})", holder.process)
            }
            Self::NotLocked { .. } => {
                "use a file system with locks for a simulated board; for a real one, look at the end of `dmesg`"
                    .to_owned()
            }
            Self::PerhapsOccupied { .. } => {
                "end LinuxCNC (`halrun -U`); if it drives other boards only, run this as root".to_owned()
            }
            Self::NotMapped { error, .. } if error.kind() == io::ErrorKind::PermissionDenied => {
                "the kernel is locked down, as it is with Secure Boot: switch Secure Boot off in the BIOS"
                    .to_owned()
            }
            Self::NotMapped { .. } => "look at the end of `dmesg`".to_owned(),
            Self::NoSimulator { path, .. } => format!(
                "start `mesa sim --pci` again, or remove {}",
                path.display()
            ),
            Self::NoCookie { found: u32::MAX, .. } => {
                "the board does not answer: it has no power, or its FPGA was loaded again without a restart of \
                 the computer"
                    .to_owned()
            }
            Self::NoCookie { .. } => {
                "the FPGA has another firmware: write one with HostMot2, with mesaflash, and switch the \
                 computer off and on"
                    .to_owned()
            }
        }
    }
}
