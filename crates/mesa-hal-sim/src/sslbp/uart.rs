//! The UART of a channel: a transmitter and a receiver with FIFOs of 16 characters.

use crate::wire::{Burst, Nanos};

/// Receiver flag: a false start bit.
pub(super) const FALSE_START: u8 = 0x01;
/// Receiver flag: a character without a stop bit.
pub(super) const BREAK: u8 = 0x02;

const MAX_FIFO: usize = 32;
const MAX_QUEUED: usize = 8;

/// The bit-rate divider of both directions: bit rate = clock * register / 2^20.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct BitRate {
    register: u32,
    bit: Nanos,
    /// Time of nine and a half bits, in units of 2^-16 ns.
    zero: u64,
}

/// Bits behind the point of [`BitRate::zero`].
const FRACTION: u32 = 16;

impl BitRate {
    /// The divider that the firmware computes for `baud` at a clock of `hz`.
    pub fn new(baud: u32, hz: u32) -> Self {
        let register = ((u64::from(baud & 0x0FFF_FFFF) << 20) / u64::from(hz.max(1))) as u32;
        let register = register & 0x000F_FFFF;
        let bit = match register {
            0 => 0,
            r => ((1_000_000_000_u128 << 20) / (u128::from(r) * u128::from(hz.max(1)))) as Nanos,
        };
        let bits = (19 * 1_000_000_000_u128) << (20 + FRACTION);
        let steps = 2 * u128::from(register.max(1)) * u128::from(hz.max(1));
        Self {
            register,
            bit: bit.max(u64::from(register != 0)),
            zero: (bits / steps) as u64,
        }
    }

    /// Nanoseconds of one bit; zero for a stopped UART.
    pub fn bit(self) -> Nanos {
        self.bit
    }
}

/// The transmitter of a UART.
#[derive(Clone, Debug, Default)]
pub(super) struct Transmitter {
    queue: [Option<Burst>; 2],
}

impl Transmitter {
    /// Sends characters, the first of which is written at `now`. A full FIFO (`capacity` characters
    /// beside the one being shifted) loses its oldest waiting character for each further one: all
    /// are written before the first has left. FACTS 11.4. There is a short `gap` between
    /// characters, which the burst spreads over its bits so that it ends with the last character.
    pub fn send(&mut self, now: Nanos, rate: BitRate, gap: Nanos, bytes: &[u8], capacity: usize) {
        let free = self.queue.iter().flatten().map(Burst::end).max();
        let start = free.map_or(now, |end| end.max(now));
        // While another character is being shifted, the first one waits as well.
        let shifted = usize::from(start == now);
        let lost = bytes.len().saturating_sub(capacity + shifted);
        let head = bytes.get(..shifted).unwrap_or(bytes);
        let tail = bytes.get(shifted + lost..).unwrap_or(&[]);
        let length = (head.len() + tail.len()).max(1) as Nanos;
        let end = start + 10 * length * rate.bit() + (length - 1) * gap;
        let bit = (end - start) / (10 * length);
        let mut burst = Burst::new(end - 10 * length * bit, bit, head);
        for &byte in tail {
            burst.push(byte);
        }
        if let Some(slot) = self.queue.iter_mut().find(|slot| slot.is_none()) {
            *slot = Some(burst);
        }
    }

    /// Time at which the FIFO passes its last character to the shift register, if later than `now`.
    pub fn fifo_empty_after(&self, now: Nanos) -> Option<Nanos> {
        self.queue
            .iter()
            .flatten()
            .map(|burst| burst.end() - 10 * burst.bit)
            .filter(|&empty| empty > now)
            .max()
    }

    /// End of the burst in progress.
    pub fn next_end(&self) -> Option<Nanos> {
        self.queue.iter().flatten().map(Burst::end).min()
    }

    /// Takes the burst that ends first.
    pub fn take_ended(&mut self) -> Option<Burst> {
        let end = self.next_end()?;
        self.queue
            .iter_mut()
            .find(|slot| slot.is_some_and(|burst| burst.end() == end))?
            .take()
    }
}

