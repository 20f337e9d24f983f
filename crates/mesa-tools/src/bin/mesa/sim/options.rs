//! Command line options of the simulator.

use std::error::Error;
use std::fs;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::{Args, ValueEnum};
use mesa_hal::lbp16;
use mesa_hal_sim::{FirmwareImage, Mishaps, SimFpga, machines};

use super::control::Control;
use super::file;
use super::plan::Plan;
use super::slot::{self, Slot};

const AFTER_HELP: &str = "\
The 7I97's own serial channel is 0 (TB4); more channels take pins of P1. The 7I77 of a 7I92 or a
7I80DB has 7i77-io on 0 and 7i77-analog on 1; 2 is its expansion connector. That of a 7I97 has the
channels 1 to 3. A 7I76 has 7i76 on 0, and its expansion connector is 1.

Devices: 7i77-io, 7i77-analog, 7i64, 7i69, 7i70, 7i71, 7i72, 7i73, 7i73-display, 7i76, 7i76-r14 (an
older 7I76, of software revision 14), 7i76e and 7i76eu (the 7I76 of these boards), 7i76u, 7i83,
7i84, 7i84u, 7i87. What is not known of their records is listed in docs/gateware.md, FACTS 8.7 and
8.8. A 7I90 is a board: --firmware.

It runs in real time until SIGTERM, SIGINT or the command `quit`, then prints a summary.
It takes commands on standard input; type `help`.

With --watch the screen shows each board, its clients and its watchdog, and of one board its
remotes, axes, switches, inputs and outputs as they really are. Type the same commands there; they
are for the board that is shown, and Tab shows the next one. q or Ctrl-C ends it, without a
summary.

A control socket takes the same commands, one a line, with the same answers: lines `name value`,
then `ok`, or `error: ` and the reason. A line {\"command\": \"show motors\"} is answered by one
line of JSON.

Examples:
  mesa sim --board 7i97 --listen 127.0.0.1 --remote 0=7i77-io:2 --loss 0.01
  mesa sim --firmware tests/transcripts/firmwares/7I97-7I97D_51.txt --listen 127.0.0.1
  mesa sim --board 5i25-7i77 --pci /tmp/pci
  mesa sim --machine examples/mill.toml --watch
  mesa sim --machine examples/mill.toml --control 4711
  mesa sim --machine a.toml --machine b.toml --listen 127.0.0.1 --listen 127.0.0.2 --pcap both.pcap";

/// Simulate boards on the network or on the PCI bus, for programs that expect real ones
#[derive(Clone, Debug, Args)]
#[command(after_help = AFTER_HELP, args_override_self = true)]
pub struct Options {
    /// Board to simulate
    #[arg(
        long,
        value_enum,
        ignore_case = true,
        required_unless_present_any = ["machine", "firmware"]
    )]
    board: Option<Board>,
    /// Simulate the board with the firmware whose identity memory is in FILE: a line `ADDR VALUE`,
    /// both hexadecimal, for each word. The board has no motors
    #[arg(long, value_name = "FILE", conflicts_with_all = ["board", "machine"])]
    firmware: Option<PathBuf>,
    /// Simulate the machine described in FILE: board, remotes, motors, switches
    /// (examples/mill.toml). Repeat for more boards, up to 16, in one process
    #[arg(long = "machine", id = "machine", value_name = "FILE", conflicts_with_all = ["board", "remotes"])]
    machines: Vec<PathBuf>,
    /// IPv4 address to listen on, unless given in the machine's file. With several machines, repeat
    /// for each in their order
    #[arg(long, value_name = "ADDR", required_unless_present_any = ["machine", "pci"])]
    listen: Vec<Ipv4Addr>,
    /// Simulate boards on the PCI bus (5I25): make them in FOLDER, in files like those below /sys,
    /// for `mesa --pci FOLDER`
    #[arg(long, value_name = "FOLDER",
        conflicts_with_all = ["listen", "port", "mac", "loss", "late", "dup", "pcap"])]
    pci: Option<PathBuf>,
    /// UDP port, 0 to 65535; 0 takes a free one. Default: the one in the machine's file, or 27181
    #[arg(long)]
    port: Option<u16>,
    /// MAC address of the board, such as 00:60:1b:1b:00:97. With several machines, repeat for each
    /// in their order
    #[arg(long, value_name = "MAC")]
    mac: Vec<Mac>,
    /// Plug a remote into a serial channel; repeat for more. CH: the channel; PORT.CH on a serial
    /// port other than 0. DEVICE: one of the list below, or a description file. MODE: number of the
    /// software mode after power-up; setup: jumper in the setup position (115200 baud)
    #[arg(long = "remote", value_name = "[PORT.]CH=DEVICE[:MODE][:setup]")]
    pub remotes: Vec<RemoteOption>,
    /// Keep the board's EEPROM and flash and the remotes' parameters and firmware in FILE
    #[arg(long, value_name = "FILE")]
    pub state: Option<PathBuf>,
    /// Lose packets with this probability, 0 to 1, in each direction
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = probability)]
    loss: f64,
    /// Delay packets by 0.5 to 3 ms with this probability, 0 to 1
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = probability)]
    late: f64,
    /// Duplicate packets with this probability, 0 to 1
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = probability)]
    dup: f64,
    /// Seed of the packet faults, 0 to 2^64-1
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Show boards and machines live on the whole screen of a terminal, with the console at the
    /// bottom
    #[arg(long)]
    pub watch: bool,
    /// Take commands of other programs as well, on this TCP port of loopback (0 takes a free one)
    /// or on a Unix socket. Repeat for more
    #[arg(long, value_name = "PORT|PATH")]
    pub control: Vec<Control>,
    /// Write all packets to FILE, for wireshark and tcpdump
    #[arg(long, value_name = "FILE")]
    pub pcap: Option<PathBuf>,
    /// Size limit of the capture file in megabytes, 1 to 100000; the capture ends there
    #[arg(long, value_name = "MB", default_value_t = 1000, requires = "pcap",
        value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub pcap_limit: u64,
}

