//! The registers of a firmware: their names, and what a read of them does.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;

use crate::hostmot2::{COOKIE_ADDRESS, Gtag, HostMot2, ModuleDescriptor};
use crate::sslbp::{Channel, CsStatus, PortLayout, PortPlace};

/// A register of HostMot2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedRegister {
    /// Name: module, instance and register, such as `encoder.00.count` or `sserial.0.2.cs`.
    pub name: String,
    /// Address in space 0.
    pub address: u16,
    /// The reason why it is not read beside a running program; `None` if a read has no effect.
    pub refusal: Option<ReadRefusal>,
}

/// Reason why a register is not read beside a running program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ReadRefusal {
    /// Nothing of the firmware is there.
    NoRegister,
    /// A read returns something else than the content of the register.
    WriteOnly,
    /// A read changes something, or makes the board wait.
    SideEffect(&'static str),
    /// A register of a module of which it is not known what a read does.
    UnknownModule(Gtag),
}

impl fmt::Display for ReadRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRegister => f.write_str("no register is known there"),
            Self::WriteOnly => f.write_str("it can be written only, and reads as something else"),
            Self::SideEffect(effect) => write!(f, "a read has a side effect: {effect}"),
            Self::UnknownModule(gtag) => write!(
                f,
                "it belongs to the module {gtag}, of which it is not known what a read changes"
            ),
        }
    }
}

/// What a read of a register does.
#[derive(Clone, Copy, Debug)]
enum ReadEffect {
    Nothing,
    /// It returns something else than the content.
    WriteOnly,
    /// As `Nothing` in this version of the module, and as `WriteOnly` in others.
    NothingIn(u8),
    Changes(&'static str),
}

use ReadEffect::{Changes, Nothing, NothingIn, WriteOnly};

type KnownRegisters = &'static [(&'static str, ReadEffect)];

const WATCHDOG: KnownRegisters = &[("time", Nothing), ("status", Nothing), ("reset", WriteOnly)];
const IO_PORT: KnownRegisters = &[
    ("data", Nothing),
    ("direction", Nothing),
    ("alternate-source", WriteOnly),
    ("open-drain", WriteOnly),
    ("output-invert", WriteOnly),
];
const ENCODER: KnownRegisters = &[
    ("count", Nothing),
    ("control", Nothing),
    ("timestamp-divider", WriteOnly),
    ("timestamp", Nothing),
    ("filter-rate", WriteOnly),
];
const STEPGEN: KnownRegisters = &[
    ("rate", WriteOnly),
    ("accumulator", Nothing),
    ("mode", NothingIn(0xC2)),
    ("dir-setup", WriteOnly),
    ("dir-hold", WriteOnly),
    ("step-length", WriteOnly),
    ("step-space", WriteOnly),
    ("table-data", WriteOnly),
    ("table-last", WriteOnly),
    ("master-rate", Nothing),
];
const PWM: KnownRegisters = &[
    ("value", WriteOnly),
    ("mode", WriteOnly),
    ("master-rate", WriteOnly),
    ("pdm-rate", WriteOnly),
    ("enables", Nothing),
];
const INPUTS: KnownRegisters = &[
    ("control", Nothing),
    ("filter", Nothing),
    ("input", Nothing),
    ("raw", Nothing),
    ("mpg", Nothing),
];
const SSR: KnownRegisters = &[("data", Nothing), ("rate", Nothing)];
const DPLL: KnownRegisters = &[
    ("base-rate", Nothing),
    ("phase-error", Nothing),
    ("control-0", Nothing),
    ("control-1", Nothing),
    ("timer-12", Nothing),
    ("timer-34", Nothing),
    (
        "sync",
        Changes("it marks the time of the driver's cycle for the phase-locked loop"),
    ),
];
const LED: KnownRegisters = &[("data", WriteOnly)];

/// A kind of module: the first part of its names, and its registers in order. Registers behind the
/// end are not known.
///
/// Source: FACTS 12.4, 12.11, 14.1; Mesa's public VHDL sources for step generators.
fn known(gtag: Gtag) -> Option<(&'static str, KnownRegisters)> {
    Some(match gtag {
        Gtag::WATCHDOG => ("watchdog", WATCHDOG),
        Gtag::IO_PORT => ("ioport", IO_PORT),
        Gtag::ENCODER | Gtag::MUXED_ENCODER => ("encoder", ENCODER),
        Gtag::STEPGEN => ("stepgen", STEPGEN),
        Gtag::PWM => ("pwmgen", PWM),
        Gtag::IN_MUX => ("inmux", INPUTS),
        Gtag::IN_M => ("inm", INPUTS),
        Gtag::SSR => ("ssr", SSR),
        Gtag::HM2DPLL => ("dpll", DPLL),
        Gtag::LED => ("led", LED),
        _ => return None,
    })
}

/// The registers of a firmware by name: those that can be read without an effect, and the reasons
/// for the others.
///
/// ```
/// use mesa_hal::hostmot2::HostMot2;
/// use mesa_hal::transport::{ReadRefusal, RegisterMap};
/// use mesa_hal_sim::machines;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let map = RegisterMap::of(&HostMot2::identify(&mut machines::i7i92_7i77())?);
/// assert_eq!(map.name(0x0C00), Some("watchdog.time"));
/// let reset = map.named("watchdog.reset").next().ok_or("no watchdog")?;
/// assert_eq!(reset.refusal, Some(ReadRefusal::WriteOnly));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RegisterMap {
    registers: Vec<NamedRegister>,
}

