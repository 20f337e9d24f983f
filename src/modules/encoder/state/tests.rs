mod outages;

use super::*;
use proptest::prelude::*;

const HZ: f64 = 1e6;

/// Time stamps in microseconds, and this number of samples per second.
const fn rates(sample_hz: f64) -> EncoderRates {
    EncoderRates {
        tick_hz: HZ,
        sample_hz,
    }
}

/// The registers that the hardware would show: a wide counter, and the time of its last change.
#[derive(Default)]
struct Hardware {
    count: i64,
    changed_us: u64,
    now_us: u64,
    control: u32,
}

impl Hardware {
    fn sample(&self) -> EncoderSample {
        EncoderSample {
            count: u32::from(self.count as u16) | (u32::from(self.changed_us as u16) << 16),
            control: self.control,
            timestamp: self.now_us as u16,
            asked: Instant::from_nanos(self.now_us * 1_000),
            at: Instant::from_nanos(self.now_us * 1_000),
        }
    }

    fn step(&mut self, change: i64, us: u64) -> EncoderSample {
        self.now_us += us;
        self.count += change;
        if change != 0 {
            self.changed_us = self.now_us;
        }
        self.sample()
    }
}

fn encoder() -> EncoderState {
    of_kind(false)
}

fn of_kind(is_muxed: bool) -> EncoderState {
    let config = EncoderConfig {
        mode: 0x1808,
        scale: 100.0,
        idle_time: 0.5,
    };
    EncoderState::new(config, is_muxed)
}

const RESET: Outage = Outage {
    was_reset: true,
    has_released: true,
    was_replaced: false,
    last_feed: None,
    shows_bite: false,
};

const BITE: Outage = Outage {
    was_reset: false,
    shows_bite: true,
    ..RESET
};

proptest! {
    #[test]
    fn counts_follow_a_wide_counter_over_any_walk(
        start: i64,
        steps in prop::collection::vec((-32_767i64..=32_767, 1u64..200_000), 1..200),
    ) {
        let mut hardware = Hardware { count: start >> 20, ..Hardware::default() };
        let mut encoder = encoder();
        let first = encoder.read(hardware.sample());
        prop_assert_eq!(first.rawcounts, 0);
        let start = hardware.count;
        for (change, us) in steps {
            let reading = encoder.read(hardware.step(change, us));
            prop_assert_eq!(reading.rawcounts, hardware.count - start);
            prop_assert_eq!(reading.count, reading.rawcounts);
            prop_assert!(reading.velocity.is_finite());
        }
    }

    #[test]
    fn any_words_give_finite_values(words in prop::collection::vec(any::<(u32, u32, u16, u32)>(), 1..50)) {
        let mut encoder = encoder();
        let mut at = Instant::default();
        encoder.latch.request(LatchRequest::Index);
        for (count, control, timestamp, ns) in words {
            at = at.after(core::time::Duration::from_nanos(u64::from(ns)));
            let reading = encoder.read(EncoderSample {
                count, control, timestamp, asked: at, at,
            });
            prop_assert!(reading.position.is_finite() && reading.velocity.is_finite());
        }
    }
}

/// Runs an encoder at a constant speed in counts/s, sampled each millisecond.
fn run_at(speed: f64, seconds: f64) -> f64 {
    let mut hardware = Hardware::default();
    let mut encoder = encoder();
    let mut velocity = encoder.read(hardware.sample()).velocity;
    for ms in 1..=(seconds * 1e3) as u64 {
        let us = ms * 1_000;
        hardware.now_us = us;
        let count = (speed * us as f64 / 1e6).floor() as i64;
        if count != hardware.count {
            // The time of the last count, as a stamp of whole microseconds.
            let edge = if speed > 0.0 { count } else { count + 1 };
            hardware.changed_us = (edge as f64 / speed * 1e6).ceil() as u64;
            hardware.count = count;
        }
        velocity = encoder.read(hardware.sample()).velocity * 100.0;
    }
    velocity
}

#[test]
fn constant_speed_is_measured_from_below_one_count_per_cycle_up() {
    for speed in [5.0, 37.0, 999.0, 12_345.0, 1e6, -5.0, -37.0, -20_000.0] {
        let velocity = run_at(speed, 2.0);
        assert!(
            (velocity - speed).abs() < speed.abs() * 0.01,
            "{speed}: {velocity}"
        );
    }
}

