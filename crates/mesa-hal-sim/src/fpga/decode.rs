//! Address decoder: the register at each address.

use super::firmware::{COOKIE_ADDRESS, IDROM_ADDRESS, SimFirmware, SimModuleDescriptor, gtag};

/// Maximum number of ports of a serial module.
pub(super) const MAX_PORTS: u8 = 4;

/// Target of an address.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Target {
    /// No register.
    #[default]
    Nothing,
    /// Identification and IDROM, read only: index into the words.
    Rom(u16),
    /// A register of a module.
    Module {
        /// The module.
        gtag: u8,
        /// Register number.
        register: u8,
        /// Instance, or channel for smart serial.
        instance: u8,
        /// Smart serial only: the port.
        port: u8,
    },
}

/// The address space, one entry for each 32-bit word.
#[derive(Clone, Debug)]
pub(crate) struct AddressMap {
    targets: Box<[Target]>,
}

impl AddressMap {
    /// The map of a firmware. `rom` is the number of words of identification and IDROM.
    pub(crate) fn new(firmware: &SimFirmware, idrom_words: usize) -> Self {
        let mut map = Self {
            targets: vec![Target::Nothing; 0x4000].into_boxed_slice(),
        };
        // Serial ports are numbered consecutively over all modules.
        let mut ports = 0;
        for module in &firmware.modules {
            // The select line of the encoders has no register of its own, and a descriptor without
            // instances has no hardware.
            if module.gtag == gtag::MUX_SELECT || module.instances == 0 {
                continue;
            }
            let (register_stride, instance_stride) = SimFirmware::strides(module);
            let serial = matches!(module.gtag, gtag::SSERIAL | gtag::SSERIAL_B);
            for register in 0..registers(firmware, module).min(32) {
                let multiple = module.multiple >> register & 1 != 0;
                let base = module
                    .base
                    .wrapping_add(u16::from(register).wrapping_mul(register_stride));
                let instances = if multiple || serial {
                    module.instances
                } else {
                    1
                };
                for instance in 0..instances {
                    let address =
                        base.wrapping_add(u16::from(instance).wrapping_mul(instance_stride));
                    if serial {
                        let port = instance.saturating_add(ports);
                        map.put_channels(address, module.gtag, register, port, multiple);
                    } else {
                        let target = Target::Module {
                            gtag: module.gtag,
                            register,
                            instance,
                            port: 0,
                        };
                        map.put(address, target);
                    }
                }
            }
            if serial {
                ports += module.instances.min(MAX_PORTS);
            }
        }
        for index in 0..4 {
            map.put(COOKIE_ADDRESS + 4 * index, Target::Rom(index));
        }
        for index in 0..idrom_words as u16 {
            map.put(IDROM_ADDRESS + 4 * index, Target::Rom(4 + index));
        }
        map
    }

    /// The target at a byte address.
    pub(crate) fn at(&self, address: u16) -> Target {
        self.targets
            .get(usize::from(address >> 2))
            .copied()
            .unwrap_or_default()
    }

    /// Maps smart serial: COMMAND and DATA once per port, the others once for each of eight
    /// channels.
    fn put_channels(&mut self, address: u16, gtag: u8, register: u8, port: u8, multiple: bool) {
        let channels = if multiple { 8 } else { 1 };
        for channel in 0..channels {
            let target = Target::Module {
                gtag,
                register,
                instance: channel,
                port,
            };
            self.put(address.wrapping_add(4 * u16::from(channel)), target);
        }
    }

    fn put(&mut self, address: u16, target: Target) {
        if let Some(slot) = self.targets.get_mut(usize::from(address >> 2)) {
            *slot = target;
        }
    }
}

/// Number of registers of a module. With a DPLL, encoders have one more than their descriptor
/// counts: the selection of the timer that latches them.
fn registers(firmware: &SimFirmware, module: &SimModuleDescriptor) -> u8 {
    let is_encoder = matches!(module.gtag, gtag::ENCODER | gtag::MUXED_ENCODER);
    let has_timer = is_encoder && firmware.module(gtag::DPLL).is_some();
    module.registers + u8::from(has_timer)
}
