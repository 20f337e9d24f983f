//! Where the registers of a port are.

use super::{Channel, ChannelMask, MAX_CHANNELS};
use crate::hostmot2::{HostMot2, HostMot2Error, ModuleDescriptor};
use thiserror::Error;

/// The most interface registers a channel has: 224 bits.
pub const MAX_INTERFACE_REGISTERS: u8 = 7;

/// The most instances one module has.
const MAX_INSTANCES: u8 = 4;

/// Distance of the registers of neighbouring channels.
const CHANNEL_STRIDE: u16 = 4;

/// Indices of the registers: COMMAND, DATA, CS, then the interface registers.
const DATA: u16 = 1;
const CS: u16 = 2;
const INTERFACE: u16 = 3;

/// What a HostMot2 module descriptor says about SSLBP, in plain numbers.
///
/// Source: FACTS 2.1, 9.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SslbpModule {
    /// GTAG: C1 (three interface registers) or C6 (seven).
    pub gtag: u8,
    /// Base address.
    pub base: u16,
    /// Number of registers: 6 or 10.
    pub registers: u8,
    /// Distance of registers in bytes.
    pub register_stride: u16,
    /// Distance of instances in bytes.
    pub instance_stride: u16,
    /// The registers that exist once for each channel: 3C or 3FC.
    pub multiple_registers: u32,
    /// Number of instances.
    pub instances: u8,
}

impl SslbpModule {
    /// GTAG of SSLBP with three interface registers.
    pub const GTAG: u8 = 0xC1;
    /// GTAG of SSLBP with seven interface registers.
    pub const GTAG_WIDE: u8 = 0xC6;
}

impl From<&ModuleDescriptor> for SslbpModule {
    fn from(descriptor: &ModuleDescriptor) -> Self {
        Self {
            gtag: descriptor.gtag.0,
            base: descriptor.base,
            registers: descriptor.registers,
            register_stride: descriptor.register_stride,
            instance_stride: descriptor.instance_stride,
            multiple_registers: descriptor.multiple_registers,
            instances: descriptor.instances,
        }
    }
}

/// Why a module descriptor is not one of SSLBP that this crate can use.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LayoutError {
    /// The firmware has no SSLBP at all.
    #[error(transparent)]
    Missing(#[from] HostMot2Error),
    /// The descriptor is of another module.
    #[error(
        "module with GTAG {found:#04X} is not SSLBP (C1 or C6): look it up in the IDROM by its GTAG"
    )]
    NotSslbp {
        /// GTAG of the descriptor.
        found: u8,
    },
    /// The register set is none that is known.
    #[error(
        "SSLBP module {gtag:#04X} has {registers} registers with multiple-register mask {mask:#X}, \
         expected {expected_registers} and {expected_mask:#X}: this firmware has a register \
         layout that this crate does not know"
    )]
    UnknownLayout {
        /// GTAG of the descriptor.
        gtag: u8,
        /// Number of registers in the descriptor.
        registers: u8,
        /// Multiple-register mask in the descriptor.
        mask: u32,
        /// Number of registers of the known layout.
        expected_registers: u8,
        /// Mask of the known layout.
        expected_mask: u32,
    },
    /// Registers would overlap, or lie outside of the 16-bit address space.
    #[error(
        "SSLBP registers do not fit: base {base:#06X}, register stride {register_stride:#X}, \
         instance stride {instance_stride:#X}, instance {instance}: the module descriptor or the \
         strides of the IDROM were misread"
    )]
    BadAddresses {
        /// Base address.
        base: u16,
        /// Distance of registers.
        register_stride: u16,
        /// Distance of instances.
        instance_stride: u16,
        /// The instance that was asked for.
        instance: u8,
    },
    /// There is no such instance.
    #[error(
        "there is no SSLBP port {instance}: this firmware has {instances} of them; choose another \
         port or a firmware with more"
    )]
    NoSuchInstance {
        /// The instance that was asked for.
        instance: u8,
        /// Number of instances.
        instances: u8,
    },
    /// No pin of the FPGA belongs to the port, or to a ninth channel.
    #[error(
        "the pin descriptors give SSLBP port {instance} {channels} channels, expected 1 to 8: \
         this firmware does not bring the port to any pin, or the pins were misread"
    )]
    BadChannelCount {
        /// The port.
        instance: u8,
        /// Channels according to the pin descriptors.
        channels: u8,
    },
}

/// The register addresses of one port.
///
/// Source: FACTS 2.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Layout {
    instance: u8,
    channels: u8,
    interface_registers: u8,
    base: u16,
    register_stride: u16,
}

