//! What the cycle needs to know of a port: words, times and steps, without any waiting.

use super::{Channel, ChannelMask, Command, ProcessDataSizes};
use core::time::Duration;

/// Baud rate of every channel unless it is changed.
pub const DEFAULT_BAUD_RATE: u32 = 2_500_000;

/// Time that a remote takes to answer, as recorded with well-behaved ones.
pub const USUAL_REMOTE_LATENCY: Duration = Duration::from_micros(10);

/// How long the DOIT of a port takes.
///
/// FACTS 5.1, 5.2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DoitTime {
    /// The line alone: the slowest channel's request, the remote's own time and the reply.
    pub line: Duration,
    /// The most when all is well, the firmware's own time included.
    pub usual: Duration,
    /// The most when a reply does not come.
    pub with_timeout: Duration,
    /// The most for the first DOIT after START, which waits for a running chatter frame.
    pub first: Duration,
}

/// The firmware's own time for one channel of eight, and for each further one (FACTS 5.1: 4 to
/// 27 us in all).
const FIRMWARE_BASE: Duration = Duration::from_micros(11);
const FIRMWARE_PER_CHANNEL: Duration = Duration::from_micros(2);

/// What a timeout adds to the duration of the last chatter exchange. FACTS 5.2.
const TIMEOUT_MARGIN: Duration = Duration::from_micros(40);

/// How late the firmware may notice a timeout: one pass for each channel.
const TIMEOUT_NOTICED: Duration = Duration::from_micros(12);

impl DoitTime {
    /// The time that `channels` take together at `baud_rate`, with remotes that answer after
    /// `latency`. All channels run at the same time, so the slowest one decides.
    ///
    /// # Real time
    /// Bounded by the number of channels; allocates nothing.
    pub fn expected(
        channels: impl IntoIterator<Item = ProcessDataSizes>,
        baud_rate: u32,
        latency: Duration,
    ) -> Self {
        let mut line = Duration::ZERO;
        let mut count = 0u32;
        for sizes in channels {
            line = line.max(exchange(sizes, baud_rate) + latency);
            count += 1;
        }
        if count == 0 {
            return Self::default();
        }
        let usual = line + FIRMWARE_BASE + FIRMWARE_PER_CHANNEL * count;
        Self {
            line,
            usual,
            with_timeout: usual + TIMEOUT_MARGIN + TIMEOUT_NOTICED,
            first: usual + usual,
        }
    }

    /// What is left of `period` when a reply does not come; `None` if the period is too short for
    /// that, so that one lost reply would cost two cycles.
    pub fn margin(&self, period: Duration) -> Option<Duration> {
        period.checked_sub(self.with_timeout)
    }
}

/// Characters of a request (BD, data, CRC) and of a reply (data, CRC) on the line, 8N1.
fn exchange(sizes: ProcessDataSizes, baud_rate: u32) -> Duration {
    let characters = u64::from(sizes.tx) + 2 + u64::from(sizes.rx) + 1;
    Duration::from_nanos(characters * 10 * 1_000_000_000 / u64::from(baud_rate.max(1)))
}

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
    use proptest::prelude::*;

    fn time(rx: u8, tx: u8, channels: usize) -> DoitTime {
        let sizes = ProcessDataSizes { rx, tx };
        DoitTime::expected(
            std::iter::repeat_n(sizes, channels),
            DEFAULT_BAUD_RATE,
            USUAL_REMOTE_LATENCY,
        )
    }

    fn micros(duration: Duration) -> u128 {
        duration.as_micros()
    }

    /// FACTS 5.1; gateware transcripts t07a, t07d, t15a, t15b, t10, t26.
    #[test]
    fn recorded_doits_took_no_longer_than_expected_and_not_much_less() {
        let recorded = [
            (5, 2, 1, 57),
            (5, 2, 8, 70),
            (7, 6, 8, 96),
            (13, 12, 1, 130),
            (13, 12, 8, 147),
            (1, 0, 1, 33),
            (9, 2, 1, 75),
        ];
        for (rx, tx, channels, took) in recorded {
            let expected = time(rx, tx, channels);
            assert!(
                micros(expected.usual) >= took,
                "{rx}/{tx} on {channels}: {expected:?}"
            );
            assert!(
                micros(expected.line) < took,
                "{rx}/{tx} on {channels}: {expected:?}"
            );
            assert!(
                micros(expected.usual) <= took + 12,
                "{rx}/{tx} on {channels}"
            );
        }
    }

    /// Gateware transcripts t10 and t12: 97.7 and 100.3 us with a lost reply.
    #[test]
    fn a_lost_reply_is_within_the_longer_time() {
        assert!(micros(time(5, 2, 1).with_timeout) >= 101);
        assert!(micros(time(5, 2, 1).with_timeout) <= 125);
    }

    #[test]
    fn a_period_that_is_too_short_has_no_margin() {
        let doit = time(13, 12, 8);
        assert_eq!(doit.margin(Duration::from_micros(150)), None);
        assert!(doit.margin(Duration::from_millis(1)) > Some(Duration::from_micros(700)));
    }

    #[test]
    fn no_channel_takes_no_time() {
        assert_eq!(time(5, 2, 0), DoitTime::default());
    }

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

    proptest! {
        #[test]
        fn any_sizes_and_rates_have_a_time(rx: u8, tx: u8, n in 0usize..9, baud: u32) {
            let sizes = ProcessDataSizes { rx, tx };
            let times = DoitTime::expected(
                std::iter::repeat_n(sizes, n),
                baud,
                USUAL_REMOTE_LATENCY,
            );
            prop_assert!(times.line <= times.usual && times.usual <= times.with_timeout);
        }
    }
}
