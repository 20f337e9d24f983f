//! How long a DOIT takes: the lines, and the firmware's loop over its channels.
//!
//! The firmware walks over all channels of the build, one after the other and again and again. It
//! sends to the asked channels in one pass, looks at each of them once a pass afterwards, and
//! clears COMMAND at the end of the pass that took the last reply. So a reply that has just missed
//! its look costs a whole pass, and [`Walk`] goes through the passes like the firmware does. Its
//! costs are in clock cycles (one instruction each), fitted to recordings of the gateware:
//! `t06`, `t07`, `t08`, `t15`, `t25`, `r` (FACTS 5.1, 11.11).

use super::{Channel, MAX_CHANNELS, ProcessDataSizes};
use core::time::Duration;

/// Baud rate of every channel unless it is changed.
pub const DEFAULT_BAUD_RATE: u32 = 2_500_000;

/// Time that a remote takes to answer, as recorded with well-behaved ones.
pub const USUAL_REMOTE_LATENCY: Duration = Duration::from_micros(10);

/// The clock that the gateware was recorded at, in hertz. FACTS 3.
const RECORDED_CLOCK: u32 = 100_000_000;

/// What a timeout adds to the duration of the last chatter exchange. FACTS 5.2.
const TIMEOUT_MARGIN: Duration = Duration::from_micros(40);

/// Two ticks of the timer that timeouts are measured with. FACTS 4.2.
const TIMER_GRAIN: Duration = Duration::from_micros(4);

/// How long the DOIT of a port takes, from the end of the write of COMMAND on.
///
/// FACTS 5.1, 5.2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DoitTime {
    /// The most when all is well, the firmware's own time included, for remotes that answer when
    /// they are expected to: never less than what the gateware took in the recordings, and up to
    /// 7 us more. A later answer makes it longer by as much, and by up to one pass of the firmware
    /// over its channels (1 to 6 us at 100 MHz). With several remotes a pass can, rarely, take one
    /// reply more than foreseen here: 2 us at most at 100 MHz.
    pub usual: Duration,
    /// The most when a reply does not come.
    pub with_timeout: Duration,
    /// The most for the first DOIT after START, which waits for a running chatter frame.
    pub first: Duration,
}

/// The processor that runs a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Processor {
    /// Channels of the build, used or not: the firmware looks at all of them.
    pub channels: u8,
    /// Its clock in hertz.
    pub clock_hz: u32,
}

impl Processor {
    /// One of `channels` channels at 100 MHz.
    pub const fn usual(channels: u8) -> Self {
        Self {
            channels,
            clock_hz: RECORDED_CLOCK,
        }
    }

    fn cycles(self, time: Duration) -> u64 {
        let cycles = time.as_nanos() * u128::from(self.clock_hz) / 1_000_000_000;
        u64::try_from(cycles).unwrap_or(u64::MAX)
    }

    fn time(self, cycles: u64) -> Duration {
        let nanos = u128::from(cycles) * 1_000_000_000 / u128::from(self.clock_hz.max(1));
        Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
    }
}

/// What one channel does in a DOIT.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Exchange {
    /// The channel.
    pub channel: Channel,
    /// How much it sends and receives.
    pub sizes: ProcessDataSizes,
    /// Its baud rate.
    pub baud_rate: u32,
    /// From the end of the request until the remote begins to answer.
    pub latency: Duration,
}

impl Exchange {
    /// At 2.5 Mbaud, with a remote that answers as fast as well-behaved ones do.
    pub const fn usual(channel: Channel, sizes: ProcessDataSizes) -> Self {
        Self {
            channel,
            sizes,
            baud_rate: DEFAULT_BAUD_RATE,
            latency: USUAL_REMOTE_LATENCY,
        }
    }

    /// Characters of a request (BD, data, CRC), and of a reply (data, CRC).
    fn characters(&self) -> (u64, u64) {
        (u64::from(self.sizes.tx) + 2, u64::from(self.sizes.rx) + 1)
    }
}

impl DoitTime {
    /// The time that `exchanges`, all in one DOIT, take on `processor`. All channels run at the
    /// same time, so the slowest one decides. A second exchange of the same channel replaces the
    /// first.
    ///
    /// # Real time
    /// Bounded by the number of channels; allocates nothing.
    pub fn expected(processor: Processor, exchanges: impl IntoIterator<Item = Exchange>) -> Self {
        let mut walk = Walk::new(processor);
        for exchange in exchanges {
            walk.add(&exchange);
        }
        let running = walk.running();
        if running == 0 {
            return Self::default();
        }
        let wait = walk.idle_pass();
        let chatter = processor.time(walk.chatter_pass());
        let pass = processor.time(walk.pass());
        let margin = ASIDE + walk.another_reply();
        let usual = processor.time(wait.saturating_add(walk.duration()).saturating_add(margin));
        let noticed = TIMER_GRAIN + chatter + pass;
        let with_timeout = usual.saturating_add(TIMEOUT_MARGIN + noticed);
        Self {
            usual,
            with_timeout,
            first: usual.saturating_add(usual).saturating_add(chatter + pass),
        }
    }
}

