//! `mesa peek` and `mesa poke`: manual access to registers of any space.

use std::fmt::{self, Display};
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use mesa_hal::MesaError;
use mesa_hal::bus::{Access, Clock, RegisterBus};
use mesa_hal::ethernet::EthernetBoard;
use mesa_hal::lbp16::{ElementSize, Space};
use mesa_hal::transport::RegisterMap;
use mesa_tools::passive::{PassiveError, Read, Sample, Watched};
use serde::Serialize;

use crate::board::bus::Bus;
use crate::board::changed::ChangedTarget;
use crate::board::link::BoardLink;
use crate::board::look;
use crate::board::target::{Found, Target};
use crate::machine::embedded::Passage;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::output;
use mesa_hal::hostmot2::HostMot2;
use mesa_tools::advice::told;

const PLACES: &str = "\
SPACE is 0 (HostMot2, 32 bits), 1 (Ethernet chip), 2 (EEPROM), 3 (flash registers, 32 bits),
4 (timer), 6 (control) or 7 (read only); those without a width have 16 bits. Addresses are byte
addresses: multiples of 4 in spaces 0 and 3, of 2 elsewhere. Numbers are decimal, or
hexadecimal after 0x.";

const PEEK: &str = "\
Works beside LinuxCNC or another program that drives the board: writes nothing, and sends at most 20
small packets a second. Registers that a read changes are refused, and those of which it is not
known; --any reads them on a board that no other program drives. Without REGISTER, all that can be
read are listed with their names. REGISTER: a name (encoder.00.count), a module or an instance of it
(encoder, sserial.0.2), an address of HostMot2 (0x3500), or SPACE:ADDRESS; or a pin by its name in
LinuxCNC (inmux.00.input-05), if a register shows it.";

const PEEK_EXAMPLES: &str = "\
Examples (the cookie of HostMot2; the count of the first encoder, ten times a second):
  mesa peek 0:0x100 --addr 10.10.10.10
  mesa peek encoder.00.count --every 100ms --addr 10.10.10.10";

/// Read registers of a board, also of a running machine
#[derive(Debug, Args)]
#[command(after_help = format!("{PEEK}\n\n{PLACES}\n\n{PEEK_EXAMPLES}"))]
pub struct Peek {
    #[command(flatten)]
    target: Target,
    /// First register, by name or address, such as encoder.00.count, 0x3500 or 6:0x0A
    #[arg(value_name = "REGISTER")]
    selection: Option<Selection>,
    /// Number of neighbouring registers, 1 to 16384
    #[arg(value_parser = clap::value_parser!(u16).range(1..=16384))]
    count: Option<u16>,
    /// Read again and again, with this time in between: 50ms to 3600s, as 100ms or 2s
    #[arg(long, value_name = "TIME", value_parser = look::parse_every)]
    every: Option<Duration>,
    /// Read any register, also where a read changes something, as fast as possible. Fails if
    /// another program drives the board
    #[arg(long, conflicts_with = "every", requires = "selection")]
    any: bool,
}

/// Write registers of a board and read them back
#[derive(Debug, Args)]
#[command(after_help = format!("{PLACES}\n\nAn output that is switched on stays on: no watchdog \
    runs unless a driver has started it. The\nEEPROM can be written from 0x20 on; spaces 3 and 7 cannot \
    be written (see `mesa flash`).\n\nExample (the LEDs show the LED pins of HostMot2):\n  \
    mesa poke 6:0x14 0 --addr 10.10.10.10 --yes"))]
pub struct Poke {
    #[command(flatten)]
    target: ChangedTarget,
    /// Address of the first register, such as 6:0x14
    #[arg(value_name = "SPACE:ADDRESS")]
    place: Place,
    /// Values for consecutive registers: 1 to 127 numbers, 0 to 0xFFFFFFFF in space 0, 0 to 0xFFFF
    /// elsewhere
    #[arg(required = true, num_args = 1..=127, value_parser = parse_number)]
    values: Vec<u32>,
}

/// Address of a register.
#[derive(Clone, Copy, Debug)]
struct Place {
    space: Space,
    address: u16,
}

/// Registers of `mesa peek`.
#[derive(Clone, Debug)]
enum Selection {
    At(Place),
    /// Name of a register, a module or an instance.
    Named(String),
}

