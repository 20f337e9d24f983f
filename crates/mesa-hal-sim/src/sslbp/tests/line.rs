//! Characters at the wrong time, and a line that goes low. FACTS 11.8, 11.12.

use super::{Bench, MS, REMOTE, US};
use crate::sslbp::{Lines, Register, SslbpPort};
use crate::wire::{Burst, Nanos};

const EXTRA: u32 = 0x10;
const OVERRUN: u32 = 0x04;
/// The local variable of channel 0 that counts overruns.
const OVERRUNS: u32 = 0x70 + 0x16;
/// A character on a line held low: nine bits and a half of 401 ns.
const CHARACTER: Nanos = 3_809;
/// One clock cycle.
const CYCLE: Nanos = 10;

/// A line that is held low, or an idle one.
struct Held(bool);

impl Lines for Held {
    fn transmit(&mut self, _channel: usize, _burst: &Burst) {}

    fn receive(&mut self, _channel: usize) -> Option<Burst> {
        None
    }

    fn held_low(&mut self, channel: usize, _now: Nanos) -> bool {
        self.0 && channel == 0
    }
}

/// A remote that replies to each request with valid process data, and sends one stray burst.
struct Answering {
    reply: Option<Burst>,
    stray: Option<Burst>,
}

impl Lines for Answering {
    fn transmit(&mut self, _channel: usize, burst: &Burst) {
        let reply = [0x00, 0x11, 0x22, 0x33, 0x44, 0x33];
        self.reply = Some(Burst::new(burst.end() + 10 * US, 400, &reply));
    }

    fn receive(&mut self, _channel: usize) -> Option<Burst> {
        self.reply.take().or_else(|| self.stray.take())
    }
}

/// A port of one channel with a running remote, after its first DOIT.
fn running() -> (SslbpPort, Nanos) {
    let mut bench = Bench::new(super::PortConfig::new(1, 100_000_000), &[REMOTE]);
    bench.start(0x0901);
    for _ in 0..2 {
        assert!(bench.command(0x1001, MS).is_some());
        bench.wait(200 * US);
    }
    assert_eq!(bench.read(Register::Cs(0)), 0x0042_0000);
    (bench.port, bench.now)
}

/// Writes a command at `at`; returns the time at which COMMAND reads 0 again.
fn command(port: &mut SslbpPort, at: Nanos, command: u32, lines: &mut dyn Lines) -> Nanos {
    port.advance(at, lines);
    port.write(at, Register::Command, command);
    let mut now = at;
    loop {
        now += 100;
        port.advance(now, lines);
        if port.read(now, Register::Command) == 0 {
            return now + 100;
        }
        assert!(now < at + MS, "the command never ends");
    }
}

/// Local error bits after a DOIT during which stray `characters` arrive, for each clock cycle
/// around the time of sending in which the last of them can complete.
fn errors_by_phase(characters: &[u8]) -> Vec<u32> {
    let (original, now) = running();
    let (first, second) = (now + 10 * US, now + 300 * US);
    let length = 4 * US * characters.len() as Nanos;
    let phases = 0..600;
    phases
        .map(|phase| {
            let mut port = original.clone();
            let stray = Burst::new(second - length + phase * CYCLE, 400, characters);
            let mut lines = Answering {
                reply: None,
                stray: Some(stray),
            };
            command(&mut port, first, 0x1001, &mut lines);
            let end = command(&mut port, second, 0x1001, &mut lines);
            port.advance(end + 10 * US, &mut lines);
            port.read(end + 10 * US, Register::Cs(0)) & (EXTRA | OVERRUN)
        })
        .collect()
}

#[test]
fn character_overruns_only_within_50_ns_after_an_empty_poll() {
    let errors = errors_by_phase(&[0xA5]);
    let count = |bits| errors.iter().filter(|&&found| found == bits).count();
    assert_eq!(count(OVERRUN), 5, "cycles of 10 ns");
    assert_eq!(count(OVERRUN | EXTRA), 0);
    assert!(count(EXTRA) > 50, "a character that waits is an extra one");
    let first = errors.iter().position(|&found| found == OVERRUN);
    let last_extra = errors.iter().rposition(|&found| found == EXTRA);
    assert_eq!(first, last_extra.map(|last| last + 1), "right after it");
}

