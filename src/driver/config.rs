//! What a machine is told about its remotes before it is built.

use core::str::FromStr;

use crate::boards::RemoteTable;
use crate::discovery::RemoteName;
use crate::sslbp::{Channel, MAX_CHANNELS};

/// What is expected of the remote on a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RemoteConfig {
    /// The software mode it is started in.
    pub mode: u8,
    /// Whether the machine can do without it. If it is required, building the driver fails
    /// without it; if not, the rest runs and it is reported as missing.
    pub required: bool,
    /// The name it must have.
    pub name: Option<RemoteName>,
    /// The top byte that its unit number must have: it tells the parts of a card apart that share a
    /// name, as a 7I77's field I/O (0x12) and analog part (0x11) do.
    pub unit_class: Option<u8>,
    /// The unit number it must have: printed on the card's label.
    pub unit_number: Option<u32>,
    /// It may be plugged in later: what it is then.
    pub optional: Option<&'static RemoteTable>,
}

impl RemoteConfig {
    /// Any remote, in this software mode; the machine can do without it.
    pub const fn in_mode(mode: u8) -> Self {
        Self {
            mode,
            required: false,
            name: None,
            unit_class: None,
            unit_number: None,
            optional: None,
        }
    }

    /// The machine can not do without it.
    #[must_use]
    pub const fn required(mut self) -> Self {
        self.required = true;
        self
    }

    /// It must have this name, for example `*b"7I77"`.
    #[must_use]
    pub const fn named(mut self, name: [u8; 4]) -> Self {
        self.name = Some(RemoteName(name));
        self
    }

    /// It must be the remote of this table: name and part of the card. Swapped channels are then an
    /// error that says so.
    ///
    /// ```
    /// use mesa_hal::boards::i7i77;
    /// use mesa_hal::driver::{RemoteConfig, SerialConfig};
    ///
    /// let port = SerialConfig::NONE
    ///     .with(0, RemoteConfig::in_mode(2).required().kind(&i7i77::FIELD))
    ///     .with(1, RemoteConfig::in_mode(0).required().kind(&i7i77::ANALOG));
    /// # assert_eq!(port.channel(1).unwrap().unit_class, Some(0x11));
    /// ```
    #[must_use]
    pub const fn kind(mut self, table: &RemoteTable) -> Self {
        self.name = Some(RemoteName(table.name));
        self.unit_class = table.unit_class;
        self
    }

    /// It must be the remote of this table, and may be absent at the start: its pins exist then,
    /// never valid, and it comes up when it is plugged in. See
    /// [`Board::attach_optional`](super::Board::attach_optional).
    #[must_use]
    pub const fn optional(mut self, table: &'static RemoteTable) -> Self {
        self.optional = Some(table);
        self.kind(table)
    }

    /// It must have this unit number.
    #[must_use]
    pub const fn unit(mut self, unit_number: u32) -> Self {
        self.unit_number = Some(unit_number);
        self
    }
}

/// Which channels of a serial port are used, and how.
///
/// It can be parsed from what LinuxCNC takes for `sserial_port_0=`: a digit for each channel, its
/// software mode, or `x` for a channel that is not used. Channels that are not named are used in
/// mode 0. The I/O pins of a channel that is not used (RX, TX, TXEN) are plain I/O pins.
///
/// ```
/// use mesa_hal::driver::SerialConfig;
///
/// let config: SerialConfig = "20xxxxxx".parse()?;
/// assert_eq!(config.channel(0).map(|remote| remote.mode), Some(2));
/// assert_eq!(config.channel(2), None);
/// # Ok::<(), mesa_hal::driver::SerialConfigError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SerialConfig {
    channels: [Option<RemoteConfig>; MAX_CHANNELS as usize],
    /// A channel that was configured and that no port has.
    pub(super) beyond: Option<u8>,
}

impl Default for SerialConfig {
    /// All channels, in mode 0, none of them required.
    fn default() -> Self {
        Self {
            channels: [Some(RemoteConfig::in_mode(0)); MAX_CHANNELS as usize],
            beyond: None,
        }
    }
}

impl SerialConfig {
    /// No channel.
    pub const NONE: Self = Self {
        channels: [None; MAX_CHANNELS as usize],
        beyond: None,
    };

    /// The same with this remote on channel `channel`, 0 to 7. Building the driver refuses others.
    #[must_use]
    pub fn with(mut self, channel: u8, remote: RemoteConfig) -> Self {
        match self.channels.get_mut(usize::from(channel)) {
            Some(slot) => *slot = Some(remote),
            None => self.beyond = Some(channel),
        }
        self
    }

    /// What is expected on a channel; `None` if it is not used.
    pub fn channel(&self, channel: u8) -> Option<RemoteConfig> {
        *self.channels.get(usize::from(channel))?
    }

    /// The channels that are used.
    pub fn iter(&self) -> impl Iterator<Item = (Channel, RemoteConfig)> + '_ {
        Channel::ALL
            .into_iter()
            .zip(self.channels)
            .filter_map(|(channel, remote)| Some((channel, remote?)))
    }
}

/// Why a text is no [`SerialConfig`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SerialConfigError {
    /// A character that means nothing.
    #[error(
        "channel {channel}: '{found}' is neither a software mode (0 to 9) nor x for a channel \
         that is not used"
    )]
    Character {
        /// The channel it stands for.
        channel: usize,
        /// The character.
        found: char,
    },
    /// More than eight characters.
    #[error("{found} channels; a port has at most 8; leave the rest out")]
    TooMany {
        /// How many there are.
        found: usize,
    },
}

impl FromStr for SerialConfig {
    type Err = SerialConfigError;

    fn from_str(text: &str) -> Result<Self, SerialConfigError> {
        let found = text.chars().count();
        if found > usize::from(MAX_CHANNELS) {
            return Err(SerialConfigError::TooMany { found });
        }
        let mut config = Self::default();
        for (channel, (slot, found)) in config.channels.iter_mut().zip(text.chars()).enumerate() {
            *slot = match (found, found.to_digit(10)) {
                ('x' | 'X', _) => None,
                (_, Some(digit)) => Some(RemoteConfig::in_mode(digit as u8)),
                _ => return Err(SerialConfigError::Character { channel, found }),
            };
        }
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn modes(text: &str) -> Result<[Option<u8>; 8], SerialConfigError> {
        let config: SerialConfig = text.parse()?;
        Ok(config.channels.map(|remote| remote.map(|r| r.mode)))
    }

    #[test]
    fn digits_are_modes_and_x_is_not_used() {
        let z = Some(0);
        assert_eq!(
            modes("02xX9"),
            Ok([z, Some(2), None, None, Some(9), z, z, z])
        );
        assert_eq!(modes(""), Ok([z; 8]));
    }

    #[test]
    fn what_means_nothing_is_refused() {
        let bad = SerialConfigError::Character {
            channel: 1,
            found: '-',
        };
        assert_eq!(modes("0-"), Err(bad));
        assert_eq!(
            modes("000000000"),
            Err(SerialConfigError::TooMany { found: 9 })
        );
    }

    proptest! {
        #[test]
        fn any_text_is_parsed_or_refused(text in ".{0,12}") {
            let _ = text.parse::<SerialConfig>();
        }
    }
}
