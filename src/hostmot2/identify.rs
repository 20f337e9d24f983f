//! Reading of the firmware's description of itself.

use super::idrom::MODULE_WORDS;
use super::idrom::{IDROM_WORDS, name};
use super::pin::list_of;
use super::{
    Gtag, HostMot2Error, IdentifyError, Idrom, ModuleDescriptor, PinDescriptor, TrailingEntry,
};
use crate::bus::{Access, AccessList, BoardIdentity, BusError, Effort, RegisterBus};
use alloc::boxed::Box;
use alloc::collections::BTreeMap;
use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec;
use alloc::vec::Vec;

/// Address of the cookie; configuration name and IDROM address follow it.
pub(crate) const COOKIE_ADDRESS: u16 = 0x0100;
pub(crate) const COOKIE: u32 = 0x55AA_CAFE;
const CONFIG_NAME: &str = "HOSTMOT2";

/// Largest number of module descriptors.
const MAX_MODULES: usize = 32;

/// Words of one access: fewer than any bus can transfer at once.
const ACCESS_WORDS: u16 = 64;

/// A HostMot2 firmware's description of itself: the board, its modules and its pins.
///
/// # Example
/// ```no_run
/// # fn f<B: mesa_hal::bus::RegisterBus>(mut bus: B) -> Result<(), Box<dyn std::error::Error>> {
/// use mesa_hal::hostmot2::{Gtag, HostMot2};
/// let firmware = HostMot2::identify(&mut bus)?;
/// println!("{} with {}", firmware.idrom.board_name, firmware.gtags());
/// let encoders = firmware.require(Gtag::MUXED_ENCODER)?;
/// println!("{} encoders at {:#06X}", encoders.instances, encoders.base);
/// # Ok(()) }
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostMot2 {
    /// The header of the IDROM: board, widths, clocks.
    pub idrom: Idrom,
    /// All modules, in the order of their descriptors.
    pub modules: Vec<ModuleDescriptor>,
    /// Entries behind the end of the module descriptors.
    pub trailing: Vec<TrailingEntry>,
    /// All I/O pins, by number.
    pub pins: Vec<PinDescriptor>,
    /// Local I/O pins, by number: pins of the FPGA that are on no connector and have no port
    /// registers.
    pub local_pins: Vec<PinDescriptor>,
    /// Oddities of this firmware that do not prevent its use.
    pub warnings: Vec<String>,
}

impl HostMot2 {
    /// Reads and checks the description: four exchanges on the bus, whatever the firmware.
    ///
    /// Anything that real clients refuse or that would give wrong addresses is an error; anything
    /// merely odd is listed in [`warnings`](Self::warnings).
    ///
    /// Source: FACTS 9.1, 9.5.
    ///
    /// # Errors
    /// [`IdentifyError`]: the bus, or the firmware.
    ///
    /// # Real time
    /// For set-up: allocates.
    pub fn identify<B: RegisterBus>(bus: &mut B) -> Result<Self, IdentifyError> {
        Ok(Self::describe(bus)?.0)
    }

