//! Results of START for each channel.

use super::{Channel, ComState, CsStatus, LocalFaults, RemoteFaults};
use crate::advice::{self, Advice, MesaError};
use core::fmt;
use thiserror::Error;

/// Number of bytes of process data that a remote and its channel exchange.
///
/// FACTS 1.2, 2.4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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

    /// True if neither direction is larger than in `limit`.
    pub const fn fit(self, limit: Self) -> bool {
        self.rx <= limit.rx && self.tx <= limit.tx
    }
}

/// The four characters of a remote's own name, for example `7I77`.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RemoteName(pub [u8; 4]);

impl RemoteName {
    /// The name from interface register 1 after START, which contains it least significant byte
    /// first.
    pub const fn from_register(word: u32) -> Self {
        Self(word.to_le_bytes())
    }

    /// Its characters, with `_` for those that cannot be printed.
    pub(super) fn characters(self) -> impl Iterator<Item = char> {
        self.0.into_iter().map(printable)
    }
}

fn printable(byte: u8) -> char {
    if byte.is_ascii_graphic() {
        char::from(byte)
    } else {
        '_'
    }
}

impl fmt::Display for RemoteName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.characters()
            .try_for_each(|c| fmt::Write::write_char(f, c))
    }
}

impl fmt::Debug for RemoteName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RemoteName({self})")
    }
}

/// Serialised as four characters, with `_` for characters that cannot be printed.
#[cfg(feature = "serde")]
impl serde::Serialize for RemoteName {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for RemoteName {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = <alloc::string::String as serde::Deserialize>::deserialize(deserializer)?;
        let name = text.as_bytes().try_into();
        let refuse = |_| serde::de::Error::custom("a remote's name has four ASCII characters");
        name.map(Self).map_err(refuse)
    }
}

/// Name and unit number of a remote: it is the same one if both are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RemoteIdentity {
    /// Its name.
    pub name: RemoteName,
    /// Its unit number. 0 if it is not known; for a part of a card of which only the kind is known,
    /// its top byte.
    pub unit_number: u32,
}

impl fmt::Display for RemoteIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, unit_number } = self;
        match (unit_number >> 24, unit_number & 0x00FF_FFFF) {
            (0, 0) => write!(f, "{name}"),
            (class, 0) => write!(f, "{name} (unit number {class:#04X}......)"),
            _ => write!(f, "{name} (unit number {unit_number:#010X})"),
        }
    }
}

/// A remote that START has identified.
///
/// Manual: 7I77, "INTERFACE AND CS REGISTER DATA AT START".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct StartedRemote {
    /// Its channel.
    pub channel: Channel,
    /// The software mode in which it was started.
    pub software_mode: u8,
    /// Its unit number: printed on the card's label, or set by the user. 0 if the remote did not
    /// report one (setup START tolerates that).
    pub unit_number: u32,
    /// Its name.
    pub name: RemoteName,
    /// Process table of contents; 0 if it does not support discovery.
    pub ptoc: u16,
    /// Global table of contents; 0 if it does not support discovery.
    pub gtoc: u16,
    /// Sizes of its process data.
    pub sizes: ProcessDataSizes,
    /// CS when START was complete.
    pub cs: CsStatus,
}

impl StartedRemote {
    /// Name of the card that predates discovery, which the gateware handles separately (FACTS 4.7).
    pub const NAME_7I64: RemoteName = RemoteName(*b"7I64");

    /// True if the remote reports its name and nothing else: either only its bootloader answers,
    /// because its program was cut off (FACTS 1.6), or it predates discovery and unit numbers.
    pub const fn is_bare(&self) -> bool {
        self.unit_number == 0 && self.ptoc == 0 && self.gtoc == 0
    }

    /// The remote on `channel`, started in this software mode, from the contents of interface
    /// registers 0 to 2.
    pub(crate) fn new(
        channel: Channel,
        software_mode: u8,
        interfaces: [u32; 3],
        sizes: ProcessDataSizes,
        cs: CsStatus,
    ) -> Self {
        let [unit_number, name, tables] = interfaces;
        Self {
            channel,
            software_mode,
            unit_number,
            name: RemoteName::from_register(name),
            ptoc: tables as u16,
            gtoc: (tables >> 16) as u16,
            sizes,
            cs,
        }
    }

    /// Its name and unit number.
    pub const fn identity(&self) -> RemoteIdentity {
        RemoteIdentity {
            name: self.name,
            unit_number: self.unit_number,
        }
    }

    /// True if the first byte of its replies is the fault byte, which CS byte 3 shows. The 7I64 has
    /// no fault byte: its first byte is data. Gateware transcript t26.
    pub fn has_fault_byte(&self) -> bool {
        self.name != Self::NAME_7I64
    }

    /// Bytes of input process data.
    pub fn input_bytes(&self) -> u8 {
        self.sizes.rx.saturating_sub(self.has_fault_byte().into())
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
            self.sizes.tx
        )
    }
}

