//! Module descriptors, and the register addresses that follow from them.

use core::ops::RangeInclusive;

use super::{Gtag, Idrom};
use thiserror::Error;

/// Which clock of the FPGA a module runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ModuleClock {
    /// ClockLow, most often 100 MHz.
    Low,
    /// ClockHigh, most often 200 MHz.
    High,
}

/// What the firmware says about one kind of module: where its registers are, and how many there are.
///
/// Strides and clock are those of the IDROM, looked up already.
///
/// Source: FACTS 9.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ModuleDescriptor {
    /// What kind it is.
    pub gtag: Gtag,
    /// Version of the module.
    pub version: u8,
    /// The clock it runs on.
    pub clock: ModuleClock,
    /// Frequency of that clock in Hz.
    pub clock_hz: u32,
    /// How many there are.
    pub instances: u8,
    /// Address of its first register.
    pub base: u16,
    /// Number of registers, those of several instances counted once.
    pub registers: u8,
    /// Distance of registers in bytes.
    pub register_stride: u16,
    /// Distance of instances in bytes.
    pub instance_stride: u16,
    /// The registers that exist once for each instance: bit r is register r.
    pub multiple_registers: u32,
}

/// The words of one module descriptor.
pub(super) const MODULE_WORDS: usize = 3;

/// Why the words of a module descriptor make no descriptor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DescriptorFault {
    ClockTag(u8),
    Strides { register: u8, instance: u8 },
}

impl ModuleDescriptor {
    /// Parses a descriptor; `None` is the end of the list.
    pub(super) fn parse(
        words: [u32; MODULE_WORDS],
        idrom: &Idrom,
    ) -> Result<Option<Self>, DescriptorFault> {
        let [what, place, multiple_registers] = words;
        let [gtag, version, clock_tag, instances] = what.to_le_bytes();
        let [_, _, registers, strides] = place.to_le_bytes();
        if gtag == 0 {
            return Ok(None);
        }
        let (clock, clock_hz) = match clock_tag {
            1 => (ModuleClock::Low, idrom.clock_low_hz),
            2 => (ModuleClock::High, idrom.clock_high_hz),
            other => return Err(DescriptorFault::ClockTag(other)),
        };
        let (register, instance) = (strides & 0x0F, strides >> 4);
        let [register_0, register_1] = idrom.register_strides;
        let [instance_0, instance_1] = idrom.instance_strides;
        let choose = |selector, zero, one| match selector {
            0 => Ok(zero),
            1 => Ok(one),
            _ => Err(DescriptorFault::Strides { register, instance }),
        };
        Ok(Some(Self {
            gtag: Gtag(gtag),
            version,
            clock,
            clock_hz,
            instances,
            base: place as u16,
            registers,
            register_stride: choose(register, register_0, register_1)?,
            instance_stride: choose(instance, instance_0, instance_1)?,
            multiple_registers,
        }))
    }

    /// Address of register `register` of instance `instance`:
    /// base + register * register stride + instance * instance stride, the last only for registers
    /// of the multiple-register mask. `None` beyond the 16-bit address space, and for registers
    /// and instances that the module does not have.
    pub fn address(&self, register: u8, instance: u8) -> Option<u16> {
        if register >= self.registers || instance >= self.instances {
            return None;
        }
        let offset = if self.is_multiple(register) {
            u32::from(instance) * u32::from(self.instance_stride)
        } else {
            0
        };
        let start = u32::from(self.base) + u32::from(register) * u32::from(self.register_stride);
        let address = u16::try_from(start + offset).ok()?;
        (address <= LAST_REGISTER && address.is_multiple_of(4)).then_some(address)
    }

    /// Address of register `register` of instance `instance`, which is that of all instances where
    /// they share it.
    ///
    /// # Errors
    /// [`ModuleError::Address`] if there is none: see [`address`](Self::address).
    pub fn register(&self, register: u8, instance: u8) -> Result<u16, ModuleError> {
        self.address(register, instance)
            .ok_or(ModuleError::Address {
                gtag: self.gtag,
                base: self.base,
                register,
                register_stride: self.register_stride,
                instances: self.instances,
                instance_stride: self.instance_stride,
            })
    }