    /// Reads the description like [`identify`](Self::identify) and returns its raw words as well.
    ///
    /// # Errors
    /// As [`identify`](Self::identify).
    pub(crate) fn describe<B: RegisterBus>(
        bus: &mut B,
    ) -> Result<(Self, FirmwareWords), IdentifyError> {
        let mut description = FirmwareWords::default();
        let mut words = [0; 4];
        description.read(bus, COOKIE_ADDRESS, &mut words)?;
        let start = idrom_address(words)?;
        let mut words = [0; IDROM_WORDS];
        description.read_part(bus, "header", start, 0, &mut words)?;
        let idrom = Idrom::parse(words)?;
        let mut words = [0; MAX_MODULES * MODULE_WORDS];
        let offset = idrom.offset_to_modules;
        description.read_part(bus, "module descriptors", start, offset, &mut words)?;
        let (descriptors, _) = words.as_chunks();
        let slots = idrom.module_slots(descriptors.len());
        let (mut modules, mut trailing) = (Vec::new(), Vec::new());
        let mut has_ended = false;
        for (slot, &words) in descriptors.iter().take(slots).enumerate() {
            if has_ended || TrailingEntry::is_hint(words) {
                trailing.extend(TrailingEntry::parse(slot, words));
            } else {
                let module = ModuleDescriptor::parse(slot, words, &idrom)?;
                has_ended = module.is_none();
                modules.extend(module);
            }
        }
        let io_pins = idrom.io_width as usize;
        let mut words = vec![0; io_pins.max(idrom.pin_slots())];
        let offset = idrom.offset_to_pins;
        description.read_part(bus, "pin descriptors", start, offset, &mut words)?;
        let (io_pins, local_pins) = words.split_at_checked(io_pins).unwrap_or((&words, &[]));
        let pins: Vec<_> = io_pins.iter().copied().map(PinDescriptor::parse).collect();
        let local_pins = local_pins.iter().copied().map(PinDescriptor::parse);
        let found = Self {
            warnings: warnings(&idrom, &modules, &pins),
            idrom,
            modules,
            trailing,
            pins,
            local_pins: local_pins.take_while(PinDescriptor::is_local).collect(),
        };
        Ok((found, description))
    }

    /// The kinds of modules and the number of each, as readable text: `Watchdog (02) x1, …`.
    /// Descriptors without instances are left out.
    pub fn gtags(&self) -> String {
        let modules = self.modules.iter().filter(|module| module.instances > 0);
        let texts: Vec<_> = modules
            .map(|module| format!("{} x{}", module.gtag, module.instances))
            .collect();
        match texts.len() {
            0 => "nothing".to_string(),
            _ => texts.join(", "),
        }
    }

    /// All modules of a kind that have instances, in the order of their descriptors, each with the
    /// number of its first instance. The instances of a kind are numbered consecutively: those of a
    /// second module follow those of the first, and pin descriptors refer to them by this number.
    pub fn modules_of(&self, gtag: Gtag) -> impl Iterator<Item = (u8, &ModuleDescriptor)> + '_ {
        let modules = self.modules.iter();
        let modules = modules.filter(move |module| module.gtag == gtag && module.instances > 0);
        modules.scan(0_u8, |next, module| {
            let first = *next;
            *next = next.checked_add(module.instances)?;
            Some((first, module))
        })
    }

    /// The first module of a kind, if the firmware has it; a descriptor without instances is
    /// ignored.
    pub fn find(&self, gtag: Gtag) -> Option<&ModuleDescriptor> {
        self.modules
            .iter()
            .find(|module| module.gtag == gtag && module.instances > 0)
    }

    /// The module of a kind.
    ///
    /// # Errors
    /// [`HostMot2Error::Missing`], which lists the modules present, if the firmware does not have
    /// it.
    pub fn require(&self, gtag: Gtag) -> Result<&ModuleDescriptor, HostMot2Error> {
        self.find(gtag).ok_or_else(|| HostMot2Error::Missing {
            wanted: gtag,
            present: self.gtags(),
        })
    }

    /// The smart serial module: [`Gtag::SSERIAL`], or else [`Gtag::SSERIAL_B`].
    ///
    /// # Errors
    /// As [`require`](Self::require).
    pub fn require_sserial(&self) -> Result<&ModuleDescriptor, HostMot2Error> {
        let wide = self.find(Gtag::SSERIAL_B);
        self.require(Gtag::SSERIAL)
            .or_else(|error| wide.ok_or(error))
    }

    /// The pins of instance `unit` of a module, with their I/O numbers.
    pub fn pins_of(
        &self,
        gtag: Gtag,
        unit: u8,
    ) -> impl Iterator<Item = (u16, &PinDescriptor)> + '_ {
        (0..)
            .zip(&self.pins)
            .filter(move |(_, pin)| (pin.secondary, pin.unit) == (gtag, unit))
    }

    /// Number of channels that instance `instance` of the smart serial module `gtag` has on pins,
    /// determined by the highest one. 0 if it has no pins at all; up to 15, of which 8 can be
    /// driven.
    ///
    /// Source: FACTS 2.1.
    pub fn sserial_channels(&self, gtag: Gtag, instance: u8) -> u8 {
        self.pins_of(gtag, instance)
            .filter_map(|(_, pin)| pin.sserial_channel())
            .max()
            .map_or(0, |highest| highest + 1)
    }
}

