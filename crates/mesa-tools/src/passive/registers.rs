//! Registers that can be read beside a running program.

use core::fmt;

use mesa_hal::hostmot2::{Gtag, HostMot2, ModuleDescriptor};
use mesa_hal::lbp16::Space;
use mesa_hal::lbp16::registers::{control, eeprom, timer};
use mesa_hal::sslbp::{Channel, PortLayout, PortPlace};

/// A register of HostMot2 that can be read without any effect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Register {
    /// Name: module, instance and register, such as `encoder.00.count` or `sserial.0.2.cs`.
    pub name: String,
    /// Address in space 0.
    pub address: u16,
}

/// Reason why a register is not read beside a running program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Refusal {
    /// Nothing of the firmware is there.
    NoRegister,
    /// A read returns something else than the content of the register.
    WriteOnly,
    /// A read changes something, or makes the board wait.
    SideEffect(&'static str),
    /// A register of a module of which it is not known what a read does.
    UnknownModule(Gtag),
}

impl fmt::Display for Refusal {
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
enum Effect {
    None(&'static str),
    Refused(Refusal),
}

use Effect::{None as Plain, Refused};
const WRITE_ONLY: Effect = Refused(Refusal::WriteOnly);
const SYNC: Effect = Refused(Refusal::SideEffect(
    "it marks the time of the driver's cycle for the phase-locked loop",
));

const WATCHDOG: &[Effect] = &[Plain("time"), Plain("status"), WRITE_ONLY];
const IO_PORT: &[Effect] = &[
    Plain("data"),
    Plain("direction"),
    WRITE_ONLY,
    WRITE_ONLY,
    WRITE_ONLY,
];
const ENCODER: &[Effect] = &[
    Plain("count"),
    Plain("control"),
    WRITE_ONLY,
    Plain("timestamp"),
    WRITE_ONLY,
];
const STEPGEN: &[Effect] = &[
    WRITE_ONLY,
    Plain("accumulator"),
    WRITE_ONLY,
    WRITE_ONLY,
    WRITE_ONLY,
    WRITE_ONLY,
    WRITE_ONLY,
    WRITE_ONLY,
    WRITE_ONLY,
    Plain("master-rate"),
];
const PWM: &[Effect] = &[
    WRITE_ONLY,
    WRITE_ONLY,
    WRITE_ONLY,
    WRITE_ONLY,
    Plain("enables"),
];
const INPUTS: &[Effect] = &[
    Plain("control"),
    Plain("filter"),
    Plain("input"),
    Plain("raw"),
    Plain("mpg"),
];
const DPLL: &[Effect] = &[
    Plain("base-rate"),
    Plain("phase-error"),
    Plain("control-0"),
    Plain("control-1"),
    Plain("timer-12"),
    Plain("timer-34"),
    SYNC,
];

/// A kind of module: the first part of its names, and its registers in order. Registers behind the
/// end are not known.
///
/// Source: FACTS 12.4, 12.11; Mesa's public VHDL sources for step generators.
fn known(gtag: Gtag) -> Option<(&'static str, &'static [Effect])> {
    Some(match gtag {
        Gtag::WATCHDOG => ("watchdog", WATCHDOG),
        Gtag::IO_PORT => ("ioport", IO_PORT),
        Gtag::ENCODER | Gtag::MUXED_ENCODER => ("encoder", ENCODER),
        Gtag::STEPGEN => ("stepgen", STEPGEN),
        Gtag::PWM => ("pwmgen", PWM),
        Gtag::IN_MUX => ("inmux", INPUTS),
        Gtag::IN_M => ("inm", INPUTS),
        Gtag::SSR => ("ssr", &[Plain("data"), Plain("rate")]),
        Gtag::HM2DPLL => ("dpll", DPLL),
        Gtag::LED => ("led", &[WRITE_ONLY]),
        _ => return None,
    })
}

/// The registers of a firmware: those that can be read, by name, and the reasons for the others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RegisterMap {
    registers: Vec<Register>,
    refused: Vec<(u16, Refusal)>,
}

impl RegisterMap {
    /// The registers of a firmware.
    pub fn of(firmware: &HostMot2) -> Self {
        let mut map = Self::default();
        for (n, module) in firmware.modules.iter().enumerate() {
            match known(module.gtag) {
                Some((name, effects)) => {
                    // Instances of a kind are numbered through.
                    let before = firmware.modules.iter().take(n);
                    let same = before.filter(|other| known(other.gtag).map(|k| k.0) == Some(name));
                    let first = same
                        .map(|other| other.instances)
                        .fold(0, u8::saturating_add);
                    map.add_module(module, name, effects, first);
                }
                None if matches!(module.gtag, Gtag::SSERIAL | Gtag::SSERIAL_B) => {}
                None => map.add_unknown(module),
            }
        }
        for PortPlace { layout, .. } in PortLayout::ports(firmware) {
            map.add_port(layout);
        }
        map
    }