/// A channel that START could not start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("channel {channel} did not start: {reason} (CS {:08X})", .cs.0)]
#[non_exhaustive]
pub struct StartFailure {
    /// The channel.
    pub channel: Channel,
    /// Reason of the failure.
    pub reason: StartFailureReason,
    /// CS after START.
    pub cs: CsStatus,
}

impl MesaError for StartFailure {
    fn advice(&self) -> Option<Advice> {
        self.reason.advice()
    }
}

/// Reason why START failed, as far as the registers indicate it.
///
/// FACTS 4.3 to 4.5, 5.6.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Error)]
#[non_exhaustive]
pub enum StartFailureReason {
    /// No reply at all.
    #[error("no reply")]
    NoReply,
    /// A remote answered at first, and then stopped.
    #[error("the remote answered at first and then stopped")]
    StoppedAnswering,
    /// The replies do not come from a remote.
    #[error("the reply is not from a smart-serial card (wrong cookie)")]
    WrongCookie,
    /// The receive line is low.
    #[error("the receive line is low")]
    LineLow,
    /// Too many replies with a wrong CRC.
    #[error("too many CRC errors")]
    BadCrc,
    /// Too many replies with more characters than expected.
    #[error("replies are too long")]
    ExtraCharacters,
    /// Only characters received while a request is sent.
    #[error("characters arrive while a request is sent")]
    Overrun,
    /// The remote's LBP status does not become clear.
    #[error("the remote keeps reporting LBP errors")]
    StatusStuck,
    /// The remote does not report its unit number (RPC BC).
    #[error("the remote does not report its unit number")]
    NoUnitNumber,
    /// The remote does not report its sizes (RPC BB).
    #[error("the remote does not report the sizes of its process data")]
    NoSizes,
    /// The remote does not have the software mode.
    #[error("the remote does not have software mode {0}")]
    IllegalMode(u8),
    /// A fault remains that could not be cleared.
    #[error("the remote's fault cannot be cleared: {0}")]
    FaultRemains(RemoteFaults),
    /// The remote has more process data than the interface registers can hold.
    #[error(
        "its process data (RX {}, TX {} bytes) is larger than the interface registers take (RX {}, \
         TX {})",
        sizes.rx, sizes.tx, limit.rx, limit.tx
    )]
    SizesTooLarge {
        /// Sizes that the remote requires.
        sizes: ProcessDataSizes,
        /// Largest sizes that fit.
        limit: ProcessDataSizes,
    },
    /// The remote is identified, but does not answer to process data.
    #[error("the remote is identified but does not answer to process data")]
    NoProcessData,
    /// The remote was started, but had too many errors before the first DOIT.
    #[error("the remote was started and then had too many errors")]
    DiedInChatter,
    /// START is complete, but this channel never became ready.
    #[error("START is complete but the channel is not ready")]
    NotReady,
    /// The registers match none of these reasons.
    #[error("the registers do not contain the reason")]
    Unknown,
}

impl MesaError for StartFailureReason {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            Self::NoReply => advice::CHECK_REMOTE_POWER,
            Self::StoppedAnswering | Self::DiedInChatter => advice::CHECK_CABLE_AND_POWER,
            Self::WrongCookie => advice::CHECK_BAUD_RATE,
            Self::LineLow => advice::CHECK_RX_WIRES,
            Self::BadCrc => advice::CHECK_SHIELD,
            Self::ExtraCharacters | Self::Overrun => advice::CHECK_NOISE,
            Self::StatusStuck => advice::POWER_CYCLE_THEN_CABLE,
            Self::NoUnitNumber | Self::NoSizes => advice::RESTART_OR_UPDATE_REMOTE,
            Self::IllegalMode(_) => advice::CHOOSE_MODE,
            Self::FaultRemains(faults)
                if faults
                    .intersects(RemoteFaults::LOW_VOLTAGE.union(RemoteFaults::HIGH_VOLTAGE)) =>
            {
                advice::CHECK_FIELD_POWER
            }
            Self::FaultRemains(_) => advice::CHECK_LOADS,
            Self::SizesTooLarge { .. } => advice::CHOOSE_MODE_OR_WIDE_FIRMWARE,
            Self::NoProcessData => advice::POWER_CYCLE,
            Self::NotReady | Self::Unknown => advice::RESTART_CHANNEL,
        })
    }
}

/// The reason for which START failed, as far as CS alone indicates it.
pub(crate) struct StartProblem(pub CsStatus);

impl fmt::Display for StartProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(cs) = *self;
        let found = StartedRemote::new(Channel::ALL[0], 0, [0; 3], ProcessDataSizes::default(), cs);
        match StartFailureReason::of(&found, ProcessDataSizes::default()) {
            StartFailureReason::Unknown => write!(f, "{cs}"),
            StartFailureReason::IllegalMode(_) => {
                write!(
                    f,
                    "the remote does not have the software mode (CS {:08X})",
                    cs.0
                )
            }
            reason => write!(f, "{reason} (CS {:08X})", cs.0),
        }
    }
}

