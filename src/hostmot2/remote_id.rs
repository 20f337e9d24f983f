//! Address of a remote.

use core::fmt;
use core::str::FromStr;

use crate::ParseError;

/// Address of a remote: the smart-serial port and the channel of that port.
///
/// As text, `port 0, channel 1`; with the name of what is there it is a
/// [`RemoteLabel`](crate::RemoteLabel), `7i77.0.1`. [`FromStr`] accepts the first, and the short
/// form of LinuxCNC's pin names, `0.1`. Functions that take a remote accept the pair
/// `(port, channel)` too:
///
/// ```
/// use mesa_hal::RemoteId;
///
/// let remote = RemoteId::new(0, 1);
/// assert_eq!(remote, RemoteId::from((0, 1)));
/// assert_eq!(remote.to_string(), "port 0, channel 1");
/// assert_eq!("0.1".parse(), Ok(remote));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RemoteId {
    /// Smart-serial port, counted from 0 in the order of the firmware's module list.
    pub port: u8,
    /// Channel of the port, 0 to 7.
    pub channel: u8,
}

impl RemoteId {
    /// The remote on `channel` of `port`.
    pub const fn new(port: u8, channel: u8) -> Self {
        Self { port, channel }
    }
}

impl From<(u8, u8)> for RemoteId {
    fn from((port, channel): (u8, u8)) -> Self {
        Self { port, channel }
    }
}

impl fmt::Display for RemoteId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { port, channel } = self;
        write!(f, "port {port}, channel {channel}")
    }
}

impl FromStr for RemoteId {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Self, ParseError> {
        let parse = || {
            let long = || text.strip_prefix("port ")?.split_once(", channel ");
            let (port, channel) = long().or_else(|| text.split_once('.'))?;
            let remote = Self::new(port.parse().ok()?, channel.parse().ok()?);
            (remote.channel < 8).then_some(remote)
        };
        parse().ok_or_else(|| ParseError {
            what: "remote",
            found: text.into(),
            expected: "PORT.CHANNEL, for example 0.1, with a channel of 0 to 7",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn text_of_a_remote_parses_to_the_same_remote(port: u8, channel in 0u8..8) {
            let remote = RemoteId::new(port, channel);
            prop_assert_eq!(remote.to_string().parse(), Ok(remote));
            prop_assert_eq!(alloc::format!("{port}.{channel}").parse(), Ok(remote));
        }

        #[test]
        fn arbitrary_text_never_panics(text: String) {
            let _ = text.parse::<RemoteId>();
        }
    }

    #[test]
    fn text_that_is_no_address_is_refused() {
        for text in [
            "", "0", "0.", ".1", "0.8", "256.0", "0.1.2", "port 0", "port 0.1", "-1.0",
        ] {
            let error = text.parse::<RemoteId>().unwrap_err();
            assert_eq!((error.what, error.found.as_str()), ("remote", text));
        }
        assert_eq!(
            "0.8".parse::<RemoteId>().unwrap_err().to_string(),
            "remote '0.8': expected PORT.CHANNEL, for example 0.1, with a channel of 0 to 7"
        );
    }
}
