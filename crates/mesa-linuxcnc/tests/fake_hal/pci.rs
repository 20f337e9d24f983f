//! The component under the name `mesa_pci.so`, on a simulated 5I25 in mapped memory.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use mesa_hal_sim::devices::{SignalValue, find, find_mut};
use mesa_hal_sim::{SimFpga, machines};
use mesa_pci::BoardKind;
use mesa_pci::simulated::{SimulatedDevice, SimulatedRegisters};

use crate::hal::{Hal, hal};
use crate::{PERIOD, SETTLE};

/// A board that the test can look at while it is served.
#[derive(Clone)]
struct Seen(Arc<Mutex<SimFpga>>);

impl Seen {
    fn with<T>(&self, look: impl FnOnce(&mut SimFpga) -> T) -> T {
        look(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn output_3(&self) -> bool {
        self.with(|fpga| {
            let device = find(fpga.remote(0, 0).expect("a remote")).expect("a device");
            device.outputs()[3].1 == SignalValue::Bool(true)
        })
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

/// A 5I25 with a 7I77 in a folder like sysfs's, served by a thread.
struct PciBoard {
    root: PathBuf,
    seen: Seen,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl PciBoard {
    fn start(name: &str) -> Self {
        let name = format!("mesa-linuxcnc-{name}-{}", std::process::id());
        let root = std::env::temp_dir().join(name);
        let mut fpga = machines::i5i25_7i77();
        machines::plug_7i77(&mut fpga, 0, 0);
        let seen = Seen(Arc::new(Mutex::new(fpga)));
        let address = "0000:05:00.0".parse().expect("an address");
        let device = SimulatedDevice::new(&root, address, BoardKind::I5i25);
        let mut device = device.expect("a folder");
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

    fn root(&self) -> &str {
        self.root.to_str().expect("UTF-8")
    }
}

impl Drop for PciBoard {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = std::fs::remove_dir_all(&self.root);
    }
}

fn refused(hal: &Hal, words: &[(&str, &str)]) -> String {
    assert!(hal.load_as("mesa_pci.so", words).is_err());
    hal.messages()
}

#[test]
fn it_drives_the_boards_on_the_pci_bus_with_the_words_of_hm2_pci() {
    let (hal, board) = (hal(), PciBoard::start("driven"));
    let words = [
        ("config", "num_encoders=6 sserial_port_0=00xxxxxx"),
        ("sysfs", board.root()),
    ];
    let loaded = hal.load_as("mesa_pci.so", &words);
    let loaded = loaded.unwrap_or_else(|result| panic!("{result}: {}", hal.messages()));
    let messages = hal.messages();
    assert!(
        messages.contains("5I25 at 0000:05:00.0: hm2_5i25.0"),
        "{messages}"
    );
    loaded.set("hm2_5i25.0.watchdog.timeout_ns", 4e9);
    let cycle = || {
        loaded.call("hm2_5i25.0.read", PERIOD.as_nanos() as i64);
        loaded.call("hm2_5i25.0.write", PERIOD.as_nanos() as i64);
        std::thread::sleep(PERIOD);
    };
    loaded.set("hm2_5i25.0.7i77.0.0.output-03", 1.0);
    board.seen.with(|fpga| {
        let device = find_mut(fpga.remote_mut(0, 0).expect("a remote"));
        device
            .expect("a device")
            .set_input(7, true)
            .expect("an input");
    });
    let start = std::time::Instant::now();
    while !board.seen.output_3() || loaded.get("hm2_5i25.0.7i77.0.0.input-07") == 0.0 {
        assert!(start.elapsed() < SETTLE, "{}", loaded.messages());
        cycle();
    }
    loaded.unload();
    assert!(!board.seen.output_3(), "off at the end");
}

#[test]
fn wrong_words_and_an_empty_bus_are_refused_with_the_reason() {
    let (hal, board) = (hal(), PciBoard::start("refused"));
    let sysfs = ("sysfs", board.root());
    let address = refused(&hal, &[sysfs, ("board_ip", "10.10.10.10")]);
    assert!(
        address.contains("board_ip=10.10.10.10: mesa_pci takes"),
        "{address}"
    );
    let surplus = refused(&hal, &[sysfs, ("config", "num_encoders=1,num_encoders=2")]);
    assert!(surplus.contains("config=num_encoders=2:"), "{surplus}");
    let empty = refused(&hal, &[("sysfs", "/var/empty/no-such-folder")]);
    assert!(
        empty.contains("no board on the PCI bus below /var/empty"),
        "{empty}"
    );
    let found = mesa_pci::search(&board.root).expect("boards");
    let bus = found[0].open().expect("free");
    let occupied = refused(&hal, &[sysfs]);
    assert!(occupied.contains("drives this board"), "{occupied}");
    drop(bus);
}
