//! Boards in sysfs: search and opening.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

use crate::lock::{self, NoLock, Suspect};
use crate::mapping::Mapping;
use crate::simulated::{LOG_FILE, Log};
use crate::{COOKIE, PciAddress, PciBoard, PciBus, PciOpenError, REGISTERS};

/// The root of sysfs on a computer.
pub const SYSFS: &str = "/sys";

/// Folder of all devices, below the root.
const DEVICES: &str = "bus/pci/devices";

/// Bit of the command register: the device answers to accesses of memory.
const MEMORY_SPACE: u16 = 1 << 1;
/// Flag of the kernel: the region is memory.
const IORESOURCE_MEM: u64 = 0x200;

/// A board that the kernel knows. Nothing of it was accessed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PciDevice {
    address: PciAddress,
    board: PciBoard,
    path: PathBuf,
    processes: PathBuf,
}

/// All boards below a root, which is [`SYSFS`] on a computer, in the order of their addresses.
///
/// # Errors
/// The folder of PCI devices cannot be read. A computer without such a folder has no boards.
pub fn search(root: &Path) -> io::Result<Vec<PciDevice>> {
    let entries = match fs::read_dir(root.join(DEVICES)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let name = entry?.file_name();
        let address = name.to_str().and_then(|name| name.parse().ok());
        // A device can go while the list is made; other devices are no boards.
        found.extend(address.and_then(|address| PciDevice::at(root, address).ok()));
    }
    found.sort_by_key(|device| device.address);
    Ok(found)
}

impl PciDevice {
    /// The board at an address below a root.
    ///
    /// # Errors
    /// [`PciOpenError::NoDevice`], [`PciOpenError::OtherDevice`] and [`PciOpenError::Sysfs`].
    pub fn at(root: &Path, address: PciAddress) -> Result<Self, PciOpenError> {
        let path = root.join(DEVICES).join(address.to_string());
        if !path.is_dir() {
            return Err(PciOpenError::NoDevice { address, path });
        }
        let (vendor, device) = (number(&path, "vendor")?, number(&path, "device")?);
        let board = PciBoard::of(vendor, device).ok_or(PciOpenError::OtherDevice {
            address,
            vendor,
            device,
        })?;
        Ok(Self {
            address,
            board,
            path,
            processes: "/proc".into(),
        })
    }

    /// Its address.
    pub const fn address(&self) -> PciAddress {
        self.address
    }

    /// Its kind.
    pub const fn board(&self) -> PciBoard {
        self.board
    }

    /// Its folder in sysfs.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// True if the board is [simulated](crate::simulated).
    pub fn is_simulated(&self) -> bool {
        self.path.join(LOG_FILE).exists()
    }

    /// The kernel's driver of the board; `None` if none is bound, as it should be.
    pub fn driver(&self) -> Option<String> {
        let driver = fs::read_link(self.path.join("driver")).ok()?;
        Some(driver.file_name()?.to_string_lossy().into_owned())
    }

    /// Checks everything that can be checked without an access to the board.
    ///
    /// # Errors
    /// As [`open`](Self::open), as far as they need no access.
    pub fn check(&self) -> Result<(), PciOpenError> {
        let address = self.address;
        if let Some(driver) = self.driver() {
            return Err(PciOpenError::DriverBound { address, driver });
        }
        self.check_region()?;
        let command = self.command()?;
        if command & MEMORY_SPACE == 0 {
            return Err(PciOpenError::MemoryOff { address, command });
        }
        Ok(())
    }

    /// Checks the board, locks it and maps its registers. Nothing is written to it.
    ///
    /// The lock is the kernel's, on the file with the registers: it ends with the bus, or with the
    /// process, however that ends.
    ///
    /// # Errors
    /// All of [`PciOpenError`].
    pub fn open(&self) -> Result<PciBus, PciOpenError> {
        self.check()?;
        let address = self.address;
        let path = self.path.join("resource0");
        let file = OpenOptions::new().read(true).write(true).open(&path);
        let file = file.map_err(|error| PciOpenError::NoAccess {
            address,
            path: path.clone(),
            error,
        })?;
        lock::take(&file).map_err(|reason| match reason {
            NoLock::Held(holder) => PciOpenError::Occupied { address, holder },
            NoLock::Refused(error) => PciOpenError::NotLocked {
                address,
                path: path.clone(),
                error: error.into(),
            },
        })?;
        self.check_mappings(&path)?;
        let mapped = Mapping::new(&file, REGISTERS / 4);
        let registers = mapped.map_err(|error| PciOpenError::NotMapped {
            address,
            path,
            error: error.into(),
        })?;
        let log = self.log()?;
        let mut bus = PciBus::new(address, registers, log, file);
        match bus.cookie() {
            Ok(COOKIE) => Ok(bus),
            Ok(found) => Err(PciOpenError::NoCookie { address, found }),
            Err(_) => Err(self.no_simulator()),
        }
    }