/// The address of the IDROM: the last of the four words that begin with the cookie.
fn idrom_address([cookie, low, high, start]: [u32; 4]) -> Result<u32, HostMot2Error> {
    if cookie != COOKIE {
        return Err(HostMot2Error::NoCookie { found: cookie });
    }
    let found = name(low, high);
    if found != CONFIG_NAME {
        let what = "configuration name at 0x0104";
        return Err(HostMot2Error::description(what, found, CONFIG_NAME));
    }
    Ok(start)
}

/// The words of a firmware's description of itself.
#[derive(Debug, Default)]
pub(crate) struct FirmwareWords(Vec<(Vec<Access>, Box<[u32]>)>);

/// Detects whether the same board with the same firmware still answers.
#[derive(Debug)]
pub(crate) struct FirmwareCheck {
    board: BoardIdentity,
    parts: Vec<(AccessList, Box<[u32]>)>,
    /// Buffer as long as the longest part.
    now: Box<[u32]>,
}

impl FirmwareCheck {
    /// True if the board is the same one and its description still consists of the same words.
    ///
    /// # Errors
    /// Errors of the bus.
    ///
    /// # Real time
    /// With [`Effort::Once`] five exchanges, without allocation.
    pub fn is_still<B>(&mut self, bus: &mut B, effort: Effort) -> Result<bool, BusError>
    where
        B: RegisterBus,
    {
        if bus.board(effort)? != self.board {
            return Ok(false);
        }
        for (list, words) in &self.parts {
            let Some(now) = self.now.get_mut(..words.len()) else {
                return Ok(false);
            };
            match effort {
                Effort::Once => drop(bus.run(list, now)?),
                Effort::Repeated => bus.exchange(list.as_ref(), now)?,
            }
            if *now != **words {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

impl FirmwareWords {
    /// Prepares reading the description again on this bus.
    ///
    /// # Errors
    /// Errors of the bus.
    pub fn known<B: RegisterBus>(self, bus: &mut B) -> Result<FirmwareCheck, BusError> {
        let board = bus.board(Effort::Repeated)?;
        let longest = self.0.iter().map(|(_, words)| words.len()).max();
        let parts = self.0.into_iter();
        let parts =
            parts.map(|(accesses, words)| bus.prepare(&accesses, None).map(|list| (list, words)));
        Ok(FirmwareCheck {
            board,
            parts: parts.collect::<Result<_, _>>()?,
            now: vec![0; longest.unwrap_or_default()].into(),
        })
    }

    /// Reads a part of the IDROM, if it lies in the address space.
    fn read_part<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        part: &str,
        start: u32,
        offset: u32,
        words: &mut [u32],
    ) -> Result<(), IdentifyError> {
        let place = u64::from(start) + u64::from(offset);
        let end = place + 4 * words.len() as u64;
        match u16::try_from(place) {
            Ok(address) if address.is_multiple_of(4) && end <= 0x1_0000 => {
                self.read(bus, address, words)
            }
            _ => {
                let found = format!("{} words at {place:#X}", words.len());
                let expected = "a multiple of 4 in the 16-bit address space";
                let what = format!("IDROM {part}");
                Err(HostMot2Error::description(&what, found, expected).into())
            }
        }
    }

    /// Reads adjacent registers in one exchange, in accesses small enough for every bus.
    fn read<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        address: u16,
        words: &mut [u32],
    ) -> Result<(), IdentifyError> {
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
            })?;
        self.0.push((accesses, (&*words).into()));
        Ok(())
    }
}

