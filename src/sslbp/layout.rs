//! Register addresses of a port.

use super::{Channel, ChannelMask, MAX_CHANNELS};
use crate::hostmot2::{Gtag, HostMot2, HostMot2Error, ModuleDescriptor};
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

/// Largest number of interface registers of a channel: 224 bits.
pub const MAX_INTERFACE_REGISTERS: u8 = 7;

/// Largest number of ports that are used.
pub(crate) const MAX_PORTS: u8 = 4;

/// Distance of the registers of neighbouring channels.
const CHANNEL_STRIDE: u16 = 4;

/// Indices of the registers: COMMAND, DATA, CS, then the interface registers.
const DATA: u16 = 1;
const CS: u16 = 2;
const INTERFACE: u16 = 3;

/// A smart serial port of a firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PortPlace {
    /// Its module: [`Gtag::SSERIAL`] or [`Gtag::SSERIAL_B`].
    pub gtag: Gtag,
    /// Its number among the instances of its kind of module, as used in pin descriptors.
    pub unit: u8,
    /// Its registers, with its number on the board.
    pub layout: PortLayout,
}

/// The register addresses of one port.
///
/// Source: FACTS 2.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PortLayout {
    /// Number of the port, 0 to 3: within its module, or within the board if that has several
    /// serial modules.
    pub instance: u8,
    /// Number of channels, 1 to 8.
    pub channels: u8,
    /// Interface registers of each channel: 3 or 7.
    pub interface_registers: u8,
    /// Address of COMMAND.
    pub command: u16,
    /// Distance of registers.
    register_stride: u16,
}

impl PortLayout {
    /// The ports of an identified board that can be driven, at most 4: those of all serial modules
    /// that have pins, numbered consecutively in the order of the descriptors. At most the first 8
    /// channels of a port are used.
    pub fn ports(hostmot2: &HostMot2) -> Vec<PortPlace> {
        let mut ports = Vec::new();
        for module in &hostmot2.modules {
            let gtag = module.gtag;
            let mut same = hostmot2.modules_of(gtag);
            let first = same.find(|(_, other)| core::ptr::eq(*other, module));
            let (Gtag::SSERIAL | Gtag::SSERIAL_B, Some((first, _))) = (gtag, first) else {
                continue;
            };
            for instance in 0..module.instances {
                let unit = first.saturating_add(instance);
                let channels = hostmot2.sserial_channels(gtag, unit).min(MAX_CHANNELS);
                if let Ok(layout) = Self::new(module, instance, channels) {
                    let instance = ports.len() as u8;
                    let layout = Self { instance, ..layout };
                    ports.push(PortPlace { gtag, unit, layout });
                }
            }
        }
        ports.truncate(MAX_PORTS.into());
        ports
    }

    /// The registers of port `port` of an identified board: see [`ports`](Self::ports).
    ///
    /// # Errors
    /// [`HostMot2Error`] if the port does not exist, or its registers are at unsupported addresses.
    pub fn locate(hostmot2: &HostMot2, port: u8) -> Result<Self, HostMot2Error> {
        let mut ports = Self::ports(hostmot2).into_iter();
        if let Some(place) = ports.nth(port.into()) {
            return Ok(place.layout);
        }
        let module = hostmot2.require_sserial()?;
        Self::new(module, port, hostmot2.sserial_channels(module.gtag, port))
    }

    /// The registers of port `instance` of `module`, which has `channels` channels according to the
    /// pin descriptors.
    ///
    /// # Errors
    /// As [`locate`](Self::locate).
    pub fn new(
        module: &ModuleDescriptor,
        instance: u8,
        channels: u8,
    ) -> Result<Self, HostMot2Error> {
        let gtag = module.gtag;
        let interface_registers = interface_registers(module)?;
        let registers = interface_registers + INTERFACE as u8;
        if instance >= module.instances.min(MAX_PORTS) {
            return Err(HostMot2Error::NoRegister {
                gtag,
                register: 0,
                instance,
                registers,
                instances: module.instances,
            });
        }
        if channels == 0 {
            return Err(HostMot2Error::NoPins {
                gtag,
                unit: instance,
            });
        }
        let command = Self::base(module, instance, channels, registers);
        let Some(command) = command.filter(|_| channels <= MAX_CHANNELS) else {
            let (register, of_instance) = (module.register_stride, module.instance_stride);
            let found = format!(
                "{channels} channels on port {instance}, strides {register:#X} and {of_instance:#X}"
            );
            let expected = "1 to 8 whose registers do not overlap".into();
            return Err(unknown(gtag, found, expected));
        };
        Ok(Self {
            instance,
            channels,
            interface_registers,
            command,
            register_stride: module.register_stride,
        })
    }