    fn add_module(&mut self, module: &ModuleDescriptor, name: &str, effects: &[Effect], first: u8) {
        for (register, effect) in (0..module.registers).zip(effects) {
            let is_multiple = module.multiple_registers >> register & 1 == 1;
            let instances = if is_multiple { module.instances } else { 1 };
            for instance in 0..instances {
                let Ok(address) = module.register(register, instance) else {
                    continue;
                };
                match effect {
                    Refused(refusal) => self.refused.push((address, *refusal)),
                    Plain(what) if is_multiple || is_numbered(module.gtag) => {
                        let number = first.saturating_add(instance);
                        self.add(format!("{name}.{number:02}.{what}"), address);
                    }
                    Plain(what) => self.add(format!("{name}.{what}"), address),
                }
            }
        }
        let (effects, registers) = (effects.len() as u8, module.registers);
        for address in (effects..registers).filter_map(|r| module.register(r, 0).ok()) {
            let unknown = Refusal::UnknownModule(module.gtag);
            self.refused.push((address, unknown));
        }
    }

    fn add_unknown(&mut self, module: &ModuleDescriptor) {
        for register in 0..module.registers {
            for instance in 0..module.instances {
                if let Ok(address) = module.register(register, instance) {
                    let refusal = Refusal::UnknownModule(module.gtag);
                    self.refused.push((address, refusal));
                }
            }
        }
    }

    /// Reads of a serial port have no effect: a command to the port is a write (FACTS 2.2).
    fn add_port(&mut self, layout: PortLayout) {
        let port = format!("sserial.{}", layout.instance);
        self.add(format!("{port}.command"), layout.command);
        self.add(format!("{port}.data"), layout.data());
        for channel in layout.mask().iter() {
            self.add_channel(&port, layout, channel);
        }
    }

    fn add_channel(&mut self, port: &str, layout: PortLayout, channel: Channel) {
        let channel_name = format!("{port}.{}", channel.index());
        if let Some(cs) = layout.cs(channel) {
            self.add(format!("{channel_name}.cs"), cs);
        }
        for (n, address) in layout.interfaces(channel).enumerate() {
            self.add(format!("{channel_name}.interface{n}"), address);
        }
    }

    fn add(&mut self, name: String, address: u16) {
        self.registers.push(Register { name, address });
    }

    /// All registers that can be read, in the order of the firmware's modules.
    pub fn registers(&self) -> &[Register] {
        &self.registers
    }

    /// The registers of a name: one register, or all of a module or an instance
    /// (`encoder`, `encoder.00`).
    pub fn named<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Register> {
        let registers = self.registers.iter();
        registers.filter(move |register| {
            let rest = register.name.strip_prefix(name);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        })
    }

    /// The register at an address.
    ///
    /// # Errors
    /// The reason why it is not read.
    pub fn at(&self, address: u16) -> Result<&Register, Refusal> {
        let mut registers = self.registers.iter();
        let found = registers.find(|register| register.address == address);
        found.ok_or_else(|| {
            let mut refused = self.refused.iter();
            let refused = refused.find(|(other, _)| *other == address);
            refused.map_or(Refusal::NoRegister, |(_, refusal)| *refusal)
        })
    }
}

/// Modules that LinuxCNC's names number although they have one instance.
fn is_numbered(gtag: Gtag) -> bool {
    matches!(gtag, Gtag::IN_MUX | Gtag::IN_M | Gtag::SSR)
}

/// Checks a read outside of HostMot2's registers.
///
/// # Errors
/// The reason why it is not done.
///
/// Source: manual 7I97, "7I97 SUPPORTED MEMORY SPACES".
pub(super) fn check_space(space: Space, addresses: core::ops::Range<u32>) -> Result<(), Refusal> {
    let within =
        |start: u16, end: u16| addresses.start >= start.into() && addresses.end <= end.into();
    let is_known = match space {
        Space::Eeprom => within(0, eeprom::LEN),
        Space::Timer => within(timer::TIME_STAMP, timer::WAIT_US) || within(timer::SCRATCH, 0x20),
        Space::Control => within(control::ERROR, control::RESET),
        Space::ReadOnly => within(0, 0x20),
        Space::HostMot2 | Space::EthernetChip | Space::Flash | Space::Unused => false,
    };
    if is_known {
        return Ok(());
    }
    Err(match space {
        Space::EthernetChip => Refusal::SideEffect("some registers of the chip change when read"),
        Space::Flash => Refusal::SideEffect("the data port advances its address"),
        Space::Timer if within(timer::WAIT_US, timer::SCRATCH) => {
            Refusal::SideEffect("the board waits, and answers nobody meanwhile")
        }
        Space::Control if within(control::RESET, 0x20) => {
            Refusal::SideEffect("it belongs to the reset and the reload of the board")
        }
        // The board would count an error.
        _ => Refusal::NoRegister,
    })
}
