//! `mesa peek` and `mesa poke`: manual access to registers of any space.

use std::fmt::{self, Display};
use std::str::FromStr;

use clap::Args;
use mesa_hal::bus::{Access, RegisterBus};
use mesa_hal::ethernet::EthernetBoard;
use mesa_hal::lbp16::{ElementSize, Space};
use serde::Serialize;

use crate::context::{Context, Ending, Failure, told};
use crate::link::Bus;
use crate::target::{ChangedTarget, Target};

const PLACES: &str = "\
SPACE is 0 (HostMot2, 32 bits), 1 (Ethernet chip), 2 (EEPROM), 3 (flash registers, 32 bits),
4 (timer), 6 (control) or 7 (read only); those without a width have 16 bits. Addresses are byte
addresses: multiples of 4 in spaces 0 and 3, of 2 elsewhere. Numbers are decimal, or
hexadecimal after 0x.";

/// Read registers of a board
#[derive(Debug, Args)]
#[command(after_help = format!("{PLACES}\n\nExample (the cookie of HostMot2):\n  \
    mesa peek 0:0x100 --addr 10.10.10.10"))]
pub struct Peek {
    #[command(flatten)]
    target: Target,
    /// Address of the first register, such as 0:0x100
    #[arg(value_name = "SPACE:ADDRESS")]
    place: Place,
    /// Number of registers, 1 to 16384
    #[arg(default_value = "1", value_parser = clap::value_parser!(u16).range(1..=16384))]
    count: u16,
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
    #[serde(skip_serializing_if = "Option::is_none")]
    written: Option<u32>,
}

impl Peek {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let Place { space, address } = self.place;
        let found = self.target.find()?;
        let mut bus = found.open()?;
        let values = EthernetBoard::new(&mut bus).peek(space, address, self.count)?;
        context.print(&Contents::new(self.place, &values, &[]))?;
        Ok(context.ending())
    }
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
        let found = self.target.find()?;
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
                    written: written.get(index).copied(),
                })
                .collect(),
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
                _ => writeln!(f)?,
            }
        }
        Ok(())
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
