//! What the cycle needs to know of a port: words, times and steps, without any waiting.

use super::{Channel, ChannelMask, Command};
use core::time::Duration;

/// What a channel's CS is written with before START: its software mode in the top byte.
///
/// Manual: 7I77, "REMOTE MODES".
pub const fn software_mode_word(mode: u8) -> u32 {
    (mode as u32) << 24
}

/// The steps that bring a channel back while others run. One after the other, and COMMAND must
/// read 0 before each; no DOIT is possible meanwhile, which the other remotes' watchdogs (50 ms)
/// allow.
///
/// FACTS 5.7.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RecoveryStep {
    /// Stop the channel: clears its sticky faults and its counters.
    Stop,
    /// START it in normal mode; its CS must hold the software mode by then.
    Start,
}

impl RecoveryStep {
    /// The word for COMMAND.
    pub const fn command(self, channel: Channel) -> Command {
        let mask = channel.mask();
        match (self, Command::stop(mask)) {
            (Self::Stop, Some(stop)) => stop,
            // A channel's mask is never empty, so that the stop word always exists.
            (Self::Start | Self::Stop, _) => Command::start(mask),
        }
    }

    /// How long it takes when the remote is there.
    pub const fn usual(self) -> Duration {
        match self {
            Self::Stop => Duration::from_micros(7),
            Self::Start => Duration::from_micros(1_200),
        }
    }

    /// How long to wait for COMMAND to read 0 before something is wrong. An absent remote makes
    /// START take 17 ms (FACTS 3).
    pub const fn limit(self) -> Duration {
        match self {
            Self::Stop => Duration::from_millis(1),
            Self::Start => Duration::from_millis(30),
        }
    }
}

/// The DOIT of those channels of `wanted` that run; `None` if none of them does.
///
/// A channel that does not run is never sent to, and its bit in DATA means nothing then (FACTS
/// 5.5).
pub const fn doit_of(running: ChannelMask, wanted: ChannelMask) -> Option<Command> {
    let mask = running.intersection(wanted);
    if mask.is_empty() {
        None
    } else {
        Some(Command::doit(mask))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FACTS 5.7: 08NN, then 09NN.
    #[test]
    fn recovery_stops_and_starts_one_channel() {
        let channel = Channel::ALL[2];
        assert_eq!(RecoveryStep::Stop.command(channel).word(), 0x0804);
        assert_eq!(RecoveryStep::Start.command(channel).word(), 0x0904);
        assert_eq!(software_mode_word(3), 0x0300_0000);
    }

    #[test]
    fn a_doit_asks_only_channels_that_run() {
        let mask = ChannelMask::from_bits;
        assert_eq!(
            doit_of(mask(0x05), mask(0x06)),
            Some(Command::doit(mask(0x04)))
        );
        assert_eq!(doit_of(mask(0x01), mask(0x06)), None);
    }
}
