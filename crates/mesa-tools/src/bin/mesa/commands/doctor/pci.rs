//! Findings about a board on the PCI bus, and its data for the report.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::time::Duration;

use mesa_hal::MesaError;
use mesa_hal::bus::{Access, Clock, RegisterBus};
use mesa_hal::ethernet::{FlashChip, SpiFlash};
use mesa_hal::hostmot2::HostMot2;
use mesa_pci::PciDevice;
use mesa_tools::diagnosis::{FigureVerdict, Finding};
use serde::Serialize;

use super::bite;
use crate::board::bus::Bus;
use crate::ui::context::Failure;
use mesa_tools::advice::told;

/// Time of a read from which on a bridge or power management is suspected.
const SLOW: Duration = Duration::from_micros(5);

/// Accesses of one exchange while times are measured.
const AT_A_TIME: u16 = 16;

/// The reads that are measured: the cookie and what follows it.
const READS: Access = Access::read(0x0100, 0, AT_A_TIME);

/// The write that is measured: 1 while the flash memory is not selected. FACTS 15.2.
const NOT_SELECTED: Access = Access::write(0x0070, 0, 1);

/// Register of the configuration port of newer firmware. FACTS 15.2.
const ICAP: u16 = 0x0078;

/// Data of a board on the PCI bus that settles what is not confirmed.
#[derive(Debug, Serialize)]
pub struct PciFacts {
    board: &'static str,
    simulated: bool,
    /// Files of the board in sysfs, by their names.
    sysfs: Vec<(String, String)>,
    /// The first 64 bytes of its configuration, hexadecimal.
    configuration: String,
    /// Median time of a read, and of a write, in nanoseconds.
    read_ns: u64,
    write_ns: u64,
    /// Electronic signature of the flash memory, or why it could not be read.
    flash_id: String,
    /// Time of a byte of the flash memory, with the three accesses that it takes, in nanoseconds.
    flash_byte_ns: u64,
    /// Register 0x0078.
    icap: u32,
}

/// The board in its slot.
pub fn place(device: &PciDevice) -> Finding {
    let name = device.board().name;
    match device.check() {
        Ok(()) if device.is_simulated() => Finding::good("slot", format!("a simulated {name}")),
        Ok(()) => Finding::good(
            "slot",
            format!("a {name}, memory on, no driver of the kernel"),
        ),
        Err(error) => Finding::new(
            FigureVerdict::Bad,
            "slot",
            error.to_string(),
            error
                .advice()
                .map(|advice| advice.to_string())
                .unwrap_or_default(),
        ),
    }
}

/// Adds the findings that need reads only.
pub fn ask(bus: &mut Bus, exchanges: u32, findings: &mut Vec<Finding>) -> Result<(), Failure> {
    let firmware = HostMot2::identify(bus)?;
    let name = firmware.idrom.board().to_uppercase();
    findings.push(Finding::good("firmware", format!("HostMot2 for a {name}")));
    findings.push(bite(bus, &firmware)?);
    let read = median(bus, exchanges, READS, 0)?;
    let figure = format!("{:.2} us", read.as_secs_f64() * 1e6);
    findings.push(match bus {
        Bus::Pci(bus) if bus.is_simulated() => Finding::good("bus: time of a read", figure),
        _ if read > SLOW => Finding::new(
            FigureVerdict::Look,
            "bus: time of a read",
            figure,
            "about 1 us is usual; switch the power management of PCI Express off (`pcie_aspm=off` on the \
             kernel's command line), and try another slot",
        ),
        _ => Finding::good("bus: time of a read", figure),
    });
    Ok(())
}

/// Median time of one register of an access; `word` is written.
fn median(bus: &mut Bus, exchanges: u32, access: Access, word: u32) -> Result<Duration, Failure> {
    let list = bus.prepare(&[access], None)?;
    let mut words = vec![word; access.words().end];
    let mut times = Vec::new();
    for _ in 0..exchanges.max(1) {
        let begun = bus.now();
        let _ = bus.run(&list, &mut words)?;
        times.push(bus.now().since(begun));
    }
    times.sort_unstable();
    let middle = times.get(times.len() / 2).copied().unwrap_or_default();
    Ok(middle / u32::from(access.count.max(1)))
}

impl PciFacts {
    /// Reads the data. The write that is measured changes nothing: the flash memory stays not
    /// selected.
    pub fn gather(bus: &mut Bus, device: &PciDevice) -> Result<Self, Failure> {
        let path = device.path();
        let names = [
            "vendor",
            "device",
            "subsystem_vendor",
            "subsystem_device",
            "class",
            "resource",
        ];
        let sysfs = names.map(|name| (name.to_owned(), text(&path.join(name))));
        let configuration = fs::read(path.join("config")).unwrap_or_default();
        let configuration = configuration.iter().take(64);
        let configuration = configuration.fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        });
        let mut flash = SpiFlash::new(bus);
        let id = flash.id();
        let flash_byte_ns = if id.is_ok() { byte_time(bus)? } else { 0 };
        Ok(Self {
            board: device.board().name,
            simulated: device.is_simulated(),
            sysfs: sysfs.into(),
            configuration,
            read_ns: median(bus, 1000, READS, 0)?.as_nanos() as u64,
            write_ns: median(bus, 1000, NOT_SELECTED, 1)?.as_nanos() as u64,
            flash_byte_ns,
            flash_id: id.map_or_else(|error| told(&error), |id| format!("0x{id:02X}")),
            icap: bus.read(ICAP)?,
        })
    }

    /// Data for the questions about the bus: where they stand, what is not confirmed, what decides
    /// it, and what was found.
    pub fn answers(&self) -> [(&'static str, &'static str, &'static str, String); 3] {
        let found = |text: String| if self.simulated { String::new() } else { text };
        [
            (
                "FACTS 15.1",
                "numbers and size of the region of a board on the PCI bus",
                "its files in sysfs",
                found(format!("{:?}", self.sysfs)),
            ),
            (
                "FACTS 15.2",
                "signature of the flash memory, the time of a byte of it, and the register of the \
                 configuration port",
                "these registers, and a read of 256 bytes",
                found(format!(
                    "{}, {} ns, {:08X}",
                    self.flash_id, self.flash_byte_ns, self.icap
                )),
            ),
            (
                "docs/pci.md",
                "time of a read and of a write",
                "the median of 1000",
                found(format!("{} ns, {} ns", self.read_ns, self.write_ns)),
            ),
        ]
    }
}

/// Time of a byte of the flash memory, in nanoseconds.
fn byte_time(bus: &mut Bus) -> Result<u64, Failure> {
    let mut bytes = [0; 256];
    let begun = bus.now();
    SpiFlash::new(bus).read(0, &mut bytes)?;
    let time = bus.now().since(begun);
    // With the command and its address.
    Ok(time.as_nanos() as u64 / (bytes.len() as u64 + 4))
}

fn text(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap_or_default();
    text.lines().next().unwrap_or_default().to_owned()
}
