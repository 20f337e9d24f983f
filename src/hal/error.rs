//! Errors of pins, at set-up and when settings are changed.

use alloc::string::String;

use super::{AnyValue, HalType, MAX_NAME};
use crate::advice::{self, Advice, MesaError};

/// Reason why a pin or parameter was not made, not found or not changed.
///
/// Returned at set-up and by the application's calls, never by the cycle itself: there, a bad value
/// is replaced by a safe one and counted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PinError {
    /// The name is empty, longer than LinuxCNC accepts, or contains characters that HAL files
    /// cannot hold.
    #[error(
        "`{name}` is not a pin name: HAL takes 1 to {} letters, digits, '-', '_' and '.'",
        super::MAX_NAME
    )]
    BadName {
        /// The name.
        name: String,
    },
    /// A pin or parameter with that name already exists.
    #[error("two pins or parameters are named `{name}`")]
    NameTaken {
        /// The name.
        name: String,
    },
    /// The store cannot number any more pins.
    #[error(
        "more than {} pins and parameters, or 65,535 parts of groups",
        super::MAX_PINS
    )]
    TooMany,
    /// No pin or parameter has that name.
    #[error("no pin or parameter `{name}`{}", Nearest(.nearest.as_deref()))]
    NotFound {
        /// The name.
        name: String,
        /// The nearest existing name.
        nearest: Option<String>,
    },
    /// The pin or parameter exists, but has another type or role.
    #[error("`{name}` is {actual}, not {expected}")]
    WrongKind {
        /// The name.
        name: String,
        /// The requested type or role.
        expected: &'static str,
        /// The actual type or role.
        actual: &'static str,
    },
    /// The value has another type than the pin.
    #[error(
        "`{name}` takes a value of type {}{}, and {value} is of type {}",
        expected.as_str(),
        Limits(*.limits),
        value.hal_type.as_str()
    )]
    WrongType {
        /// The pin or parameter.
        name: ShortName,
        /// Its type.
        expected: HalType,
        /// The value, of another type.
        value: AnyValue,
        /// The limits of the pin or parameter, if it has any.
        limits: Option<(f64, f64)>,
    },
    /// The pin is an input, which the machine sets.
    #[error("`{name}` is an input: the machine sets it, and the application reads it")]
    NotSettable {
        /// The pin.
        name: ShortName,
    },
    /// No parameter or pin inverts the output.
    #[error("`{name}` is an output that nothing inverts")]
    NothingInverts {
        /// The output.
        name: ShortName,
    },
    /// The handle belongs to another store.
    #[error("the handle belongs to another driver's pins, or to none")]
    ForeignHandle,
    /// The limits or the full scale of a pin or parameter are not finite or not in order, or its
    /// first value lies outside them.
    #[error(
        "`{name}` cannot begin at {initial}: its limits and its full scale must be finite, the limits in order, and its first value between them{}",
        Limits(*.limits)
    )]
    BadLimits {
        /// Its name.
        name: ShortName,
        /// The first value, which for an output is the safe value.
        initial: AnyValue,
        /// Its limits, if it has any.
        limits: Option<(f64, f64)>,
    },
    /// The parameter cannot be written.
    #[error("`{name}` is a read-only parameter: it shows a value, and cannot be set")]
    ReadOnly {
        /// The parameter.
        name: ShortName,
    },
    /// The parameter is kept in a remote, which accepts it in setup mode only.
    #[error("`{name}` is kept in a remote, which takes it in setup mode only")]
    InRemote {
        /// The parameter.
        name: ShortName,
    },
    /// The value is not finite, or outside the limits of the parameter.
    #[error(
        "`{name}` cannot be set to {value}: it takes a finite number{}; it keeps its value",
        Limits(*.limits)
    )]
    BadValue {
        /// The parameter.
        name: ShortName,
        /// The value.
        value: AnyValue,
        /// Its limits, if it has any.
        limits: Option<(f64, f64)>,
    },
    /// The value cannot be a scale.
    #[error(
        "`{name}` cannot be set to {value}: it is a scale (counts or volts for each unit of the machine), which takes a number from 1e-100 to 1e100, or the same below 0; it keeps its value"
    )]
    BadScale {
        /// The parameter.
        name: ShortName,
        /// The value.
        value: AnyValue,
    },
    /// The group does not run, so its outputs cannot be armed.
    #[error("the group of `{pin}` does not run: its last transfer failed")]
    NotRunning {
        /// The first pin of the group.
        pin: ShortName,
    },
    /// The port of the group is switched off, so that its remotes do not run.
    #[error("the port of the group of `{pin}` is switched off")]
    PortOff {
        /// The first pin of the group.
        pin: ShortName,
    },
}

impl MesaError for PinError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::BadName { .. } => Some(advice::SHORTEN_NAME),
            Self::NameTaken { .. } => Some(advice::CHOOSE_OTHER_NAME),
            Self::TooMany => Some(advice::LEAVE_BOARDS_OUT),
            Self::NotFound { nearest: None, .. } => Some(advice::LIST_PINS),
            Self::WrongKind { .. } => Some(advice::USE_MATCHING_HANDLE),
            Self::NothingInverts { .. } => Some(advice::SET_OPPOSITE),
            Self::ForeignHandle => Some(advice::ASK_THIS_DRIVER),
            Self::InRemote { .. } => Some(advice::WRITE_REMOTE_PARAMETER),
            Self::NotRunning { .. } => Some(advice::REARM_LATER),
            Self::PortOff { .. } => Some(advice::SWITCH_PORT_ON),
            Self::NotFound { .. }
            | Self::WrongType { .. }
            | Self::NotSettable { .. }
            | Self::BadLimits { .. }
            | Self::ReadOnly { .. }
            | Self::BadValue { .. }
            | Self::BadScale { .. } => None,
        }
    }
}

/// Name of a pin or parameter, stored inline so that an error of the cycle allocates nothing.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct ShortName {
    length: usize,
    bytes: [u8; MAX_NAME],
}

impl ShortName {
    /// Copies a name; characters beyond [`MAX_NAME`] are left out.
    pub fn new(name: &str) -> Self {
        let mut bytes = [0; MAX_NAME];
        for (kept, byte) in bytes.iter_mut().zip(name.bytes()) {
            *kept = byte;
        }
        let length = name.len().min(MAX_NAME);
        Self { length, bytes }
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        let kept = self.bytes.get(..self.length).unwrap_or_default();
        match core::str::from_utf8(kept) {
            Ok(name) => name,
            // A multi-byte character was cut.
            Err(error) => {
                let whole = kept.get(..error.valid_up_to()).unwrap_or_default();
                core::str::from_utf8(whole).unwrap_or_default()
            }
        }
    }
}

impl core::fmt::Debug for ShortName {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        core::fmt::Debug::fmt(self.as_str(), f)
    }
}

impl core::fmt::Display for ShortName {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Limits of a number, as the end of a message.
struct Limits(Option<(f64, f64)>);

impl core::fmt::Display for Limits {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            Some((min, max)) => write!(f, " (its limits are {min} to {max})"),
            None => Ok(()),
        }
    }
}

/// Nearest existing name, as the end of a message about an unknown name.
struct Nearest<'a>(Option<&'a str>);

impl core::fmt::Display for Nearest<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            Some(nearest) => write!(f, "; the nearest is `{nearest}`"),
            None => Ok(()),
        }
    }
}
