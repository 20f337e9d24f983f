//! The side of a simulated board that its clients see: UDP, or a folder like sysfs's.

use std::fmt::{self, Display};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use mesa_hal_sim::wire::Nanos;
use mesa_hal_sim::{SimBoard, SimFpga, UdpFace};
use mesa_pci::simulated::{SimulatedDevice, SimulatedRegisters};
use mesa_pci::{BOARDS, BoardKind, PciAddress};

/// Bus number of the first simulated board; each further one is on a bus of its own.
const FIRST_BUS: u8 = 5;

/// The side of a board that its clients see.
pub enum Face {
    Ethernet(UdpFace),
    Pci(PciFace),
}

/// A board in a folder like sysfs's.
pub struct PciFace {
    device: SimulatedDevice,
    place: Place,
    /// Accesses executed.
    pub accesses: u64,
}

/// Address and folder of a board on the PCI bus.
#[derive(Clone, Debug)]
struct Place {
    address: PciAddress,
    root: PathBuf,
}

impl Face {
    /// A board in a folder, at the `index`th place there. `name` is its name in its firmware.
    pub fn on_pci(
        root: &Path,
        index: usize,
        name: &str,
        board: &mut SimBoard<SimFpga>,
    ) -> Result<Self, String> {
        let kind = kind(name).ok_or_else(|| {
            let known = BOARDS.map(|board| board.name).join(", ");
            format!("a {name} is no board on the PCI bus; there are {known}")
        })?;
        let address = PciAddress {
            domain: 0,
            bus: FIRST_BUS.saturating_add(index as u8),
            device: 0,
            function: 0,
        };
        let device = SimulatedDevice::new(root, address, kind);
        let mut device = device.map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => format!(
                "{}: another simulator has {address} here; give another folder",
                root.display()
            ),
            _ => format!("{}: {error}", root.display()),
        })?;
        device.show(&mut OnPci(board));
        Ok(Self::Pci(PciFace {
            device,
            place: Place {
                address,
                root: root.to_owned(),
            },
            accesses: 0,
        }))
    }

    /// Where clients find the board.
    pub fn place(&self) -> io::Result<String> {
        Ok(match self {
            Self::Ethernet(face) => face.local_addr()?.to_string(),
            Self::Pci(face) => face.place.to_string(),
        })
    }

    /// Time since the start.
    pub fn now(&self) -> Nanos {
        match self {
            Self::Ethernet(face) => face.now(),
            Self::Pci(face) => face.device.now(),
        }
    }

    /// Executes what clients have sent, and waits for `limit` at most if there is nothing.
    pub fn step(&mut self, board: &mut SimBoard<SimFpga>, limit: Duration) -> io::Result<()> {
        match self {
            Self::Ethernet(face) => face.step(board, limit).map(drop),
            Self::Pci(face) => {
                let done = face.device.step(&mut OnPci(board), limit);
                face.accesses += u64::from(done);
                Ok(())
            }
        }
    }

    /// Takes a board on the PCI bus from it, or puts it back.
    pub fn set_on_bus(&mut self, is_on_bus: bool) -> Result<(), String> {
        match self {
            Self::Pci(face) => {
                face.device.set_unplugged(!is_on_bus);
                Ok(())
            }
            Self::Ethernet(_) => Err("this board is on Ethernet: see loss".to_owned()),
        }
    }
}

impl Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} below {}", self.address, self.root.display())
    }
}

/// The kind of a board by its name.
fn kind(name: &str) -> Option<BoardKind> {
    let mut boards = BOARDS.into_iter();
    let board = boards.find(|board| board.name == name);
    board.map(|board| board.kind)
}

/// A simulated board as the PCI bus sees it.
struct OnPci<'a>(&'a mut SimBoard<SimFpga>);

impl SimulatedRegisters for OnPci<'_> {
    fn advance_to(&mut self, nanos: u64) {
        self.0.advance_to(nanos);
    }

    fn read(&mut self, address: u16) -> u32 {
        self.0.read_on_pci(address)
    }

    fn write(&mut self, address: u16, value: u32) {
        self.0.write_on_pci(address, value);
    }
}