/// Maximum number of boards of one process.
const MAX_BOARDS: usize = 16;

/// A MAC address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mac([u8; 6]);

impl FromStr for Mac {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        parse_mac(text).map(Self)
    }
}

/// A board to simulate, with its name and its address.
pub struct Wanted {
    pub name: String,
    pub machine: MachineOptions,
    pub place: Where,
}

/// Where clients find a board.
pub enum Where {
    Ethernet(SocketAddrV4),
    /// The folder, and the number of the board there.
    Pci {
        root: PathBuf,
        index: usize,
    },
}

impl Options {
    /// Packet faults of the network.
    pub fn mishaps(&self) -> Mishaps {
        Mishaps {
            loss: self.loss,
            late: self.late,
            dup: self.dup,
            seed: self.seed,
        }
    }

    /// The boards to simulate, with their surroundings.
    pub fn wanted(&self) -> Result<Vec<Wanted>, String> {
        let mut machines = Vec::new();
        for path in &self.machines {
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            machines.push((name.into_owned(), file::read(path)?));
        }
        if let Some(path) = &self.firmware {
            let machine = MachineOptions::of_firmware(path, self.remotes.clone())?;
            machines.push(("board".to_owned(), machine));
        }
        if let Some(board) = self.board {
            check_slots(&board.channels(), &self.remotes)?;
            let machine = MachineOptions::new(board, self.remotes.clone());
            machines.push(("board".to_owned(), machine));
        }
        let count = machines.len();
        if count > MAX_BOARDS {
            return Err(format!("no more than {MAX_BOARDS} boards in one process"));
        }
        for (given, option) in [(self.listen.len(), "--listen"), (self.mac.len(), "--mac")] {
            if count > 1 && given > 0 && given != count {
                return Err(format!(
                    "{count} machines and {given} times {option}; give it for each"
                ));
            }
        }
        for index in 1..count {
            // Gives each board a name of its own; several boards may share one description file.
            let before = &machines[..index];
            let is_free = |name: &String| before.iter().all(|(other, _)| other != name);
            let name = &machines[index].0;
            let numbered = (2..).map(|number| format!("{name}-{number}"));
            let free = std::iter::once(name.clone()).chain(numbered).find(is_free);
            if let Some(free) = free {
                machines[index].0 = free;
            }
        }
        let machines = machines.into_iter().enumerate();
        machines
            .map(|(index, (name, machine))| self.place(index, count, name, machine))
            .collect()
    }