/// The receiver of a UART.
///
/// Bursts are kept as they are on the line, and sampled like in the hardware, so that a wrong bit
/// rate or a break gives the same characters and flags.
#[derive(Clone, Debug)]
pub(super) struct Receiver {
    rate: BitRate,
    capacity: usize,
    fifo: [u8; MAX_FIFO],
    head: usize,
    count: usize,
    flags: u8,
    queue: [Option<Burst>; MAX_QUEUED],
    /// Time from which the receiver looks for the next start bit.
    idle_from: Nanos,
    /// The fraction of a nanosecond of this time, in units of 2^-16 ns. The zeros of a line that is
    /// held low do not follow each other in whole clocks, so that they meet every phase of the
    /// firmware's passes in time. T:w07.
    idle_fraction: u64,
    /// The last time span in which the line was held low.
    low: Option<Low>,
    /// Time from the middle of a stop bit until the character is counted.
    delay: Nanos,
    /// Time before which the line as known gives nothing.
    nothing_before: Nanos,
}

/// A time span in which the line is held low.
#[derive(Clone, Copy, Debug)]
struct Low {
    since: Nanos,
    until: Option<Nanos>,
}

impl Receiver {
    /// A receiver with a FIFO of `capacity` characters (at most 32) that counts a character
    /// `delay` after the middle of its stop bit.
    pub fn new(capacity: usize, delay: Nanos) -> Self {
        Self {
            rate: BitRate::default(),
            capacity: capacity.min(MAX_FIFO),
            fifo: [0; MAX_FIFO],
            head: 0,
            count: 0,
            flags: 0,
            queue: [None; MAX_QUEUED],
            idle_from: 0,
            idle_fraction: 0,
            low: None,
            delay,
            nothing_before: 0,
        }
    }

    /// Sets the bit rate.
    pub fn set_rate(&mut self, rate: BitRate) {
        self.rate = rate;
        self.nothing_before = 0;
    }

    /// Queues a burst that arrives along the line; lost if the queue is full.
    pub fn expect(&mut self, burst: Burst) {
        self.nothing_before = 0;
        if let Some(slot) = self.queue.iter_mut().find(|slot| slot.is_none()) {
            *slot = Some(burst);
        }
    }

    /// Holds the line low from `now` on, or releases it. The part of a burst in that time is lost.
    pub fn hold_low(&mut self, now: Nanos, low: bool) {
        let is_held = self.low.is_some_and(|low| low.until.is_none());
        match (low, &mut self.low) {
            (true, _) if !is_held => {
                self.listen(now);
                self.low = Some(Low {
                    since: now,
                    until: None,
                });
            }
            (false, Some(held)) if is_held => held.until = Some(now),
            _ => return,
        }
        self.nothing_before = 0;
    }

    /// Number of characters in the FIFO at `now`.
    pub fn count(&mut self, now: Nanos) -> usize {
        self.listen(now);
        self.count
    }

    /// The flags at `now`.
    pub fn flags(&mut self, now: Nanos) -> u8 {
        self.listen(now);
        self.flags
    }

    /// Takes the oldest character; 0 if the FIFO is empty.
    pub fn pop(&mut self) -> u8 {
        if self.count == 0 {
            return 0;
        }
        let byte = self.fifo.get(self.head).copied().unwrap_or(0);
        self.head = (self.head + 1) % MAX_FIFO;
        self.count -= 1;
        byte
    }

    /// Empties the FIFO at `now`.
    pub fn clear(&mut self, now: Nanos) {
        self.listen(now);
        self.count = 0;
    }

    /// Clears the flags at `now`.
    pub fn clear_flags(&mut self, now: Nanos) {
        self.listen(now);
        self.flags = 0;
    }

    /// Adds a character; a full FIFO loses its oldest one. FACTS 11.4.
    fn push(&mut self, byte: u8) {
        if self.count >= self.capacity {
            self.pop();
        }
        let tail = (self.head + self.count) % MAX_FIFO;
        if let Some(slot) = self.fifo.get_mut(tail) {
            *slot = byte;
        }
        self.count += 1;
    }

    /// Receives all characters with a stop bit sampled up to `now`.
    fn listen(&mut self, now: Nanos) {
        let bit = self.rate.bit();
        if bit == 0 || now < self.nothing_before {
            return;
        }
        self.nothing_before = self.receive(now, bit);
    }

