//! Duration of a DOIT: the lines, and the firmware's loop over its channels.
//!
//! The firmware repeatedly walks over all channels of the build, one after the other. It sends to
//! the requested channels in one pass, checks each of them once in every later pass, and clears
//! COMMAND at the end of the pass that took the last reply. A reply that just misses its check thus
//! costs a whole pass, and [`Walk`] goes through the passes like the firmware does. Its costs are
//! in clock cycles (one instruction each), fitted to recordings of the gateware: `t06`, `t07`,
//! `t08`, `t15`, `t25`, `r` (FACTS 5.1, 11.11).

use super::line::{DEFAULT_BAUD_RATE, USUAL_REMOTE_LATENCY};
use super::{Channel, MAX_CHANNELS, ProcessDataSizes};
use core::time::Duration;

/// Longest latency taken into account: the timeout of an exchange is shorter.
const LONGEST_LATENCY: Duration = Duration::from_secs(1);

/// Time that a timeout adds to the duration of the last chatter exchange. FACTS 5.2.
const TIMEOUT_MARGIN: Duration = Duration::from_micros(40);

/// Two ticks of the timer that measures timeouts. FACTS 4.2.
const TIMER_GRAIN: Duration = Duration::from_micros(4);

/// Duration of a port's DOIT, measured from the end of the write of COMMAND.
///
/// FACTS 5.1, 5.2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DoitTime {
    /// Upper bound without errors, including the firmware's own time, for remotes that answer in
    /// their expected time: never less than the gateware took in the recordings, and at most 7 us
    /// more. A later answer makes it longer by its delay, and by up to one pass of the firmware
    /// over its channels (1 to 6 us at 100 MHz). With several remotes a pass can, rarely, take one
    /// reply more than assumed here: 2 us at most at 100 MHz.
    pub usual: Duration,
    /// Upper bound if a reply is missing.
    pub with_timeout: Duration,
    /// Upper bound for the first DOIT after START, which waits for a running chatter frame.
    pub first: Duration,
}

/// Data of one channel's exchange in a DOIT.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ChannelExchange {
    /// The channel.
    pub channel: Channel,
    /// Number of bytes sent and received.
    pub sizes: ProcessDataSizes,
    /// Its baud rate.
    pub baud_rate: u32,
    /// Time from the end of the request until the remote begins to answer.
    pub latency: Duration,
}

impl ChannelExchange {
    /// An exchange at 2.5 Mbaud, with a remote that answers as fast as well-behaved remotes do.
    pub const fn usual(channel: Channel, sizes: ProcessDataSizes) -> Self {
        Self {
            channel,
            sizes,
            baud_rate: DEFAULT_BAUD_RATE,
            latency: USUAL_REMOTE_LATENCY,
        }
    }
}

impl DoitTime {
    /// The time of a DOIT with these `exchanges`, on a port whose processor has a clock of
    /// `clock_hz` and whose build has `channels` channels, used or not: the firmware checks all of
    /// them. All channels run at the same time, so the slowest one determines the result. A second
    /// exchange of the same channel replaces the first.
    ///
    /// # Real time
    /// Bounded by the number of channels; allocates nothing.
    pub fn expected(
        channels: u8,
        clock_hz: u32,
        exchanges: impl IntoIterator<Item = ChannelExchange>,
    ) -> Self {
        let mut walk = Walk {
            channels: channels.min(MAX_CHANNELS).into(),
            stations: [None; MAX_CHANNELS as usize],
        };
        for exchange in exchanges {
            let slot = walk.stations.get_mut(usize::from(exchange.channel.index()));
            if let Some(slot) = slot {
                *slot = Some(Station::new(&exchange, clock_hz));
            }
        }
        let others = walk.running().count().saturating_sub(1);
        let Some(longest) = walk.running().map(|station| station.receive).max() else {
            return Self::default();
        };
        let time = |cycles: u64| {
            let nanos = u128::from(cycles) * 1_000_000_000 / u128::from(clock_hz.max(1));
            Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
        };
        // The arrival time of a reply determines the pass that takes it.
        let durations = LATER.map(|later| walk.duration(later));
        let duration = durations.into_iter().max().unwrap_or(0);
        // The last pass may take one more reply than in the walk, if others arrived slightly
        // earlier.
        let another = if others > 0 { longest } else { 0 };
        // The command arrives during a pass with nothing to do.
        let usual = time(walk.pass_with(|_| DONE) + duration + OTHERS + another);
        // In chatter, every channel receives its reply or sends its next frame.
        let chatter =
            time(walk.pass_with(|station| FOUND + station.receive.max(RECEIVE.0 + station.send)));
        let pass = time(walk.pass_with(|_| LOOK));
        Self {
            usual,
            with_timeout: usual + TIMEOUT_MARGIN + TIMER_GRAIN + chatter + pass,
            first: usual * 2 + chatter + pass,
        }
    }
}

