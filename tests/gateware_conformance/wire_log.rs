//! The recorded serial lines: compares the bursts of the simulated FPGA, and answers as recorded.

use mesa_hal_sim::sslbp::Lines;
use mesa_hal_sim::wire::{Burst, Nanos};

use crate::common::recording::Outcome;
use crate::common::recording::sslbp::{Event, Transcript};

/// Times may differ by this much, or by a twentieth, whichever is more (index.txt).
pub const TOLERANCE: Nanos = 15_000;

/// True if two durations agree.
pub fn within_tolerance(expected: Nanos, actual: Nanos) -> bool {
    expected.abs_diff(actual) <= TOLERANCE.max(expected / 20)
}

/// A reply with this latency is no longer awaited.
const LATE: Nanos = 300_000;
/// A DOIT meets a chatter frame in progress, or begins or ends within one pass of the firmware.
const MEETING: Nanos = 12_000;
/// Two replies follow each other without a pause.
const BACK_TO_BACK: Nanos = 20;

/// A request and its replies.
struct Request<'t> {
    line: usize,
    start: Nanos,
    end: Nanos,
    bytes: &'t [u8],
    replies: Vec<Reply<'t>>,
}

/// A reply, with its times relative to the end of the request.
#[derive(Clone, Copy)]
struct Reply<'t> {
    latency: Nanos,
    length: Nanos,
    is_break: bool,
    bytes: &'t [u8],
}

impl Request<'_> {
    /// True for chatter: process data of zeros. A remote that only claims to be an 8I20 is
    /// repeatedly asked in the same way.
    fn is_chatter(&self) -> bool {
        matches!(self.bytes, [0xBD, data @ .., _] if data.iter().all(|&byte| byte == 0))
            || matches!(self.bytes, [0x45, 0x54, 0x08, _])
    }

    /// End of the last reply, in recorded time.
    fn settled(&self) -> Nanos {
        self.replies
            .iter()
            .map(|reply| self.end + reply.latency + reply.length)
            .max()
            .unwrap_or(self.end)
    }
}

#[derive(Default)]
struct Channel<'t> {
    requests: Vec<Request<'t>>,
    next: usize,
    waiting: Vec<Burst>,
    /// The last event on this line: recorded and simulated time.
    reference: (Nanos, Nanos),
    /// Offset in nanoseconds of replies that are no longer awaited.
    tie: i64,
    /// End of the activity on the line towards the FPGA: recorded and simulated time.
    line_free: (Nanos, Nanos),
    /// Time since which the line towards the FPGA is held low, in recorded time.
    low_since: Option<Nanos>,
    /// Surplus or missing chatter frames, and all chatter frames.
    uneven: usize,
    chatter: usize,
    /// Recorded time from one chatter frame to the next.
    chatter_period: Nanos,
}

/// All lines of a transcript.
pub struct WireLog<'t> {
    channels: Vec<Channel<'t>>,
    outcome: Outcome,
    /// The last host action: recorded and simulated time.
    host: (Nanos, Nanos),
    log_off: Nanos,
    end: Nanos,
}

impl<'t> WireLog<'t> {
    /// Collects the bursts of a transcript.
    ///
    /// Channels that the recorded build does not have are left out: their bursts at power-up are an
    /// artefact of undriven lines (index.txt).
    pub fn new(transcript: &'t Transcript, tie: i64) -> Self {
        let channel = |_| Channel {
            tie,
            ..Channel::default()
        };
        let mut channels: Vec<Channel<'t>> = (0..transcript.channels).map(channel).collect();
        let mut log_off = Nanos::MAX;
        for entry in &transcript.entries {
            match &entry.event {
                Event::FromFpga {
                    channel,
                    start,
                    bytes,
                } => {
                    if let Some(channel) = channels.get_mut(usize::from(*channel)) {
                        channel.requests.push(Request {
                            line: entry.line,
                            start: *start,
                            end: entry.time,
                            bytes,
                            replies: Vec::new(),
                        });
                    }
                }
                Event::ToFpga {
                    channel,
                    start,
                    is_break,
                    bytes,
                } => {
                    let request = channels
                        .get_mut(usize::from(*channel))
                        .and_then(|channel| channel.requests.iter_mut().rfind(|r| r.end <= *start));
                    if let Some(request) = request {
                        request.replies.push(Reply {
                            latency: start - request.end,
                            length: entry.time - start,
                            is_break: *is_break,
                            bytes,
                        });
                    }
                }
                Event::WireLogOff => log_off = entry.time,
                Event::Remote { remote, text } if text == "idle=0" => {
                    if let Some(channel) = channels.get_mut(usize::from(*remote)) {
                        channel.low_since = Some(entry.time);
                    }
                }
                _ => {}
            }
        }
        Self {
            channels,
            outcome: Outcome::default(),
            host: (0, 0),
            log_off,
            end: transcript.entries.last().map_or(0, |entry| entry.time),
        }
    }