    /// Receives up to `now`; returns the time before which nothing more comes.
    fn receive(&mut self, now: Nanos, bit: Nanos) -> Nanos {
        let character = 9 * bit + bit / 2;
        // Bounded: each iteration advances by at least half a bit, and a line held low is one
        // iteration.
        while let Some(edge) = self.next_edge() {
            let zeros = self.zeros(edge, now);
            if zeros > 0 {
                for _ in 0..zeros.min(self.capacity as u64) {
                    self.push(0);
                }
                self.flags |= BREAK;
                let after = zeros * self.rate.zero + self.fraction(edge);
                self.idle_from = edge + (after >> FRACTION);
                self.idle_fraction = after & ((1 << FRACTION) - 1);
                continue;
            }
            let burst = self.oldest();
            let sample = |n: u64| {
                let time = edge + n * bit + bit / 2;
                burst.is_none_or(|burst| level(&burst, time)) && !self.is_low(time)
            };
            if sample(0) {
                if edge + bit / 2 > now {
                    return edge + bit / 2;
                }
                self.flags |= FALSE_START;
                self.idle_from = edge + bit / 2;
                self.idle_fraction = 0;
                continue;
            }
            let end = if self.is_low(edge) {
                edge + ((self.rate.zero + self.fraction(edge)) >> FRACTION) + 1
            } else {
                edge + character
            };
            if end + self.delay > now {
                return end + self.delay;
            }
            let byte = (1..=8).fold(0, |byte, n| byte >> 1 | u8::from(sample(n)) << 7);
            let has_stop_bit = sample(9);
            self.push(byte);
            if !has_stop_bit {
                self.flags |= BREAK;
            }
            self.idle_from = end;
            self.idle_fraction = 0;
        }
        Nanos::MAX
    }

    /// Time from `idle_from` on at which the line goes low next, or is already low.
    fn next_edge(&mut self) -> Option<Nanos> {
        let of_low = self.low.and_then(|low| {
            let edge = low.since.max(self.idle_from);
            low.until.is_none_or(|until| edge < until).then_some(edge)
        });
        while let Some(burst) = self.oldest() {
            if let Some(of_burst) = low_from(&burst, self.idle_from) {
                return Some(of_low.map_or(of_burst, |edge| edge.min(of_burst)));
            }
            self.remove(&burst);
        }
        of_low
    }

    /// The fraction of a nanosecond by which a character that begins at `edge` begins later.
    fn fraction(&self, edge: Nanos) -> u64 {
        if edge == self.idle_from {
            self.idle_fraction
        } else {
            0
        }
    }

    /// Number of characters that begin at `edge`, are held low throughout, and are received up to
    /// `now`.
    fn zeros(&self, edge: Nanos, now: Nanos) -> u64 {
        let Some(low) = self.low.filter(|low| low.since <= edge) else {
            return 0;
        };
        let zeros_in = |span: Nanos| {
            let span = u128::from(span) << FRACTION;
            let left = span.saturating_sub(self.fraction(edge).into());
            (left / u128::from(self.rate.zero.max(1))) as u64
        };
        let received = zeros_in(now.saturating_sub(self.delay + edge));
        // The stop bit is sampled before the line rises.
        let held = low
            .until
            .map_or(Nanos::MAX, |until| zeros_in(until.saturating_sub(edge + 1)));
        received.min(held)
    }

    /// True if the line is held low at `time`.
    fn is_low(&self, time: Nanos) -> bool {
        self.low
            .is_some_and(|low| low.since <= time && low.until.is_none_or(|until| time < until))
    }

    fn oldest(&self) -> Option<Burst> {
        self.queue
            .iter()
            .flatten()
            .min_by_key(|burst| burst.start)
            .copied()
    }

    fn remove(&mut self, burst: &Burst) {
        if let Some(slot) = self
            .queue
            .iter_mut()
            .find(|slot| slot.as_ref() == Some(burst))
        {
            *slot = None;
        }
    }
}

/// The level of the line at `time` with only `burst` on it.
fn level(burst: &Burst, time: Nanos) -> bool {
    if time < burst.start || time >= burst.end() || burst.bit == 0 {
        return true;
    }
    if burst.is_break {
        return false;
    }
    let bit = (time - burst.start) / burst.bit;
    let byte = burst
        .bytes()
        .get((bit / 10) as usize)
        .copied()
        .unwrap_or(0xFF);
    match bit % 10 {
        0 => false,
        9 => true,
        n => byte >> (n - 1) & 1 == 1,
    }
}