/// Taking the command and setting up the DOIT.
const TAKE_DOIT: u64 = 32;
/// Start of a pass, before the first channel.
const PASS_HEAD: u64 = 29;
/// End of a pass, after the last channel: the checks for completed commands and for a new one.
const PASS_TAIL: u64 = 32;
/// End of the last pass, until COMMAND reads 0.
const COMPLETE: u64 = 17;
/// Turn of a channel that takes no part.
const ASIDE: u64 = 30;
/// Turn of a participating channel with nothing to do.
const DONE: u64 = 42;
/// Turn of a channel that checks for its reply and finds none.
const LOOK: u64 = 68;
/// Turn of a channel that finds its reply, without taking it.
const FOUND: u64 = 48;
/// Taking a reply and copying its data to the interface registers: fixed part, and for each byte.
const RECEIVE: (u64, u64) = (71, 11);
/// Turn of a channel that sends: fixed part, and for each byte of data.
const SEND: (u64, u64) = (84, 8);
/// Delay of the first start bit within a turn, relative to the check for a reply.
const SEND_AFTER_LOOK: u64 = 23;
/// Gap between two characters of a request.
const CHARACTER_GAP: u64 = 3;
/// From the middle of a reply's last stop bit until its character is counted.
const RECEIVER: u64 = 6;

/// Delays of replies that are tried, because the exact delay is not known.
const LATER: [u64; 3] = [0, 10, 20];

/// Time that channels running without being requested may add to a pass.
const OTHERS: u64 = 75;

/// A participating channel; times in cycles.
#[derive(Clone, Copy, Debug)]
struct Station {
    /// From its sending turn until a check finds its reply.
    line: u64,
    /// Costs of sending its data, and of taking its reply.
    send: u64,
    receive: u64,
    /// Waiting for a reply that a check finds from this cycle on.
    due: Option<u64>,
}

impl Station {
    fn new(exchange: &ChannelExchange, clock_hz: u32) -> Self {
        let clock = u64::from(clock_hz);
        let bits = |bits: u64| (bits * clock).div_ceil(u64::from(exchange.baud_rate.max(1)));
        let latency = exchange.latency.min(LONGEST_LATENCY).as_nanos() as u64;
        let ProcessDataSizes { rx, tx } = exchange.sizes;
        let (tx, rx) = (u64::from(tx), u64::from(rx));
        // BD, data and CRC; data and CRC. The wait does not include the last half bit of the reply.
        let (request, reply) = (tx + 2, rx + 1);
        let line = bits(10 * (request + reply)).saturating_sub(bits(1) / 2);
        let gaps = CHARACTER_GAP * (request - 1) + RECEIVER + SEND_AFTER_LOOK;
        Self {
            line: line + gaps + latency * clock / 1_000_000_000,
            send: SEND.1 * tx,
            receive: RECEIVE.0 + RECEIVE.1 * rx,
            due: None,
        }
    }

    /// Cost of its turn at `now`.
    fn turn(&mut self, now: u64) -> u64 {
        match self.due {
            None => DONE,
            Some(due) if due > now => LOOK,
            Some(_) => {
                self.due = None;
                FOUND + self.receive
            }
        }
    }
}

/// The passes of the firmware during one DOIT.
#[derive(Clone, Copy, Debug)]
struct Walk {
    /// By channel; `None` for a channel that takes no part.
    stations: [Option<Station>; MAX_CHANNELS as usize],
    /// Number of channels of the build.
    channels: usize,
}

impl Walk {
    fn running(&self) -> impl Iterator<Item = &Station> + Clone {
        self.stations.iter().take(self.channels).flatten()
    }

    /// Duration of a pass in which each participating channel has a turn of this cost.
    fn pass_with(&self, turn: impl Fn(&Station) -> u64) -> u64 {
        let turns = self.running().map(|station| turn(station) - ASIDE);
        PASS_HEAD + ASIDE * self.channels as u64 + turns.sum::<u64>() + PASS_TAIL
    }

