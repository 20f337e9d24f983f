//! What START found out about each channel.

use super::{Channel, ChannelMask, ComState, CsStatus, LocalFaults, MAX_CHANNELS, RemoteFaults};
use crate::discovery::RemoteName;
use core::fmt;

/// How many bytes of process data a remote and its channel exchange.
///
/// FACTS 1.2, 2.4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ProcessDataSizes {
    /// RXSize: bytes of a reply without its CRC, the fault byte included.
    pub rx: u8,
    /// TXSize: data bytes of a request.
    pub tx: u8,
}

impl ProcessDataSizes {
    /// The largest sizes that work with `interface_registers` interface registers (FACTS 5.6).
    pub const fn largest(interface_registers: u8) -> Self {
        let bytes = interface_registers.saturating_mul(4);
        Self {
            rx: bytes.saturating_add(1),
            tx: bytes,
        }
    }

    /// Whether neither direction is larger than in `limit`.
    pub const fn fit(self, limit: Self) -> bool {
        self.rx <= limit.rx && self.tx <= limit.tx
    }
}

/// What the first byte of a reply is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ReplyFormat {
    /// The fault byte; CS byte 3 shows it.
    #[default]
    FaultByteFirst,
    /// Data: the 7I64 has no fault byte. Gateware transcript t26.
    DataOnly,
}

/// A remote that START has identified.
///
/// Manual: 7I77, "INTERFACE AND CS REGISTER DATA AT START".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StartedRemote {
    /// The channel it is on.
    pub channel: Channel,
    /// The software mode it was started in.
    pub software_mode: u8,
    /// Its unit number: printed on the card's label, or set by its owner. 0 if it did not say
    /// (setup START tolerates that).
    pub unit_number: u32,
    /// Its name.
    pub name: RemoteName,
    /// Process table of contents; 0 if it does not support discovery.
    pub ptoc: u16,
    /// Global table of contents; 0 if it does not support discovery.
    pub gtoc: u16,
    /// Its process data.
    pub sizes: ProcessDataSizes,
    /// CS when START was complete.
    pub cs: CsStatus,
}

impl StartedRemote {
    /// The card that predates discovery, and has a path of its own in the gateware (FACTS 4.7).
    pub const NAME_7I64: RemoteName = RemoteName(*b"7I64");

    /// Where its process data begins in a reply.
    pub fn reply_format(&self) -> ReplyFormat {
        if self.name == Self::NAME_7I64 {
            ReplyFormat::DataOnly
        } else {
            ReplyFormat::FaultByteFirst
        }
    }

    /// Bytes of input process data.
    pub fn input_bytes(&self) -> u8 {
        match self.reply_format() {
            ReplyFormat::FaultByteFirst => self.sizes.rx.saturating_sub(1),
            ReplyFormat::DataOnly => self.sizes.rx,
        }
    }

    /// Bytes of output process data.
    pub const fn output_bytes(&self) -> u8 {
        self.sizes.tx
    }
}

impl fmt::Display for StartedRemote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "channel {}: {}, unit number {:#010X}, software mode {}, {} bytes in, {} bytes out",
            self.channel,
            self.name,
            self.unit_number,
            self.software_mode,
            self.input_bytes(),
            self.output_bytes()
        )
    }
}

/// A channel that START could not start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StartFailure {
    /// The channel.
    pub channel: Channel,
    /// The software mode that was asked for.
    pub software_mode: u8,
    /// Why.
    pub reason: StartFailureReason,
    /// CS after START.
    pub cs: CsStatus,
}

impl fmt::Display for StartFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (channel, word) = (self.channel, self.cs.word());
        write!(
            f,
            "channel {channel} did not start: {} (CS {word:08X})",
            self.reason
        )?;
        if self.reason == StartFailureReason::IllegalMode {
            write!(f, "; the mode asked for was {}", self.software_mode)?;
        }
        Ok(())
    }
}

impl core::error::Error for StartFailure {}

/// Why START failed, as far as the registers tell.
///
/// FACTS 4.3 to 4.5, 5.6.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum StartFailureReason {
    /// Nothing answers.
    NoReply,
    /// Something answered at first, and then no more.
    StoppedAnswering,
    /// Something answers, but it is not a remote.
    WrongCookie,
    /// The receive line is low.
    LineLow,
    /// Too many replies with a wrong CRC.
    BadCrc,
    /// Too many replies with more characters than they should have.
    ExtraCharacters,
    /// Too many characters that came faster than they were read.
    Overrun,
    /// The remote's LBP status does not become clear.
    StatusStuck,
    /// The remote does not tell its unit number (RPC BC).
    NoUnitNumber,
    /// The remote does not tell its sizes (RPC BB).
    NoSizes,
    /// The remote does not know the software mode.
    IllegalMode,
    /// A fault that could not be cleared.
    FaultRemains(RemoteFaults),
    /// More process data than the interface registers hold.
    SizesTooLarge {
        /// What the remote asks for.
        sizes: ProcessDataSizes,
        /// What there is room for.
        limit: ProcessDataSizes,
    },
    /// The remote is identified, but does not answer to process data.
    NoProcessData,
    /// The remote was started, and then had too many errors before the first DOIT.
    DiedInChatter,
    /// START is complete, but this channel never became ready.
    NotReady,
    /// Nothing of all this.
    Unknown,
}

