//! Module descriptors, and the register addresses that follow from them.

use alloc::format;
use alloc::string::String;
use core::ops::RangeInclusive;

use super::idrom::MODULE_WORDS;
use super::{Gtag, HostMot2Error, Idrom};

/// Description of one kind of module: addresses of its registers and number of its instances.
///
/// Strides and clock are already resolved from the IDROM.
///
/// Source: FACTS 9.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ModuleDescriptor {
    /// Kind of module.
    pub gtag: Gtag,
    /// Version of the module.
    pub version: u8,
    /// Frequency of its clock in Hz.
    pub clock_hz: u32,
    /// Number of instances.
    pub instances: u8,
    /// Address of its first register.
    pub base: u16,
    /// Number of registers; a register that exists once for each instance counts once.
    pub registers: u8,
    /// Distance of registers in bytes.
    pub register_stride: u16,
    /// Distance of instances in bytes.
    pub instance_stride: u16,
    /// The registers that exist once for each instance: bit r is register r.
    pub multiple_registers: u32,
}

/// The last 32-bit register of the 16-bit address space.
const LAST_REGISTER: u16 = 0xFFFC;

/// One instance of a kind of module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ModuleInstance {
    /// The kind of module.
    pub gtag: Gtag,
    /// The number of the instance among all instances of this kind, as in pin descriptors.
    pub instance: u8,
}

impl ModuleInstance {
    /// Instance `instance` of this kind of module.
    pub const fn new(gtag: Gtag, instance: u8) -> Self {
        Self { gtag, instance }
    }
}

impl ModuleDescriptor {
    /// Set in the version of encoders that have a probe (FACTS 9.1).
    pub(crate) const WITH_PROBE: u8 = 0x80;

    /// Parses descriptor `index`; `None` is the end of the list.
    pub(super) fn parse(
        index: usize,
        words: [u32; MODULE_WORDS],
        idrom: &Idrom,
    ) -> Result<Option<Self>, HostMot2Error> {
        let [what, place, multiple_registers] = words;
        let [gtag, version, clock_tag, instances] = what.to_le_bytes();
        let [_, _, registers, strides] = place.to_le_bytes();
        let gtag = Gtag(gtag);
        if gtag == Gtag::NONE {
            return Ok(None);
        }
        let bad = |what, found: String, expected| {
            let what = format!("{what} of module descriptor {index}, {gtag}");
            HostMot2Error::description(&what, found, expected)
        };
        let clock_hz = match clock_tag {
            1 => idrom.clock_low_hz,
            2 => idrom.clock_high_hz,
            other => {
                let expected = "1 (ClockLow) or 2 (ClockHigh)";
                return Err(bad("clock tag", format!("{other}"), expected));
            }
        };
        let stride = |selector: u8, strides: [u16; 2]| {
            let stride = strides.get(usize::from(selector)).copied();
            stride.ok_or_else(|| bad("choice of a stride", format!("{selector}"), "0 or 1"))
        };
        let module = Self {
            gtag,
            version,
            clock_hz,
            instances,
            base: place as u16,
            registers,
            register_stride: stride(strides & 0x0F, idrom.register_strides)?,
            instance_stride: stride(strides >> 4, idrom.instance_strides)?,
            multiple_registers,
        };
        let has = |register| (0..instances).all(|n| module.address(register, n).is_some());
        if !(0..registers).all(has) {
            let found = format!(
                "base {place:#06X}, {registers} registers, {instances} instances",
                place = module.base
            );
            let expected = "multiples of 4 in the 16-bit address space";
            return Err(bad("addresses", found, expected));
        }
        Ok(Some(module))
    }

    /// base + register * register stride + instance * instance stride, the last term only for
    /// registers in the multiple-register mask. `None` beyond the 16-bit address space, and for
    /// registers and instances that the module does not have.
    fn address(&self, register: u8, instance: u8) -> Option<u16> {
        if register >= self.registers || instance >= self.instances {
            return None;
        }
        let bit = self.multiple_registers.checked_shr(register.into());
        let offset = match bit.unwrap_or(0) & 1 {
            0 => 0,
            _ => u32::from(instance) * u32::from(self.instance_stride),
        };
        let start = u32::from(self.base) + u32::from(register) * u32::from(self.register_stride);
        let address = u16::try_from(start + offset).ok()?;
        (address <= LAST_REGISTER && address.is_multiple_of(4)).then_some(address)
    }

    /// Address of register `register` of instance `instance`; the same for all instances if they
    /// share the register.
    ///
    /// # Errors
    /// [`HostMot2Error::NoRegister`] if the module does not have it.
    pub fn register(&self, register: u8, instance: u8) -> Result<u16, HostMot2Error> {
        self.address(register, instance)
            .ok_or(HostMot2Error::NoRegister {
                gtag: self.gtag,
                register,
                instance,
                registers: self.registers,
                instances: self.instances,
            })
    }

