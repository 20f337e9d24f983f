//! Folders like sysfs's, and simulators that serve them.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use mesa_hal_sim::SimFpga;
use mesa_pci::simulated::{SimulatedDevice, SimulatedRegisters};
use mesa_pci::{BoardKind, PciAddress, PciDevice};

use crate::tools::realtime_thread;

/// A folder of a test, which is removed at its end.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new() -> Self {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("mesa-pci-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        fs::create_dir_all(&path).expect("a folder");
        Self(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

pub fn address() -> PciAddress {
    "0000:05:00.0".parse().expect("an address")
}

/// The files of a board that is not simulated: a copy of a simulated one without its log, with the
/// cookie in its memory.
pub fn plain(root: &Path, kind: BoardKind) -> PathBuf {
    let made = Folder::new();
    let simulated = SimulatedDevice::new(made.path(), address(), kind).expect("a board");
    let folder = root.join("bus/pci/devices").join(address().to_string());
    fs::create_dir_all(&folder).expect("a folder");
    for entry in fs::read_dir(simulated.folder()).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name");
        if path.is_file() && name != "mesa_simulated" {
            fs::copy(&path, folder.join(name)).expect("copied");
        }
    }
    poke(&folder, 0x0100, 0x55AA_CAFE);
    folder
}

/// Writes into the memory of a plain board.
pub fn poke(folder: &Path, address: u64, word: u32) {
    use std::os::unix::fs::FileExt;
    let file = fs::File::options()
        .write(true)
        .open(folder.join("resource0"));
    let written = file.and_then(|file| file.write_all_at(&word.to_le_bytes(), address));
    written.expect("written");
}

/// Reads from the memory of a plain board.
pub fn peek(folder: &Path, address: u64) -> u32 {
    use std::os::unix::fs::FileExt;
    let mut bytes = [0; 4];
    let file = fs::File::open(folder.join("resource0"));
    let read = file.and_then(|file| file.read_exact_at(&mut bytes, address));
    read.expect("read");
    u32::from_le_bytes(bytes)
}

pub fn device(root: &Path) -> PciDevice {
    PciDevice::at(root, address()).expect("a board")
}

/// A simulated FPGA as the board behind mapped memory.
pub struct Fpga(pub SimFpga);

impl SimulatedRegisters for Fpga {
    fn advance_to(&mut self, nanos: u64) {
        self.0.advance_to(nanos);
    }

    fn read(&mut self, address: u16) -> u32 {
        self.0.read_register(address)
    }

    fn write(&mut self, address: u16, value: u32) {
        self.0.write_register(address, value);
    }
}

/// A simulator in a thread of its own.
pub struct Served<B> {
    flags: Arc<Flags>,
    thread: Option<JoinHandle<B>>,
}

#[derive(Default)]
struct Flags {
    ends: AtomicBool,
    is_unplugged: AtomicBool,
}

/// Simulator and driver answer in time on a busy computer, where the user may have that.
impl<B: SimulatedRegisters + Send + 'static> Served<B> {
    pub fn start(root: &Path, mut board: B) -> Self {
        let made = SimulatedDevice::new(root, address(), BoardKind::I5i25);
        let mut device = made.expect("a board");
        let flags = Arc::new(Flags::default());
        let seen = Arc::clone(&flags);
        let thread = thread::spawn(move || {
            realtime_thread();
            while !seen.ends.load(Ordering::Relaxed) {
                device.set_unplugged(seen.is_unplugged.load(Ordering::Acquire));
                device.step(&mut board, Duration::from_millis(1));
            }
            board
        });
        Self {
            flags,
            thread: Some(thread),
        }
    }

    pub fn unplug(&self, is_unplugged: bool) {
        self.flags
            .is_unplugged
            .store(is_unplugged, Ordering::Release);
    }

    /// Ends the simulator and returns the board.
    pub fn end(mut self) -> B {
        self.flags.ends.store(true, Ordering::Relaxed);
        let thread = self.thread.take().expect("it runs");
        thread.join().expect("the simulator")
    }
}

impl<B> Drop for Served<B> {
    fn drop(&mut self) {
        self.flags.ends.store(true, Ordering::Relaxed);
    }
}