impl fmt::Display for StartFailureReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NoReply => {
                "no reply; check that a remote is connected to this channel and has power (field \
                 power too, where it is powered from there)"
            }
            Self::StoppedAnswering => {
                "the remote answered at first and then stopped; check its cable and its power"
            }
            Self::WrongCookie => {
                "what answers is not a remote (wrong cookie); check the baud rate and what is \
                 connected"
            }
            Self::LineLow => {
                "the receive line is low; check for swapped or shorted RX wires, or a remote \
                 without power"
            }
            Self::BadCrc => "too many CRC errors; check cable, shield and ground",
            Self::ExtraCharacters => {
                "replies are too long; check for noise, and for two remotes on one line"
            }
            Self::Overrun => "characters come too fast; check the baud rate",
            Self::StatusStuck => {
                "the remote keeps reporting LBP errors; power it off and on, then check the cable"
            }
            Self::NoUnitNumber => {
                "the remote does not tell its unit number; its firmware may be damaged or too old"
            }
            Self::NoSizes => {
                "the remote does not tell its process data sizes; its firmware may be too old"
            }
            Self::IllegalMode => "the remote does not have this software mode; choose another",
            Self::FaultRemains(faults) => {
                return write!(f, "the remote's fault can not be cleared: {faults}");
            }
            Self::SizesTooLarge { sizes, limit } => {
                return write!(
                    f,
                    "its process data (RX {}, TX {} bytes) is larger than the interface registers \
                     take (RX {}, TX {}); choose another software mode, or a firmware with wide \
                     SSLBP",
                    sizes.rx, sizes.tx, limit.rx, limit.tx
                );
            }
            Self::NoProcessData => {
                "the remote is identified but does not answer to process data; power it off and on"
            }
            Self::DiedInChatter => {
                "the remote was started and then had too many errors; check cable and power"
            }
            Self::NotReady => "START is complete but the channel is not ready; stop and start it",
            Self::Unknown => "the registers do not say why; stop and start it again",
        })
    }
}

/// What the registers of a failed channel are told apart by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FailedRegisters {
    /// CS.
    pub cs: CsStatus,
    /// Interface registers 0 to 2.
    pub interface: [u32; 3],
    /// RXSize and TXSize as the channel has them.
    pub sizes: ProcessDataSizes,
    /// The largest that the registers take.
    pub limit: ProcessDataSizes,
}

impl StartFailureReason {
    /// The reason that the registers give.
    pub fn from_registers(registers: &FailedRegisters) -> Self {
        let FailedRegisters {
            cs,
            interface,
            sizes,
            limit,
        } = *registers;
        let (local, remote) = (cs.local_faults(), cs.remote_faults());
        if local.contains(LocalFaults::SERIAL_BREAK) {
            return Self::LineLow;
        }
        match cs.state() {
            ComState::CheckFaults | ComState::FaultsTried
                if remote.contains(RemoteFaults::ILLEGAL_MODE) =>
            {
                Self::IllegalMode
            }
            ComState::CheckFaults | ComState::FaultsTried => Self::FaultRemains(remote),
            _ if !sizes.fit(limit) => Self::SizesTooLarge { sizes, limit },
            ComState::UnitNumber => Self::NoUnitNumber,
            ComState::Sizes => Self::NoSizes,
            ComState::ClearOutputs => Self::NoProcessData,
            ComState::Chatter => Self::DiedInChatter,
            ComState::PassThrough | ComState::ProcessData => Self::NotReady,
            _ => Self::from_faults(local, interface != [0; 3]),
        }
    }

    /// The reason of a channel that went back to the start until it had too many errors.
    fn from_faults(local: LocalFaults, identified: bool) -> Self {
        if local.contains(LocalFaults::INVALID_COOKIE) {
            Self::WrongCookie
        } else if local.contains(LocalFaults::CRC) {
            Self::BadCrc
        } else if local.contains(LocalFaults::EXTRA_CHARACTER) {
            Self::ExtraCharacters
        } else if local.contains(LocalFaults::OVERRUN) {
            Self::Overrun
        } else if local.contains(LocalFaults::REMOTE_FAULT) {
            Self::StatusStuck
        } else if local.contains(LocalFaults::TIMEOUT) {
            if identified {
                Self::StoppedAnswering
            } else {
                Self::NoReply
            }
        } else {
            Self::Unknown
        }
    }
}

