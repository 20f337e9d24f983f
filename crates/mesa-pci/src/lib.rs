//! The register bus of Mesa's PCI boards: 5I25, 6I25 and relatives whose FPGA is on the bus itself.
//!
//! - [`search`] lists the boards that the kernel knows, below a root that is `/sys` on a computer
//!   and another directory in tests.
//! - [`PciDevice::open`] checks a board, locks it, and maps its registers. It refuses with the
//!   reason and the [advice](mesa_wire::MesaError::advice).
//! - [`PciBus`] is the [`RegisterBus`](mesa_wire::bus::RegisterBus) and
//!   [`Clock`](mesa_wire::bus::Clock) of a driver.
//! - [`simulated`] makes such a board from a file, for tests and for `mesa sim --pci`.
//!
//! # Order and arrival of writes
//!
//! The registers are mapped uncached. The processor and all bridges keep the order of accesses to
//! one board, so that COMMAND never overtakes the data before it. A write is *posted*: the
//! processor goes on before it has arrived, which is usually within 1 us. A read waits until all
//! writes before it have arrived. So a read forces them, at its own cost of about 1 us:
//!
//! | writes | forced by | cost |
//! |---|---|---|
//! | set-up, and all of [`exchange`](mesa_wire::bus::RegisterBus::exchange) | a read of the cookie at the end, unless the list ends with a read | one read |
//! | set-up that is written again in the cycle | the evidence that the same list reads | none |
//! | outputs, watchdog and COMMAND of a cycle | the read of the next cycle | none |
//!
//! The last row is enough: the watchdog's time is several periods, and a remote's transfer starts
//! when COMMAND arrives. [`Reply::certain`](mesa_wire::bus::Reply::certain) of a list that only
//! writes is false, and that of the next list that reads is true.
//!
//! # A board that vanishes
//!
//! A board without power, in reset, or whose addresses were taken away reads as all ones. If a list
//! reads such a word, [`PciBus`] reads the cookie as well. Without the cookie the whole list fails
//! with [`BusError::Vanished`](mesa_wire::bus::BusError::Vanished), and no word is changed: in the
//! same cycle, and before any of it is taken for data.

pub mod simulated;

pub mod advice;
mod boards;
mod bus;
mod device;
mod error;
mod lock;
mod mapping;

pub use boards::{BOARDS, BoardKind, MESA, PciBoard};
pub use bus::{PciBus, PciCounts};
pub use device::{PciDevice, SYSFS, search};
pub use error::PciOpenError;
pub use lock::Holder;
pub use mesa_wire::bus::PciAddress;

/// Bytes of the registers of a board.
pub const REGISTERS: usize = 0x1_0000;

/// Address of the cookie.
const COOKIE_ADDRESS: u16 = 0x0100;
/// Value of the cookie. FACTS 9.1.
const COOKIE: u32 = 0x55AA_CAFE;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