    /// Checks that `version`, this module's own or the relevant part of it, is in `known`.
    ///
    /// # Errors
    /// [`HostMot2Error::Unknown`].
    pub fn expect_version(
        &self,
        version: u8,
        known: RangeInclusive<u8>,
    ) -> Result<(), HostMot2Error> {
        if known.contains(&version) {
            return Ok(());
        }
        Err(HostMot2Error::Unknown {
            gtag: self.gtag,
            found: format!("version {}", self.version),
            expected: format!("{} to {}", known.start(), known.end()),
        })
    }

    /// Checks that the module has at least `registers` registers, and that exactly those in
    /// `multiple` exist once for each instance, as the calling code expects.
    ///
    /// # Errors
    /// [`HostMot2Error::Unknown`].
    pub fn check_layout(&self, registers: u8, multiple: u32) -> Result<(), HostMot2Error> {
        let mask = 1u32
            .checked_shl(u32::from(registers))
            .map_or(u32::MAX, |bit| bit - 1);
        if self.registers >= registers && self.multiple_registers & mask == multiple {
            return Ok(());
        }
        let (version, found, of_each) = (self.version, self.registers, self.multiple_registers);
        Err(HostMot2Error::Unknown {
            gtag: self.gtag,
            found: format!(
                "{found} registers with multiple-register mask {of_each:#X} (version {version})"
            ),
            expected: format!("at least {registers} and {multiple:#X}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::idrom::tests::idrom_7i97;
    use super::*;
    use proptest::prelude::*;

    fn parse(words: [u32; 3]) -> Result<Option<ModuleDescriptor>, HostMot2Error> {
        ModuleDescriptor::parse(7, words, &idrom_7i97())
    }

    #[test]
    fn sserial_descriptor_of_facts_9_2_gives_addresses_of_facts_2_1() {
        let module = parse([0x0401_00C1, 0x1006_5B00, 0x3C]).unwrap().unwrap();
        assert_eq!(module.gtag, Gtag::SSERIAL);
        assert_eq!((module.instances, module.registers), (4, 6));
        assert_eq!(module.instance_stride, 0x40);
        assert_eq!(module.register(0, 0), Ok(0x5B00));
        assert_eq!(module.register(2, 0), Ok(0x5D00));
        assert_eq!(module.register(5, 3), Ok(0x6000 + 0xC0));
        for (register, instance) in [(6, 0), (0, 4)] {
            let error = module.register(register, instance).unwrap_err().to_string();
            let text = format!("register {register} of SSerial (C1) {instance} does not exist: ");
            assert!(error.contains(&text), "{error}");
            assert!(error.contains("6 registers and 4 instances"), "{error}");
        }
    }

    #[test]
    fn registers_outside_of_the_mask_are_shared_by_all_instances() {
        let encoders = parse([0x0601_040C, 0x0005_3600, 3]).unwrap().unwrap();
        assert_eq!(encoders.register(0, 5), Ok(0x3614));
        assert_eq!(encoders.register(1, 5), Ok(0x3714));
        assert_eq!(encoders.register(2, 5), Ok(0x3800));
    }

    #[test]
    fn clock_strides_and_addresses_must_be_possible() {
        assert_eq!(parse([0, 1, 2]), Ok(None));
        for (words, text) in [
            (
                [0x0103_0002, 0, 0],
                "clock tag of module descriptor 7, Watchdog (02): 3, ",
            ),
            (
                [0x0101_0002, 0x2000_0000, 0],
                "choice of a stride of module descriptor 7, Watchdog (02): 2, ",
            ),
            (
                [0x0101_0002, 0x0003_FF00, 0],
                "addresses of module descriptor 7, Watchdog (02): base 0xFF00, 3 registers, ",
            ),
        ] {
            let error = parse(words).unwrap_err().to_string();
            assert!(error.starts_with(text), "{error}");
        }
    }

    proptest! {
        #[test]
        fn all_registers_of_any_descriptor_lie_in_the_address_space(
            words in any::<[u32; 3]>(),
            strides in any::<[u16; 4]>(),
        ) {
            let mut idrom = idrom_7i97();
            let [r0, r1, i0, i1] = strides;
            idrom.register_strides = [r0, r1];
            idrom.instance_strides = [i0, i1];
            if let Ok(Some(module)) = ModuleDescriptor::parse(0, words, &idrom) {
                for (register, instance) in (0..module.registers)
                    .flat_map(|r| (0..module.instances).map(move |i| (r, i)))
                {
                    let address = module.register(register, instance).unwrap();
                    prop_assert!(address.is_multiple_of(4));
                }
            }
        }
    }
}
