//! The modules of a firmware that are not driven, with the reason.

use alloc::vec::Vec;
use core::fmt;

use super::built_in::{NotDriven, check, is_single};
use crate::advice::{Advice, MesaError};
use crate::hostmot2::{Gtag, HostMot2, HostMot2Error, ModuleDescriptor, list_of};
use crate::sslbp::{MAX_CHANNELS, MAX_PORTS, PortLayout};

/// A module of a firmware, or a part of one, that is not driven. Its pins are plain I/O.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Undriven {
    /// The kind of the module.
    pub gtag: Gtag,
    /// The version of the module.
    pub version: u8,
    /// Number of instances of the descriptor.
    pub instances: u8,
    /// The reason.
    pub reason: UndrivenReason,
    /// The I/O pins of the module, by number.
    pub pins: Vec<u16>,
    /// The local I/O pins of the module, by number.
    pub local_pins: Vec<u16>,
}

/// The reason why a module is not driven.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UndrivenReason {
    /// This crate has no driver for this kind.
    #[error("the driver does not support it")]
    Unsupported,
    /// The version, or the register layout, is unknown.
    #[error("{0}")]
    Unknown(HostMot2Error),
    /// A second module of a kind of which a board has only one.
    #[error("only the first one is driven")]
    Another,
    /// The module selects multiplexed encoders that do not exist or are not driven.
    #[error("no multiplexed encoder is driven")]
    NoEncoders,
    /// A serial module with more ports than can be driven.
    #[error("only {driven} of its ports are driven, of {most} that a board can have")]
    Ports {
        /// Number of driven ports.
        driven: u8,
        /// Greatest number of ports that a board can have.
        most: u8,
    },
    /// A serial port has more channels than can be driven.
    #[error("port {port} has {channels} channels, of which {MAX_CHANNELS} are driven")]
    Channels {
        /// The number of the port.
        port: u8,
        /// Number of channels with pins.
        channels: u8,
    },
}

impl MesaError for UndrivenReason {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Unknown(error) => error.advice(),
            Self::Unsupported
            | Self::Another
            | Self::NoEncoders
            | Self::Ports { .. }
            | Self::Channels { .. } => None,
        }
    }
}

/// `StepGen (05) version 2, 5 instances: this crate does not drive it; plain I/O are pins 17-26`.
impl fmt::Display for Undriven {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (gtag, version, instances) = (self.gtag, self.version, self.instances);
        let plural = if instances == 1 { "" } else { "s" };
        write!(
            f,
            "{gtag} version {version}, {instances} instance{plural}: "
        )?;
        write!(f, "{}; ", self.reason)?;
        match &*self.pins {
            [] => f.write_str("it has no I/O pins")?,
            [pin] => write!(f, "I/O pin {pin} is plain I/O")?,
            pins => write!(
                f,
                "I/O pins {} are plain I/O",
                list_of(pins.iter().copied())
            )?,
        }
        match &*self.local_pins {
            [] => Ok(()),
            pins => write!(f, "; local I/O: {}", list_of(pins.iter().copied())),
        }
    }
}

/// Returns the modules of a firmware that are not driven, in the order of its descriptors. Modules
/// of the kinds `claimed` are driven by the application.
///
/// A descriptor without instances has nothing to drive.
pub fn undriven(firmware: &HostMot2, claimed: &[Gtag]) -> Vec<Undriven> {
    let mut list = Vec::new();
    for module in firmware.modules.iter().filter(|m| m.instances > 0) {
        if claimed.contains(&module.gtag) {
            continue;
        }
        let mut same = firmware.modules_of(module.gtag);
        let Some((first, _)) = same.find(|(_, m)| core::ptr::eq(*m, module)) else {
            continue;
        };
        let reason = match check(module) {
            Err(NotDriven::Unsupported) => Some(UndrivenReason::Unsupported),
            Err(NotDriven::Unknown(error)) => Some(UndrivenReason::Unknown(error)),
            Ok(()) if first > 0 && is_single(module.gtag) => Some(UndrivenReason::Another),
            Ok(()) if module.gtag == Gtag::MUX_SELECT && !has_muxed(firmware) => {
                Some(UndrivenReason::NoEncoders)
            }
            Ok(()) => None,
        };
        match reason {
            Some(reason) => {
                let mut same = firmware.modules_of(module.gtag);
                let is_last = same.all(|(other, _)| other <= first);
                // Pins of instances beyond those of the descriptors belong to the last module.
                let end = if is_last {
                    u8::MAX
                } else {
                    first.saturating_add(module.instances.saturating_sub(1))
                };
                let is_its = |unit, _| (first..=end).contains(&unit);
                list.push(Undriven::new(firmware, module, reason, is_its));
            }
            None => list.extend(undriven_serial(firmware, module, first)),
        }
    }
    list
}

fn has_muxed(firmware: &HostMot2) -> bool {
    let mut modules = firmware.modules_of(Gtag::MUXED_ENCODER);
    modules.any(|(_, module)| check(module).is_ok())
}

/// The ports and channels of a serial module beyond the supported number.
fn undriven_serial(firmware: &HostMot2, module: &ModuleDescriptor, first: u8) -> Vec<Undriven> {
    let gtag = module.gtag;
    if !matches!(gtag, Gtag::SSERIAL | Gtag::SSERIAL_B) {
        return Vec::new();
    }
    let mut list = Vec::new();
    let units = first..first.saturating_add(module.instances);
    let ports: Vec<_> = PortLayout::ports(firmware)
        .into_iter()
        .filter(|port| port.gtag == gtag && units.contains(&port.unit))
        .collect();
    let is_driven = |unit| ports.iter().any(|port| port.unit == unit);
    let with_pins = units
        .clone()
        .filter(|&unit| firmware.sserial_channels(gtag, unit) > 0);
    if !with_pins.clone().all(is_driven) {
        let reason = UndrivenReason::Ports {
            driven: ports.len() as u8,
            most: MAX_PORTS,
        };
        let of_others = |unit, _| units.contains(&unit) && !is_driven(unit);
        list.push(Undriven::new(firmware, module, reason, of_others));
    }
    for port in &ports {
        let channels = firmware.sserial_channels(gtag, port.unit);
        if channels > MAX_CHANNELS {
            let port_number = port.layout.instance;
            let reason = UndrivenReason::Channels {
                port: port_number,
                channels,
            };
            list.push(Undriven::new(firmware, module, reason, |unit, channel| {
                unit == port.unit && channel.is_some_and(|n| n >= MAX_CHANNELS)
            }));
        }
    }
    list
}

impl Undriven {
    /// Makes the entry. `is_its` returns true for unit and serial channel of the pins of the entry.
    fn new(
        firmware: &HostMot2,
        module: &ModuleDescriptor,
        reason: UndrivenReason,
        is_its: impl Fn(u8, Option<u8>) -> bool,
    ) -> Self {
        let gtag = module.gtag;
        let numbers = |pins: &[crate::hostmot2::PinDescriptor]| {
            let pins = (0_u16..).zip(pins);
            let its = pins.filter(|(_, pin)| {
                pin.secondary == gtag && is_its(pin.unit, pin.sserial_channel())
            });
            its.map(|(number, _)| number).collect()
        };
        Self {
            gtag,
            version: module.version,
            instances: module.instances,
            reason,
            pins: numbers(&firmware.pins),
            local_pins: numbers(&firmware.local_pins),
        }
    }
}
