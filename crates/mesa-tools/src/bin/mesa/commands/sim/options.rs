//! Command line options of the simulator.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::PathBuf;

use clap::Args;
use mesa_hal::lbp16;
use mesa_hal_sim::Mishaps;

use super::control::Control;
use crate::machine::boards::Board;
use crate::machine::description::{Description, Mac, Remote};
use crate::machine::file;

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
    board: Option<&'static Board>,
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
    pub remotes: Vec<Remote>,
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

/// A board to simulate, with its name and its address.
pub struct Wanted {
    pub name: String,
    pub machine: Description,
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
            let machine = Description::of_firmware(path, self.remotes.clone())?;
            machines.push(("board".to_owned(), machine));
        }
        if let Some(board) = self.board {
            let machine = Description::of_board(board, self.remotes.clone())?;
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
        mut machine: Description,
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
        let ip = self.listen.get(own).copied().or(machine.listen);
        let ip = ip.ok_or_else(|| {
            format!("{name}: where to listen? Give --listen ADDR, or `listen` in its file")
        })?;
        let mac = if count == 1 {
            self.mac.last()
        } else {
            self.mac.get(index)
        };
        let port = self.port.or(machine.port).unwrap_or(lbp16::PORT);
        machine.listen = Some(ip);
        machine.mac = mac.copied().or(machine.mac);
        let address = SocketAddrV4::new(ip, port);
        if machine.board.is_on_pci {
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

fn probability(text: &str) -> Result<f64, String> {
    let value = text.parse().ok();
    value
        .filter(|value| (0.0..=1.0).contains(value))
        .ok_or_else(|| format!("`{text}` is no probability from 0 to 1"))
}
