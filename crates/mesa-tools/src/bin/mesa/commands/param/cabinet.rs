//! Target of commands for remotes: those of a board, or the one on a serial port of the PC.

use std::time::Duration;

use clap::Args;
use mesa_hal::hal::AnyValue;
use mesa_hal::transport::udp::UdpError;
use mesa_hal::{Board, Configured, DriverError, Settings};
use mesa_tools::setup::{
    Cabinet, CabinetRemote, RemotePlace, SETUP_BAUD_RATE, SerialCabinet, SerialCabinetError,
    SerialHost,
};
use serialport::SerialPort;

use crate::context::{Failure, told};
use crate::link::Bus;
use crate::output::complain;
use crate::target::{Found, Target};

/// Timeout of one read from a serial port.
const READ: Duration = Duration::from_millis(10);

/// All remotes of a board, or the one card on a serial port.
#[derive(Clone, Debug, Args)]
pub struct CabinetTarget {
    #[command(flatten)]
    pub target: Target,
    #[command(flatten)]
    pub line: SerialLine,
}

/// A serial port of the PC.
#[derive(Clone, Debug, Args)]
pub struct SerialLine {
    /// Serial port of the PC with a card in setup mode, for example /dev/ttyUSB0; instead of a
    /// board
    #[arg(long, value_name = "DEVICE", conflicts_with_all = ["addr", "sim"])]
    pub serial: Option<String>,
    /// Baud rate of the serial port, 9600 to 10000000. A card in setup mode uses 115200
    #[arg(
        long, value_name = "BAUD", default_value_t = SETUP_BAUD_RATE, requires = "serial",
        value_parser = clap::value_parser!(u32).range(9_600..=10_000_000)
    )]
    baud: u32,
}

/// An open serial port.
pub type OpenLine = SerialHost<Box<dyn SerialPort>>;

impl SerialLine {
    /// Opens the serial port, if one was given, for exclusive use.
    pub fn open(&self) -> Result<Option<OpenLine>, Failure> {
        let Some(device) = &self.serial else {
            return Ok(None);
        };
        let port = serialport::new(device, self.baud).timeout(READ).open();
        let port = port.map_err(|error| {
            let hint = match error.kind() {
                serialport::ErrorKind::Io(std::io::ErrorKind::PermissionDenied) => {
                    "; you may have to be in the group that owns it (often `dialout`)"
                }
                serialport::ErrorKind::NoDevice => {
                    "; is its adapter plugged in, and no other program using it?"
                }
                _ => "",
            };
            Failure::refused(format_args!("{device}: {error}{hint}"))
        })?;
        Ok(Some(SerialHost::new(port)))
    }
}

/// Remotes in setup mode.
pub enum OpenCabinet {
    /// Remotes of a board.
    Board {
        board: Box<Configured<Bus>>,
        found: Found,
    },
    /// The remote on a serial port.
    Serial(Box<SerialCabinet<Box<dyn SerialPort>>>),
}

/// Error of reading or writing a parameter.
#[derive(Debug, thiserror::Error)]
pub enum CabinetError {
    #[error(transparent)]
    Board(#[from] DriverError<UdpError>),
    #[error(transparent)]
    Serial(#[from] SerialCabinetError),
}

impl CabinetTarget {
    /// Stops the ports of the board and starts its remotes in setup mode, or identifies the remote
    /// on the serial port. Prints missing remotes and problems to standard error.
    pub fn open(&self) -> Result<OpenCabinet, Failure> {
        if let Some(line) = self.line.open()? {
            let device = self.line.serial.as_deref().unwrap_or_default();
            let open = SerialCabinet::open(line);
            let open =
                open.map_err(|error| Failure::refused(format_args!("{device}: {}", told(&error))))?;
            if open.remote.is_bare {
                let card = open.remote.started.name;
                return Err(Failure::refused(format_args!(
                    "{device}: this {card} answers neither unit number nor discovery: its firmware was \
                     cut off, or it is older than discovery. `mesa update` finishes a firmware update"
                )));
            }
            for problem in &open.found.problems {
                complain(format_args!("Note: {device}: {}", told(problem)));
            }
            return Ok(OpenCabinet::Serial(Box::new(open)));
        }
        let found = self.target.find()?;
        let board = Board::identify(found.open()?, Settings::default())?.discover()?;
        for missing in board.missing().iter().filter(|remark| !remark.is_silent()) {
            complain(format_args!("MISSING: {}", told(missing)));
        }
        for remark in board.remarks() {
            complain(format_args!("Note: {}", told(remark)));
        }
        if Cabinet::remotes(&board).is_empty() {
            let why: Vec<_> = board.missing().iter().map(|remark| told(remark)).collect();
            return Err(Failure::refused(format_args!(
                "{}: no remote answers. {}",
                found.address,
                why.join("\n")
            )));
        }
        Ok(OpenCabinet::Board {
            board: Box::new(board),
            found,
        })
    }
}

impl OpenCabinet {
    /// The board, which another program may drive; `None` for a serial port.
    pub fn found(&self) -> Option<&Found> {
        match self {
            Self::Board { found, .. } => Some(found),
            Self::Serial(_) => None,
        }
    }
}

impl Cabinet for OpenCabinet {
    type Error = CabinetError;

    fn remotes(&self) -> Vec<CabinetRemote> {
        match self {
            Self::Board { board, .. } => Cabinet::remotes(&**board),
            Self::Serial(card) => card.remotes(),
        }
    }

    fn read(&mut self, place: RemotePlace, name: &str) -> Result<u64, CabinetError> {
        Ok(match self {
            Self::Board { board, .. } => board.read(place, name)?,
            Self::Serial(card) => card.read(place, name)?,
        })
    }

    fn write(
        &mut self,
        place: RemotePlace,
        name: &str,
        value: AnyValue,
    ) -> Result<(), CabinetError> {
        match self {
            Self::Board { board, .. } => board.write(place, name, value)?,
            Self::Serial(card) => card.write(place, name, value)?,
        }
        Ok(())
    }
}
