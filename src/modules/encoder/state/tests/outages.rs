//! Counters of a board that was out of reach, has bitten or was reset.

use super::*;

#[test]
fn counts_continue_after_an_unseen_counter_reset() {
    let mut hardware = Hardware::default();
    let mut encoder = encoder();
    encoder.read(hardware.sample());
    encoder.read(hardware.step(20_000, 1_000));
    encoder.latch.request(LatchRequest::Index);
    hardware.count = 0;
    encoder.set_up_again(&RESET);
    // The register content after a reload must not be taken for an index.
    hardware.control = 0x1848 | (7 << 16);
    let reading = encoder.read(hardware.step(0, 1_000));
    assert_eq!((reading.rawcounts, reading.count), (20_000, 20_000));
    assert!(reading.velocity.abs() < f64::EPSILON);
    assert_eq!(encoder.latch.wanted, LatchRequest::Index);
    hardware.control = 0x1808;
    assert_eq!(encoder.read(hardware.step(5, 1_000)).count, 20_005);
    assert_eq!(encoder.control(), 0x1858);
}

#[test]
fn gap_is_unsure_where_the_counter_can_have_wrapped_around() {
    // 20 counts in a millisecond: with the margin 31 in each.
    for (ms, is_unsure) in [(50, false), (1_000, false), (1_060, true), (5_000, true)] {
        let (mut encoder, mut hardware) = running(20);
        let reading = encoder.read(hardware.step(20 * ms, ms as u64 * 1_000));
        assert_eq!(reading.is_unsure, is_unsure, "{ms}");
        assert_eq!(reading.rawcounts == hardware.count - 20, ms < 1_600, "{ms}");
        assert_eq!(
            encoder.read(hardware.step(0, 1_000)).is_unsure,
            is_unsure,
            "kept"
        );
        encoder.reset();
        assert!(!encoder.read(hardware.step(10, 1_000)).is_unsure);
    }
}

#[test]
fn encoder_whose_last_edge_is_the_same_has_not_moved() {
    let (mut encoder, mut hardware) = running(20);
    assert!(!encoder.read(hardware.step(0, 60_000_000)).is_unsure);
    assert!(encoder.read(hardware.step(1, 60_000_000)).is_unsure);
}

#[test]
fn reply_that_lay_unread_is_as_old_as_its_request() {
    let (mut encoder, mut hardware) = running(20);
    let mut sample = hardware.step(0, 1_000);
    // The host was suspended with the reply.
    hardware.now_us += 60_000_000;
    sample.at = Instant::from_nanos(hardware.now_us * 1_000);
    assert!(!encoder.read(sample).is_unsure, "the last edge is the same");
    assert!(encoder.read(hardware.step(20, 1_000)).is_unsure);
}

#[test]
fn counter_runs_on_through_a_bite() {
    for (is_muxed, is_followed) in [(false, true), (false, false), (true, true), (true, false)] {
        let (mut encoder, mut hardware) = running(20);
        encoder.is_muxed = is_muxed;
        let before = hardware.count;
        if is_followed {
            // For much longer than a gap may be.
            for _ in 0..40 {
                encoder.run_on(hardware.step(2_000, 100_000), &BITE, false);
            }
        } else {
            encoder.run_on(hardware.step(2_000, 100_000), &BITE, false);
        }
        encoder.set_up_again(&BITE);
        let reading = encoder.read(hardware.step(20, 1_000));
        assert_eq!(reading.rawcounts, hardware.count - 20);
        assert!(hardware.count > before);
        assert_eq!(reading.is_unsure, is_muxed);
    }
}

#[test]
fn reset_that_looks_like_a_bite_is_unsure() {
    let (mut encoder, mut hardware) = running(20);
    let before = encoder.read(hardware.step(0, 1_000)).rawcounts;
    (hardware.count, hardware.control) = (0, 0);
    encoder.run_on(hardware.step(3, 200_000), &BITE, false);
    hardware.control = 0x1808;
    encoder.set_up_again(&BITE);
    let reading = encoder.read(hardware.step(0, 1_000));
    assert_eq!((reading.rawcounts, reading.is_unsure), (before, true));
    // Without a mode there is nothing that a reset clears.
    let (mut encoder, mut hardware) = running(20);
    (encoder.config.mode, hardware.control) = (0, 0);
    encoder.read(hardware.step(20, 1_000));
    encoder.run_on(hardware.step(20, 1_000), &BITE, false);
    encoder.set_up_again(&BITE);
    let reading = encoder.read(hardware.step(20, 1_000));
    assert_eq!(
        (reading.rawcounts, reading.is_unsure),
        (hardware.count - 20, true)
    );
}

#[test]
fn board_that_has_kept_its_mode_was_not_reset() {
    let (mut encoder, mut hardware) = running(20);
    encoder.run_on(hardware.step(20, 1_000), &RESET, false);
    encoder.set_up_again(&RESET);
    let reading = encoder.read(hardware.step(20, 1_000));
    assert_eq!(
        (reading.rawcounts, reading.is_unsure),
        (hardware.count - 20, false)
    );
    // The mode may be that of a set-up that came late.
    encoder.run_on(hardware.step(20, 1_000), &RESET, false);
    encoder.set_up_again(&RESET);
    assert!(encoder.read(hardware.step(20, 1_000)).is_unsure);
}

#[test]
fn mode_that_was_written_after_the_last_read_is_no_proof() {
    for is_unseen in [false, true] {
        let (mut encoder, mut hardware) = running(20);
        encoder.run_on(hardware.step(20, 1_000), &RESET, is_unseen);
        // What is written from then on does not count.
        encoder.run_on(hardware.step(20, 1_000), &RESET, true);
        encoder.set_up_again(&RESET);
        let reading = encoder.read(hardware.step(20, 1_000));
        assert_eq!(reading.is_unsure, is_unseen);
    }
}

#[test]
fn counter_that_begins_again_with_the_set_up_is_unsure() {
    let (mut encoder, mut hardware) = running(20);
    encoder.run_on(hardware.step(20, 1_000), &BITE, false);
    encoder.set_up_again(&BITE);
    hardware.count = 0;
    assert!(encoder.read(hardware.step(1, 1_000)).is_unsure);
}