impl Layout {
    /// The registers of port `instance` of an identified board.
    pub fn locate(hostmot2: &HostMot2, instance: u8) -> Result<Self, LayoutError> {
        let descriptor = hostmot2.require_sserial()?;
        let channels = hostmot2.sserial_channels(descriptor.gtag, instance);
        Self::new(&SslbpModule::from(descriptor), instance, channels)
    }

    /// The registers of port `instance` of `module`, which has `channels` channels according to
    /// the pin descriptors.
    pub const fn new(
        module: &SslbpModule,
        instance: u8,
        channels: u8,
    ) -> Result<Self, LayoutError> {
        let (interface_registers, expected_mask) = match module.gtag {
            SslbpModule::GTAG => (3, 0x3C),
            SslbpModule::GTAG_WIDE => (7, 0x3FC),
            found => return Err(LayoutError::NotSslbp { found }),
        };
        let expected_registers = interface_registers + INTERFACE as u8;
        if module.registers != expected_registers || module.multiple_registers != expected_mask {
            return Err(LayoutError::UnknownLayout {
                gtag: module.gtag,
                registers: module.registers,
                mask: module.multiple_registers,
                expected_registers,
                expected_mask,
            });
        }
        if instance >= module.instances || instance >= MAX_INSTANCES {
            return Err(LayoutError::NoSuchInstance {
                instance,
                instances: module.instances,
            });
        }
        if channels == 0 || channels > MAX_CHANNELS {
            return Err(LayoutError::BadChannelCount { instance, channels });
        }
        let Some(base) = Self::instance_base(module, instance, channels, expected_registers) else {
            return Err(LayoutError::BadAddresses {
                base: module.base,
                register_stride: module.register_stride,
                instance_stride: module.instance_stride,
                instance,
            });
        };
        Ok(Self {
            instance,
            channels,
            interface_registers,
            base,
            register_stride: module.register_stride,
        })
    }

    /// Address of COMMAND, if all registers lie in the address space and none overlap.
    const fn instance_base(
        module: &SslbpModule,
        instance: u8,
        channels: u8,
        registers: u8,
    ) -> Option<u16> {
        let channel_bytes = channels as u32 * CHANNEL_STRIDE as u32;
        let base = module.base as u32 + module.instance_stride as u32 * instance as u32;
        let last = base + module.register_stride as u32 * (registers as u32 - 1);
        let overlap = (module.register_stride as u32) < channel_bytes
            || (module.instances > 1 && (module.instance_stride as u32) < channel_bytes);
        if overlap || !base.is_multiple_of(4) || !module.register_stride.is_multiple_of(4) {
            return None;
        }
        if last + channel_bytes > 0x1_0000 {
            return None;
        }
        Some(base as u16)
    }

    /// Which port of the module it is: 0 to 3.
    pub const fn instance(&self) -> u8 {
        self.instance
    }

    /// Number of channels, 1 to 8.
    pub const fn channels(&self) -> u8 {
        self.channels
    }

    /// All its channels.
    pub const fn mask(&self) -> ChannelMask {
        ChannelMask::first(self.channels)
    }

    /// Interface registers of each channel: 3 or 7.
    pub const fn interface_registers(&self) -> u8 {
        self.interface_registers
    }

    /// The most bits that a channel moves in one direction: 96 or 224.
    pub const fn process_data_bits(&self) -> u16 {
        self.interface_registers as u16 * 32
    }

    /// Address of COMMAND.
    pub const fn command(&self) -> u16 {
        self.base
    }

    /// Address of DATA.
    pub const fn data(&self) -> u16 {
        self.register(DATA)
    }

    /// Addresses of the registers of `channel`; `None` if the port does not have it.
    pub const fn channel(&self, channel: Channel) -> Option<ChannelRegisters> {
        if channel.index() >= self.channels {
            return None;
        }
        let offset = channel.index() as u16 * CHANNEL_STRIDE;
        Some(ChannelRegisters {
            cs: self.register(CS) + offset,
            interface: self.register(INTERFACE) + offset,
            register_stride: self.register_stride,
            count: self.interface_registers,
        })
    }

    /// `instance_base` has checked that the last register is in the address space.
    const fn register(self, index: u16) -> u16 {
        self.base + self.register_stride * index
    }
}

/// The register addresses of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ChannelRegisters {
    cs: u16,
    interface: u16,
    register_stride: u16,
    count: u8,
}

impl ChannelRegisters {
    /// Address of CS.
    pub const fn cs(&self) -> u16 {
        self.cs
    }

    /// Address of interface register `n`; `None` if there are not that many.
    pub const fn interface(&self, n: u8) -> Option<u16> {
        if n < self.count {
            Some(self.interface + self.register_stride * n as u16)
        } else {
            None
        }
    }