/// Contents of registers.
#[derive(Debug, Serialize)]
struct Contents {
    space: u8,
    space_name: &'static str,
    bits: usize,
    registers: Vec<Register>,
}

#[derive(Debug, Serialize)]
struct Register {
    address: u16,
    value: u32,
    /// Name in `mesa peek`, if the register has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    written: Option<u32>,
}

impl Peek {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let found = self.target.find(context)?;
        if self.any {
            return self.read_any(context, &found);
        }
        let found = match self.every {
            Some(_) => found.pass_time(Passage::Paced),
            None => found,
        };
        if found.address.on_ethernet().is_none() {
            return self.read_on_pci(context, &found);
        }
        let mut bus = found.look()?;
        let at = |error: &dyn MesaError| look::failed(found.address, error);
        bus.identify().map_err(|error| at(&error))?;
        let map = bus.map().ok_or_else(|| Failure::refused("no firmware"))?;
        if let Some(Selection::Named(name)) = &self.selection
            && map.named(name).next().is_none()
        {
            let watched = Watched::new(bus).map_err(|error| at(&error))?;
            return self.peek_pins(context, &found, watched, name);
        }
        let (space, reads) = self.reads(map)?;
        loop {
            let now = bus.now();
            let words = bus.read_all(&reads).map_err(|error| match error {
                PassiveError::Refused { .. } => refused(&error),
                error => at(&error),
            })?;
            let map = bus.map().ok_or_else(|| Failure::refused("no firmware"))?;
            context.print(&Contents::of_reads(space, &reads, &words, map))?;
            let mut goes_on = |every| look::wait(context, &mut bus, now.after(every));
            if !self.every.is_some_and(&mut goes_on) || output::is_closed() {
                return Ok(context.ending());
            }
        }
    }

    /// Prints the pins of a name: one pin, or all of a module or an instance, with or without the
    /// name of the board before it.
    fn peek_pins(
        &self,
        context: &Context,
        found: &Found,
        mut watched: Watched<BoardLink>,
        name: &str,
    ) -> Result<Ending, Failure> {
        let board = format!("{}.", watched.listener().name());
        let name = name.strip_prefix(&*board).unwrap_or(name);
        let is_named = |full: &str| {
            let own = full.strip_prefix(&*board).unwrap_or_default();
            let rest = own.strip_prefix(name);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        let mut infos = watched.listener().pins().infos().iter();
        let is_pin = infos.any(|info| is_named(&info.name));
        loop {
            let now = watched.bus().now();
            let sample = watched.sample();
            let mut sample = sample.map_err(|error| look::failed(found.address, &error))?;
            sample.values.retain(|value| is_named(&value.name));
            if sample.values.is_empty() {
                return Err(if is_pin {
                    unknown_value(name)
                } else {
                    no_register(name)
                });
            }
            context.print(&PeekedPins(sample))?;
            let mut goes_on = |every| look::wait(context, watched.bus(), now.after(every));
            if !self.every.is_some_and(&mut goes_on) || output::is_closed() {
                return Ok(context.ending());
            }
        }
    }

    /// Registers to read, all of one space.
    fn reads(&self, map: &RegisterMap) -> Result<(Space, Vec<Read>), Failure> {
        let count = self.count.unwrap_or(1);
        // Of a whole module those that can be read; a single one is refused with the reason.
        let named = |name: &'_ str| -> Vec<u16> {
            let all = map.named(name);
            let wanted = all.filter(|register| register.refusal.is_none() || register.name == name);
            wanted.map(|register| register.address).collect()
        };
        let addresses: Vec<u16> = match &self.selection {
            Some(Selection::At(Place { space, address })) => {
                let (space, address) = (*space, *address);
                let read = Read {
                    space,
                    address,
                    count,
                };
                return Ok((space, vec![read]));
            }
            None => map.readable().map(|register| register.address).collect(),
            Some(Selection::Named(name)) => named(name),
        };
        if addresses.is_empty() {
            // On Ethernet it may be a pin, which was looked for before.
            let advice =
                "`mesa peek` without a name lists those that it has, and `mesa pins` prints pins";
            let name = self.selection.iter().map(ToString::to_string);
            let name: String = name.collect();
            let what = format_args!("this firmware has no register `{name}`; {advice}");
            return Err(Failure::refused(what).advising(advice));
        }
        let reads = match (self.count, &addresses[..]) {
            (Some(count), [address, ..]) => vec![Read::hostmot2(*address, count)],
            (_, addresses) => addresses.iter().map(|&at| Read::hostmot2(at, 1)).collect(),
        };
        Ok((Space::HostMot2, reads))
    }

    /// Reads registers on the PCI bus. The lock of the board shows that no other program drives it.
    fn read_on_pci(&self, context: &Context, found: &Found) -> Result<Ending, Failure> {
        let mut bus = found.open()?;
        let map = RegisterMap::of(&HostMot2::identify(&mut bus)?);
        let (space, reads) = self.reads(&map)?;
        if space != Space::HostMot2 {
            found.need_ethernet("a space other than 0")?;
        }
        loop {
            let now = bus.now();
            let mut words = Vec::new();
            for read in &reads {
                let mut part = vec![0; read.count.into()];
                bus.exchange(&[Access::read(read.address, 0, read.count)], &mut part)?;
                words.extend(part);
            }
            context.print(&Contents::of_reads(space, &reads, &words, &map))?;
            let Some(every) = self.every.filter(|_| !output::is_closed()) else {
                return Ok(context.ending());
            };
            let next = now.after(every);
            while bus.now() < next && context.stop.signal().is_none() {
                let left = next.since(bus.now());
                bus.sleep(left.min(look::NOTICE));
            }
            if context.stop.signal().is_some() {
                return Ok(context.ending());
            }
        }
    }

    /// Reads without regard to side effects.
    fn read_any(&self, context: &Context, found: &Found) -> Result<Ending, Failure> {
        let Some(Selection::At(place)) = self.selection else {
            return Err(Failure::usage("`--any` needs SPACE:ADDRESS"));
        };
        let mut bus = found.open()?;
        let count = self.count.unwrap_or(1);
        let values = EthernetBoard::new(&mut bus).peek(place.space, place.address, count)?;
        context.print(&Contents::new(place, &values, &[]))?;
        Ok(context.ending())
    }
}

