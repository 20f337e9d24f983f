//! The command line.

use std::{
    fmt,
    net::{Ipv4Addr, SocketAddrV4},
    path::PathBuf,
};

use lexopt::prelude::*;
use mesa_hal::sim::Mishaps;

pub const HELP: &str = "\
A simulated Mesa Ethernet board: what mesaflash, LinuxCNC and mesa-hal find on a desk.

Usage: sim_board --board BOARD --listen ADDR [OPTIONS]

  --board BOARD         7i97, or 7i92-7i77 (a 7I92 with a 7I77 on P2)
  --listen ADDR         IPv4 address to listen on
  --port PORT           UDP port (default 27181; 0 takes a free one)
  --remote CH=DEVICE[:MODE]
                        plug a remote into serial channel CH; repeat for more.
                        DEVICE: 7i77-io, 7i77-analog, 7i72, 7i64, or a description file.
                        MODE: number of the software mode it powers up in.
                        The 7I97's own channel is 0 (TB4); more channels take pins of P1.
                        The 7I92's 7I77 has 7i77-io on 0 and 7i77-analog on 1; 2 is its
                        expansion connector.
  --state FILE          keep EEPROM, flash and the remotes' non-volatile memory in FILE
  --loss P              lose packets with this probability (0 to 1, each way)
  --late P              delay packets by 0.5 to 3 ms with this probability
  --dup P               double packets with this probability
  --seed N              seed of these mishaps (default 1)
  --help

It runs in real time until SIGTERM, SIGINT or the command `quit`, then prints a summary.
It takes commands on standard input; type `help`.
";

/// Which board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    I7i97,
    I7i92With7i77,
}

/// What is plugged into a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RemoteOption {
    pub channel: u8,
    pub device: String,
    pub mode: Option<u8>,
}

/// Everything the command line says.
#[derive(Clone, Debug)]
pub struct Options {
    pub board: Board,
    pub listen: SocketAddrV4,
    pub remotes: Vec<RemoteOption>,
    pub state: Option<PathBuf>,
    pub mishaps: Mishaps,
}

/// A command line that makes no sense, in words.
#[derive(Debug)]
pub struct UsageError(String);

impl fmt::Display for UsageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl From<lexopt::Error> for UsageError {
    fn from(error: lexopt::Error) -> Self {
        Self(error.to_string())
    }
}

/// Reads the command line; `None`: help was asked for.
pub fn parse(mut parser: lexopt::Parser) -> Result<Option<Options>, UsageError> {
    let (mut board, mut listen, mut port) = (None, None, mesa_hal::lbp16::PORT);
    let (mut remotes, mut state) = (Vec::new(), None);
    let mut mishaps = Mishaps {
        seed: 1,
        ..Mishaps::default()
    };
    while let Some(argument) = parser.next()? {
        match argument {
            Long("board") => board = Some(parse_board(&text(&mut parser)?)?),
            Long("listen") => listen = Some(parse_address(&text(&mut parser)?)?),
            Long("port") => port = parser.value()?.parse()?,
            Long("remote") => remotes.push(parse_remote(&text(&mut parser)?)?),
            Long("state") => state = Some(PathBuf::from(parser.value()?)),
            Long("loss") => mishaps.loss = probability(&text(&mut parser)?)?,
            Long("late") => mishaps.late = probability(&text(&mut parser)?)?,
            Long("dup") => mishaps.dup = probability(&text(&mut parser)?)?,
            Long("seed") => mishaps.seed = parser.value()?.parse()?,
            Long("help") | Short('h') => return Ok(None),
            _ => return Err(argument.unexpected().into()),
        }
    }
    let board = board.ok_or_else(|| UsageError("--board is missing".into()))?;
    let listen = listen.ok_or_else(|| UsageError("--listen is missing".into()))?;
    check_channels(board, &remotes)?;
    Ok(Some(Options {
        board,
        listen: SocketAddrV4::new(listen, port),
        remotes,
        state,
        mishaps,
    }))
}

fn text(parser: &mut lexopt::Parser) -> Result<String, UsageError> {
    Ok(parser.value()?.string()?)
}

fn parse_board(text: &str) -> Result<Board, UsageError> {
    match text.to_ascii_lowercase().as_str() {
        "7i97" => Ok(Board::I7i97),
        "7i92-7i77" => Ok(Board::I7i92With7i77),
        _ => Err(UsageError(format!(
            "no board `{text}`; there are 7i97 and 7i92-7i77"
        ))),
    }
}

fn parse_address(text: &str) -> Result<Ipv4Addr, UsageError> {
    text.parse()
        .map_err(|_| UsageError(format!("`{text}` is no IPv4 address")))
}

fn parse_remote(text: &str) -> Result<RemoteOption, UsageError> {
    let form = || UsageError(format!("`--remote {text}`: expected CH=DEVICE[:MODE]"));
    let (channel, device) = text.split_once('=').ok_or_else(form)?;
    let channel = channel.parse().map_err(|_| form())?;
    let (device, mode) = match device.rsplit_once(':') {
        Some((device, mode)) => (device, Some(mode.parse().map_err(|_| form())?)),
        None => (device, None),
    };
    if device.is_empty() {
        return Err(form());
    }
    Ok(RemoteOption {
        channel,
        device: device.to_owned(),
        mode,
    })
}

fn probability(text: &str) -> Result<f64, UsageError> {
    let value = text.parse().ok();
    value
        .filter(|value| (0.0..=1.0).contains(value))
        .ok_or_else(|| UsageError(format!("`{text}` is no probability from 0 to 1")))
}

fn check_channels(board: Board, remotes: &[RemoteOption]) -> Result<(), UsageError> {
    let channels = match board {
        Board::I7i97 => 8,
        Board::I7i92With7i77 => 3,
    };
    for (index, remote) in remotes.iter().enumerate() {
        let channel = remote.channel;
        if channel >= channels {
            return Err(UsageError(format!(
                "channel {channel}: this board has channels 0 to {}",
                channels - 1
            )));
        }
        if remotes[..index]
            .iter()
            .any(|other| other.channel == channel)
        {
            return Err(UsageError(format!("two remotes on channel {channel}")));
        }
    }
    Ok(())
}
