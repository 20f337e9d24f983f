//! What can go wrong with pins at set-up and when settings are changed.

use alloc::string::String;

use super::{AnyValue, MAX_NAME};

/// Why a pin or parameter was not made, not found or not changed.
///
/// Nothing in the cycle returns it: there, a bad value becomes a safe one and is counted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PinError {
    /// The name is empty, longer than LinuxCNC takes, or has characters that HAL files can not hold.
    #[error(
        "`{name}` is not a pin name: HAL takes 1 to {} letters, digits, '-', '_' and '.' (shorten the remote's own name for it)",
        super::MAX_NAME
    )]
    BadName {
        /// The name.
        name: String,
    },
    /// There is a pin or parameter of that name.
    #[error("there are two pins or parameters `{name}` (are two boards numbered alike?)")]
    NameTaken {
        /// The name.
        name: String,
    },
    /// More pins than a store can number.
    #[error(
        "more than {} pins and parameters; leave boards or modules out",
        super::MAX_PINS
    )]
    TooMany,
    /// There is no pin or parameter of that name.
    #[error("no pin or parameter `{name}`{}", Hint(.nearest.as_deref()))]
    NotFound {
        /// The name.
        name: String,
        /// The one that it may be meant for.
        nearest: Option<String>,
    },
    /// There is one, but of another type or role.
    #[error("`{name}` is {actual}, and {expected} was asked for; take the handle of that kind")]
    WrongKind {
        /// The name.
        name: String,
        /// What was asked for.
        expected: &'static str,
        /// What it is.
        actual: &'static str,
    },
    /// The value has another type than the pin.
    #[error("it takes a value of type {expected}, and this one is {actual}")]
    WrongType {
        /// The pin's type.
        expected: &'static str,
        /// The value's.
        actual: &'static str,
    },
    /// The pin is one that the machine sets.
    #[error("it is an input: the machine sets it, and the application reads it")]
    NotSettable,
    /// Nothing inverts the output.
    #[error("nothing inverts this output: set the opposite instead")]
    NothingInverts,
    /// The handle is one of another store.
    #[error(
        "the handle belongs to another driver's pins, or to none; ask this driver for it by name"
    )]
    ForeignHandle,
    /// The limits or the full scale of a pin or parameter are not finite and in order, or its first
    /// value is outside of them.
    #[error(
        "`{name}` can not begin at {initial}: its limits and its full scale must be finite, the limits in order, and what it begins with between them{}",
        Limits(*.limits)
    )]
    BadLimits {
        /// Its name.
        name: ShortName,
        /// What it was to begin with, which is the safe value of an output.
        initial: AnyValue,
        /// Its limits, if it has any.
        limits: Option<(f64, f64)>,
    },
    /// The parameter can not be written.
    #[error("the parameter is read-only: it shows a value, and can not be set")]
    ReadOnly,
    /// The parameter is kept in a remote, which takes it in setup mode only.
    #[error(
        "the parameter is kept in a remote, which takes it in setup mode only: write it before with `Board::write_remote_parameter` while the board is configured, or at run time with `Driver::write_remote_parameter`, which stops its port"
    )]
    InRemote,
    /// The value is not finite, or outside what the parameter takes.
    #[error(
        "`{name}` can not be set to {value}: it takes a finite number{}; it keeps its value",
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
    /// The value can be no scale.
    #[error(
        "`{name}` can not be set to {value}: it is a scale (how many counts, or volts, make one unit of the machine), which takes a number from 1e-100 to 1e100, or the same below 0; it keeps its value"
    )]
    BadScale {
        /// The parameter.
        name: ShortName,
        /// The value.
        value: AnyValue,
    },
    /// The group does not run, so its outputs can not be armed.
    #[error(
        "the group does not run (its last transfer failed): it can be armed when its inputs are valid again"
    )]
    NotRunning,
}

/// The name of a pin or parameter, kept in place: an error of the cycle allocates nothing.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct ShortName {
    length: usize,
    bytes: [u8; MAX_NAME],
}

impl ShortName {
    /// A name; what is beyond [`MAX_NAME`] characters is left out.
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
            // A character of several bytes was cut.
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

/// The end of a message about a number.
struct Limits(Option<(f64, f64)>);

impl core::fmt::Display for Limits {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            Some((min, max)) => write!(f, " (its limits are {min} to {max})"),
            None => Ok(()),
        }
    }
}

/// The end of a message about a name that does not exist.
struct Hint<'a>(Option<&'a str>);

impl core::fmt::Display for Hint<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            Some(nearest) => write!(f, "; the nearest is `{nearest}`"),
            None => f.write_str(" (list them with `Pins::infos`)"),
        }
    }
}
