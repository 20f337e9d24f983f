//! The board with everything around it.

use std::{error::Error, fmt::Write};

use mesa_hal::sim::{
    AxisWiring, BoardConfig, DriveSource, MotorConfig, SimBoard, SimFpga,
    devices::{SimDevice, find_cable, find_mut},
    machines,
    remote::Cable,
};

use crate::{
    devices,
    options::{Board, Options, RemoteOption},
};

/// Serial port that everything is plugged into.
pub const PORT: usize = 0;

/// Axes of either board.
const AXES: usize = 6;

/// The board, what is plugged in, and what is pulled out but still on the desk.
pub struct Machine {
    pub board: SimBoard<SimFpga>,
    pub remotes: Vec<Plugged>,
    pub kind: Board,
}

/// A remote and where it belongs.
pub struct Plugged {
    pub channel: usize,
    pub device: String,
}

impl Machine {
    /// Builds what the command line says.
    pub fn new(options: &Options) -> Result<Self, Box<dyn Error>> {
        let wanted = with_own_remotes(options);
        let channels = wanted.iter().map(|remote| remote.channel + 1).max();
        let fpga = match options.board {
            Board::I7i97 => machines::i7i97(channels.unwrap_or(1)),
            Board::I7i92With7i77 => machines::i7i92_7i77(),
        };
        let mut config = BoardConfig::new(name(options.board));
        config.ip = *options.listen.ip();
        let mut machine = Self {
            board: SimBoard::new(config, fpga),
            remotes: Vec::new(),
            kind: options.board,
        };
        for remote in &wanted {
            let seed = options.mishaps.seed ^ u64::from(remote.channel) << 32;
            let cable = devices::build(&remote.device, remote.mode, seed)?;
            machine.add(remote, cable);
        }
        machine.wire_motors();
        Ok(machine)
    }

    /// Name of the board.
    pub fn name(&self) -> &'static str {
        name(self.kind)
    }

    /// What is there, for people.
    pub fn inventory(&self) -> String {
        let mut text = String::new();
        for remote in &self.remotes {
            let _ = writeln!(text, "channel {}: {}", remote.channel, remote.device);
        }
        let _ = writeln!(text, "type `help` for what can be done to it");
        text
    }

    /// The FPGA.
    pub fn fpga(&mut self) -> &mut SimFpga {
        self.board.gateware_mut()
    }

    /// The cable of a channel.
    pub fn cable(&mut self, channel: usize) -> Result<&mut Cable, String> {
        let end = self.fpga().remote_mut(PORT, channel);
        end.and_then(|end| find_cable(end))
            .ok_or_else(|| nothing_on(channel))
    }

    /// The device of a channel, plugged in or not.
    pub fn device(&mut self, channel: usize) -> Result<&mut dyn SimDevice, String> {
        let end = self.fpga().remote_mut(PORT, channel);
        end.and_then(|end| find_mut(end))
            .ok_or_else(|| nothing_on(channel))
    }

    /// How often something that is kept has changed.
    pub fn changes(&self) -> u64 {
        self.board.changes()
    }

    /// What is kept.
    pub fn state(&self) -> Vec<u8> {
        self.board.state()
    }

    /// Puts back what was kept.
    pub fn restore(&mut self, state: &[u8]) -> Result<(), Box<dyn Error>> {
        Ok(self.board.restore(state)?)
    }

    fn add(&mut self, remote: &RemoteOption, cable: Cable) {
        let channel = usize::from(remote.channel);
        self.fpga().plug(PORT, channel, Some(Box::new(cable)));
        self.remotes.push(Plugged {
            channel,
            device: remote.device.clone(),
        });
    }

    /// Six motors on the analog outputs turn the six encoders.
    fn wire_motors(&mut self) {
        let kind = self.kind;
        let analog = self.remotes.iter().find(|r| r.device == devices::ANALOG);
        let analog = analog.map(|remote| remote.channel);
        for axis in 0..AXES {
            let source = match (kind, analog) {
                (Board::I7i97, _) => DriveSource::Pwm { unit: axis },
                (_, Some(channel)) => devices::drive(PORT, channel, axis as u8),
                _ => DriveSource::Nothing,
            };
            self.fpga().wire_axis(AxisWiring {
                source,
                encoder: axis,
                motor: MotorConfig::default(),
            });
        }
    }
}

fn name(board: Board) -> &'static str {
    match board {
        Board::I7i97 => "7I97",
        Board::I7i92With7i77 => "7I92",
    }
}

/// The remotes asked for, and those that are part of the board unless others stand in their place.
fn with_own_remotes(options: &Options) -> Vec<RemoteOption> {
    let mut wanted = options.remotes.clone();
    if options.board == Board::I7i92With7i77 {
        for (channel, device) in [(0, devices::FIELD_IO), (1, devices::ANALOG)] {
            if wanted.iter().all(|remote| remote.channel != channel) {
                wanted.push(RemoteOption {
                    channel,
                    device: device.to_owned(),
                    mode: None,
                });
            }
        }
    }
    wanted.sort_by_key(|remote| remote.channel);
    wanted
}

fn nothing_on(channel: usize) -> String {
    format!("no remote belongs to channel {channel}")
}