/// The first time from `from` on at which the line is low.
fn low_from(burst: &Burst, from: Nanos) -> Option<Nanos> {
    let mut time = from.max(burst.start);
    while time < burst.end() {
        if !level(burst, time) {
            return Some(time);
        }
        let bit = (time - burst.start) / burst.bit.max(1);
        time = burst.start + (bit + 1) * burst.bit.max(1);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn receiver(baud: u32) -> Receiver {
        let mut receiver = Receiver::new(16, 0);
        receiver.set_rate(BitRate::new(baud, 100_000_000));
        receiver
    }

    #[test]
    fn characters_arrive_in_the_middle_of_their_stop_bits() {
        let mut receiver = receiver(2_500_000);
        receiver.expect(Burst::new(1_000, 400, &[0x5A, 0xA5]));
        assert_eq!(receiver.count(4_700), 0);
        assert_eq!(receiver.count(4_810), 1);
        assert_eq!(receiver.count(8_900), 2);
        assert_eq!((receiver.pop(), receiver.pop()), (0x5A, 0xA5));
        assert_eq!(receiver.flags(8_900), 0);
    }

    #[test]
    fn full_fifo_loses_its_oldest_character() {
        let mut receiver = receiver(2_500_000);
        let bytes: [u8; 17] = core::array::from_fn(|n| n as u8);
        receiver.expect(Burst::new(0, 400, &bytes));
        assert_eq!(receiver.count(1_000_000), 16);
        for n in 1..17 {
            assert_eq!(receiver.pop(), n);
        }
    }

    #[test]
    fn break_gives_zeros_and_its_flag() {
        let mut receiver = receiver(2_500_000);
        let mut burst = Burst::new(0, 400, &[0; 3]);
        burst.is_break = true;
        receiver.expect(burst);
        // Thirty bit times low are three characters of nine and a half, and a start bit.
        assert_eq!(receiver.count(100_000), 4);
        assert_eq!([receiver.pop(), receiver.pop(), receiver.pop()], [0; 3]);
        assert_eq!(receiver.flags(100_000), BREAK);
    }

    #[test]
    fn line_held_low_never_stops_giving_zeros() {
        let mut receiver = receiver(2_500_000);
        receiver.hold_low(0, true);
        assert_eq!(receiver.count(8_000), 2);
        assert_eq!(receiver.count(1_000_000), 16);
        receiver.hold_low(1_000_000, false);
        // The character in progress still ends.
        receiver.clear(1_004_000);
        assert_eq!(receiver.count(2_000_000), 0);
    }

    #[test]
    fn line_that_goes_low_inside_a_burst_takes_the_rest_of_it() {
        let mut receiver = receiver(2_500_000);
        receiver.expect(Burst::new(1_000, 400, &[0x5A; 4]));
        // In the start bit of the third character.
        receiver.hold_low(9_100, true);
        assert_eq!(receiver.count(20_000), 4);
        let received: [u8; 4] = core::array::from_fn(|_| receiver.pop());
        assert_eq!(received, [0x5A, 0x5A, 0, 0]);
        assert_eq!(receiver.flags(20_000), BREAK);
    }

    #[test]
    fn brief_low_on_the_line_damages_the_character_it_meets() {
        let mut receiver = receiver(2_500_000);
        receiver.expect(Burst::new(1_000, 400, &[0x5A, 0xFF, 0xA5]));
        // Bits 2 and 3 of the second character.
        receiver.hold_low(6_100, true);
        receiver.hold_low(7_000, false);
        assert_eq!(receiver.count(20_000), 3);
        let received: [u8; 3] = core::array::from_fn(|_| receiver.pop());
        assert_eq!(received, [0x5A, 0xF3, 0xA5]);
        assert_eq!(receiver.flags(20_000), 0);
    }

    #[test]
    fn wrong_bit_rate_does_not_give_the_right_characters() {
        let mut receiver = receiver(115_200);
        receiver.expect(Burst::new(0, 400, &[0x5A, 0xA5]));
        assert_eq!(receiver.count(1_000_000), 1);
        assert_ne!(receiver.pop(), 0x5A);
    }

    #[test]
    fn bit_rate_is_that_of_the_divider() {
        assert_eq!(BitRate::new(2_500_000, 100_000_000).bit(), 400);
        assert_eq!(BitRate::new(115_200, 100_000_000).bit(), 8_687);
        assert_eq!(BitRate::new(0, 100_000_000).bit(), 0);
    }
}
