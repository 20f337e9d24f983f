//! Commands in the queue, as words.

use crate::hal::{AnyValue, GroupId, HalType, PinId};
use crate::hostmot2::RemoteId;

/// Words of a command.
pub(super) const WORDS: usize = 4;

/// Commands to the cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum QueuedCommand {
    /// The pin, its value, and the fault count of its group when the command was sent.
    Set(PinId, AnyValue, u64),
    /// The epoch when the command was sent.
    Rearm(u64),
    RearmGroup(GroupId, u64),
    RearmWhenRunning(u64),
    RearmGroupWhenRunning(GroupId, u64),
    Restart(RemoteId),
}

const TYPES: [HalType; 6] = [
    HalType::Bit,
    HalType::Float,
    HalType::S32,
    HalType::U32,
    HalType::S64,
    HalType::U64,
];

impl QueuedCommand {
    /// The epoch when the command was sent, if it counts.
    pub const fn epoch(self) -> Option<u64> {
        match self {
            Self::Rearm(epoch)
            | Self::RearmGroup(_, epoch)
            | Self::RearmWhenRunning(epoch)
            | Self::RearmGroupWhenRunning(_, epoch) => Some(epoch),
            Self::Set(..) | Self::Restart(_) => None,
        }
    }

    pub fn to_words(self) -> [u64; WORDS] {
        match self {
            Self::Rearm(epoch) => [0, 0, epoch, 0],
            Self::RearmGroup(group, epoch) => [1, group.to_word(), epoch, 0],
            Self::Restart(RemoteId { port, channel }) => [2, port.into(), channel.into(), 0],
            Self::RearmWhenRunning(epoch) => [3, 0, epoch, 0],
            Self::RearmGroupWhenRunning(group, epoch) => [4, group.to_word(), epoch, 0],
            Self::Set(pin, value, faults) => {
                let number = TYPES.iter().position(|&other| other == value.hal_type);
                debug_assert!(number.is_some(), "a type without a number");
                let number = number.unwrap_or_default() as u64;
                [number.wrapping_add(5), pin.to_word(), value.bits, faults]
            }
        }
    }

    pub fn from_words([kind, one, other, faults]: [u64; WORDS]) -> Self {
        match kind {
            0 => Self::Rearm(other),
            1 => Self::RearmGroup(GroupId::from_word(one), other),
            2 => Self::Restart(RemoteId::new(one as u8, other as u8)),
            3 => Self::RearmWhenRunning(other),
            4 => Self::RearmGroupWhenRunning(GroupId::from_word(one), other),
            _ => {
                let hal_type = TYPES.get(kind.wrapping_sub(5) as usize);
                let value = AnyValue {
                    hal_type: hal_type.copied().unwrap_or(HalType::Bit),
                    bits: other,
                };
                Self::Set(PinId::from_word(one), value, faults)
            }
        }
    }
}
