//! `mesa hal`: initial files for LinuxCNC and for mesa-hal.

mod linuxcnc;
mod machine;
mod rust;

use std::fmt::{self, Display};
use std::fs;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use mesa_hal::{Board, Settings};
use serde::Serialize;

use crate::board::consent::Asks;
use crate::board::modes::Modes;
use crate::board::target::Target;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::files;
use crate::ui::output::complain;
use machine::{Axes, Machine};
use mesa_tools::advice::told;

const AFTER_HELP: &str = "\
The files: machine.ini, with the first steps and the values to set (marked TODO); board.hal, the
driver with a signal for each pin; motion.hal, LinuxCNC's motion, servo loops and emergency stop,
and lines for switches, spindle, coolant, probe and handwheel that are prepared as comments;
tool.tbl, the tools; bench.hal, the board alone; main.rs, a program for mesa-hal. None of them
enables a drive. Without --out they are printed.

Stops the serial ports and turns all pins into inputs: do not use this on a running machine. A board
that another program drives is left alone. Existing files are replaced only with --yes or after a
question.

Examples:
  mesa hal --addr 10.10.10.10 --mode 0.0=2 --out my_machine
  mesa hal --addr 10.10.10.10 --driver mesa_eth --axes XYZ --out my_machine
  cd my_machine && halrun -I -i machine.ini -f bench.hal
  linuxcnc my_machine/machine.ini";

/// Write initial HAL and INI files for LinuxCNC, and a program for mesa-hal
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Hal {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
    /// The axes, a letter for each joint in the order of the outputs: XYZ, or XYYZ for two motors
    /// on one axis. Default: every output that can drive an axis
    #[arg(long, value_name = "XYZ")]
    axes: Option<Axes>,
    /// The component of LinuxCNC that drives the board. Default: hm2_eth, or hm2_pci on the PCI bus
    #[arg(long, value_enum)]
    driver: Option<Component>,
    /// Directory for the files, created if missing
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    asks: Asks,
}

/// A component of LinuxCNC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
enum Component {
    /// LinuxCNC's own for Ethernet boards, with hostmot2
    Hm2Eth,
    /// This project's, which is installed beside it
    MesaEth,
    /// LinuxCNC's own for boards on the PCI bus, with hostmot2
    Hm2Pci,
    /// This project's for boards on the PCI bus
    MesaPci,
}

impl Component {
    /// The requested component, or LinuxCNC's own for the board. Fails if it is for the other
    /// interface.
    fn of(requested: Option<Self>, machine: &Machine) -> Result<Self, Failure> {
        let is_pci = machine.host.is_pci();
        let usual = if is_pci { Self::Hm2Pci } else { Self::Hm2Eth };
        let component = requested.unwrap_or(usual);
        if matches!(component, Self::Hm2Pci | Self::MesaPci) == is_pci {
            return Ok(component);
        }
        let other = if is_pci {
            "this board is on the PCI bus; give hm2_pci or mesa_pci"
        } else {
            "this board is on Ethernet; give hm2_eth or mesa_eth"
        };
        Err(Failure::usage(format_args!("--driver: {other}")).advising(other))
    }

    /// True for this project's components, which have pins that LinuxCNC's have not.
    const fn is_ours(self) -> bool {
        matches!(self, Self::MesaEth | Self::MesaPci)
    }
}

/// The files, written or printed.
#[derive(Debug, Serialize)]
struct Skeleton {
    board: String,
    files: [File; NAMES.len()],
    #[serde(skip)]
    is_written: bool,
}

#[derive(Debug, Serialize)]
struct File {
    path: PathBuf,
    text: String,
}

/// Names of the files, in the order in which they are read.
const NAMES: [&str; 6] = [
    "machine.ini",
    "board.hal",
    "motion.hal",
    "tool.tbl",
    "bench.hal",
    "main.rs",
];

impl Hal {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        if let Some(directory) = &self.out {
            may_replace(directory, self.asks, context)?;
        }
        let machine = self.look(context)?;
        let component = Component::of(self.driver, &machine)?;
        if let Some(signal) = context.stop.signal() {
            complain(format_args!("mesa: ended by {signal}; nothing was written"));
            return Ok(Ending::Stopped(signal));
        }
        let texts = [
            linuxcnc::ini(&machine, component),
            linuxcnc::board(&machine, component),
            linuxcnc::motion(&machine, component),
            linuxcnc::tools(),
            linuxcnc::bench(&machine),
            rust::program(&machine),
        ];
        let directory = self.out.as_deref().unwrap_or(Path::new(""));
        let mut texts = texts.into_iter();
        let skeleton = Skeleton {
            files: NAMES.map(|name| File {
                path: directory.join(name),
                text: texts.next().unwrap_or_default(),
            }),
            board: machine.board,
            is_written: self.out.is_some(),
        };
        if skeleton.is_written {
            skeleton.write(directory)?;
        }
        context.print(&skeleton)?;
        Ok(context.ending())
    }

    /// Discovers the board with all outputs off. Prints its remotes, missing remotes and remarks to
    /// standard error.
    fn look(&self, context: &Context) -> Result<Machine, Failure> {
        let found = self.target.find(context)?;
        let mut settings = Settings::default();
        self.modes.put(&mut settings);
        let board = Board::identify(found.open()?, settings)?.discover()?;
        let machine = Machine::of(&board, found.address, self.axes.as_ref())?;
        for remote in &machine.remotes {
            complain(format_args!("{}: {remote}", machine.board));
        }
        // Nothing has to be on a channel.
        for missing in board.missing().iter().filter(|one| !one.is_silent()) {
            complain(format_args!("MISSING: {}", told(missing)));
        }
        for remark in board.remarks() {
            complain(format_args!("Note: {}", told(remark)));
        }
        Ok(machine)
    }
}

/// Asks for consent before files are replaced. Anything else of such a name, such as a directory,
/// is refused.
fn may_replace(directory: &Path, asks: Asks, context: &Context) -> Result<(), Failure> {
    let mut there = Vec::new();
    for name in NAMES {
        let path = directory.join(name);
        match fs::metadata(&path) {
            Ok(found) if !found.is_file() => {
                let why = "no regular file, and left unchanged; choose another --out";
                return Err(Failure::usage(format_args!("{}: {why}", path.display())));
            }
            Ok(_) => there.push(path),
            Err(_) => {}
        }
    }
    asks.replaces_all(context, &there)
}

impl Skeleton {
    fn write(&self, directory: &Path) -> Result<(), Failure> {
        fs::create_dir_all(directory)
            .map_err(|error| Failure::refused(format_args!("{}: {error}", directory.display())))?;
        let mut files = self.files.iter();
        files.try_for_each(|file| files::write(&file.path, file.text.as_bytes()))
    }
}

impl Display for Skeleton {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.files.iter().try_for_each(|File { path, text }| {
            let path = path.display();
            if self.is_written {
                writeln!(f, "{path}")
            } else {
                writeln!(f, "==> {path} <==\n{text}")
            }
        })
    }
}
