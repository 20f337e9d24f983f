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
            for register in 0..registers(firmware, module).min(32) {
                map.put_register(module, register, ports);
            }
            if is_serial(module) {
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

    /// Maps one register in all instances of a module. `first_port` is the number of the first
    /// port, if the module is serial.
    fn put_register(&mut self, module: &SimModuleDescriptor, register: u8, first_port: u8) {
        let (register_stride, instance_stride) = SimFirmware::strides(module);
        let serial = is_serial(module);
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
            let address = base.wrapping_add(u16::from(instance).wrapping_mul(instance_stride));
            if serial {
                let port = instance.saturating_add(first_port);
                self.put_channels(address, module.gtag, register, port, multiple);
            } else {
                let target = Target::Module {
                    gtag: module.gtag,
                    register,
                    instance,
                    port: 0,
                };
                self.put(address, target);
            }
        }
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

fn is_serial(module: &SimModuleDescriptor) -> bool {
    matches!(module.gtag, gtag::SSERIAL | gtag::SSERIAL_B)
}

/// Number of registers of a module. Encoders with a DPLL and step generators have one more than
/// their descriptor counts: the selection of the timer that latches them. Step generators without a
/// DPLL have its address, but nothing drives the bus there.
fn registers(firmware: &SimFirmware, module: &SimModuleDescriptor) -> u8 {
    let has_timer = match module.gtag {
        gtag::ENCODER | gtag::MUXED_ENCODER => firmware.module(gtag::DPLL).is_some(),
        gtag::STEPGEN => true,
        _ => false,
    };
    module.registers + u8::from(has_timer)
}
