//! What is known of a pin beside its value.

use alloc::string::String;

use super::{GroupId, HalType, PinId, Place};

/// The longest name: what LinuxCNC's HAL takes.
///
/// Names of up to 41 characters also fit its older tools (FACTS 8.6).
pub const MAX_NAME: usize = 47;

/// The largest number of pins and parameters of a store.
pub const MAX_PINS: usize = 1 << 20;

/// What something in the store is, as LinuxCNC sees it.
///
/// LinuxCNC's directions are those of the driver: what the machine reports is `OUT` of the driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Set by the driver, read by the application: [`Input`](super::Input), HAL `OUT`.
    Input,
    /// Set by the application: [`Output`](super::Output), HAL `IN`.
    Output,
    /// Set by both: [`InOut`](super::InOut), HAL `I/O`.
    InOut,
    /// A setting: [`Param`](super::Param), HAL `RW`.
    Setting,
    /// A property that can not be changed: [`Param`](super::Param), HAL `RO`.
    Property,
    /// A parameter that a remote keeps, HAL `RW`: it takes an operation of its own to change it
    /// ([`Driver::write_remote_parameter`](crate::driver::Driver::write_remote_parameter)).
    InRemote,
}

impl Role {
    /// LinuxCNC's word, as `halcmd show` prints it.
    pub const fn hal_direction(self) -> &'static str {
        match self {
            Self::Input => "OUT",
            Self::Output => "IN",
            Self::InOut => "I/O",
            Self::Setting | Self::InRemote => "RW",
            Self::Property => "RO",
        }
    }

    /// What it is, for messages.
    pub(super) const fn as_str(self) -> &'static str {
        match self {
            Self::Input => "an input",
            Self::Output => "an output",
            Self::InOut => "a pin set by both sides",
            Self::Setting => "a parameter",
            Self::Property => "a read-only parameter",
            Self::InRemote => "a parameter kept in a remote",
        }
    }

    /// Whether it is a parameter and no pin.
    pub const fn is_param(self) -> bool {
        matches!(self, Self::Setting | Self::Property | Self::InRemote)
    }
}

/// What is known of a pin or parameter beside its value.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PinInfo {
    /// Its LinuxCNC name, for example `hm2_7i92.0.7i77.0.0.input-07-not`.
    pub name: String,
    /// Its type.
    pub hal_type: HalType,
    /// Which way it goes, or what kind of parameter it is.
    pub role: Role,
    /// Where it is; empty if it is at no terminal.
    pub place: Place,
    /// Its unit, for example `V`; empty for a plain number or truth value.
    pub unit: String,
    /// The smallest and the largest value it can have, where there are such.
    pub limits: Option<(f64, f64)>,
    /// It is a setting that others are divided by or multiplied with, and is never 0.
    pub is_scale: bool,
    /// The group it belongs to.
    pub group: GroupId,
    /// What has to be on for the value of an output to reach its terminal: the enable of an analog
    /// output, the direction of an I/O pin. That may need another one in its turn: see
    /// [`Pins::enables`](super::Pins::enables).
    pub enabled_by: Option<PinId>,
}