    /// Checks that a version, this module's own or the part of it that counts, is `known`.
    pub(crate) fn expect_version(
        &self,
        version: u8,
        known: RangeInclusive<u8>,
    ) -> Result<(), ModuleError> {
        if known.contains(&version) {
            return Ok(());
        }
        Err(ModuleError::UnknownVersion {
            gtag: self.gtag,
            version: self.version,
            oldest: *known.start(),
            newest: *known.end(),
        })
    }

    /// Whether the register exists once for each instance.
    pub fn is_multiple(&self, register: u8) -> bool {
        self.multiple_registers
            .checked_shr(u32::from(register))
            .is_some_and(|bits| bits & 1 == 1)
    }

    /// All instances of a register, checked once so that their addresses are known to exist.
    pub fn block(&self, register: u8) -> Result<RegisterBlock, ModuleError> {
        let count = if self.is_multiple(register) {
            self.instances
        } else {
            1
        };
        let last = count.saturating_sub(1);
        match (self.address(register, 0), self.address(register, last)) {
            (Some(first), Some(_)) => Ok(RegisterBlock {
                first,
                stride: self.instance_stride,
                count,
            }),
            _ => Err(ModuleError::Address {
                gtag: self.gtag,
                base: self.base,
                register,
                register_stride: self.register_stride,
                instances: self.instances,
                instance_stride: self.instance_stride,
            }),
        }
    }

    /// Checks that this is a module of kind `gtag` with at least `registers` registers, of which
    /// those of `multiple` exist once for each instance, as the code that asks has them.
    ///
    /// # Errors
    /// [`ModuleError::WrongModule`] and [`ModuleError::UnknownLayout`].
    pub fn expect(&self, gtags: &[Gtag], registers: u8, multiple: u32) -> Result<(), ModuleError> {
        if !gtags.contains(&self.gtag) {
            return Err(ModuleError::WrongModule {
                expected: gtags.first().copied().unwrap_or_default(),
                found: self.gtag,
            });
        }
        let mask = 1u32
            .checked_shl(u32::from(registers))
            .map_or(u32::MAX, |bit| bit - 1);
        if self.registers < registers || self.multiple_registers & mask != multiple {
            return Err(ModuleError::UnknownLayout {
                gtag: self.gtag,
                version: self.version,
                registers: self.registers,
                mask: self.multiple_registers,
                expected_registers: registers,
                expected_mask: multiple,
            });
        }
        Ok(())
    }
}

/// The last 32-bit register of the 16-bit address space.
const LAST_REGISTER: u16 = 0xFFFC;

/// The addresses of one register of all instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RegisterBlock {
    first: u16,
    stride: u16,
    count: u8,
}

impl RegisterBlock {
    /// Address of the first instance.
    pub const fn first(&self) -> u16 {
        self.first
    }

    /// Number of instances.
    pub const fn count(&self) -> u8 {
        self.count
    }

    /// Address of instance `instance`; `None` if there is no such instance.
    pub const fn address(&self, instance: u8) -> Option<u16> {
        if instance < self.count {
            // Checked for the last instance when the block was made.
            Some(self.first + instance as u16 * self.stride)
        } else {
            None
        }
    }

    /// The addresses of all instances.
    pub fn addresses(&self) -> impl Iterator<Item = u16> + '_ {
        (0..self.count).filter_map(|instance| self.address(instance))
    }
}