/// True for a version that real clients accept without a warning (FACTS 9.5). Modules that are not
/// driven in other versions are reported separately.
fn is_usual_version(module: &ModuleDescriptor) -> bool {
    match module.gtag {
        Gtag::MUXED_ENCODER => module.version & !ModuleDescriptor::WITH_PROBE != 2,
        Gtag::WATCHDOG | Gtag::IO_PORT | Gtag::LED => module.version == 0,
        _ => true,
    }
}

/// Describes pins of instances that a module does not have. Pins of select lines carry another
/// number, and pins of multiplexed encoders that of a pair.
fn beyond_all_instances(modules: &[ModuleDescriptor], pins: &[PinDescriptor]) -> Vec<String> {
    let mut beyond = BTreeMap::<Gtag, Vec<u16>>::new();
    for (number, pin) in (0..).zip(pins) {
        let gtag = pin.secondary;
        let of_kind = modules.iter().filter(|module| module.gtag == gtag);
        let instances = of_kind.map(|module| u32::from(module.instances)).sum();
        let units = match gtag {
            Gtag::MUX_SELECT | Gtag::MUX_SELECT_MIM => continue,
            Gtag::MUXED_ENCODER | Gtag::MUXED_ENCODER_MIM => u32::div_ceil(instances, 2),
            _ => instances,
        };
        if units > 0 && (units..PinDescriptor::GLOBAL.into()).contains(&pin.unit.into()) {
            beyond.entry(gtag).or_default().push(number);
        }
    }
    let texts = beyond.into_iter().map(|(gtag, numbers)| {
        let numbers = list_of(numbers);
        format!("I/O pins of {gtag} belong to instances that it does not have: {numbers}")
    });
    texts.collect()
}

fn warnings(idrom: &Idrom, modules: &[ModuleDescriptor], pins: &[PinDescriptor]) -> Vec<String> {
    let mut list = Vec::new();
    if idrom.instance_strides != [4, 0x40] || idrom.register_strides != [0x100, 0x100] {
        list.push("strides are not 4/0x40 and 0x100/0x100".to_string());
    }
    let module = modules.iter().find(|m| m.gtag == Gtag::IO_PORT);
    let (ports, instances) = (idrom.io_ports, module.map_or(0, |m| m.instances));
    if u32::from(instances) != ports {
        list.push(format!(
            "the IDROM has {ports} I/O ports, the module descriptor {instances}"
        ));
    }
    for module in modules.iter().filter(|module| !is_usual_version(module)) {
        let (gtag, version) = (module.gtag, module.version);
        list.push(format!(
            "{gtag} has version {version}, which is not known to work"
        ));
    }
    // Grouped by oddity: one sentence for all pins of a kind.
    let mut odd = BTreeMap::<(bool, Gtag), Vec<u16>>::new();
    for (number, pin) in (0..).zip(pins) {
        if pin.has_module() && !modules.iter().any(|m| m.gtag == pin.secondary) {
            odd.entry((false, pin.secondary)).or_default().push(number);
        }
        if pin.primary != Gtag::IO_PORT {
            odd.entry((true, pin.primary)).or_default().push(number);
        }
    }
    list.extend(beyond_all_instances(modules, pins));
    for ((is_primary, gtag), numbers) in odd {
        let (subject, verb) = match *numbers {
            [_] => ("pin", ["belongs to", "is a pin of"]),
            _ => ("pins", ["belong to", "are pins of"]),
        };
        let [belongs, is_of] = verb;
        let numbers = list_of(numbers);
        list.push(if is_primary {
            format!("{subject} {numbers} {is_of} {gtag}, expected an I/O port")
        } else {
            format!("{subject} {numbers} {belongs} {gtag}, which has no descriptor")
        });
    }
    list
}
