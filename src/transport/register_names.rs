//! Names of registers.

use alloc::collections::BTreeMap;
use alloc::format;
use alloc::string::String;

use crate::hostmot2::{COOKIE_ADDRESS, Gtag, HostMot2, ModuleDescriptor};
use crate::sslbp::{Channel, CsStatus, PortLayout};

/// Number of ports that are searched.
const MAX: u8 = 4;

/// The names of a firmware's registers, each found once.
pub(super) struct RegisterNames<'a> {
    firmware: &'a HostMot2,
    known: BTreeMap<u16, String>,
}

impl<'a> RegisterNames<'a> {
    pub fn new(firmware: &'a HostMot2) -> Self {
        Self {
            firmware,
            known: BTreeMap::new(),
        }
    }

    /// The name of a register.
    pub fn of(&mut self, address: u16) -> &str {
        let firmware = self.firmware;
        let found = self.known.entry(address);
        found.or_insert_with(|| name(firmware, address))
    }

    /// The name of a register, and what its word means where that is a status.
    pub fn read(&mut self, address: u16, word: u32) -> String {
        let name = self.of(address);
        if name.ends_with(" CS") {
            format!("{name}: {}", CsStatus(word))
        } else {
            name.into()
        }
    }
}

/// Returns the name of a register: the module by the name of its tag and the number of the
/// instance, and the register by its name, or else by its number.
fn name(firmware: &HostMot2, address: u16) -> String {
    if address == COOKIE_ADDRESS {
        return "HostMot2 cookie".into();
    }
    let serial = (0..MAX).find_map(|port| in_port(firmware, port, address));
    let module = || {
        firmware
            .modules
            .iter()
            .find_map(|it| in_module(it, address))
    };
    let name = serial.or_else(module);
    name.unwrap_or_else(|| format!("register {address:#06X}"))
}

fn in_port(firmware: &HostMot2, port: u8, address: u16) -> Option<String> {
    let layout = PortLayout::locate(firmware, port).ok()?;
    if address == layout.command {
        return Some(format!("sserial {port} COMMAND"));
    }
    if address == layout.data() {
        return Some(format!("sserial {port} DATA"));
    }
    Channel::ALL.into_iter().find_map(|channel| {
        let registers = layout.channel(channel)?;
        if address == registers.cs {
            return Some(format!("sserial {port} channel {channel} CS"));
        }
        let number = registers.interfaces().position(|it| it == address)?;
        Some(format!(
            "sserial {port} channel {channel} interface {number}"
        ))
    })
}

fn in_module(module: &ModuleDescriptor, address: u16) -> Option<String> {
    let gtag = module.gtag;
    let kind = gtag.name().unwrap_or("module");
    for register in 0..module.registers {
        for instance in 0..module.instances {
            if module.register(register, instance) != Ok(address) {
                continue;
            }
            let is_shared = module
                .multiple_registers
                .checked_shr(register.into())
                .is_none_or(|bit| bit & 1 == 0);
            let instance = if is_shared {
                String::new()
            } else {
                format!(" {instance}")
            };
            return Some(match known(gtag, register) {
                Some(name) => format!("{kind}{instance} {name}"),
                None => format!("{kind}{instance} register {register}"),
            });
        }
    }
    None
}

/// Names of registers, as in the code of their modules.
fn known(gtag: Gtag, register: u8) -> Option<&'static str> {
    let names: &[&str] = match gtag {
        Gtag::WATCHDOG => &["time left", "status", "reset"],
        Gtag::IO_PORT => &[
            "data",
            "direction",
            "alternate source",
            "open drain",
            "output invert",
        ],
        Gtag::ENCODER | Gtag::MUXED_ENCODER => {
            &["count", "control", "divider", "timestamp", "filter rate"]
        }
        Gtag::PWM => &["value", "mode", "master rate", "PDM rate", "enables"],
        _ => &[],
    };
    names.get(usize::from(register)).copied()
}