/// Why a module can not be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ModuleError {
    /// The descriptor is of another kind of module.
    #[error("this is the descriptor of {found}, expected {expected}: look modules up by their tag")]
    WrongModule {
        /// The kind that was expected.
        expected: Gtag,
        /// The kind of the descriptor.
        found: Gtag,
    },
    /// The set of registers is none that is known.
    #[error(
        "{gtag} version {version} has {registers} registers with multiple-register mask {mask:#X}, \
         expected at least {expected_registers} and {expected_mask:#X}: this firmware has a layout \
         that this crate does not know"
    )]
    UnknownLayout {
        /// The module.
        gtag: Gtag,
        /// Its version.
        version: u8,
        /// Its registers.
        registers: u8,
        /// Its multiple-register mask.
        mask: u32,
        /// The registers that are needed.
        expected_registers: u8,
        /// The mask that is expected.
        expected_mask: u32,
    },
    /// The module behaves as this crate does not know.
    #[error(
        "{gtag} has version {version}, known are {oldest} to {newest}: use a firmware with one of them"
    )]
    UnknownVersion {
        /// The module.
        gtag: Gtag,
        /// Its version.
        version: u8,
        /// The oldest version that is known.
        oldest: u8,
        /// The newest version that is known.
        newest: u8,
    },
    /// A register lies outside of the 16-bit address space, is not at a multiple of 4, or is not
    /// there at all.
    #[error(
        "{gtag} has no register {register}, or it lies outside of the address space: base \
         {base:#06X}, register stride {register_stride:#X}, {instances} instances, instance stride \
         {instance_stride:#X}; the IDROM was misread, or is not right"
    )]
    Address {
        /// The module.
        gtag: Gtag,
        /// Address of its first register.
        base: u16,
        /// The register that was asked for.
        register: u8,
        /// Distance of registers.
        register_stride: u16,
        /// Number of instances.
        instances: u8,
        /// Distance of instances.
        instance_stride: u16,
    },
    /// There is no such instance.
    #[error("there is no {gtag} {instance}: this firmware has {instances} of them, counted from 0")]
    NoSuchInstance {
        /// The module.
        gtag: Gtag,
        /// The instance that was asked for.
        instance: u8,
        /// Number of instances.
        instances: u8,
    },
}

#[cfg(test)]
mod tests {
    use super::super::idrom::tests::idrom_7i97;
    use super::*;
    use proptest::prelude::*;

    fn parse(words: [u32; 3]) -> Result<Option<ModuleDescriptor>, DescriptorFault> {
        ModuleDescriptor::parse(words, &idrom_7i97())
    }

    #[test]
    fn the_sserial_descriptor_of_facts_9_2_gives_the_addresses_of_facts_2_1() {
        let module = parse([0x0401_00C1, 0x1006_5A00, 0x3C]).unwrap().unwrap();
        assert_eq!(module.gtag, Gtag::SSERIAL);
        assert_eq!((module.instances, module.registers), (4, 6));
        assert_eq!(module.instance_stride, 0x40);
        assert_eq!(module.address(0, 0), Some(0x5A00));
        assert_eq!(module.address(2, 0), Some(0x5C00));
        assert_eq!(module.address(5, 3), Some(0x5F00 + 0xC0));
        assert_eq!(module.address(6, 0), None);
        assert_eq!(module.address(0, 4), None);
    }

    #[test]
    fn registers_outside_of_the_mask_are_shared_by_all_instances() {
        let encoders = parse([0x0601_040C, 0x0005_3500, 3]).unwrap().unwrap();
        assert_eq!(encoders.address(0, 5), Some(0x3514));
        assert_eq!(encoders.address(1, 5), Some(0x3614));
        assert_eq!(encoders.address(2, 5), Some(0x3700));
        assert_eq!(encoders.block(2).unwrap().count(), 1);
    }

    #[test]
    fn clock_and_strides_must_be_among_those_of_the_idrom() {
        assert_eq!(parse([0, 1, 2]), Ok(None));
        assert_eq!(
            parse([0x0103_0002, 0, 0]),
            Err(DescriptorFault::ClockTag(3))
        );
        assert_eq!(
            parse([0x0101_0002, 0x2100_0000, 0]),
            Err(DescriptorFault::Strides {
                register: 1,
                instance: 2
            })
        );
    }

    proptest! {
        #[test]
        fn a_block_of_any_descriptor_lies_in_the_address_space(
            words in any::<[u32; 3]>(),
            strides in any::<[u16; 4]>(),
            register in any::<u8>(),
        ) {
            let mut idrom = idrom_7i97();
            let [r0, r1, i0, i1] = strides;
            idrom.register_strides = [r0, r1];
            idrom.instance_strides = [i0, i1];
            if let Ok(Some(module)) = ModuleDescriptor::parse(words, &idrom)
                && let Ok(block) = module.block(register)
            {
                for (instance, address) in block.addresses().enumerate() {
                    prop_assert_eq!(Some(address), module.address(register, instance as u8));
                }
                prop_assert_eq!(block.addresses().count(), block.count() as usize);
            }
        }
    }
}