    /// Addresses of the interface registers, in the order in which they are packed.
    pub fn interfaces(&self) -> impl Iterator<Item = u16> + use<> {
        let registers = *self;
        (0..registers.count).filter_map(move |n| registers.interface(n))
    }

    /// Addresses of the interface registers that `bytes` bytes of process data take.
    pub fn interfaces_for(&self, bytes: u8) -> impl Iterator<Item = u16> + use<> {
        self.interfaces().take(usize::from(bytes.div_ceil(4)))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// FACTS 9.2: C1, 5A00, 6 registers, strides 10, mask 3C.
    pub(in crate::sslbp) const MODULE: SslbpModule = SslbpModule {
        gtag: 0xC1,
        base: 0x5A00,
        registers: 6,
        register_stride: 0x100,
        instance_stride: 0x40,
        multiple_registers: 0x3C,
        instances: 4,
    };

    const WIDE: SslbpModule = SslbpModule {
        gtag: 0xC6,
        registers: 10,
        multiple_registers: 0x3FC,
        ..MODULE
    };

    /// FACTS 2.1.
    #[test]
    fn addresses_are_those_of_the_facts() {
        let layout = Layout::new(&MODULE, 0, 8).unwrap();
        assert_eq!(layout.command(), 0x5A00);
        assert_eq!(layout.data(), 0x5B00);
        let registers = layout.channel(Channel::ALL[3]).unwrap();
        assert_eq!(registers.cs(), 0x5C0C);
        assert!(registers.interfaces().eq([0x5D0C, 0x5E0C, 0x5F0C]));
        assert!(registers.interfaces_for(5).eq([0x5D0C, 0x5E0C]));
        assert!(registers.interfaces_for(0).eq([]));
        assert_eq!(layout.process_data_bits(), 96);
        let second = Layout::new(&MODULE, 1, 8).unwrap();
        assert_eq!(second.command(), 0x5A40);
        assert_eq!(second.channel(Channel::ALL[7]).unwrap().cs(), 0x5C5C);
    }

    #[test]
    fn the_wide_layout_has_seven_interface_registers() {
        let layout = Layout::new(&WIDE, 3, 2).unwrap();
        assert_eq!(layout.process_data_bits(), 224);
        let registers = layout.channel(Channel::ALL[1]).unwrap();
        assert_eq!(registers.interface(6), Some(0x5A00 + 9 * 0x100 + 0xC0 + 4));
        assert_eq!(registers.interface(7), None);
    }

    #[test]
    fn what_is_not_there_is_not_addressed() {
        let layout = Layout::new(&MODULE, 0, 3).unwrap();
        assert_eq!(layout.channel(Channel::ALL[3]), None);
        assert_eq!(
            Layout::new(&MODULE, 4, 8),
            Err(LayoutError::NoSuchInstance {
                instance: 4,
                instances: 4
            })
        );
        assert_eq!(
            Layout::new(&MODULE, 0, 0),
            Err(LayoutError::BadChannelCount {
                instance: 0,
                channels: 0
            })
        );
    }

    #[test]
    fn other_modules_and_layouts_are_refused() {
        let encoder = SslbpModule {
            gtag: 0x0C,
            ..MODULE
        };
        assert_eq!(
            Layout::new(&encoder, 0, 8),
            Err(LayoutError::NotSslbp { found: 0x0C })
        );
        let mixed = SslbpModule {
            gtag: 0xC6,
            ..MODULE
        };
        assert!(matches!(
            Layout::new(&mixed, 0, 8),
            Err(LayoutError::UnknownLayout {
                expected_mask: 0x3FC,
                ..
            })
        ));
    }

    proptest! {
        #[test]
        fn registers_of_any_accepted_module_are_distinct_and_in_range(
            base: u16,
            register_stride: u16,
            instance_stride: u16,
            wide: bool,
            instance in 0u8..6,
            channels in 0u8..10,
        ) {
            let kind = if wide { WIDE } else { MODULE };
            let module = SslbpModule { base, register_stride, instance_stride, ..kind };
            if let Ok(layout) = Layout::new(&module, instance, channels) {
                let mut seen = std::collections::BTreeSet::from([layout.command()]);
                prop_assert!(seen.insert(layout.data()));
                for channel in layout.mask().iter() {
                    let registers = layout.channel(channel).unwrap();
                    prop_assert!(seen.insert(registers.cs()));
                    for address in registers.interfaces() {
                        prop_assert!(seen.insert(address));
                    }
                }
                prop_assert!(seen.iter().all(|address| address % 4 == 0));
            }
        }
    }
}