/// What START did on each channel that was asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StartReport {
    outcomes: [Option<Result<StartedRemote, StartFailure>>; MAX_CHANNELS as usize],
}

impl StartReport {
    /// The outcome of a channel; `None` if it was not asked for.
    pub fn outcome(&self, channel: Channel) -> Option<Result<StartedRemote, StartFailure>> {
        *self.outcomes.get(usize::from(channel.index()))?
    }

    /// The remotes that run now.
    pub fn remotes(&self) -> impl Iterator<Item = &StartedRemote> {
        self.outcomes
            .iter()
            .flatten()
            .filter_map(|o| o.as_ref().ok())
    }

    /// The channels that did not start.
    pub fn failures(&self) -> impl Iterator<Item = &StartFailure> {
        self.outcomes
            .iter()
            .flatten()
            .filter_map(|o| o.as_ref().err())
    }

    /// The channels that run now.
    pub fn started(&self) -> ChannelMask {
        self.remotes().map(|remote| remote.channel).collect()
    }

    /// The channels that did not start.
    pub fn failed(&self) -> ChannelMask {
        self.failures().map(|failure| failure.channel).collect()
    }

    pub(super) fn set(&mut self, channel: Channel, outcome: Result<StartedRemote, StartFailure>) {
        if let Some(slot) = self.outcomes.get_mut(usize::from(channel.index())) {
            *slot = Some(outcome);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;
    use proptest::prelude::*;

    const LIMIT: ProcessDataSizes = ProcessDataSizes::largest(3);

    fn reason(cs: u32, interface: [u32; 3], rx: u8, tx: u8) -> StartFailureReason {
        StartFailureReason::from_registers(&FailedRegisters {
            cs: CsStatus::from_register(cs),
            interface,
            sizes: ProcessDataSizes { rx, tx },
            limit: LIMIT,
        })
    }

    /// FACTS 5.6: RX 13, TX 12 is the most that works.
    #[test]
    fn thirteen_and_twelve_bytes_are_the_most_for_three_registers() {
        assert_eq!(LIMIT, ProcessDataSizes { rx: 13, tx: 12 });
        assert_eq!(
            ProcessDataSizes::largest(7),
            ProcessDataSizes { rx: 29, tx: 28 }
        );
    }

    /// FACTS 4.3 to 4.5, 5.6; gateware transcripts t04, t04c, t15f, t16, t06d, t20.
    #[test]
    fn recorded_failures_get_their_reason() {
        use StartFailureReason as R;
        let none = [0; 3];
        let known = [0x77AA, 0x3737_4937, 0x04A4_049A];
        assert_eq!(reason(0x0001_E188, none, 0, 0), R::NoReply);
        assert_eq!(reason(0x0002_E188, none, 0, 0), R::NoReply);
        assert_eq!(reason(0x0001_E188, known, 5, 2), R::StoppedAnswering);
        assert_eq!(reason(0x0001_E182, none, 0, 0), R::WrongCookie);
        assert_eq!(reason(0x0001_E1C0, none, 0, 0), R::StatusStuck);
        assert_eq!(reason(0x000D_E188, none, 0, 0), R::NoUnitNumber);
        assert_eq!(reason(0x001D_E188, [0x77AA, 1, 0], 0, 0), R::NoSizes);
        assert_eq!(
            reason(0x2024_A1C0, known, 5, 2),
            R::FaultRemains(RemoteFaults::LOW_VOLTAGE)
        );
        assert_eq!(reason(0x4024_A1C0, known, 5, 2), R::IllegalMode);
        assert_eq!(reason(0x0004_E1B0, none, 0, 0), R::LineLow);
        assert_eq!(
            reason(0x001E_A188, known, 16, 2),
            R::SizesTooLarge {
                sizes: ProcessDataSizes { rx: 16, tx: 2 },
                limit: LIMIT
            }
        );
        assert_eq!(reason(0x001E_A188, known, 5, 2), R::NoProcessData);
        assert_eq!(reason(0x003B_2088, known, 5, 2), R::DiedInChatter);
    }

    #[test]
    fn a_failure_says_what_to_do() {
        let failure = StartFailure {
            channel: Channel::ALL[1],
            software_mode: 5,
            reason: StartFailureReason::IllegalMode,
            cs: CsStatus::from_register(0x4024_A1C0),
        };
        assert_eq!(
            failure.to_string(),
            "channel 1 did not start: the remote does not have this software mode; choose another \
             (CS 4024A1C0); the mode asked for was 5"
        );
    }

    proptest! {
        #[test]
        fn any_registers_have_a_reason(cs: u32, interface: [u32; 3], rx: u8, tx: u8) {
            prop_assert!(!reason(cs, interface, rx, tx).to_string().is_empty());
        }
    }
}