/// Taking the command and setting up the DOIT.
const TAKE_DOIT: u64 = 32;
/// What comes before the first channel of a pass.
const PASS_HEAD: u64 = 29;
/// After the last channel: the checks for completed commands and for a new one.
const PASS_TAIL: u64 = 32;
/// After the last channel of the last pass, until COMMAND reads 0.
const COMPLETE: u64 = 17;
/// The turn of a channel that does nothing.
const TURN: (u64, u64) = (10, 20);
/// A channel that runs: to the routine of its state and back, at least.
const DISPATCH: (u64, u64) = (6, 1);
/// A channel that runs and has nothing to do.
const NOTHING_TO_DO: u64 = 5;
/// Sending: until the first start bit, and from there on without the data.
const SEND: (u64, u64) = (34, 13);
/// Sending each byte of data.
const SEND_BYTE: u64 = 8;
/// Between two characters of a request.
const CHARACTER_GAP: u64 = 3;
/// From the middle of a reply's last stop bit until its character counts.
const RECEIVER: u64 = 6;
/// Looking for a reply: until the look, and after it if there is none.
const LOOK: (u64, u64) = (11, 20);
/// Taking a reply with its data to the interface registers, without the bytes.
const RECEIVE: u64 = 71;
/// Taking each byte of a reply.
const RECEIVE_BYTE: u64 = 11;

/// How much later than they should replies may come, as far as that is not told.
const LATER: [u64; 3] = [0, 10, 20];

/// What channels that run without being asked may make of a pass.
const ASIDE: u64 = 75;

/// Where a channel is.
#[derive(Clone, Copy, Debug)]
enum Stage {
    /// It has no part in the DOIT.
    Aside,
    /// Its frame is about to be sent.
    Send,
    /// Its reply counts from this cycle on.
    Wait(u64),
    /// It is done.
    Done,
}

/// What the walk has to know of a channel, in cycles.
#[derive(Clone, Copy, Debug)]
struct Station {
    stage: Stage,
    /// From the first start bit to the last character that counts.
    line: u64,
    send: u64,
    receive: u64,
}

/// The firmware's passes of one DOIT.
#[derive(Clone, Copy, Debug)]
struct Walk {
    processor: Processor,
    stations: [Station; MAX_CHANNELS as usize],
    now: u64,
}

impl Walk {
    fn new(processor: Processor) -> Self {
        let aside = Station {
            stage: Stage::Aside,
            line: 0,
            send: 0,
            receive: 0,
        };
        Self {
            processor,
            stations: [aside; MAX_CHANNELS as usize],
            now: 0,
        }
    }

    fn add(&mut self, exchange: &Exchange) {
        let (request, reply) = exchange.characters();
        let bits = |bits: u64| {
            let clock = u64::from(self.processor.clock_hz);
            (bits * clock).div_ceil(u64::from(exchange.baud_rate.max(1)))
        };
        // The last half bit of the reply is not waited for.
        let line = bits(10 * (request + reply)).saturating_sub(bits(1) / 2)
            + CHARACTER_GAP * (request - 1)
            + RECEIVER;
        let station = Station {
            stage: Stage::Send,
            line: line.saturating_add(self.processor.cycles(exchange.latency)),
            send: SEND_BYTE * u64::from(exchange.sizes.tx),
            receive: RECEIVE_BYTE * u64::from(exchange.sizes.rx),
        };
        let slot = self.stations.get_mut(usize::from(exchange.channel.index()));
        if let Some(slot) = slot {
            *slot = station;
        }
    }

    /// Channels that take part.
    fn running(&self) -> u64 {
        let run = |station: &&Station| !matches!(station.stage, Stage::Aside);
        self.stations.iter().filter(run).count() as u64
    }

    /// A pass in which every channel that takes part costs `each` more than one that does not.
    fn pass_with(&self, each: u64) -> u64 {
        let turns = (TURN.0 + TURN.1) * u64::from(self.processor.channels);
        PASS_HEAD + turns + (DISPATCH.0 + DISPATCH.1 + each) * self.running() + PASS_TAIL
    }

    /// A pass while all are waiting for their replies.
    fn pass(&self) -> u64 {
        self.pass_with(LOOK.0 + LOOK.1)
    }

    /// A pass while there is nothing to do: so long a command can wait until it is looked at.
    fn idle_pass(&self) -> u64 {
        self.pass_with(NOTHING_TO_DO)
    }

