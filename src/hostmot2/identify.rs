//! Reading the firmware's description of itself.

use super::idrom::{IDROM_WORDS, IdromFault, MAX_PINS};
use super::module::{DescriptorFault, MODULE_WORDS};
use super::{
    Gtag, GtagList, IdentifyError, Idrom, IdromPart, MissingModule, ModuleDescriptor, Name8,
    PinDescriptor, Warning,
};
use crate::bus::{Access, RegisterBus};
use alloc::vec::Vec;

/// Address of the cookie; configuration name and IDROM address follow it.
const COOKIE_ADDRESS: u16 = 0x0100;
const COOKIE: u32 = 0x55AA_CAFE;
const CONFIG_NAME: Name8 = Name8(*b"HOSTMOT2");

/// The most module descriptors there are.
const MAX_MODULES: usize = GtagList::CAPACITY;

/// Words of one access: fewer than any bus can move at once.
const ACCESS_WORDS: u16 = 64;

/// What a HostMot2 firmware says about itself: the board, its modules and its pins.
///
/// # Example
/// ```no_run
/// # fn f<B: mesa_hal::bus::RegisterBus>(mut bus: B) -> Result<(), Box<dyn std::error::Error>> {
/// use mesa_hal::hostmot2::{Gtag, HostMot2};
/// let firmware = HostMot2::identify(&mut bus)?;
/// println!("{} with {}", firmware.idrom().board_name, firmware.gtags());
/// let encoders = firmware.require(Gtag::MUXED_ENCODER)?;
/// println!("{} encoders at {:#06X}", encoders.instances, encoders.base);
/// # Ok(()) }
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostMot2 {
    idrom: Idrom,
    modules: Vec<ModuleDescriptor>,
    pins: Vec<PinDescriptor>,
    warnings: Vec<Warning>,
}

impl HostMot2 {
    /// Reads and checks the description: four exchanges on the bus, whatever the firmware.
    ///
    /// What real clients refuse and what would give wrong addresses is an error; what is merely
    /// odd is in [`warnings`](Self::warnings).
    ///
    /// Source: FACTS 9.1, 9.5.
    ///
    /// # Real time
    /// For set-up: allocates.
    pub fn identify<B: RegisterBus>(bus: &mut B) -> Result<Self, IdentifyError<B::Error>> {
        let start = read_cookie(bus)?;
        let idrom = read_header(bus, start)?;
        let modules = read_modules(bus, start, &idrom)?;
        let pins = read_pins(bus, start, &idrom)?;
        let warnings = warnings(&idrom, &modules, &pins);
        Ok(Self {
            idrom,
            modules,
            pins,
            warnings,
        })
    }

    /// The header of the IDROM: board, widths, clocks.
    pub fn idrom(&self) -> &Idrom {
        &self.idrom
    }

    /// All modules, in the order of their descriptors.
    pub fn modules(&self) -> &[ModuleDescriptor] {
        &self.modules
    }

    /// All pins, by I/O number.
    pub fn pins(&self) -> &[PinDescriptor] {
        &self.pins
    }

    /// What is odd about this firmware.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// The kinds of modules and how many there are of each.
    pub fn gtags(&self) -> GtagList {
        let mut list = GtagList::new();
        for module in &self.modules {
            list.push(module.gtag, module.instances);
        }
        list
    }

    /// The module of a kind, if the firmware has it. A descriptor without instances is none.
    pub fn find(&self, gtag: Gtag) -> Option<&ModuleDescriptor> {
        self.modules
            .iter()
            .find(|module| module.gtag == gtag && module.instances > 0)
    }

    /// The module of a kind; an error that names what is there if the firmware does not have it.
    pub fn require(&self, gtag: Gtag) -> Result<&ModuleDescriptor, MissingModule> {
        self.find(gtag).ok_or_else(|| MissingModule {
            wanted: gtag,
            present: self.gtags(),
        })
    }

