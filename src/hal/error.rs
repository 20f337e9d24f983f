//! What can go wrong with pins at set-up and when settings are changed.

use alloc::string::String;

/// Why a pin or parameter was not made, not found or not changed.
///
/// Nothing in the cycle returns it: there, a bad value becomes a safe one and is counted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
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
    /// The limits or the full scale of an output are not finite and in order, or its safe value is
    /// outside of them.
    #[error(
        "the limits of an output must be finite, in order, and have its safe value between them"
    )]
    BadLimits,
    /// The parameter can not be written.
    #[error("the parameter is read-only: it shows a value, and can not be set")]
    ReadOnly,
    /// The parameter is kept in a remote, which takes it in setup mode only.
    #[error(
        "the parameter is kept in a remote, which takes it in setup mode only: write it before with `Board::write_remote_parameter` while the board is configured, or at run time with `Driver::write_remote_parameter`, which stops its port"
    )]
    InRemote,
    /// The value is not finite, or outside what the parameter takes.
    #[error("the value is not finite, or outside the limits of the parameter (see its `PinInfo`)")]
    BadValue,
    /// The value can be no scale.
    #[error(
        "a scale is never 0, and its size is from 1e-100 to 1e100: set how many counts, or volts, make one unit of the machine (the parameter keeps its value)"
    )]
    BadScale,
    /// The group does not run, so its outputs can not be armed.
    #[error(
        "the group does not run (its last transfer failed): it can be armed when its inputs are valid again"
    )]
    NotRunning,
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