/// Pins at the time of a read.
#[derive(Debug, Serialize)]
#[serde(transparent)]
struct PeekedPins(Sample);

impl Display for PeekedPins {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let values = &self.0.values;
        let widths = values.iter().map(|value| value.name.len());
        let width = widths.max().unwrap_or(0);
        values.iter().try_for_each(|value| {
            let line = format!("{:<width$}  {value:<6}  {}", value.name, value.place);
            writeln!(f, "{}", line.trim_end())
        })
    }
}

fn no_register(name: &str) -> Failure {
    let advice = "`mesa peek` without a name lists its registers, and `mesa info --passive` the pins that \
                  registers show";
    let what = format_args!("this firmware has no register and no pin `{name}`; {advice}");
    Failure::refused(what).advising(advice)
}

/// Failure because no register shows the value of a pin.
fn unknown_value(name: &str) -> Failure {
    let advice = "`halcmd show pin` shows it, if LinuxCNC drives the board";
    let what = format_args!(
        "`{name}` is known to the program that drives the board alone: no register shows it; {advice}"
    );
    Failure::refused(what).advising(advice)
}

/// Failure because a read may change something.
fn refused(error: &dyn MesaError) -> Failure {
    let advice = "`--any` reads it, on a board that no other program drives";
    Failure::refused(format_args!("{error}; {advice}")).advising(advice)
}

impl Poke {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let Place { space, address } = self.place;
        if space.element() == ElementSize::Word {
            let too_large = self.values.iter().find(|&&value| value > 0xFFFF);
            if let Some(value) = too_large {
                return Err(Failure::usage(format_args!(
                    "0x{value:X} is no 16-bit number, 0 to 0xFFFF"
                )));
            }
        }
        EthernetBoard::<Bus>::check_poke(space, address, self.values.len())
            .map_err(|error| Failure::usage(told(&error)))?;
        let found = self.target.find(context)?;
        let values: Vec<String> = self
            .values
            .iter()
            .map(|value| format!("0x{value:X}"))
            .collect();
        let what = format!(
            "write {} to 0x{address:04X} of space {space}",
            values.join(" ")
        );
        let mut bus = found.open()?;
        if !context.agrees(&self.target, &found, &what)? {
            return Ok(context.ending());
        }
        let values = if space == Space::HostMot2 {
            // Written once only, because a write to a register of the FPGA may have a side effect.
            let count = self.values.len() as u16;
            let mut words = self.values.clone();
            bus.exchange(&[Access::write(address, 0, count)], &mut words)?;
            bus.exchange(&[Access::read(address, 0, count)], &mut words)?;
            words
        } else {
            EthernetBoard::new(&mut bus).poke(space, address, &self.values)?
        };
        context.print(&Contents::new(self.place, &values, &self.values))?;
        Ok(context.ending())
    }
}

