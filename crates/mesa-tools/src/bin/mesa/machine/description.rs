//! The description of a simulated machine: a board, and everything connected to it.

use std::error::Error;
use std::fs;
use std::net::Ipv4Addr;
use std::path::Path;
use std::str::FromStr;

use mesa_hal_sim::{FirmwareImage, Motor, SimFpga, SimTerminal, Stepper};

use super::boards::{Board, OF_FIRMWARE};
use super::slot::{self, Slot};

/// A board and everything connected to it. Without axes, each axis of the board has its usual
/// motor.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    pub board: &'static Board,
    /// Identity of the firmware, unless it is the board's usual one.
    pub firmware: Option<FirmwareImage>,
    /// IP address of the board, at which it listens; 127.0.0.1 unless given.
    pub listen: Option<Ipv4Addr>,
    pub port: Option<u16>,
    /// MAC address, unless it is the default of the simulated boards.
    pub mac: Option<Mac>,
    pub remotes: Vec<Remote>,
    pub seed: u64,
    pub axes: Vec<Axis>,
    pub switches: Vec<Switch>,
    pub wheels: Vec<Wheel>,
    pub estop: Option<Estop>,
}

impl Description {
    /// A board with its usual firmware and motors. Refuses remotes in slots that the board does not
    /// have, and two in one slot.
    pub fn of_board(board: &'static Board, remotes: Vec<Remote>) -> Result<Self, String> {
        Self::new(board, None).with_remotes(remotes)
    }

    /// A board with the firmware of an image, without motors. Remotes as in
    /// [`of_board`](Self::of_board).
    pub fn of_firmware(path: &Path, remotes: Vec<Remote>) -> Result<Self, String> {
        let in_file = |error: &dyn Error| format!("{}: {error}", path.display());
        let text = fs::read_to_string(path).map_err(|error| in_file(&error))?;
        let image = FirmwareImage::parse(&text).map_err(|error| in_file(&error))?;
        SimFpga::from_image(&image).map_err(|error| in_file(&error))?;
        Self::new(&OF_FIRMWARE, Some(image)).with_remotes(remotes)
    }

    const fn new(board: &'static Board, firmware: Option<FirmwareImage>) -> Self {
        Self {
            board,
            firmware,
            listen: None,
            port: None,
            mac: None,
            remotes: Vec::new(),
            seed: 1,
            axes: Vec::new(),
            switches: Vec::new(),
            wheels: Vec::new(),
            estop: None,
        }
    }

    fn with_remotes(self, remotes: Vec<Remote>) -> Result<Self, String> {
        check_slots(&self.channels()?, &remotes)?;
        Ok(Self { remotes, ..self })
    }

    /// Maximum number of channels of each serial port.
    pub fn channels(&self) -> Result<Vec<u8>, String> {
        let Some(image) = &self.firmware else {
            return Ok(self.board.channels());
        };
        let fpga = SimFpga::from_image(image).map_err(|error| error.to_string())?;
        Ok(slot::channels(&fpga))
    }

    /// Adds the board's own remotes, on channels where no other is described.
    pub fn with_own_remotes(mut self) -> Self {
        for &(channel, device) in self.board.own_remotes {
            let slot = Slot::channel(channel);
            if self.remotes.iter().all(|remote| remote.slot != slot) {
                self.remotes.push(Remote {
                    slot,
                    device: device.to_owned(),
                    mode: None,
                    setup: false,
                });
            }
        }
        self.remotes.sort_by_key(|remote| remote.slot);
        self
    }
}

/// Refuses remotes in slots that a board with these `channels` does not have, and two in one slot.
pub fn check_slots(channels: &[u8], remotes: &[Remote]) -> Result<(), String> {
    let slots: Vec<Slot> = remotes.iter().map(|remote| remote.slot).collect();
    slot::check(channels, &slots)
}

/// A MAC address of one host: six hexadecimal bytes separated by colons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mac(pub [u8; 6]);

impl FromStr for Mac {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bytes: Result<Vec<u8>, _> = text
            .split(':')
            .map(|byte| match byte.len() {
                2 => u8::from_str_radix(byte, 16).map_err(|_| ()),
                _ => Err(()),
            })
            .collect();
        let mac = bytes.ok().and_then(|bytes| <[u8; 6]>::try_from(bytes).ok());
        let mac = mac.filter(|[first, ..]| first & 1 == 0);
        mac.map(Self).ok_or_else(|| {
            format!("`{text}` is no MAC address of a board: expected 00:60:1b:1b:00:97 or so")
        })
    }
}

/// A remote plugged into a channel: `CH=DEVICE[:MODE][:setup]`, or `PORT.CH=...`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Remote {
    pub slot: Slot,
    /// Name of a known device, or a description file.
    pub device: String,
    /// Software mode after power-up, unless it is the device's first one.
    pub mode: Option<u8>,
    /// True if the remote's jumper is in the setup position.
    pub setup: bool,
}

impl FromStr for Remote {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("`{text}`: expected CH=DEVICE[:MODE], for example 0=7i72");
        let (channel, device) = text.split_once('=').ok_or_else(form)?;
        let slot = channel.parse().map_err(|_| form())?;
        let (device, setup) = match device.strip_suffix(":setup") {
            Some(device) => (device, true),
            None => (device, false),
        };
        let (device, mode) = match device.rsplit_once(':') {
            Some((device, mode)) => (device, Some(mode.parse().map_err(|_| form())?)),
            None => (device, None),
        };
        if device.is_empty() {
            return Err(form());
        }
        Ok(Self {
            slot,
            device: device.to_owned(),
            mode,
            setup,
        })
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    pub name: String,
    pub mover: Mover,
}

/// The motor of an axis, and what drives it.
#[derive(Clone, Debug, PartialEq)]
pub enum Mover {
    /// A motor on an analog output, with its encoder.
    Servo {
        output: u8,
        encoder: usize,
        motor: Motor,
    },
    /// A stepper motor on a step generator.
    Stepper {
        generator: usize,
        encoder: Option<usize>,
        motor: Stepper,
    },
}

impl Mover {
    /// The encoder on the motor.
    pub const fn encoder(&self) -> Option<usize> {
        match *self {
            Self::Servo { encoder, .. } => Some(encoder),
            Self::Stepper { encoder, .. } => encoder,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Switch {
    pub name: String,
    /// Index of the switch's axis.
    pub axis: usize,
    pub from: f64,
    pub to: f64,
    pub hysteresis: f64,
    pub bounce_ms: f64,
    pub normally_closed: bool,
    pub wire: Wire,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Wheel {
    pub name: String,
    pub a: Wire,
    pub b: Wire,
    pub speed: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Estop {
    pub inputs: Vec<Wire>,
    pub cuts_drives: bool,
    /// Channels, each with its line in the description.
    pub cuts_field: Vec<(Slot, usize)>,
}

/// A wire to an input, with its line in the description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wire {
    pub terminal: SimTerminal,
    pub line: usize,
}
