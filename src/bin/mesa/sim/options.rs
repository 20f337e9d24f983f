//! What is simulated, as the command line tells it.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use mesa_hal::lbp16;
use mesa_hal::sim::Mishaps;

const AFTER_HELP: &str = "\
The 7I97's own serial channel is 0 (TB4); more channels take pins of P1. The 7I92's 7I77 has
7i77-io on 0 and 7i77-analog on 1; 2 is its expansion connector.

It runs in real time until SIGTERM, SIGINT or the command `quit`, then prints a summary.
It takes commands on standard input; type `help`.

Example:
  mesa sim --board 7i97 --listen 127.0.0.1 --remote 0=7i77-io:2 --loss 0.01";

/// A simulated Ethernet board on the network, which other programs take for a real one
#[derive(Clone, Debug, Args)]
#[command(after_help = AFTER_HELP, args_override_self = true)]
pub struct Options {
    /// Which board
    #[arg(long, value_enum, ignore_case = true)]
    pub board: Board,
    /// IPv4 address to listen on
    #[arg(long, value_name = "ADDR")]
    listen: Ipv4Addr,
    /// UDP port; 0 takes a free one
    #[arg(long, default_value_t = lbp16::PORT)]
    port: u16,
    /// Plug a remote into a serial channel; repeat for more. DEVICE: 7i77-io, 7i77-analog, 7i72,
    /// 7i64, or a description file. MODE: number of the software mode it powers up in; setup: its
    /// jumper is in the setup position (115200 baud)
    #[arg(long = "remote", value_name = "CH=DEVICE[:MODE][:setup]")]
    pub remotes: Vec<RemoteOption>,
    /// Keep EEPROM, flash and the remotes' non-volatile memory in FILE
    #[arg(long, value_name = "FILE")]
    pub state: Option<PathBuf>,
    /// Lose packets with this probability, 0 to 1, each way
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = probability)]
    loss: f64,
    /// Delay packets by 0.5 to 3 ms with this probability, 0 to 1
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = probability)]
    late: f64,
    /// Double packets with this probability, 0 to 1
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = probability)]
    dup: f64,
    /// Seed of these mishaps
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

impl Options {
    /// Where to listen.
    pub fn address(&self) -> SocketAddrV4 {
        SocketAddrV4::new(self.listen, self.port)
    }

    /// What the network does to packets.
    pub fn mishaps(&self) -> Mishaps {
        Mishaps {
            loss: self.loss,
            late: self.late,
            dup: self.dup,
            seed: self.seed,
        }
    }

    /// The board and what is plugged in.
    pub fn machine(&self) -> MachineOptions {
        MachineOptions {
            board: self.board,
            ip: self.listen,
            remotes: self.remotes.clone(),
            seed: self.seed,
        }
    }
}

/// Which board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Board {
    #[value(name = "7i97", help = "a 7I97")]
    I7i97,
    #[value(name = "7i92-7i77", help = "a 7I92 with a 7I77 on P2")]
    I7i92With7i77,
}

/// What is plugged into a channel: `CH=DEVICE[:MODE][:setup]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RemoteOption {
    pub channel: u8,
    pub device: String,
    pub mode: Option<u8>,
    /// Its jumper is in the setup position.
    pub setup: bool,
}

impl FromStr for RemoteOption {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("`{text}`: expected CH=DEVICE[:MODE], for example 0=7i72");
        let (channel, device) = text.split_once('=').ok_or_else(form)?;
        let channel = channel.parse().map_err(|_| form())?;
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
            channel,
            device: device.to_owned(),
            mode,
            setup,
        })
    }
}

/// A board and what is plugged in. As text: the board, then remotes behind commas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MachineOptions {
    pub board: Board,
    /// What its jumpers and its EEPROM give as its address.
    pub ip: Ipv4Addr,
    pub remotes: Vec<RemoteOption>,
    pub seed: u64,
}

impl FromStr for MachineOptions {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(',');
        let name = parts.next().unwrap_or_default();
        let board = Board::from_str(name, true)
            .map_err(|_| format!("no machine `{name}`; there are 7i92-7i77 and 7i97"))?;
        let remotes = parts.map(str::parse).collect::<Result<Vec<_>, _>>()?;
        check_channels(board, &remotes)?;
        Ok(Self {
            board,
            ip: Ipv4Addr::LOCALHOST,
            remotes,
            seed: 1,
        })
    }
}

fn probability(text: &str) -> Result<f64, String> {
    let value = text.parse().ok();
    value
        .filter(|value| (0.0..=1.0).contains(value))
        .ok_or_else(|| format!("`{text}` is no probability from 0 to 1"))
}

/// Refuses remotes on channels that a board does not have, and two on one.
pub fn check_channels(board: Board, remotes: &[RemoteOption]) -> Result<(), String> {
    let channels = match board {
        Board::I7i97 => 8,
        Board::I7i92With7i77 => 3,
    };
    for (index, remote) in remotes.iter().enumerate() {
        let channel = remote.channel;
        if channel >= channels {
            return Err(format!(
                "channel {channel}: this board has channels 0 to {}",
                channels - 1
            ));
        }
        let mut before = remotes.iter().take(index);
        if before.any(|other| other.channel == channel) {
            return Err(format!("two remotes on channel {channel}"));
        }
    }
    Ok(())
}
