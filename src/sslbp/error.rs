//! What can go wrong with a port, and what to do then.

use super::{
    Channel, ChannelMask, Command, CsStatus, DataStatus, LocalAddress, MAX_CHANNELS, RemoteAccess,
};
use crate::bus::BusError;
use core::{fmt, time::Duration};
use thiserror::Error;

/// Why an operation on a port failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PortError<E: BusError> {
    /// The bus could not reach the registers.
    #[error(transparent)]
    Bus(#[from] E),
    /// A bounded wait came to its end.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// Local parameter 0.
    #[error(
        "SSLBP port {port}: the interface type is {found:#04X}, expected 0x12 (SSLBP): this \
         firmware has another serial protocol on that port"
    )]
    InterfaceType {
        /// The port.
        port: u8,
        /// What it is.
        found: u8,
    },
    /// Local parameter 1.
    #[error(
        "SSLBP port {port}: the data port is {found} bits wide, expected 8: this firmware is not \
         known"
    )]
    InterfaceWidth {
        /// The port.
        port: u8,
        /// What it is.
        found: u8,
    },
    /// Local parameters 2 and 3.
    #[error(
        "SSLBP port {port}: the firmware is SSLBP {major}.{minor}, supported is 1.{oldest} and \
         newer 1.x: flash a newer firmware"
    )]
    Version {
        /// The port.
        port: u8,
        /// Major revision.
        major: u8,
        /// Minor revision.
        minor: u8,
        /// The oldest minor revision that is supported.
        oldest: u8,
    },
    /// Local parameter 6.
    #[error(
        "SSLBP port {port}: the interface processor is {found:#04X}, expected 0xD8 (Dumb8): this \
         firmware is not known"
    )]
    Processor {
        /// The port.
        port: u8,
        /// What it is.
        found: u8,
    },
    /// Local parameters 4 and 5.
    #[error(
        "SSLBP port {port}: the channel variables start at {start:#04X} with stride {stride:#04X}, \
         which does not hold what version 1.43 keeps there: this firmware is not known"
    )]
    ChannelVariables {
        /// The port.
        port: u8,
        /// Local parameter 4.
        start: u8,
        /// Local parameter 5.
        stride: u8,
    },
    /// The firmware and its own pin descriptors disagree.
    #[error(
        "SSLBP port {port} has {gateware} channels according to its local parameter 7, but \
         {pins} according to the pin descriptors: the firmware image is inconsistent, use another"
    )]
    ChannelCount {
        /// The port.
        port: u8,
        /// Highest channel in the pin descriptors.
        pins: u8,
        /// Local parameter 7.
        gateware: u8,
    },
    /// The port does not have these channels.
    #[error(
        "SSLBP port {port} has only {channels} channels; it has no channel {missing}; leave it out"
    )]
    NoSuchChannel {
        /// The port.
        port: u8,
        /// Those that were asked for and do not exist.
        missing: ChannelMask,
        /// Number of channels.
        channels: u8,
    },
    /// The operation needs another state of the port.
    #[error(
        "SSLBP port {port}: {needed} needed, but the port is {state} (channels that run: \
         {running})"
    )]
    WrongState {
        /// The port.
        port: u8,
        /// What the operation needs, and how to get there.
        needed: Needed,
        /// What the port is in.
        state: PortState,
        /// The channels that run.
        running: ChannelMask,
    },
    /// The port has not been initialised, so its parameters are not known.
    #[error("SSLBP port {port} has not been initialised: call reset or identify first")]
    NotIdentified {
        /// The port.
        port: u8,
    },
    /// A stop was acknowledged, but a channel still shows something else.
    #[error("SSLBP port {port}, channel {channel}: still {cs} after a stop; reset the port")]
    NotStopped {
        /// The port.
        port: u8,
        /// The channel.
        channel: Channel,
        /// Its status.
        cs: CsStatus,
    },
    /// A byte of the port's memory did not keep what was written.
    #[error(
        "SSLBP port {port}: local address {address} reads {read:#04X} after {written:#04X} was \
         written; reset the port"
    )]
    LocalWrite {
        /// The port.
        port: u8,
        /// Where.
        address: LocalAddress,
        /// What was written.
        written: u8,
        /// What is there.
        read: u8,
    },
    /// The remote did not answer, or not as it should, however often it was asked.
    #[error(
        "SSLBP port {port}: channel {channel}, {access}: no good reply in {attempts} attempts \
         ({cs}): check the cable; if only this address fails, the remote does not have it"
    )]
    AccessFailed {
        /// The port.
        port: u8,
        /// The channel.
        channel: Channel,
        /// What was asked for.
        access: RemoteAccess,
        /// How often.
        attempts: u8,
        /// CS after the last one.
        cs: CsStatus,
    },
    /// What was written to non-volatile memory does not read back.
    #[error(
        "SSLBP port {port}: channel {channel}: non-volatile memory at {address:#06X} reads \
         {read:#X} after {written:#X} was written: it may be write-protected (see the card's \
         jumpers) or worn out"
    )]
    NotKept {
        /// The port.
        port: u8,
        /// The channel.
        channel: Channel,
        /// Where.
        address: u16,
        /// What was written.
        written: u64,
        /// What was last read.
        read: u64,
    },
    /// Access to non-volatile memory could not be switched off again.
    #[error(
        "SSLBP port {port}: channel {channel}: access to non-volatile memory could not be switched \
         off ({cs}): power the remote off and on before anything else is written to it"
    )]
    LeftNonvolatile {
        /// The port.
        port: u8,
        /// The channel.
        channel: Channel,
        /// CS after the last attempt.
        cs: CsStatus,
    },
}