#[test]
fn behind_a_character_that_waits_it_is_one_within_20_ns() {
    let errors = errors_by_phase(&[0xA5, 0xA5]);
    let both = errors.iter().filter(|&&found| found == EXTRA | OVERRUN);
    assert_eq!(both.count(), 2, "cycles of 10 ns");
}

#[test]
fn phase_of_characters_decides_overruns_on_a_line_held_low() {
    let (original, now) = running();
    let phases = CHARACTER.div_ceil(CYCLE);
    let hits = (0..phases).filter(|phase| {
        let mut port = original.clone();
        let low = now + 10 * US + phase * CYCLE;
        port.advance(low, &mut Held(false));
        let mut lines = Held(true);
        let end = command(&mut port, now + 200 * US, 0x1001, &mut lines);
        let cs = port.read(end, Register::Cs(0));
        assert_eq!(cs & EXTRA, EXTRA, "{cs:08X}");
        cs & OVERRUN != 0
    });
    let hits = hits.count();
    assert!((2..=3).contains(&hits), "{hits} of {phases} phases");
}

/// About 0.5 %, the first after some 180.
#[test]
fn line_held_low_gives_an_overrun_in_one_of_200_doits() {
    const DOITS: u32 = 4_000;
    let (mut port, mut now) = running();
    let mut lines = Held(true);
    let mut random = 0x0BAD_5EED_u64;
    let mut overruns = 0;
    for _ in 0..DOITS {
        // The multiplier is Knuth's.
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let pause = 150 * US + (random >> 33) % 50_000;
        let end = command(&mut port, now + pause, 0x1001, &mut lines);
        let end = command(&mut port, end + 100 * US, 0x2000 | OVERRUNS, &mut lines);
        if port.read(end, Register::Data) != 0 {
            overruns += 1;
            port.write(end, Register::Data, 0);
            now = command(&mut port, end + US, 0xA000 | OVERRUNS, &mut lines);
        } else {
            now = end;
        }
    }
    assert!((8..=36).contains(&overruns), "{overruns} of {DOITS}");
}

#[test]
fn line_that_goes_low_inside_a_reply_takes_the_reply() {
    // The reply of six characters begins 10 us after the end of the request.
    for inside in [12, 20, 33] {
        let mut bench = Bench::eight(&[REMOTE]);
        bench.start(0x0901);
        assert!(bench.command(0x1001, MS).is_some());
        bench.wait(200 * US);
        bench.lines.sent.clear();
        bench.write(Register::Command, 0x1001);
        while bench.lines.sent.is_empty() {
            bench.wait(US);
        }
        let end = bench.lines.sent[0].1.end();
        bench.wait(end + inside * US - bench.now);
        bench.lines.low = Some(0);
        bench.wait(MS);
        assert_eq!(bench.read(Register::Command), 0);
        assert_eq!(bench.read(Register::Data), 1, "{inside} us");
        assert_eq!(
            bench.read(Register::Cs(0)) & 0x0000_FFFF,
            0x2028,
            "break and timeout, {inside} us"
        );
    }
}

#[test]
fn line_that_is_low_again_before_the_reply_does_no_harm() {
    let mut bench = Bench::eight(&[REMOTE]);
    bench.start(0x0901);
    assert!(bench.command(0x1001, MS).is_some());
    bench.wait(200 * US);
    bench.lines.low = Some(0);
    bench.wait(5 * US);
    bench.lines.low = None;
    bench.wait(100 * US);
    // Characters that wait in the FIFO cost a single DOIT.
    let results: Vec<u32> = (0..3)
        .map(|_| {
            assert!(bench.command(0x1001, MS).is_some());
            bench.wait(200 * US);
            bench.read(Register::Data)
        })
        .collect();
    assert_eq!(results[1..], [0, 0]);
}
