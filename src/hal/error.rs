//! What can go wrong with pins at set-up and when settings are changed.

use super::HalType;

/// Why a pin or parameter was not made, not found or not changed.
///
/// Nothing in the cycle returns it: there, a bad value becomes a safe one and is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PinError {
    /// The name is longer than LinuxCNC takes.
    #[error(
        "a pin name of {length} characters: HAL takes {} (shorten the remote's own name for it)",
        super::MAX_NAME
    )]
    NameTooLong {
        /// Its length.
        length: usize,
    },
    /// The name is empty, or has characters that HAL files can not hold.
    #[error(
        "a pin name with a character that HAL files can not hold at position {position}; use letters, digits, '-', '_' and '.'"
    )]
    BadName {
        /// Where the first such character is; 0 for an empty name.
        position: usize,
    },
    /// There is a pin or parameter of that name.
    #[error(
        "the name is taken by pin or parameter number {existing} (are two boards numbered alike?)"
    )]
    NameTaken {
        /// Its place in the order of the list.
        existing: usize,
    },
    /// More pins than a store can number.
    #[error(
        "more than {} pins and parameters; leave boards or modules out",
        super::MAX_PINS
    )]
    TooMany,
    /// There is no pin or parameter of that name.
    #[error("no pin or parameter of that name (list them with `Pins::visit`)")]
    NotFound,
    /// There is one, of another type.
    #[error("it is of type {actual}, and {expected} was asked for; take the handle of that type")]
    WrongType {
        /// The type asked for.
        expected: HalType,
        /// The type it has.
        actual: HalType,
    },
    /// There is one, but it goes the other way, or is a parameter and no pin.
    #[error("it is {actual}, and {expected} was asked for")]
    WrongRole {
        /// What was asked for.
        expected: super::Role,
        /// What it is.
        actual: super::Role,
    },
    /// The handle is one of another store.
    #[error(
        "the handle belongs to another driver's pins, or to none; ask this driver for it by name"
    )]
    ForeignHandle,
    /// The safe value of an output is outside its limits, or limits are not numbers in order.
    #[error(
        "the limits of an output must be finite, in order, and have its safe value between them"
    )]
    BadLimits,
    /// The parameter can not be written.
    #[error("the parameter is read-only: it shows a value, and can not be set")]
    ReadOnly,
    /// The parameter is kept in a remote, which takes it in setup mode only.
    #[error(
        "the parameter is kept in a remote, which takes it in setup mode only: write it before with `Remotes::at` while the board is configured, or at run time with `Driver::write_remote_parameter`, which stops its port"
    )]
    InRemote,
    /// The value is no number, or outside what the parameter takes.
    #[error("the value is not finite, or outside the limits of the parameter (see its `PinInfo`)")]
    BadValue,
    /// The group does not run, so its outputs can not be armed.
    #[error(
        "the group does not run (its last transfer failed): it can be armed when its inputs are valid again"
    )]
    NotRunning,
}