    /// The smart serial module: [`Gtag::SSERIAL`], or else [`Gtag::SSERIAL_B`].
    pub fn require_sserial(&self) -> Result<&ModuleDescriptor, MissingModule> {
        self.find(Gtag::SSERIAL)
            .map_or_else(|| self.require(Gtag::SSERIAL_B), Ok)
            .map_err(|missing| MissingModule {
                wanted: Gtag::SSERIAL,
                ..missing
            })
    }

    /// The pins of instance `unit` of a module, with their I/O numbers.
    pub fn pins_of(
        &self,
        gtag: Gtag,
        unit: u8,
    ) -> impl Iterator<Item = (u16, &PinDescriptor)> + '_ {
        (0..)
            .zip(&self.pins)
            .filter(move |(_, pin)| pin.belongs_to(gtag, unit))
    }

    /// How many channels instance `instance` of the smart serial module `gtag` brings to pins:
    /// the highest one counts. 0 if it has no pins at all.
    ///
    /// Source: FACTS 2.1.
    pub fn sserial_channels(&self, gtag: Gtag, instance: u8) -> u8 {
        self.pins_of(gtag, instance)
            .filter_map(|(_, pin)| pin.sserial_channel())
            .max()
            .map_or(0, |highest| highest + 1)
    }
}

/// Checks cookie and name, and gives the address of the IDROM.
fn read_cookie<B: RegisterBus>(bus: &mut B) -> Result<u32, IdentifyError<B::Error>> {
    let mut words = [0; 4];
    read(bus, COOKIE_ADDRESS, &mut words)?;
    let [cookie, name_low, name_high, start] = words;
    if cookie != COOKIE {
        return Err(IdentifyError::NoCookie { found: cookie });
    }
    let name = Name8::from_words(name_low, name_high);
    if name != CONFIG_NAME {
        return Err(IdentifyError::WrongName { found: name });
    }
    Ok(start)
}

fn read_header<B: RegisterBus>(bus: &mut B, start: u32) -> Result<Idrom, IdentifyError<B::Error>> {
    let address = place(IdromPart::Header, start, 0, IDROM_WORDS as u32)?;
    let mut words = [0; IDROM_WORDS];
    read(bus, address, &mut words)?;
    Idrom::parse(words).map_err(|fault| match fault {
        IdromFault::Type(found) => IdentifyError::UnknownIdromType { found },
        IdromFault::Widths {
            ports,
            port_width,
            io_width,
        } => IdentifyError::Widths {
            ports,
            port_width,
            io_width,
        },
        IdromFault::Clock { low, hz } => IdentifyError::Clock { low, hz },
        IdromFault::Stride(found) => IdentifyError::Stride { found },
    })
}

fn read_modules<B: RegisterBus>(
    bus: &mut B,
    start: u32,
    idrom: &Idrom,
) -> Result<Vec<ModuleDescriptor>, IdentifyError<B::Error>> {
    let mut words = [0; MAX_MODULES * MODULE_WORDS];
    let address = place(
        IdromPart::Modules,
        start,
        idrom.offset_to_modules,
        words.len() as u32,
    )?;
    read(bus, address, &mut words)?;
    let (descriptors, _) = words.as_chunks::<MODULE_WORDS>();
    let mut modules = Vec::new();
    for (index, &descriptor) in (0u8..).zip(descriptors) {
        let [what, ..] = descriptor;
        let gtag = Gtag(what as u8);
        let parsed = ModuleDescriptor::parse(descriptor, idrom).map_err(|fault| match fault {
            DescriptorFault::ClockTag(found) => IdentifyError::ClockTag { index, gtag, found },
            DescriptorFault::Strides { register, instance } => IdentifyError::StrideChoice {
                index,
                gtag,
                register,
                instance,
            },
        })?;
        let Some(module) = parsed else { break };
        if module.instances > 0 && (0..module.registers).any(|r| module.block(r).is_err()) {
            return Err(IdentifyError::ModuleOutsideAddressSpace {
                index,
                gtag,
                base: module.base,
                registers: module.registers,
                instances: module.instances,
            });
        }
        modules.push(module);
    }
    Ok(modules)
}