    /// Applies the address and the other options of the command line to a board.
    fn place(
        &self,
        index: usize,
        count: usize,
        name: String,
        mut machine: MachineOptions,
    ) -> Result<Wanted, String> {
        machine.seed = self.seed;
        if let Some(root) = &self.pci {
            let root = root.clone();
            return Ok(Wanted {
                name,
                machine,
                place: Where::Pci { root, index },
            });
        }
        // With one board, the last --listen counts.
        let own = if count == 1 {
            usize::max(self.listen.len(), 1) - 1
        } else {
            index
        };
        let ip = self.listen.get(own).copied().or(machine.plan.listen);
        let ip = ip.ok_or_else(|| {
            format!("{name}: where to listen? Give --listen ADDR, or `listen` in its file")
        })?;
        let mac = if count == 1 {
            self.mac.last()
        } else {
            self.mac.get(index)
        };
        let port = self.port.or(machine.plan.port).unwrap_or(lbp16::PORT);
        machine.ip = ip;
        machine.mac = mac.map(|mac| mac.0).or(machine.mac);
        let address = SocketAddrV4::new(ip, port);
        if machine.is_on_pci() {
            return Err(format!(
                "{name}: a board on the PCI bus does not listen on {address}: give --pci FOLDER instead"
            ));
        }
        Ok(Wanted {
            name,
            machine,
            place: Where::Ethernet(address),
        })
    }
}

/// Simulated boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Board {
    #[value(name = "7i97", help = "a 7I97")]
    I7i97,
    #[value(name = "7i97-7i77", help = "a 7I97 with a 7I77 on P1: twelve axes")]
    I7i97With7i77,
    #[value(name = "7i97t", help = "a 7I97T (PWM version 1, ClockHigh 160 MHz)")]
    I7i97t,
    #[value(name = "7i92-7i77", help = "a 7I92 with a 7I77 on P2")]
    I7i92With7i77,
    #[value(
        name = "7i80-7i77",
        help = "a 7I80DB with a 7I77 and firmware of 2016, whose registers are at other addresses"
    )]
    I7i80With7i77,
    #[value(
        name = "7i92-7i76",
        help = "a 7I92 with a 7I76 on P2: five stepper axes"
    )]
    I7i92With7i76,
    #[value(
        name = "7i97-7i76",
        help = "a 7I97 with a 7I76 on P1: six servo axes and five stepper axes"
    )]
    I7i97With7i76,
    #[value(name = "5i25-7i77", help = "a 5I25 (PCI) with a 7I77 on P3")]
    I5i25With7i77,
    #[value(name = "5i25-7i77x2", help = "a 5I25 (PCI) with two 7I77: twelve axes")]
    I5i25With7i77x2,
    #[value(
        name = "5i25-7i77-7i76",
        help = "a 5I25 (PCI) with a 7I77 on P3 and a 7I76 on P2: six servo axes and five stepper axes"
    )]
    I5i25With7i77And7i76,
    /// Any board: its firmware is given as an image.
    #[value(skip)]
    Firmware,
}

impl Board {
    /// Names of all boards.
    pub fn names() -> String {
        let values = Self::value_variants().iter();
        let names =
            values.filter_map(|board| Some(board.to_possible_value()?.get_name().to_owned()));
        names.collect::<Vec<_>>().join(", ")
    }

    /// The FPGA with the board's usual firmware, with `channels` serial channels where the number
    /// is selectable.
    pub fn fpga(self, channels: u8) -> SimFpga {
        match self {
            Self::I7i97 | Self::Firmware => machines::i7i97(channels),
            Self::I7i97With7i77 => machines::i7i97_7i77(),
            Self::I7i97t => machines::i7i97t(channels),
            Self::I7i92With7i77 => machines::i7i92_7i77(),
            Self::I7i80With7i77 => machines::i7i80_of_2016(),
            Self::I7i92With7i76 => machines::i7i92_7i76(),
            Self::I7i97With7i76 => machines::i7i97_7i76(),
            Self::I5i25With7i77 => machines::i5i25_7i77(),
            Self::I5i25With7i77x2 => machines::i5i25_7i77x2(),
            Self::I5i25With7i77And7i76 => machines::i5i25_7i77_7i76(),
        }
    }