/// What an operation needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Needed {
    /// Stopped channels.
    Stopped,
    /// Setup mode.
    Setup,
    /// Normal mode.
    Normal,
    /// The channel to be started.
    Started(ChannelMask),
}

impl fmt::Display for Needed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stopped => f.write_str("stopped channels (call stop_all first)"),
            Self::Setup => f.write_str("setup mode (call stop_all and a setup START first)"),
            Self::Normal => f.write_str("normal mode (call stop_all and a normal START first)"),
            Self::Started(mask) => write!(f, "a START that succeeded of channels {mask}"),
        }
    }
}

/// What the channels of a port that run are in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PortState {
    /// Not known: as another program left it.
    #[default]
    Unknown,
    /// All channels are stopped.
    Stopped,
    /// Started for pass-through accesses.
    Setup,
    /// Started for process data.
    Normal,
}

impl fmt::Display for PortState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unknown => "in an unknown state",
            Self::Stopped => "stopped",
            Self::Setup => "in setup mode",
            Self::Normal => "in normal mode",
        })
    }
}

/// What is waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum WaitingFor {
    /// COMMAND to be 0, so that this command can be written.
    Idle(Command),
    /// This command to complete.
    Completion(Command),
    /// A port that is stuck to be freed by 08FF.
    Freed,
    /// The processor to finish its initialisation after a reset.
    Initialisation,
}

impl fmt::Display for WaitingFor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Idle(command) => write!(f, "COMMAND to be 0 before {command}"),
            Self::Completion(command) => write!(f, "COMMAND to be 0 after {command}"),
            Self::Freed => f.write_str("COMMAND to be 0 after the way out (08FF)"),
            Self::Initialisation => f.write_str("the processor to initialise after a reset"),
        }
    }
}

/// A wait that came to its end, and the registers at that time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WaitError {
    /// The port.
    pub port: u8,
    /// What was waited for.
    pub waiting_for: WaitingFor,
    /// How long.
    pub waited: Duration,
    /// The registers at the end.
    pub registers: Registers,
}

impl fmt::Display for WaitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "SSLBP port {}: waited {:?} for {}; {}: {}",
            self.port,
            self.waited,
            self.waiting_for,
            self.registers,
            self.hint()
        )
    }
}

impl core::error::Error for WaitError {}

impl WaitError {
    /// What a person should do next.
    const fn hint(&self) -> &'static str {
        match (self.waiting_for, self.registers.command) {
            (_, 0xFFFF_FFFF) => "all ones: there is no board at this address",
            (WaitingFor::Freed | WaitingFor::Initialisation, _) => {
                "the interface processor does not run; reset the port, or reload the FPGA"
            }
            _ => "call stop_all, which knows the way out; if that fails, reset the port",
        }
    }
}

/// COMMAND, DATA and all CS as they were at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Registers {
    /// COMMAND.
    pub command: u32,
    /// DATA.
    pub data: DataStatus,
    /// CS of each channel.
    pub cs: [CsStatus; MAX_CHANNELS as usize],
    /// How many of them exist.
    pub channels: u8,
}

impl fmt::Display for Registers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (command, data) = (self.command, self.data.byte());
        write!(f, "COMMAND {command:04X}, DATA {data:02X}, CS")?;
        self.cs
            .iter()
            .take(usize::from(self.channels))
            .try_for_each(|cs| write!(f, " {:08X}", cs.word()))
    }
}