fn read_pins<B: RegisterBus>(
    bus: &mut B,
    start: u32,
    idrom: &Idrom,
) -> Result<Vec<PinDescriptor>, IdentifyError<B::Error>> {
    let count = idrom.io_width;
    let address = place(IdromPart::Pins, start, idrom.offset_to_pins, count)?;
    let mut buffer = [0; MAX_PINS as usize];
    // The header was refused if there were more pins than the buffer has words.
    let words = buffer.get_mut(..count as usize).unwrap_or_default();
    read(bus, address, words)?;
    Ok(words
        .iter()
        .map(|&word| PinDescriptor::parse(word))
        .collect())
}

/// The address of a part of the IDROM, checked against the address space.
fn place<E: core::error::Error>(
    part: IdromPart,
    start: u32,
    offset: u32,
    words: u32,
) -> Result<u16, IdentifyError<E>> {
    let address = u64::from(start) + u64::from(offset);
    let end = address + 4 * u64::from(words);
    u16::try_from(address)
        .ok()
        .filter(|address| address.is_multiple_of(4) && end <= 0x1_0000)
        .ok_or(IdentifyError::OutsideAddressSpace {
            part,
            address,
            words,
        })
}

/// Reads neighbouring registers in one exchange of accesses that every bus can move.
fn read<B: RegisterBus>(
    bus: &mut B,
    address: u16,
    words: &mut [u32],
) -> Result<(), IdentifyError<B::Error>> {
    let count = words.len() as u16;
    let accesses: Vec<_> = (0..count)
        .step_by(ACCESS_WORDS as usize)
        .map(|first| {
            let size = ACCESS_WORDS.min(count - first);
            Access::read(address + 4 * first, first, size)
        })
        .collect();
    bus.exchange(&accesses, words)
        .map_err(|source| IdentifyError::Bus {
            address,
            count,
            source,
        })
}

/// The versions that real clients take without a word (FACTS 9.5); `None` where they do not care.
fn known_versions(gtag: Gtag) -> Option<&'static [u8]> {
    match gtag {
        Gtag::ENCODER => Some(&[2, 3]),
        Gtag::MUXED_ENCODER => Some(&[3, 4]),
        Gtag::PWM => Some(&[0, 1]),
        Gtag::WATCHDOG | Gtag::IO_PORT | Gtag::LED => Some(&[0]),
        _ => None,
    }
}

fn warnings(idrom: &Idrom, modules: &[ModuleDescriptor], pins: &[PinDescriptor]) -> Vec<Warning> {
    let mut list = Vec::new();
    if idrom.instance_strides != [4, 0x40] || idrom.register_strides != [0x100, 0x100] {
        list.push(Warning::Strides);
    }
    let ports = modules.iter().find(|m| m.gtag == Gtag::IO_PORT);
    let instances = ports.map_or(0, |module| module.instances);
    if u32::from(instances) != idrom.io_ports {
        list.push(Warning::PortInstances {
            ports: idrom.io_ports,
            instances,
        });
    }
    for (index, module) in modules.iter().enumerate() {
        let gtag = module.gtag;
        if modules.iter().take(index).any(|other| other.gtag == gtag) {
            list.push(Warning::DuplicateModule { gtag });
        }
        if module.instances == 0 {
            list.push(Warning::NoInstances { gtag });
        }
        if known_versions(gtag).is_some_and(|known| !known.contains(&module.version)) {
            list.push(Warning::Version {
                gtag,
                version: module.version,
            });
        }
    }
    for (index, pin) in (0u16..).zip(pins) {
        if pin.primary != Gtag::IO_PORT {
            list.push(Warning::PrimaryTag {
                pin: index,
                found: pin.primary,
            });
        }
        if pin.has_module() && !modules.iter().any(|m| m.gtag == pin.secondary) {
            list.push(Warning::PinWithoutModule {
                pin: index,
                gtag: pin.secondary,
            });
        }
    }
    list
}
