//! mesaflash and its files.

use std::net::Ipv4Addr;
use std::process::Command;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

/// An address in 127/8 that no other test uses, because mesaflash always talks to port 27181.
pub fn free_address() -> Ipv4Addr {
    static NEXT: AtomicU8 = AtomicU8::new(1);
    let [_, _, high, low] = std::process::id().to_be_bytes();
    let last = NEXT.fetch_add(1, Ordering::Relaxed);
    Ipv4Addr::new(127, 1 + (high & 0x7F), low, last)
}

/// mesaflash for one board.
#[derive(Clone, Copy, Debug)]
pub struct Mesaflash {
    pub device: &'static str,
    pub address: Ipv4Addr,
}

impl Mesaflash {
    /// Runs mesaflash; returns its success and its output.
    pub fn attempt(self, arguments: &[&str]) -> (bool, String) {
        let address = self.address.to_string();
        let output = Command::new("mesaflash")
            .args(["--device", self.device, "--addr", &address])
            .args(arguments)
            .output()
            .expect("mesaflash runs");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        (output.status.success(), text)
    }

    /// Runs mesaflash, which must succeed; returns its output. mesaflash waits only 2 ms for the
    /// first reply, so that it may need another try on a busy machine.
    pub fn run(self, arguments: &[&str]) -> String {
        let mut last = String::new();
        for _ in 0..20 {
            let (good, text) = self.attempt(arguments);
            if good && !text.contains("No 7I9") {
                return text;
            }
            last = text;
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("mesaflash {arguments:?} fails:\n{last}");
    }
}

/// Invented data with the synchronisation word of a configuration.
pub fn configuration(len: u32) -> Vec<u8> {
    let mut data: Vec<u8> = (0..len)
        .map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    data[16..20].copy_from_slice(&[0xAA, 0x99, 0x55, 0x66]);
    data
}

/// A Xilinx bitfile: header fields a to d, then the data.
pub fn bitfile(design: &str, part: &str, data: &[u8]) -> Vec<u8> {
    let mut file = vec![0x00, 0x09];
    file.extend([
        0x0F, 0xF0, 0x0F, 0xF0, 0x0F, 0xF0, 0x0F, 0xF0, 0x00, 0x00, 0x01,
    ]);
    let fields = [
        (b'a', design),
        (b'b', part),
        (b'c', "2026/01/02"),
        (b'd', "03:04:05"),
    ];
    for (key, text) in fields {
        file.push(key);
        file.extend((text.len() as u16 + 1).to_be_bytes());
        file.extend(text.bytes());
        file.push(0);
    }
    file.push(b'e');
    file.extend((data.len() as u32).to_be_bytes());
    file.extend(data);
    file
}