    /// True if a reply arrives when it is no longer awaited.
    pub fn has_late_replies(&self) -> bool {
        let requests = self.channels.iter().flat_map(|channel| &channel.requests);
        let mut replies = requests.flat_map(|request| &request.replies);
        replies.any(|reply| reply.latency > LATE)
    }

    /// The host acted at the recorded and at the simulated time.
    pub fn host_acted(&mut self, recorded: Nanos, simulated: Nanos) {
        self.host = (recorded, simulated);
    }

    /// Total duration of surplus and missing chatter frames so far: a DOIT that meets one more or
    /// one less of them waits that much longer or shorter.
    pub fn uneven_chatter(&self) -> Nanos {
        self.channels
            .iter()
            .map(|channel| channel.uneven as Nanos * channel.chatter_period)
            .sum()
    }

    /// Checks that all recorded requests have been sent.
    pub fn finish(mut self) -> Outcome {
        for channel in &mut self.channels {
            let first = channel.next.saturating_sub(1);
            let mut before = channel.requests.get(first).map(|request| request.bytes);
            for request in channel.requests.iter().skip(channel.next) {
                let at_the_end = request.end + TOLERANCE >= self.end;
                let continues = before.replace(request.bytes) == Some(request.bytes);
                if request.is_chatter() && (at_the_end || continues) {
                    // A run of identical frames may be a frame shorter (index.txt, "Ties").
                    channel.uneven += usize::from(!at_the_end);
                } else {
                    self.outcome.compare(false, request.line, || {
                        (format!("sent {:02X?}", request.bytes), "nothing".to_owned())
                    });
                }
            }
            let allowed = 1 + channel.chatter / 20;
            let line = channel.requests.first().map_or(0, |request| request.line);
            self.outcome.compare(channel.uneven <= allowed, line, || {
                (
                    format!("{} chatter frames", channel.chatter),
                    format!("{} too many or too few", channel.uneven),
                )
            });
        }
        self.outcome
    }

    /// The simulated time as recorded time.
    fn recorded_time(&self, simulated: Nanos) -> Nanos {
        (simulated + self.host.0).saturating_sub(self.host.1)
    }
}

