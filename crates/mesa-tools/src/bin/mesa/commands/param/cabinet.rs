//! Target of commands for remotes: those of a board, or the one on a serial port of the PC.

use std::time::Duration;

use clap::Args;
use mesa_hal::hal::AnyValue;
use mesa_hal::lbp::RemoteAccess;

use mesa_tools::setup::{
    Cabinet, CabinetError, CabinetRemote, RemotePlace, SETUP_BAUD_RATE, SerialCabinet, SerialHost,
};
use serialport::SerialPort;

use super::board::BoardCabinet;
use crate::board::target::{Found, Target};
use crate::ui::context::{Context, Failure};
use crate::ui::output::complain;
use mesa_tools::advice::told;

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
    /// Baud rate of the card, 9600 to 10000000, if neither its jumper is in the setup position
    /// (115200) nor its NVBaudRate is 9 (2500000, on a board)
    #[arg(
        long, value_name = "BAUD",
        value_parser = clap::value_parser!(u32).range(9_600..=10_000_000)
    )]
    baud: Option<u32>,
}

/// An open serial port.
pub type OpenLine = SerialHost<Box<dyn SerialPort>>;

impl SerialLine {
    /// Baud rates at which silent channels of a board are asked.
    fn rates(&self) -> Vec<u32> {
        [SETUP_BAUD_RATE].into_iter().chain(self.baud).collect()
    }

    /// Opens the serial port, if one was given, for exclusive use.
    pub fn open(&self) -> Result<Option<OpenLine>, Failure> {
        let Some(device) = &self.serial else {
            return Ok(None);
        };
        let port = serialport::new(device, self.baud.unwrap_or(SETUP_BAUD_RATE))
            .timeout(READ)
            .open();
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
    Board(Box<BoardCabinet>),
    /// The remote on a serial port.
    Serial(Box<SerialCabinet<Box<dyn SerialPort>>>),
}

impl CabinetTarget {
    /// Stops the ports of the board and starts its remotes in setup mode, or identifies the remote
    /// on the serial port. Prints missing remotes and problems to standard error.
    pub fn open(&self, context: &Context) -> Result<OpenCabinet, Failure> {
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
        let rates = self.line.rates();
        let cabinet = BoardCabinet::open(self.target.find(context)?, &rates)?;
        Ok(OpenCabinet::Board(Box::new(cabinet)))
    }
}

impl OpenCabinet {
    /// The board, which another program may drive; `None` for a serial port.
    pub fn found(&self) -> Option<&Found> {
        match self {
            Self::Board(board) => Some(&board.found),
            Self::Serial(_) => None,
        }
    }
}

impl Cabinet for OpenCabinet {
    fn remotes(&self) -> Vec<CabinetRemote> {
        match self {
            Self::Board(board) => board.remotes(),
            Self::Serial(card) => card.remotes(),
        }
    }

    fn read(&mut self, place: RemotePlace, name: &str) -> Result<u64, CabinetError> {
        match self {
            Self::Board(board) => board.read(place, name),
            Self::Serial(card) => card.read(place, name),
        }
    }

    fn write(
        &mut self,
        place: RemotePlace,
        name: &str,
        value: AnyValue,
    ) -> Result<(), CabinetError> {
        match self {
            Self::Board(board) => board.write(place, name, value),
            Self::Serial(card) => card.write(place, name, value),
        }
    }

    fn exchange(&mut self, place: RemotePlace, access: RemoteAccess) -> Result<u64, CabinetError> {
        match self {
            Self::Board(board) => board.exchange(place, access),
            Self::Serial(card) => card.exchange(place, access),
        }
    }
}