impl Contents {
    fn new(place: Place, values: &[u32], written: &[u32]) -> Self {
        let size = place.space.element().bytes();
        let addresses = (usize::from(place.address)..).step_by(size);
        let registers = addresses.zip(values).enumerate();
        Self {
            space: place.space as u8,
            space_name: place.space.name(),
            bits: 8 * size,
            registers: registers
                .map(|(index, (address, &value))| Register {
                    address: address as u16,
                    value,
                    name: None,
                    written: written.get(index).copied(),
                })
                .collect(),
        }
    }

    /// Words of these reads, with the names of the registers.
    fn of_reads(space: Space, reads: &[Read], words: &[u32], map: &RegisterMap) -> Self {
        let size = space.element().bytes();
        let addresses = reads.iter().flat_map(|read| {
            let addresses = (read.address..=u16::MAX).step_by(size);
            addresses.take(read.count.into())
        });
        let registers = addresses.zip(words).map(|(address, &value)| {
            let register = map.at(address).ok().filter(|_| space == Space::HostMot2);
            Register {
                address,
                value,
                name: register.map(|register| register.name.clone()),
                written: None,
            }
        });
        Self {
            space: space as u8,
            space_name: space.name(),
            bits: 8 * size,
            registers: registers.collect(),
        }
    }
}

impl Display for Contents {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.bits / 4;
        for register in &self.registers {
            let Register { address, value, .. } = register;
            write!(
                f,
                "{}:0x{address:04X}  0x{value:0width$X}  {value}",
                self.space
            )?;
            match register.written {
                Some(written) if written != *value => {
                    writeln!(f, "  (0x{written:0width$X} was written)")?;
                }
                _ => {
                    let name = register.name.as_ref().map(|name| format!("  {name}"));
                    writeln!(f, "{}", name.unwrap_or_default())?;
                }
            }
        }
        Ok(())
    }
}

impl Display for Selection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::At(Place { space, address }) => write!(f, "{}:0x{address:X}", *space as u8),
            Self::Named(name) => f.write_str(name),
        }
    }
}

impl FromStr for Selection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.contains(':') {
            return text.parse().map(Self::At);
        }
        if text.starts_with("0x") || text.starts_with("0X") {
            return format!("0:{text}").parse().map(Self::At);
        }
        if text.starts_with(|first: char| first.is_ascii_alphabetic()) {
            return Ok(Self::Named(text.to_lowercase()));
        }
        Err(format!(
            "`{text}` is no SPACE:ADDRESS and no name, for example 0:0x100 or encoder.00.count"
        ))
    }
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("`{text}` is no SPACE:ADDRESS, for example 0:0x100");
        let (space, address) = text.split_once(':').ok_or_else(form)?;
        let number = space.parse::<u16>().ok().filter(|space| *space < 8);
        let number =
            number.ok_or_else(|| format!("`{space}` is no space; there are 0 to 4, 6 and 7"))?;
        let space = Space::from_bits(number);
        if space == Space::Unused {
            return Err("space 5 is not used by any firmware".to_owned());
        }
        let address = parse_number(address)?;
        let address = u16::try_from(address)
            .map_err(|_| format!("0x{address:X} is no address, 0 to 0xFFFF"))?;
        let size = space.element().bytes();
        if !usize::from(address).is_multiple_of(size) {
            return Err(format!("addresses of this space are multiples of {size}"));
        }
        Ok(Self { space, address })
    }
}

fn parse_number(text: &str) -> Result<u32, String> {
    let number = match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u32::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number
        .map_err(|_| format!("`{text}` is no number of 32 bits; decimal, or hexadecimal behind 0x"))
}