impl Channel<'_> {
    /// The recorded request of a burst: the next one, or, where chatter frames of the same bytes
    /// follow each other, the one that is nearest in time. The last action of the host was at
    /// `host`.
    fn find(&mut self, bytes: &[u8], at: Nanos, host: Nanos) -> Option<usize> {
        let fits = |index: usize| {
            self.requests
                .get(index)
                .is_some_and(|request| request.bytes == bytes && request.is_chatter())
        };
        let distance = |index: usize| self.requests[index].start.abs_diff(at);
        let mut best = self.next;
        if fits(self.next) {
            let before = self.next.checked_sub(1).filter(|&index| fits(index));
            let after = (self.next + 1..self.next + 4).take_while(|&index| fits(index));
            for index in before.into_iter().chain(after) {
                if distance(index) + TOLERANCE < distance(best) {
                    best = index;
                }
            }
        } else if self.next > 0 && fits(self.next - 1) {
            best = self.next - 1;
        } else {
            // A tie (index.txt): the frame that a DOIT meets.
            let skipped = self.requests.get(self.next).is_some_and(|request| {
                let meets = request.start <= host + MEETING && host <= request.settled() + MEETING;
                request.is_chatter() && meets
            });
            let next = self.requests.get(self.next + 1);
            if skipped && next.is_some_and(|request| request.bytes == bytes) {
                best = self.next + 1;
            }
        }
        if best != self.next {
            self.uneven += best.abs_diff(self.next);
            let near = self.requests.get(best.saturating_sub(1)..=best);
            if let Some([before, after]) = near {
                self.chatter_period = after.start - before.start;
            }
        }
        (best < self.requests.len()).then_some(best)
    }

    fn answer(&mut self, index: usize, end: Nanos) {
        let Some(request) = self.requests.get(index) else {
            return;
        };
        for reply in &request.replies {
            let bit = reply.length / (10 * reply.bytes.len() as Nanos);
            let recorded = request.end + reply.latency;
            let mut start = end + reply.latency;
            if reply.latency > LATE {
                start = start.saturating_add_signed(self.tie);
            }
            // The remote's line was busy with the previous reply, and so it is here.
            if recorded.abs_diff(self.line_free.0) <= BACK_TO_BACK {
                start = start.min(self.line_free.1);
            }
            start = start.max(self.line_free.1);
            self.line_free = (recorded + reply.length, start + reply.length);
            let mut burst = Burst::new(start, bit, reply.bytes);
            burst.is_break = reply.is_break;
            self.waiting.push(burst);
        }
        self.reference = (request.settled(), end + (request.settled() - request.end));
    }
}

impl Lines for WireLog<'_> {
    fn transmit(&mut self, channel: usize, burst: &Burst) {
        let at = self.recorded_time(burst.start);
        let (host, log_off, end) = (self.host, self.log_off, self.end);
        let Some(log) = self.channels.get_mut(channel) else {
            return;
        };
        if at + TOLERANCE >= log_off && log.next >= log.requests.len() {
            let answered = log.requests.iter().rposition(|r| !r.replies.is_empty());
            log.answer(answered.unwrap_or(usize::MAX), burst.end());
            return;
        }
        let uneven = log.uneven;
        let Some(index) = log.find(burst.bytes(), at, host.0) else {
            let late = at + TOLERANCE >= end;
            self.outcome.compare(late, 0, || {
                (
                    format!("nothing on channel {channel} at {at} ns"),
                    format!("sent {:02X?}", burst.bytes()),
                )
            });
            return;
        };
        let request = &log.requests[index];
        log.chatter += usize::from(request.is_chatter());
        let same = request.bytes == burst.bytes();
        self.outcome.compare(same, request.line, || {
            (
                format!("sent {:02X?}", request.bytes),
                format!("{:02X?}", burst.bytes()),
            )
        });
        let reference = if host.0 <= request.start && host.1 <= burst.start {
            log.reference.max(host)
        } else {
            log.reference
        };
        let expected = request.start.saturating_sub(reference.0);
        let actual = burst.start.saturating_sub(reference.1);
        let again = index < log.next;
        // A tie (index.txt): a DOIT meets a chatter frame, which one side still sends.
        let skipped = (log.uneven - uneven) as Nanos * log.chatter_period;
        let is_tie = skipped > 0 && (actual + skipped).abs_diff(expected) <= TOLERANCE;
        let close = again || is_tie || within_tolerance(expected, actual);
        self.outcome.compare(close, request.line, || {
            (
                format!("sent {expected} ns after the event before"),
                format!("{actual} ns"),
            )
        });
        log.next = log.next.max(index + 1);
        log.answer(index, burst.end());
    }

    fn receive(&mut self, channel: usize) -> Option<Burst> {
        let waiting = &mut self.channels.get_mut(channel)?.waiting;
        (!waiting.is_empty()).then(|| waiting.remove(0))
    }

    fn held_low(&mut self, channel: usize, now: Nanos) -> bool {
        let now = self.recorded_time(now);
        self.channels
            .get(channel)
            .and_then(|channel| channel.low_since)
            .is_some_and(|since| since <= now)
    }
}
