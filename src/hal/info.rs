//! Description of a pin or parameter apart from its value.

use alloc::string::String;
use alloc::sync::Arc;

use super::{GroupId, HalType, PinId, Place};

/// Longest name that LinuxCNC's HAL accepts.
///
/// Names of up to 41 characters also fit its older tools (FACTS 8.6).
pub const MAX_NAME: usize = 47;

/// The largest number of pins and parameters of a store.
pub const MAX_PINS: usize = 1 << 20;

/// Role of a pin or parameter, as LinuxCNC sees it.
///
/// LinuxCNC's directions are those of the driver: a value that the machine reports is `OUT` of the
/// driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Role {
    /// Set by the driver, read by the application: [`Input`](super::Input), HAL `OUT`.
    Input,
    /// Set by the application: [`Output`](super::Output), HAL `IN`.
    Output,
    /// Set by both: [`InOut`](super::InOut), HAL `I/O`.
    InOut,
    /// A setting: [`Param`](super::Param), HAL `RW`.
    Setting,
    /// A property that cannot be changed: [`Param`](super::Param), HAL `RO`.
    Property,
    /// A parameter that a remote keeps, HAL `RW`: changing it takes a separate operation
    /// ([`Driver::write_remote_parameter`](crate::driver::Driver::write_remote_parameter)).
    InRemote,
}

impl Role {
    /// LinuxCNC's word for the direction, as `halcmd show` prints it.
    pub const fn hal_direction(self) -> &'static str {
        match self {
            Self::Input => "OUT",
            Self::Output => "IN",
            Self::InOut => "I/O",
            Self::Setting | Self::InRemote => "RW",
            Self::Property => "RO",
        }
    }

    /// The role as a noun phrase, for messages.
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

    /// True for a parameter, false for a pin.
    pub const fn is_param(self) -> bool {
        matches!(self, Self::Setting | Self::Property | Self::InRemote)
    }
}

/// Description of a pin or parameter apart from its value.
///
/// With the feature `serde`, pins and groups are serialized as their numbers: of a pin its
/// [index](PinId::index).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct PinInfo {
    /// Its LinuxCNC name, for example `hm2_7i92.0.7i77.0.0.input-07-not`.
    pub name: String,
    /// Its type.
    pub hal_type: HalType,
    /// Direction of the pin, or kind of parameter.
    pub role: Role,
    /// Terminal of the pin; empty if it has none. Pins at the same terminal share it.
    #[cfg_attr(feature = "serde", serde(serialize_with = "serialize_place"))]
    pub place: Arc<Place>,
    /// Its unit, for example `V`; empty for a plain number or truth value.
    pub unit: String,
    /// The smallest and the largest value, if the pin has limits.
    pub limits: Option<(f64, f64)>,
    /// True for a setting by which others are divided or multiplied; it is never 0.
    pub is_scale: bool,
    /// The group to which it belongs.
    pub group: GroupId,
    /// The pin that must be on for the value of an output to reach its terminal: the enable of an
    /// analog output, the direction of an I/O pin. That pin may need another one in turn: see
    /// [`Pins::enables`](super::Pins::enables).
    pub enabled_by: Option<PinId>,
}

#[cfg(feature = "serde")]
fn serialize_place<S: serde::Serializer>(
    place: &Arc<Place>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serde::Serialize::serialize(&**place, serializer)
}
