//! The UART of a remote: extracts characters from bursts of any baud rate.

use crate::wire::{Burst, Nanos};

/// Calls `take` for each character of `burst` that a receiver with bits of `bit` ns sees, with its
/// time: the middle of its stop bit.
pub(crate) fn receive(burst: &Burst, bit: Nanos, mut take: impl FnMut(Nanos, u8)) {
    if burst.is_break || burst.bit == 0 || bit == 0 {
        return;
    }
    // A receiver follows a rate that is off by up to 4 % without a sampling error.
    if burst.bit.abs_diff(bit) * 25 <= bit {
        for (index, &byte) in burst.bytes().iter().enumerate() {
            take(burst.end_of(index) - burst.bit / 2, byte);
        }
    } else {
        resample(burst, bit, take);
    }
}

/// Samples the waveform of the burst at another rate, like a receiver with a wrong setting.
fn resample(burst: &Burst, bit: Nanos, mut take: impl FnMut(Nanos, u8)) {
    let mut from = burst.start;
    while let Some(edge) = next(burst, from, false) {
        if level(burst, edge + bit / 2) {
            // A glitch of less than half a bit: not a start bit.
            from = edge + bit / 2;
            continue;
        }
        let sample = |n: Nanos| level(burst, edge + n * bit + bit / 2);
        let byte = (0..8).fold(0, |byte, n| byte | u8::from(sample(n + 1)) << n);
        let stop = edge + 9 * bit + bit / 2;
        if level(burst, stop) {
            take(stop, byte);
            from = stop;
        } else {
            // Framing error: wait until the line is high again.
            match next(burst, stop, true) {
                Some(high) => from = high,
                None => return,
            }
        }
    }
}

fn level(burst: &Burst, at: Nanos) -> bool {
    if at < burst.start {
        return true;
    }
    let index = (at - burst.start) / burst.bit;
    let byte = burst.bytes().get((index / 10) as usize);
    match (byte, index % 10) {
        (None, _) | (_, 9) => true,
        (_, 0) => false,
        (Some(byte), n) => byte >> (n - 1) & 1 != 0,
    }
}

/// The first time from `from` on at which the line is at `wanted`, before the end of the burst.
fn next(burst: &Burst, from: Nanos, wanted: bool) -> Option<Nanos> {
    let mut at = from;
    while at < burst.end() {
        if level(burst, at) == wanted {
            return Some(at);
        }
        at = burst.start + ((at - burst.start) / burst.bit + 1) * burst.bit;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all(burst: &Burst, bit: Nanos) -> Vec<(Nanos, u8)> {
        let mut seen = Vec::new();
        receive(burst, bit, |at, byte| seen.push((at, byte)));
        seen
    }

    #[test]
    fn same_rate_gives_the_characters_and_another_one_does_not() {
        let burst = Burst::new(1_000, 400, &[0xDF, 0x16]);
        assert_eq!(all(&burst, 400), [(4_800, 0xDF), (8_800, 0x16)]);
        // 115200 baud: the whole burst is shorter than one character.
        assert!(all(&burst, 8_680).iter().all(|&(_, byte)| byte != 0xDF));
    }

    proptest! {
        #[test]
        fn sampling_at_the_same_rate_is_reception(
            data in prop::collection::vec(any::<u8>(), 0..32), bit in 10..10_000u64,
        ) {
            let burst = Burst::new(77, bit, &data);
            let mut sampled = Vec::new();
            resample(&burst, bit, |_, byte| sampled.push(byte));
            prop_assert_eq!(sampled, data);
        }

        #[test]
        fn any_two_rates_end(
            data in prop::collection::vec(any::<u8>(), 0..32),
            sent in 0..10_000u64, received in 0..10_000u64,
        ) {
            let burst = Burst::new(77, sent, &data);
            let seen = all(&burst, received).len() as u64;
            prop_assert!(seen * 9 * received <= 10 * 32 * sent + 9 * received);
        }
    }
}