    /// Address of COMMAND, if all registers lie in the address space and none overlap. The stride
    /// of instances also applies to the registers that are not in the mask.
    fn base(module: &ModuleDescriptor, instance: u8, channels: u8, registers: u8) -> Option<u16> {
        let bytes = u16::from(channels) * CHANNEL_STRIDE;
        let (register, stride) = (module.register_stride, module.instance_stride);
        let base = module
            .base
            .checked_add(stride.checked_mul(instance.into())?)?;
        let last = base.checked_add(register.checked_mul(u16::from(registers) - 1)?)?;
        last.checked_add(bytes - 1)?;
        let overlap = register < bytes || module.instances > 1 && stride < bytes;
        let is_aligned = base.is_multiple_of(4) && register.is_multiple_of(4);
        (is_aligned && !overlap).then_some(base)
    }

    /// All channels of the port.
    pub const fn mask(&self) -> ChannelMask {
        ChannelMask::first(self.channels)
    }

    /// Address of DATA.
    pub const fn data(&self) -> u16 {
        self.register(DATA)
    }

    /// Address of CS of `channel`; `None` if the port does not have it.
    pub fn cs(&self, channel: Channel) -> Option<u16> {
        Some(self.channel(channel)?.cs)
    }

    /// Addresses of the interface registers of `channel`, in the order in which they are packed;
    /// none if the port does not have it.
    pub fn interfaces(&self, channel: Channel) -> impl Iterator<Item = u16> + use<> {
        let registers = self.channel(channel).into_iter();
        registers.flat_map(ChannelRegisters::interfaces)
    }

    /// Addresses of the registers of `channel`; `None` if the port does not have it.
    pub(crate) fn channel(self, channel: Channel) -> Option<ChannelRegisters> {
        let offset = u16::from(channel.index()) * CHANNEL_STRIDE;
        (channel.index() < self.channels).then(|| ChannelRegisters {
            cs: self.register(CS) + offset,
            interface: self.register(INTERFACE) + offset,
            register_stride: self.register_stride,
            count: self.interface_registers,
        })
    }

    /// `base` has checked that the last register is in the address space.
    const fn register(self, index: u16) -> u16 {
        self.command + self.register_stride * index
    }
}

/// Number of interface registers of a channel: 3 or 7, depending on the kind of the module.
fn interface_registers(module: &ModuleDescriptor) -> Result<u8, HostMot2Error> {
    let gtag = module.gtag;
    let interface_registers = match gtag {
        Gtag::SSERIAL => 3,
        Gtag::SSERIAL_B => 7,
        _ => {
            let expected = "SSerial or SSerialB".into();
            return Err(unknown(gtag, "no serial ports".into(), expected));
        }
    };
    let registers = interface_registers + INTERFACE as u8;
    // Any other set of registers belongs to an unsupported firmware.
    let expected = (registers, (1 << registers) - (1 << CS));
    let found = (module.registers, module.multiple_registers);
    if found != expected {
        let text = |(registers, multiple): (u8, u32)| {
            format!("{registers} registers with multiple-register mask {multiple:#X}")
        };
        return Err(unknown(gtag, text(found), text(expected)));
    }
    Ok(interface_registers)
}

fn unknown(gtag: Gtag, found: String, expected: String) -> HostMot2Error {
    HostMot2Error::Unknown {
        gtag,
        found,
        expected,
    }
}

/// The register addresses of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct ChannelRegisters {
    /// Address of CS.
    pub cs: u16,
    interface: u16,
    register_stride: u16,
    count: u8,
}

impl ChannelRegisters {
    /// The registers of a channel of a usual port, for tests.
    #[cfg(test)]
    pub const fn usual(channel: Channel) -> Self {
        let own = 4 * channel.index() as u16;
        Self {
            cs: 0x5C00 + own,
            interface: 0x5D00 + own,
            register_stride: 0x100,
            count: 3,
        }
    }

    /// Addresses of the interface registers, in the order in which they are packed.
    pub fn interfaces(self) -> impl Iterator<Item = u16> + use<> {
        let Self {
            interface,
            register_stride,
            count,
            ..
        } = self;
        (0..u16::from(count)).map(move |n| interface + register_stride * n)
    }