    /// Time from the check of COMMAND until COMMAND reads 0, with all replies delayed by `later`.
    fn duration(mut self, later: u64) -> u64 {
        let mut now = TAKE_DOIT;
        // A pass to send; then each reply ends a wait, and is taken in the third pass at the
        // latest.
        for pass in 0..=3 * MAX_CHANNELS {
            now += PASS_HEAD;
            for station in self.stations.iter_mut().take(self.channels) {
                now += match station {
                    None => ASIDE,
                    Some(station) if pass == 0 => {
                        station.due = Some(now + station.line + later);
                        SEND.0 + station.send
                    }
                    Some(station) => station.turn(now),
                };
            }
            let Some(earliest) = self.running().filter_map(|station| station.due).min() else {
                break;
            };
            now += PASS_TAIL;
            // Skips the passes in which nothing can happen.
            let pass = self.pass_with(|station| station.due.map_or(DONE, |_| LOOK));
            now += (earliest.saturating_sub(now) / pass).saturating_sub(1) * pass;
        }
        now + COMPLETE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn time(rx: u8, tx: u8, channels: usize) -> DoitTime {
        let sizes = ProcessDataSizes { rx, tx };
        let exchanges = Channel::ALL.into_iter().take(channels);
        DoitTime::expected(
            8,
            100_000_000,
            exchanges.map(|channel| ChannelExchange::usual(channel, sizes)),
        )
    }

    fn micros(duration: Duration) -> u128 {
        duration.as_micros()
    }

    /// FACTS 5.1; gateware transcripts t07a, t07d, t15a, t15b, t10, t26.
    #[test]
    fn recorded_doits_take_the_expected_time_or_slightly_less() {
        let recorded = [
            (5, 2, 1, 57),
            (5, 2, 8, 66),
            (7, 6, 8, 96),
            (13, 12, 1, 130),
            (13, 12, 8, 147),
            (1, 0, 1, 33),
            (9, 2, 1, 75),
        ];
        for (rx, tx, channels, took) in recorded {
            let expected = time(rx, tx, channels);
            let usual = micros(expected.usual);
            assert!(
                (took..=took + 7).contains(&usual),
                "{rx}/{tx} on {channels} took {took}: {expected:?}"
            );
        }
    }

    /// A 5I25 runs its ports at a third of the recorded clock.
    #[test]
    fn slower_processor_makes_what_it_does_longer_and_not_the_line() {
        let sizes = ProcessDataSizes { rx: 5, tx: 2 };
        let [fast, slow] = [99_000_000, 33_000_000].map(|clock_hz| {
            DoitTime::expected(
                3,
                clock_hz,
                [ChannelExchange::usual(Channel::ALL[0], sizes)],
            )
        });
        // Ten characters of 4 us, and the remote.
        let line = Duration::from_micros(50);
        let added = [fast, slow].map(|time| time.usual.saturating_sub(line));
        assert!(added[1] > added[0] * 5 / 2, "{added:?}");
    }

    /// Gateware transcripts t10 and t12: 97.7 and 100.3 us with a lost reply.
    #[test]
    fn lost_reply_is_within_the_longer_time() {
        assert!(micros(time(5, 2, 1).with_timeout) >= 101);
        assert!(micros(time(5, 2, 1).with_timeout) <= 125);
    }

    #[test]
    fn no_channel_takes_no_time() {
        assert_eq!(time(5, 2, 0), DoitTime::default());
    }

    proptest! {
        #[test]
        fn any_sizes_rates_and_processors_have_a_time(
            rx: u8,
            tx: u8,
            n in 0usize..9,
            baud_rate: u32,
            latency: u32,
            channels: u8,
            clock_hz: u32,
        ) {
            let sizes = ProcessDataSizes { rx, tx };
            let latency = Duration::from_nanos(latency.into());
            let exchanges = Channel::ALL.into_iter().take(n);
            let exchanges = exchanges.map(|channel| ChannelExchange {
                channel,
                sizes,
                baud_rate,
                latency,
            });
            let times = DoitTime::expected(channels, clock_hz, exchanges);
            prop_assert!(times.usual <= times.with_timeout && times.usual <= times.first);
        }
    }
}