    /// Looks for other programs in a folder like `/proc`, for tests.
    #[must_use]
    pub fn with_processes(self, processes: impl Into<PathBuf>) -> Self {
        Self {
            processes: processes.into(),
            ..self
        }
    }

    fn check_region(&self) -> Result<(), PciOpenError> {
        let path = self.path.join("resource");
        let text = read(&path)?;
        let first = text.lines().next().unwrap_or_default();
        let words: Vec<_> = first.split_whitespace().map(hexadecimal).collect();
        let [Some(start), Some(end), Some(flags)] = words[..] else {
            return Err(unexpected(path, first));
        };
        let bytes = match end.checked_sub(start) {
            Some(0) | None => 0,
            Some(size) => size.saturating_add(1),
        };
        let found = match (bytes, flags & IORESOURCE_MEM) {
            (0, _) => "no addresses".to_owned(),
            (_, 0) => format!("{bytes} bytes that are no memory"),
            (bytes, _) if bytes == REGISTERS as u64 => return Ok(()),
            _ => format!("{bytes} bytes of memory"),
        };
        let address = self.address;
        Err(PciOpenError::WrongRegion { address, found })
    }

    /// The command register in the PCI configuration.
    fn command(&self) -> Result<u16, PciOpenError> {
        use std::os::unix::fs::FileExt;
        let path = self.path.join("config");
        let mut bytes = [0; 2];
        let read = File::open(&path).and_then(|file| file.read_exact_at(&mut bytes, 4));
        read.map_err(|error| PciOpenError::Sysfs { path, error })?;
        Ok(u16::from_le_bytes(bytes))
    }

    fn check_mappings(&self, registers: &Path) -> Result<(), PciOpenError> {
        // The simulator maps the file as well.
        if self.is_simulated() {
            return Ok(());
        }
        let address = self.address;
        match lock::find_mapping(&self.processes, registers) {
            None => Ok(()),
            Some(Suspect::Maps(holder)) => Err(PciOpenError::Occupied { address, holder }),
            Some(Suspect::Hidden(holder)) => Err(PciOpenError::PerhapsOccupied { address, holder }),
        }
    }

    /// The log of a simulated board.
    fn log(&self) -> Result<Option<Log>, PciOpenError> {
        if !self.is_simulated() {
            return Ok(None);
        }
        let log = Log::open(&self.path.join(LOG_FILE));
        log.map(Some).map_err(|_| self.no_simulator())
    }

    fn no_simulator(&self) -> PciOpenError {
        PciOpenError::NoSimulator {
            address: self.address,
            path: self.path.clone(),
        }
    }
}

fn read(path: &Path) -> Result<String, PciOpenError> {
    fs::read_to_string(path).map_err(|error| PciOpenError::Sysfs {
        path: path.to_owned(),
        error,
    })
}

/// A number in a file of its own: `0x2718`.
fn number(folder: &Path, name: &str) -> Result<u16, PciOpenError> {
    let path = folder.join(name);
    let text = read(&path)?;
    let number = hexadecimal(text.trim()).and_then(|number| number.try_into().ok());
    number.ok_or_else(|| unexpected(path, &text))
}

fn hexadecimal(text: &str) -> Option<u64> {
    u64::from_str_radix(text.strip_prefix("0x")?, 16).ok()
}

fn unexpected(path: PathBuf, text: &str) -> PciOpenError {
    let why = format!("`{}` is not what the kernel writes there", text.trim());
    let error = io::Error::new(io::ErrorKind::InvalidData, why);
    PciOpenError::Sysfs { path, error }
}
