//! Channels of a port, and sets of them.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use core::fmt;
use core::ops::{Index, IndexMut};

/// Largest number of channels of a port.
pub const MAX_CHANNELS: u8 = 8;

/// A channel of a port: 0 to 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(transparent))]
pub struct Channel(u8);

impl Channel {
    /// All channels that a port can have.
    pub const ALL: [Self; MAX_CHANNELS as usize] = [
        Self(0),
        Self(1),
        Self(2),
        Self(3),
        Self(4),
        Self(5),
        Self(6),
        Self(7),
    ];

    /// Channel `index`; `None` above 7.
    pub const fn new(index: u8) -> Option<Self> {
        if index < MAX_CHANNELS {
            Some(Self(index))
        } else {
            None
        }
    }

    /// Its number, 0 to 7.
    pub const fn index(self) -> u8 {
        self.0
    }

    /// The set of this channel alone.
    pub const fn mask(self) -> ChannelMask {
        ChannelMask(1 << self.0)
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// A set of channels: the low byte of COMMAND, and the answer in DATA.
///
/// Manual: 7I77, "COMMAND REGISTER" (the N bits).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ChannelMask(u8);

impl ChannelMask {
    /// No channel.
    pub const NONE: Self = Self(0);

    /// The set from the bits of a register: bit n is channel n.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }

    /// The channels `0..count`; all eight from 8 on.
    pub const fn first(count: u8) -> Self {
        if count >= MAX_CHANNELS {
            Self(0xFF)
        } else {
            Self(!(u8::MAX << count))
        }
    }

    /// The bits: bit n is channel n.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// True if the set contains no channel.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Number of channels in the set.
    pub const fn len(self) -> u32 {
        self.0.count_ones()
    }

    /// True if the set contains `channel`.
    pub const fn contains(self, channel: Channel) -> bool {
        self.0 & channel.mask().0 != 0
    }

    /// Channels in this set or in `other`.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Channels in this set and in `other`.
    #[must_use]
    pub const fn intersection(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Channels in this set and not in `other`.
    #[must_use]
    pub const fn difference(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The channels, lowest first.
    pub fn iter(self) -> impl Iterator<Item = Channel> {
        Channel::ALL
            .into_iter()
            .filter(move |&channel| self.contains(channel))
    }
}

impl fmt::Display for ChannelMask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return f.write_str("none");
        }
        for (n, channel) in self.iter().enumerate() {
            let separator = if n == 0 { "" } else { "," };
            write!(f, "{separator}{channel}")?;
        }
        Ok(())
    }
}

impl FromIterator<Channel> for ChannelMask {
    fn from_iter<I: IntoIterator<Item = Channel>>(channels: I) -> Self {
        channels
            .into_iter()
            .fold(Self::NONE, |mask, channel| mask.union(channel.mask()))
    }
}

/// One value for each channel of a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PerChannel<T>(pub [T; MAX_CHANNELS as usize]);

#[allow(clippy::indexing_slicing, reason = "the index is less than 8")]
impl<T> Index<Channel> for PerChannel<T> {
    type Output = T;

    fn index(&self, channel: Channel) -> &T {
        &self.0[usize::from(channel.0 % MAX_CHANNELS)]
    }
}

#[allow(clippy::indexing_slicing, reason = "the index is less than 8")]
impl<T> IndexMut<Channel> for PerChannel<T> {
    fn index_mut(&mut self, channel: Channel) -> &mut T {
        &mut self.0[usize::from(channel.0 % MAX_CHANNELS)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    #[test]
    fn mask_lists_its_channels() {
        let mask = ChannelMask::from_bits(0b1000_0101);
        assert_eq!(mask.to_string(), "0,2,7");
        assert_eq!(mask.iter().collect::<ChannelMask>(), mask);
        assert_eq!(ChannelMask::NONE.to_string(), "none");
    }

    #[test]
    fn first_channels_are_the_low_bits() {
        assert_eq!(ChannelMask::first(0), ChannelMask::NONE);
        assert_eq!(ChannelMask::first(3).bits(), 0x07);
        assert_eq!(ChannelMask::first(8).bits(), 0xFF);
        assert_eq!(ChannelMask::first(200).bits(), 0xFF);
    }

    #[test]
    fn there_is_no_ninth_channel() {
        assert_eq!(Channel::new(8), None);
        assert_eq!(Channel::new(7), Some(Channel::ALL[7]));
    }
}