#[test]
fn velocity_is_right_after_missed_cycles_beyond_a_stamp_wrap() {
    let mut hardware = Hardware::default();
    let mut encoder = encoder();
    encoder.read(hardware.sample());
    encoder.read(hardware.step(10, 1_000));
    // 100 counts in 0.3 s, and four wraps of the time stamps.
    let reading = encoder.read(hardware.step(100, 300_000));
    assert!((reading.velocity * 100.0 - 100.0 / 0.3).abs() < 1.0);
}

#[test]
fn index_enable_zeroes_the_count_where_the_index_was() {
    let mut hardware = Hardware::default();
    let mut encoder = encoder();
    encoder.read(hardware.step(65_000, 1_000));
    encoder.latch.request(LatchRequest::Index);
    hardware.control = encoder.control();
    assert_eq!(hardware.control & 0xFFFF, 0x1858);
    let before = encoder.read(hardware.step(100, 1_000));
    assert_eq!(
        (before.count, encoder.latch.wanted),
        (100, LatchRequest::Index)
    );
    // 1000 counts on; the index was 30 counts before the end, beyond the wrap at 65536.
    let sample = hardware.step(1_000, 1_000);
    let latched = (hardware.count - 30) as u16;
    hardware.control = (0x1848) | (u32::from(latched) << 16);
    let reading = encoder.read(EncoderSample {
        control: hardware.control,
        ..sample
    });
    assert_eq!(reading.count, 30);
    assert_eq!(reading.rawcounts, 1_100);
    assert_eq!(reading.latched, Some(0));
    assert_eq!(encoder.latch.wanted, LatchRequest::None);
    assert_eq!(encoder.control(), 0x1808);
}

#[test]
fn index_within_the_first_cycle_is_seen() {
    let mut hardware = Hardware::default();
    let mut encoder = encoder();
    encoder.read(hardware.sample());
    encoder.latch.request(LatchRequest::Index);
    hardware.control = 0x1848 | (5 << 16);
    assert_eq!(encoder.read(hardware.step(8, 1_000)).count, 3);
}

#[test]
fn lost_write_of_the_control_word_is_no_index() {
    let mut hardware = Hardware::default();
    let mut encoder = encoder();
    encoder.read(hardware.sample());
    encoder.latch.request(LatchRequest::Index);
    hardware.control = 0x1808;
    for _ in 0..5 {
        encoder.read(hardware.step(10, 1_000));
        assert_eq!(encoder.latch.wanted, LatchRequest::Index);
        assert_eq!(encoder.control(), 0x1858);
    }
}

#[test]
fn end_of_one_request_is_not_taken_for_the_end_of_the_next() {
    let mut hardware = Hardware::default();
    let mut encoder = encoder();
    encoder.read(hardware.sample());
    encoder.latch.request(LatchRequest::Index);
    hardware.control = 0x1848 | (5 << 16);
    encoder.read(hardware.step(8, 1_000));
    // Requested again at once, while the register still shows the end of the first request.
    encoder.latch.request(LatchRequest::Index);
    assert_eq!(encoder.control(), 0x1808);
    encoder.read(hardware.step(8, 1_000));
    assert_eq!(encoder.latch.wanted, LatchRequest::Index);
    hardware.control = 0x1808 | (5 << 16);
    encoder.read(hardware.step(8, 1_000));
    assert_eq!(encoder.latch.wanted, LatchRequest::Index);
    assert_eq!(encoder.control(), 0x1858);
    hardware.control = 0x1848 | (20 << 16);
    let reading = encoder.read(hardware.step(8, 1_000));
    assert_eq!((reading.rawcounts, reading.count), (32, 12));
}

#[test]
fn probe_latches_and_leaves_the_count_alone() {
    let mut hardware = Hardware::default();
    let mut encoder = encoder();
    encoder.read(hardware.sample());
    encoder.latch.request(LatchRequest::Probe);
    hardware.control = encoder.control();
    encoder.read(hardware.step(10, 1_000));
    hardware.control = 0x1848 | (15 << 16);
    let reading = encoder.read(hardware.step(10, 1_000));
    assert_eq!((reading.count, reading.latched), (20, Some(15)));
}

#[test]
fn reset_zeroes_count_and_not_rawcounts() {
    let mut hardware = Hardware::default();
    let mut encoder = encoder();
    encoder.read(hardware.sample());
    encoder.read(hardware.step(250, 1_000));
    encoder.reset();
    let reading = encoder.read(hardware.step(-50, 1_000));
    assert_eq!((reading.rawcounts, reading.count), (200, -50));
    assert!((reading.position + 0.5).abs() < 1e-12);
}