impl RegisterMap {
    /// The registers of a firmware. Allocates.
    pub fn of(firmware: &HostMot2) -> Self {
        let mut map = Self::default();
        map.add("cookie".into(), COOKIE_ADDRESS, None);
        for (n, module) in firmware.modules.iter().enumerate() {
            if matches!(module.gtag, Gtag::SSERIAL | Gtag::SSERIAL_B) {
                continue;
            }
            let (name, _) = name_of(module.gtag);
            // Instances of a kind are numbered through.
            let before = firmware.modules.iter().take(n);
            let same = before.filter(|other| name_of(other.gtag).0 == name);
            let first = same.map(|other| other.instances);
            map.add_module(module, first.fold(0, u8::saturating_add));
        }
        for PortPlace { layout, .. } in PortLayout::ports(firmware) {
            map.add_port(layout);
        }
        map
    }

    fn add_module(&mut self, module: &ModuleDescriptor, first: u8) {
        let (name, registers) = name_of(module.gtag);
        for register in 0..module.registers {
            let shift = module.multiple_registers.checked_shr(register.into());
            let is_multiple = shift.is_some_and(|bits| bits & 1 == 1);
            let entry = registers.get(usize::from(register)).copied();
            let of_each = if is_multiple || entry.is_none() {
                module.instances
            } else {
                1
            };
            for instance in 0..of_each {
                let Ok(address) = module.register(register, instance) else {
                    continue;
                };
                let is_numbered = is_multiple || entry.is_none() || is_numbered(module.gtag);
                let number = first.saturating_add(instance);
                let stem = if is_numbered {
                    format!("{name}.{number:02}")
                } else {
                    name.into()
                };
                let (name, refusal) = match entry {
                    Some((what, effect)) => {
                        (format!("{stem}.{what}"), effect.refusal(module.version))
                    }
                    None => (
                        format!("{stem}.register-{register}"),
                        Some(ReadRefusal::UnknownModule(module.gtag)),
                    ),
                };
                self.add(name, address, refusal);
            }
        }
    }

    /// Reads of a serial port have no effect: a command to the port is a write (FACTS 2.2).
    fn add_port(&mut self, layout: PortLayout) {
        let port = format!("sserial.{}", layout.instance);
        self.add(format!("{port}.command"), layout.command, None);
        self.add(format!("{port}.data"), layout.data(), None);
        for channel in layout.mask().iter() {
            self.add_channel(&port, layout, channel);
        }
    }

    fn add_channel(&mut self, port: &str, layout: PortLayout, channel: Channel) {
        let channel_name = format!("{port}.{}", channel.index());
        if let Some(cs) = layout.cs(channel) {
            self.add(format!("{channel_name}.{CS}"), cs, None);
        }
        for (n, address) in layout.interfaces(channel).enumerate() {
            self.add(format!("{channel_name}.interface{n}"), address, None);
        }
    }

    fn add(&mut self, name: String, address: u16, refusal: Option<ReadRefusal>) {
        self.registers.push(NamedRegister {
            name,
            address,
            refusal,
        });
    }

    /// All registers whose address has a name, in the order of the firmware's modules.
    pub fn registers(&self) -> &[NamedRegister] {
        &self.registers
    }

    /// The registers that can be read without an effect.
    pub fn readable(&self) -> impl Iterator<Item = &NamedRegister> {
        let registers = self.registers.iter();
        registers.filter(|register| register.refusal.is_none())
    }

    /// The registers of a name: one register, or all of a module or an instance
    /// (`encoder`, `encoder.00`).
    pub fn named<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a NamedRegister> {
        let registers = self.registers.iter();
        registers.filter(move |register| {
            let rest = register.name.strip_prefix(name);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        })
    }

    /// The register at an address, if it can be read without an effect.
    ///
    /// # Errors
    /// The reason why it is not read.
    pub fn at(&self, address: u16) -> Result<&NamedRegister, ReadRefusal> {
        let register = self.find(address).ok_or(ReadRefusal::NoRegister)?;
        register.refusal.map_or(Ok(register), Err)
    }

    /// The name of the register at an address.
    pub fn name(&self, address: u16) -> Option<&str> {
        self.find(address).map(|register| &*register.name)
    }

    /// The meaning of a word that was read at an address, where that is a status: the state and the
    /// faults of a serial channel.
    pub fn meaning(&self, address: u16, word: u32) -> Option<String> {
        let last = self.name(address)?.rsplit('.').next();
        (last == Some(CS)).then(|| format!("{}", CsStatus(word)))
    }

    fn find(&self, address: u16) -> Option<&NamedRegister> {
        let mut registers = self.registers.iter();
        registers.find(|register| register.address == address)
    }
}

impl ReadEffect {
    const fn refusal(self, version: u8) -> Option<ReadRefusal> {
        match self {
            Nothing => None,
            NothingIn(readable) if readable == version => None,
            WriteOnly | NothingIn(_) => Some(ReadRefusal::WriteOnly),
            Changes(effect) => Some(ReadRefusal::SideEffect(effect)),
        }
    }
}

/// The last part of the name of a channel's status.
const CS: &str = "cs";

/// The first part of a module's names, and its registers as far as they are known.
fn name_of(gtag: Gtag) -> (&'static str, KnownRegisters) {
    known(gtag).unwrap_or((gtag.name().unwrap_or("module"), &[]))
}

/// Modules that LinuxCNC's names number although they have one instance.
fn is_numbered(gtag: Gtag) -> bool {
    matches!(gtag, Gtag::IN_MUX | Gtag::IN_M | Gtag::SSR)
}