    /// One reply more in the last pass than the walk has there: others came a little sooner.
    fn another_reply(&self) -> u64 {
        if self.running() < 2 {
            return 0;
        }
        let replies = self.stations.iter().map(|station| station.receive);
        RECEIVE + replies.max().unwrap_or(0)
    }

    /// A pass of chatter in which every channel gets its reply or sends its next frame.
    fn chatter_pass(&self) -> u64 {
        let costs = self.stations.iter();
        let costs = costs.map(|station| station.send.max(station.receive));
        self.pass_with(LOOK.0 + RECEIVE) + costs.sum::<u64>()
    }

    /// From the look at COMMAND until COMMAND reads 0: the longest for replies that come when they
    /// should or a little later, which decides in which pass they are taken.
    fn duration(&self) -> u64 {
        let durations = LATER.map(|later| self.duration_with(later));
        durations.into_iter().max().unwrap_or(0)
    }

    /// The same, where all replies come that much later.
    fn duration_with(mut self, later: u64) -> u64 {
        for station in &mut self.stations {
            station.line = station.line.saturating_add(later);
        }
        self.now = TAKE_DOIT;
        // A pass to send; then each reply ends a wait, and is taken in the second pass at the
        // latest.
        for _ in 0..=3 * MAX_CHANNELS {
            self.skip_waiting();
            self.walk_pass();
            let done = |station: &Station| matches!(station.stage, Stage::Aside | Stage::Done);
            if self.stations.iter().all(done) {
                return self.now.saturating_add(COMPLETE);
            }
            self.now = self.now.saturating_add(PASS_TAIL);
        }
        self.now
    }

    fn walk_pass(&mut self) {
        let mut now = self.now.saturating_add(PASS_HEAD);
        let channels = usize::from(self.processor.channels);
        for station in self.stations.iter_mut().take(channels) {
            now = station
                .turn(now.saturating_add(TURN.0))
                .saturating_add(TURN.1);
        }
        self.now = now;
    }

    /// Leaves out the passes in which nothing can happen.
    fn skip_waiting(&mut self) {
        let mut earliest = u64::MAX;
        let mut pass = self.pass_with(0);
        for station in &self.stations {
            match station.stage {
                Stage::Send => return,
                Stage::Wait(due) => {
                    earliest = earliest.min(due);
                    pass += LOOK.0 + LOOK.1;
                }
                Stage::Done => pass += NOTHING_TO_DO,
                Stage::Aside => {}
            }
        }
        let passes = earliest.saturating_sub(self.now) / pass;
        self.now += passes.saturating_sub(1) * pass;
    }
}

impl Station {
    /// What the channel does in its turn at `now`; when that is done.
    fn turn(&mut self, now: u64) -> u64 {
        let now = now.saturating_add(DISPATCH.0);
        let end = match self.stage {
            Stage::Aside => return now - DISPATCH.0,
            Stage::Send => {
                let start = now.saturating_add(SEND.0);
                self.stage = Stage::Wait(start.saturating_add(self.line));
                start.saturating_add(SEND.1 + self.send)
            }
            Stage::Wait(due) => {
                let look = now.saturating_add(LOOK.0);
                if due > look {
                    look.saturating_add(LOOK.1)
                } else {
                    self.stage = Stage::Done;
                    look.saturating_add(RECEIVE + self.receive)
                }
            }
            Stage::Done => now.saturating_add(NOTHING_TO_DO),
        };
        end.saturating_add(DISPATCH.1)
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
            Processor::usual(8),
            exchanges.map(|channel| Exchange::usual(channel, sizes)),
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
    fn a_slower_processor_makes_what_it_does_longer_and_not_the_line() {
        let sizes = ProcessDataSizes { rx: 5, tx: 2 };
        let [fast, slow] = [99_000_000, 33_000_000].map(|clock_hz| {
            let processor = Processor {
                channels: 3,
                clock_hz,
            };
            DoitTime::expected(processor, [Exchange::usual(Channel::ALL[0], sizes)])
        });
        // Ten characters of 4 us, and the remote.
        let line = Duration::from_micros(50);
        let added = [fast, slow].map(|time| time.usual.saturating_sub(line));
        assert!(added[1] > added[0] * 5 / 2, "{added:?}");
    }

    /// Gateware transcripts t10 and t12: 97.7 and 100.3 us with a lost reply.
    #[test]
    fn a_lost_reply_is_within_the_longer_time() {
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
            let exchanges = exchanges.map(|channel| Exchange {
                channel,
                sizes,
                baud_rate,
                latency,
            });
            let times = DoitTime::expected(Processor { channels, clock_hz }, exchanges);
            prop_assert!(times.usual <= times.with_timeout && times.usual <= times.first);
        }
    }
}