/// An encoder that has run at this number of counts in a millisecond.
fn running(counts: i64) -> (EncoderState, Hardware) {
    let (mut encoder, mut hardware) = (encoder(), Hardware::default());
    encoder.set_rates(rates(6e6));
    hardware.control = 0x1808;
    for _ in 0..200 {
        let reading = encoder.read(hardware.step(counts, 1_000));
        assert!(!reading.is_unsure);
    }
    (encoder, hardware)
}

/// An encoder whose request for its index was seen in the control register, at count 0.
fn armed() -> (EncoderState, Hardware) {
    let (mut encoder, mut hardware) = (encoder(), Hardware::default());
    encoder.read(hardware.sample());
    encoder.latch.request(LatchRequest::Index);
    hardware.control = 0x1858;
    encoder.read(hardware.step(10, 1_000));
    (encoder, hardware)
}

#[test]
fn late_write_without_request_is_no_index_and_request_repeats() {
    let (mut encoder, mut hardware) = armed();
    assert!(!encoder.latch.is_unsettled());
    hardware.control = 0x1808;
    let reading = encoder.read(hardware.step(10, 1_000));
    assert_eq!((reading.count, reading.latched), (20, None));
    assert_eq!(encoder.latch.wanted, LatchRequest::Index);
    assert_eq!(
        (encoder.control(), encoder.latch.is_unsettled()),
        (0x1858, true)
    );
    hardware.control = 0x1848 | 25 << 16;
    assert_eq!(encoder.read(hardware.step(10, 1_000)).count, 5);
}

#[test]
fn late_write_of_a_probe_request_is_no_index() {
    for control in [0x3848, 0x3848 | 15 << 16, 0x1868, 0x1878, 0x1818] {
        let (mut encoder, mut hardware) = armed();
        hardware.control = control;
        let reading = encoder.read(hardware.step(10, 1_000));
        assert_eq!((reading.count, reading.latched), (20, None), "{control:#x}");
        // The other request has to be gone before this one is written again.
        assert_eq!(
            (encoder.control(), encoder.latch.is_unsettled()),
            (0x1808, true)
        );
    }
}

#[test]
fn latch_that_was_armed_again_after_it_was_taken_is_taken() {
    let (mut encoder, mut hardware) = armed();
    hardware.control = 0x1858 | 15 << 16;
    let reading = encoder.read(hardware.step(10, 1_000));
    assert_eq!((reading.count, reading.latched), (5, Some(0)));
    assert_eq!(encoder.latch.wanted, LatchRequest::None);
}

#[test]
fn end_of_an_old_request_is_not_taken_in_a_disturbed_exchange() {
    for (disturbed, ended) in [(false, true), (true, false)] {
        let (mut encoder, mut hardware) = armed();
        hardware.control = 0x1848 | 15 << 16;
        encoder.read(hardware.step(10, 1_000));
        hardware.control = 0x1808 | 15 << 16;
        encoder.read(hardware.step(10, 1_000));
        encoder.latch.request(LatchRequest::Index);
        // The end of this request, or that of a duplicate of the previous one.
        hardware.control = 0x1848 | 35 << 16;
        encoder.latch.is_doubtful = disturbed;
        encoder.read(hardware.step(10, 1_000));
        assert_eq!(encoder.latch.wanted == LatchRequest::None, ended);
        assert_eq!(encoder.control(), 0x1808);
    }
}

#[test]
fn doubt_makes_muxed_counts_unsure_while_set_up_may_be_repeated() {
    // The index is in the doubtful exchange, in the next one, or later.
    for (later, is_unsure) in [(0, true), (1, true), (2, false), (3, false)] {
        let (mut encoder, mut hardware) = armed();
        encoder.is_muxed = true;
        for read in 0..=later {
            encoder.latch.is_doubtful = read == 0;
            let has_come = read == later;
            let latched = hardware.count as u32;
            hardware.control = if has_come {
                0x1848 | latched << 16
            } else {
                0x1858
            };
            let reading = encoder.read(hardware.step(10, 1_000));
            assert_eq!(reading.index_came, has_come, "{later}");
            assert_eq!(reading.is_unsure, is_unsure || !has_come, "{later}, {read}");
        }
    }
    let (mut encoder, mut hardware) = armed();
    encoder.latch.is_doubtful = true;
    assert!(!encoder.read(hardware.step(10, 1_000)).is_unsure, "plain");
    encoder.is_muxed = true;
    for _ in 0..HORIZON {
        let _ = encoder.read(hardware.step(0, 1_000));
    }
    encoder.latch.is_doubtful = true;
    assert!(!encoder.read(hardware.step(0, 1_000)).is_unsure, "too old");
}