impl StartFailureReason {
    /// The reason that the registers indicate; `found` contains what START had read up to the
    /// failure.
    pub(super) fn of(found: &StartedRemote, limit: ProcessDataSizes) -> Self {
        let StartedRemote { cs, sizes, .. } = *found;
        let (local, remote) = (cs.local_faults(), cs.remote_faults());
        let registers = (found.unit_number, found.name.0, found.ptoc, found.gtoc);
        let is_identified = registers != (0, [0; 4], 0, 0);
        match cs.state() {
            _ if local.contains(LocalFaults::SERIAL_BREAK) => Self::LineLow,
            ComState::CheckFaults => {
                if remote.contains(RemoteFaults::ILLEGAL_MODE) {
                    Self::IllegalMode(found.software_mode)
                } else {
                    Self::FaultRemains(remote)
                }
            }
            _ if !sizes.fit(limit) => Self::SizesTooLarge { sizes, limit },
            ComState::UnitNumber => Self::NoUnitNumber,
            ComState::Sizes => Self::NoSizes,
            ComState::ClearOutputs => Self::NoProcessData,
            ComState::Chatter => Self::DiedInChatter,
            ComState::PassThrough | ComState::ProcessData => Self::NotReady,
            // START restarted repeatedly until it had too many errors.
            _ if local.contains(LocalFaults::INVALID_COOKIE) => Self::WrongCookie,
            _ if local.contains(LocalFaults::CRC) => Self::BadCrc,
            _ if local.contains(LocalFaults::EXTRA_CHARACTER) => Self::ExtraCharacters,
            _ if local.contains(LocalFaults::REMOTE_FAULT) => Self::StatusStuck,
            // A timeout alone is no reason to give up (FACTS 11.8), so all other reasons are
            // checked before it.
            _ if local.contains(LocalFaults::TIMEOUT) => {
                if is_identified {
                    Self::StoppedAnswering
                } else {
                    Self::NoReply
                }
            }
            _ if local.contains(LocalFaults::OVERRUN) => Self::Overrun,
            _ => Self::Unknown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;
    use proptest::prelude::*;

    const LIMIT: ProcessDataSizes = ProcessDataSizes::largest(3);

    fn reason(cs: u32, registers: [u32; 3], rx: u8, tx: u8) -> StartFailureReason {
        let (sizes, cs) = (ProcessDataSizes { rx, tx }, CsStatus(cs));
        let found = StartedRemote::new(Channel::ALL[1], 5, registers, sizes, cs);
        StartFailureReason::of(&found, LIMIT)
    }

    /// FACTS 5.6: RX 13, TX 12 is the largest size that works.
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
        // An additional overrun does not hide the reason (FACTS 11.8).
        assert_eq!(reason(0x0001_E18C, none, 0, 0), R::NoReply);
        assert_eq!(reason(0x0001_E1C4, none, 0, 0), R::StatusStuck);
        assert_eq!(reason(0x0004_E1B4, none, 0, 0), R::LineLow);
        assert_eq!(reason(0x0001_E182, none, 0, 0), R::WrongCookie);
        assert_eq!(reason(0x0001_E1C0, none, 0, 0), R::StatusStuck);
        assert_eq!(reason(0x000D_E188, none, 0, 0), R::NoUnitNumber);
        assert_eq!(reason(0x001D_E188, [0x77AA, 1, 0], 0, 0), R::NoSizes);
        assert_eq!(
            reason(0x2024_A1C0, known, 5, 2),
            R::FaultRemains(RemoteFaults::LOW_VOLTAGE)
        );
        assert_eq!(reason(0x4024_A1C0, known, 5, 2), R::IllegalMode(5));
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
    fn start_failure_is_shown_with_reason_and_advice() {
        let failure = StartFailure {
            channel: Channel::ALL[1],
            reason: StartFailureReason::IllegalMode(5),
            cs: CsStatus(0x4024_A1C0),
        };
        assert_eq!(
            failure.to_string(),
            "channel 1 did not start: the remote does not have software mode 5 (CS 4024A1C0)"
        );
        assert_eq!(failure.advice(), Some(advice::CHOOSE_MODE));
    }

    /// Silence in the middle of START is an old firmware, or a cable that broke just then.
    #[test]
    fn advice_fits_each_cause_of_a_failure() {
        use StartFailureReason as R;
        for reason in [R::NoUnitNumber, R::NoSizes] {
            assert_eq!(reason.advice(), Some(advice::RESTART_OR_UPDATE_REMOTE));
        }
        let of = |faults| R::FaultRemains(faults).advice();
        assert_eq!(
            of(RemoteFaults::LOW_VOLTAGE),
            Some(advice::CHECK_FIELD_POWER)
        );
        assert_eq!(
            of(RemoteFaults::HIGH_VOLTAGE),
            Some(advice::CHECK_FIELD_POWER)
        );
        assert_eq!(of(RemoteFaults::OVER_CURRENT), Some(advice::CHECK_LOADS));
    }

    proptest! {
        #[test]
        fn any_registers_have_a_reason(cs: u32, interface: [u32; 3], rx: u8, tx: u8) {
            prop_assert!(!reason(cs, interface, rx, tx).to_string().is_empty());
        }
    }
}