    /// Maximum number of channels of each serial port.
    pub fn channels(self) -> Vec<u8> {
        slot::channels(&self.fpga(u8::MAX))
    }

    /// The remotes of the cards that are part of the board, each with its channel.
    pub const fn own_remotes(self) -> &'static [(u8, &'static str)] {
        use super::devices::{ANALOG, FIELD_IO, I7I76};
        match self {
            Self::I7i97 | Self::I7i97t | Self::Firmware => &[],
            Self::I7i97With7i77 => &[(1, FIELD_IO), (2, ANALOG)],
            Self::I7i92With7i77 | Self::I7i80With7i77 | Self::I5i25With7i77 => {
                &[(0, FIELD_IO), (1, ANALOG)]
            }
            Self::I7i92With7i76 | Self::I7i97With7i76 => &[(0, I7I76)],
            Self::I5i25With7i77x2 => &[(0, FIELD_IO), (1, ANALOG), (3, FIELD_IO), (4, ANALOG)],
            Self::I5i25With7i77And7i76 => &[(0, FIELD_IO), (1, ANALOG), (3, I7I76)],
        }
    }

    /// True for a board on the PCI bus.
    pub const fn is_on_pci(self) -> bool {
        match self {
            Self::I5i25With7i77 | Self::I5i25With7i77x2 | Self::I5i25With7i77And7i76 => true,
            Self::I7i97
            | Self::I7i97t
            | Self::I7i97With7i77
            | Self::I7i97With7i76
            | Self::I7i92With7i77
            | Self::I7i92With7i76
            | Self::I7i80With7i77
            | Self::Firmware => false,
        }
    }

    /// Number of analog outputs, from 0 on, that are on the board itself.
    pub const fn own_outputs(self) -> u8 {
        match self {
            Self::I7i97 | Self::I7i97With7i77 | Self::I7i97With7i76 | Self::I7i97t => 6,
            Self::I7i92With7i77
            | Self::I7i80With7i77
            | Self::I7i92With7i76
            | Self::I5i25With7i77
            | Self::I5i25With7i77x2
            | Self::I5i25With7i77And7i76
            | Self::Firmware => 0,
        }
    }

    /// Number of analog outputs, each with an encoder, of the board and its card: the last one of
    /// a 7I76 is its spindle. 0 for a firmware image, whose axes are unknown.
    pub const fn outputs(self) -> usize {
        match self {
            Self::I7i97
            | Self::I7i97t
            | Self::I7i92With7i77
            | Self::I7i80With7i77
            | Self::I5i25With7i77 => 6,
            Self::I7i97With7i77 | Self::I5i25With7i77x2 => 12,
            Self::I7i97With7i76 | Self::I5i25With7i77And7i76 => 7,
            Self::I7i92With7i76 => 1,
            Self::Firmware => 0,
        }
    }

    /// Number of step generators.
    pub const fn generators(self) -> usize {
        match self {
            Self::I7i92With7i76 | Self::I7i97With7i76 | Self::I5i25With7i77And7i76 => 5,
            Self::I7i97
            | Self::I7i97t
            | Self::I7i97With7i77
            | Self::I7i92With7i77
            | Self::I7i80With7i77
            | Self::I5i25With7i77
            | Self::I5i25With7i77x2
            | Self::Firmware => 0,
        }
    }

    /// The output that is the spindle of a 7I76.
    pub const fn spindle(self) -> Option<u8> {
        match self.generators() {
            0 => None,
            _ => Some(self.outputs() as u8 - 1),
        }
    }
}

/// A remote plugged into a channel: `CH=DEVICE[:MODE][:setup]`, or `PORT.CH=...`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RemoteOption {
    pub slot: Slot,
    pub device: String,
    pub mode: Option<u8>,
    /// True if the remote's jumper is in the setup position.
    pub setup: bool,
}