proptest! {
    /// An encoder that skips reads without news gives the same readings as one that evaluates every
    /// read.
    #[test]
    fn read_that_is_passed_over_would_have_changed_nothing(
        steps in prop::collection::vec(
            (
                prop_oneof![6 => Just(0), 1 => -40i64..=40],
                prop_oneof![9 => Just(1_000u64), 1 => 1u64..60_000],
                prop_oneof![40 => Just(None), 1 => (0u8..8).prop_map(Some)],
                prop::bool::weighted(0.02),
                prop::bool::weighted(0.2),
            ),
            100..700,
        ),
    ) {
        let mut hardware = Hardware::default();
        let (mut close, mut restful) = (encoder(), encoder());
        for state in [&mut close, &mut restful] {
            state.set_rates(rates(6e6));
        }
        let mut shown = EncoderReading::default();
        let mut latched = 0;
        for (change, us, what, error, latches) in steps {
            for state in [&mut close, &mut restful] {
                match what {
                    Some(0) => state.reset(),
                    Some(1) => state.latch.request(LatchRequest::Index),
                    Some(2) => state.latch.request(LatchRequest::None),
                    Some(3) => state.set_up_again(&BITE),
                    Some(7) => state.set_up_again(&RESET),
                    Some(4) => {
                        state.watches_errors ^= true;
                        state.is_awake = true;
                    }
                    Some(5) => (state.latch.is_doubtful, state.latch.is_repeated) = (true, true),
                    Some(6) => state.latch.request(LatchRequest::Probe),
                    _ => {}
                }
            }
            let mut control = close.control() & 0x7FFF | u32::from(error) << 15;
            let enables = bits::LATCH_ON_INDEX | bits::LATCH_ON_PROBE;
            if latches && control & enables != 0 {
                control &= !enables;
                latched = u32::from(hardware.count as u16);
            }
            hardware.control = control | latched << 16;
            prop_assert_eq!(close.control(), restful.control());
            prop_assert_eq!(close.latch.is_unsettled(), restful.latch.is_unsettled());
            let sample = hardware.step(change, us);
            let reading = close.read(sample);
            if !restful.rests(&sample) {
                shown = restful.read(sample);
            }
            prop_assert_eq!(reading, shown);
        }
    }
}

#[test]
fn reset_held_at_standstill_clears_the_unsure_state() {
    let (mut hardware, mut encoder) = (Hardware::default(), encoder());
    encoder.set_rates(rates(6e6));
    // Until no packet of the set-up is in flight.
    for _ in 0..=HORIZON {
        let _ = encoder.read(hardware.step(0, 1_000));
    }
    encoder.reset();
    let next = hardware.step(0, 1_000);
    assert!(encoder.rests(&next), "it was at 0");
    encoder.read(hardware.step(1, 60_000_000));
    assert!(encoder.read(hardware.step(0, 1_000)).is_unsure);
    // Until its velocity is 0.
    for _ in 0..600 {
        let _ = encoder.read(hardware.step(0, 1_000));
    }
    encoder.reset();
    let next = hardware.step(0, 1_000);
    assert!(!encoder.rests(&next));
    assert!(!encoder.read(next).is_unsure);
}

#[test]
fn encoder_that_stands_still_is_passed_over() {
    let (mut hardware, mut encoder) = (Hardware::default(), encoder());
    encoder.set_rates(rates(6e6));
    for _ in 0..1_000 {
        let _ = encoder.read(hardware.step(0, 1_000));
    }
    assert!(encoder.rests(&hardware.step(0, 1_000)));
    assert!(!encoder.rests(&hardware.step(1, 1_000)), "it moved");
    for ms in 0..502 {
        let _ = encoder.read(hardware.step(0, 1_000));
        let next = hardware.step(0, 1_000);
        if !(240..260).contains(&ms) {
            let rests = encoder.clone().rests(&next);
            assert_eq!(rests, ms >= 260, "{ms}: velocity decays for half a second");
        }
        let _ = encoder.read(next);
    }
    encoder.is_awake = true;
    assert!(
        !encoder.rests(&hardware.step(0, 1_000)),
        "it was asked for something"
    );
}

