//! A simulated board on the PCI bus for tests of this package.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use mesa_hal_sim::SimFpga;
use mesa_hal_sim::devices::{SignalValue, find, find_mut};
use mesa_pci::BoardKind;
use mesa_pci::simulated::{SimulatedDevice, SimulatedRegisters};

/// A board that the test can look at while it is served.
#[derive(Clone)]
pub struct Seen(Arc<Mutex<SimFpga>>);

impl Seen {
    pub fn with<T>(&self, look: impl FnOnce(&mut SimFpga) -> T) -> T {
        look(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Output 3 of the remote on channel 0.
    pub fn output_3(&self) -> bool {
        self.with(|fpga| {
            let device = find(fpga.remote(0, 0).expect("a remote")).expect("a device");
            device.outputs()[3].1 == SignalValue::Bool(true)
        })
    }

    /// Sets an input of the remote on channel 0.
    pub fn set_input(&self, input: usize, on: bool) {
        self.with(|fpga| {
            let device = find_mut(fpga.remote_mut(0, 0).expect("a remote"));
            let set = device.expect("a device").set_input(input, on);
            set.expect("an input");
        });
    }
}

impl SimulatedRegisters for Seen {
    fn advance_to(&mut self, nanos: u64) {
        self.with(|fpga| fpga.advance_to(nanos));
    }

    fn read(&mut self, address: u16) -> u32 {
        self.with(|fpga| fpga.read_register(address))
    }

    fn write(&mut self, address: u16, value: u32) {
        self.with(|fpga| fpga.write_register(address, value));
    }
}

/// A 5I25 in a folder like sysfs's, served by a thread.
pub struct PciBoard {
    pub root: PathBuf,
    pub seen: Seen,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl PciBoard {
    /// As the kernel makes the files: only root may open them.
    pub fn start(name: &str, fpga: SimFpga) -> Self {
        let name = format!("mesa-linuxcnc-{name}-{}", std::process::id());
        let root = std::env::temp_dir().join(name);
        let seen = Seen(Arc::new(Mutex::new(fpga)));
        let address = "0000:05:00.0".parse().expect("an address");
        let device = SimulatedDevice::new(&root, address, BoardKind::I5i25);
        let mut device = device.expect("a folder");
        for name in ["resource0", "mesa_simulated"] {
            let path = device.folder().join(name);
            fs::set_permissions(path, Permissions::from_mode(0o600)).expect("rights");
        }
        let ends = Arc::new(AtomicBool::new(false));
        let (mut board, ended) = (seen.clone(), Arc::clone(&ends));
        let thread = std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                device.step(&mut board, Duration::from_millis(1));
            }
        });
        Self {
            root,
            seen,
            ends,
            thread: Some(thread),
        }
    }

    pub fn root(&self) -> &str {
        self.root.to_str().expect("UTF-8")
    }
}

impl Drop for PciBoard {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = fs::remove_dir_all(&self.root);
    }
}