impl FromStr for RemoteOption {
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

/// A board and its surroundings. The text form is the board, or a file with the identity memory of
/// its firmware (ends in `.txt`), followed by remotes separated by commas; or a file that describes
/// the whole machine (ends in `.toml`).
#[derive(Clone, Debug, PartialEq)]
pub struct MachineOptions {
    pub board: Board,
    /// Identity of the firmware, unless it is the board's usual one.
    pub firmware: Option<FirmwareImage>,
    /// IP address from the board's jumpers and EEPROM.
    pub ip: Ipv4Addr,
    /// MAC address, unless it is the default of the simulated boards.
    pub mac: Option<[u8; 6]>,
    pub remotes: Vec<RemoteOption>,
    pub seed: u64,
    /// Mechanics and the wiring of inputs.
    pub plan: Plan,
}

impl MachineOptions {
    /// Creates the options of a board with its usual motors.
    pub fn new(board: Board, remotes: Vec<RemoteOption>) -> Self {
        Self {
            board,
            firmware: None,
            ip: Ipv4Addr::LOCALHOST,
            mac: None,
            remotes,
            seed: 1,
            plan: Plan::default(),
        }
    }
}

impl MachineOptions {
    /// Maximum number of channels of each serial port.
    pub fn channels(&self) -> Result<Vec<u8>, String> {
        let Some(image) = &self.firmware else {
            return Ok(self.board.channels());
        };
        let fpga = SimFpga::from_image(image).map_err(|error| error.to_string())?;
        Ok(slot::channels(&fpga))
    }

    /// True for a board on the PCI bus.
    pub const fn is_on_pci(&self) -> bool {
        self.board.is_on_pci()
    }

    /// Creates the options of a board with the firmware of an image.
    pub fn of_firmware(path: &Path, remotes: Vec<RemoteOption>) -> Result<Self, String> {
        let in_file = |error: &dyn Error| format!("{}: {error}", path.display());
        let text = fs::read_to_string(path).map_err(|error| in_file(&error))?;
        let image = FirmwareImage::parse(&text).map_err(|error| in_file(&error))?;
        let fpga = SimFpga::from_image(&image).map_err(|error| in_file(&error))?;
        check_slots(&slot::channels(&fpga), &remotes)?;
        Ok(Self {
            firmware: Some(image),
            ..Self::new(Board::Firmware, remotes)
        })
    }
}

impl FromStr for MachineOptions {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let path = Path::new(text);
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            return file::read(path);
        }
        let mut parts = text.split(',');
        let name = parts.next().unwrap_or_default();
        let extension = Path::new(name).extension();
        if extension.is_some_and(|extension| extension == "txt") {
            let remotes = parts.map(str::parse).collect::<Result<Vec<_>, _>>()?;
            return Self::of_firmware(Path::new(name), remotes);
        }
        let board = Board::from_str(name, true).map_err(|_| {
            let names = Board::names();
            format!(
                "no machine `{name}`; there are {names}, descriptions: FILE.toml, and images of \
                 firmwares: FILE.txt"
            )
        })?;
        let remotes = parts.map(str::parse).collect::<Result<Vec<_>, _>>()?;
        check_slots(&board.channels(), &remotes)?;
        Ok(Self::new(board, remotes))
    }
}

fn probability(text: &str) -> Result<f64, String> {
    let value = text.parse().ok();
    value
        .filter(|value| (0.0..=1.0).contains(value))
        .ok_or_else(|| format!("`{text}` is no probability from 0 to 1"))
}

/// Refuses remotes in slots that a board with these `channels` does not have, and two in one slot.
pub fn check_slots(channels: &[u8], remotes: &[RemoteOption]) -> Result<(), String> {
    let slots: Vec<Slot> = remotes.iter().map(|remote| remote.slot).collect();
    slot::check(channels, &slots)
}

/// Parses a MAC address of one host: six hexadecimal bytes separated by colons.
pub fn parse_mac(text: &str) -> Result<[u8; 6], String> {
    let bytes: Result<Vec<u8>, _> = text
        .split(':')
        .map(|byte| match byte.len() {
            2 => u8::from_str_radix(byte, 16).map_err(|_| ()),
            _ => Err(()),
        })
        .collect();
    let mac = bytes.ok().and_then(|bytes| <[u8; 6]>::try_from(bytes).ok());
    let mac = mac.filter(|[first, ..]| first & 1 == 0);
    mac.ok_or_else(|| {
        format!("`{text}` is no MAC address of a board: expected 00:60:1b:1b:00:97 or so")
    })
}