#[test]
fn unwatched_error_is_cleared_in_the_board_when_it_appears() {
    let (mut hardware, mut encoder) = (Hardware::default(), encoder());
    let _ = encoder.read(hardware.step(0, 1_000));
    assert_eq!(encoder.control() & bits::QUADRATURE_ERROR, 0);
    hardware.control = bits::QUADRATURE_ERROR;
    let _ = encoder.read(hardware.step(0, 1_000));
    let word = encoder.control();
    assert_ne!(
        word & bits::QUADRATURE_ERROR,
        0,
        "a changed word is written"
    );
}

#[test]
fn stop_at_the_greatest_rate_is_unsure_and_braking_is_not() {
    // The highest rate with 6 million samples per second and the long filter is 800 counts per
    // millisecond.
    let run = |changes: &[i64]| {
        let (mut hardware, mut encoder) = (Hardware::default(), encoder());
        encoder.set_rates(rates(6e6));
        let _ = encoder.read(hardware.sample());
        let read = |&change: &i64| encoder.read(hardware.step(change, 1_000));
        changes.iter().map(read).collect::<Vec<_>>()
    };
    for way in [1, -1] {
        let beyond = [600, 740, 740, 1, 0, 0].map(|change| way * change);
        let unsure: Vec<_> = run(&beyond).iter().map(|seen| seen.is_unsure).collect();
        assert_eq!(unsure, [false, false, false, true, true, true]);
        // Slows down to half its speed in 3 ms.
        let brakes = [740, 740, 620, 500, 380, 260, 140, 20, 0].map(|change| way * change);
        assert!(run(&brakes).iter().all(|seen| !seen.is_unsure));
        let slower = [600, 600, 1, 0].map(|change| way * change);
        let seen = run(&slower);
        assert!(seen.iter().all(|seen| !seen.is_unsure), "{seen:?}");
    }
}

#[test]
fn index_in_a_gap_with_possible_wrap_around_is_requested_again() {
    let (mut encoder, mut hardware) = armed();
    encoder.set_rates(rates(1e6));
    encoder.read(hardware.step(1_000, 1_000));
    encoder.read(hardware.step(1_000, 1_000));
    // The index was 131,560 counts before the end: the same latched count as for an index 488
    // counts before it.
    let sample = hardware.step(150_000, 160_000);
    let latched = (hardware.count - 131_560) as u16;
    hardware.control = 0x1848 | u32::from(latched) << 16;
    let control = hardware.control;
    let reading = encoder.read(EncoderSample { control, ..sample });
    assert_eq!((reading.index_came, reading.is_unsure), (false, true));
    assert_eq!(encoder.latch.wanted, LatchRequest::Index);
    // The previous request has to be gone from the control register first.
    hardware.control = encoder.control();
    assert_eq!(hardware.control, 0x1808);
    encoder.read(hardware.step(10, 1_000));
    assert_eq!(encoder.control(), 0x1858);
    hardware.control = 0x1848 | u32::from((hardware.count + 5) as u16) << 16;
    let reading = encoder.read(hardware.step(10, 1_000));
    assert_eq!((reading.count, reading.index_came), (5, true));
    assert!(!reading.is_unsure);
}

#[test]
fn index_in_a_slow_cycle_is_taken() {
    let (mut encoder, mut hardware) = armed();
    encoder.set_rates(rates(1e6));
    for _ in 0..20 {
        let _ = encoder.read(hardware.step(100, 50_000));
    }
    let sample = hardware.step(100, 50_000);
    let control = 0x1848 | u32::from((hardware.count - 30) as u16) << 16;
    let reading = encoder.read(EncoderSample { control, ..sample });
    assert_eq!((reading.count, reading.index_came), (30, true));
    assert!(!reading.is_unsure);
}

#[test]
fn homed_ends_unsure_at_its_rising_edge_alone() {
    let (mut hardware, mut encoder) = (Hardware::default(), encoder());
    let command = |homed| EncoderCommand {
        homed,
        ..EncoderCommand::default()
    };
    let _ = encoder.read(hardware.sample());
    for (homed, is_unsure) in [
        (false, true),
        (true, false),
        (true, true),
        (false, true),
        (true, false),
    ] {
        encoder.doubt.add(true);
        encoder.follow(command(homed));
        let reading = encoder.read(hardware.step(0, 1_000));
        assert_eq!(reading.is_unsure, is_unsure, "{homed}");
    }
}