    /// Addresses of the interface registers that `bytes` bytes of process data take.
    pub fn interfaces_for(self, bytes: u8) -> impl Iterator<Item = u16> + use<> {
        self.interfaces().take(usize::from(bytes.div_ceil(4)))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use alloc::string::ToString;
    use proptest::prelude::*;

    /// FACTS 2.1: C1, 5A00, 6 registers, strides 10, mask 3C.
    pub(in crate::sslbp) const MODULE: ModuleDescriptor = ModuleDescriptor {
        gtag: Gtag::SSERIAL,
        version: 0,
        clock_hz: 100_000_000,
        base: 0x5A00,
        registers: 6,
        register_stride: 0x100,
        instance_stride: 0x40,
        multiple_registers: 0x3C,
        instances: 4,
    };

    const WIDE: ModuleDescriptor = ModuleDescriptor {
        gtag: Gtag::SSERIAL_B,
        registers: 10,
        multiple_registers: 0x3FC,
        ..MODULE
    };

    /// FACTS 2.1.
    #[test]
    fn addresses_are_those_of_the_facts() {
        let layout = PortLayout::new(&MODULE, 0, 8).unwrap();
        assert_eq!(layout.command, 0x5A00);
        assert_eq!(layout.data(), 0x5B00);
        let registers = layout.channel(Channel::ALL[3]).unwrap();
        assert_eq!(registers.cs, 0x5C0C);
        assert!(registers.interfaces().eq([0x5D0C, 0x5E0C, 0x5F0C]));
        assert!(registers.interfaces_for(5).eq([0x5D0C, 0x5E0C]));
        assert_eq!(registers.interfaces_for(0).next(), None);
        assert_eq!(layout.interface_registers, 3);
        let second = PortLayout::new(&MODULE, 1, 8).unwrap();
        assert_eq!(second.command, 0x5A40);
        assert_eq!(second.channel(Channel::ALL[7]).unwrap().cs, 0x5C5C);
    }

    #[test]
    fn wide_layout_has_seven_interface_registers() {
        let layout = PortLayout::new(&WIDE, 3, 2).unwrap();
        assert_eq!(layout.interface_registers, 7);
        let registers = layout.channel(Channel::ALL[1]).unwrap();
        assert_eq!(
            registers.interfaces().last(),
            Some(0x5A00 + 9 * 0x100 + 0xC0 + 4)
        );
        assert_eq!(registers.interfaces().count(), 7);
    }

    #[test]
    fn absent_channels_and_ports_are_not_addressed() {
        let layout = PortLayout::new(&MODULE, 0, 3).unwrap();
        assert_eq!(layout.channel(Channel::ALL[3]), None);
        assert!(matches!(
            PortLayout::new(&MODULE, 4, 8),
            Err(HostMot2Error::NoRegister { instance: 4, .. })
        ));
        assert!(matches!(
            PortLayout::new(&MODULE, 0, 0),
            Err(HostMot2Error::NoPins { unit: 0, .. })
        ));
        let error = PortLayout::new(&MODULE, 0, 9).unwrap_err().to_string();
        assert!(error.contains("9 channels on port 0"), "{error}");
    }

    #[test]
    fn other_modules_and_layouts_are_refused() {
        let encoder = ModuleDescriptor {
            gtag: Gtag::MUXED_ENCODER,
            ..MODULE
        };
        let error = PortLayout::new(&encoder, 0, 8).unwrap_err().to_string();
        assert!(error.contains("has no serial ports"), "{error}");
        let mixed = ModuleDescriptor {
            gtag: Gtag::SSERIAL_B,
            ..MODULE
        };
        let error = PortLayout::new(&mixed, 0, 8).unwrap_err().to_string();
        assert!(error.contains("mask 0x3C, expected 10"), "{error}");
        assert!(error.contains("mask 0x3FC"), "{error}");
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
            let module = ModuleDescriptor { base, register_stride, instance_stride, ..kind };
            if let Ok(layout) = PortLayout::new(&module, instance, channels) {
                let mut seen = std::collections::BTreeSet::from([layout.command]);
                prop_assert!(seen.insert(layout.data()));
                for channel in layout.mask().iter() {
                    let registers = layout.channel(channel).unwrap();
                    prop_assert!(seen.insert(registers.cs));
                    for address in registers.interfaces() {
                        prop_assert!(seen.insert(address));
                    }
                }
                prop_assert!(seen.iter().all(|address| address % 4 == 0));
            }
        }
    }
}
