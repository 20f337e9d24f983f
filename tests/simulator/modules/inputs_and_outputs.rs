//! InMux, InM, SSR and OutM.

use super::{MS, set_up_pins, turned_by_hand, wait};
use mesa_hal::sim::machines;

#[test]
fn newer_firmware_with_inm_and_outm_behaves_alike() {
    let mut fpga = machines::i7i97_inm_outm(1);
    assert_eq!(fpga.read_register(0x8500) & 0x1F, 15);
    assert_eq!(fpga.read_register(0x8800), 0, "no current flows");
    fpga.set_input(12, true);
    // 16 inputs of 40 ns.
    for invert in [0, 1 << 5] {
        fpga.write_register(0x8500, invert);
        wait(&mut fpga, 2 * 640);
        assert_eq!(fpga.read_register(0x8800), 1 << 12, "invert {invert:x}");
        assert_eq!(fpga.read_register(0x8700), 1 << 12, "no filter set");
    }
    fpga.write_register(0xB000, 0b100);
    assert!(!fpga.isolated_output(2), "the pin is no output yet");
    set_up_pins(&mut fpga, &[21]);
    assert!(fpga.isolated_output(2) && fpga.pin_level(21));
    assert_eq!(fpga.read_register(0xB000), 0b100);
}

/// Control of an InMux with a scan of 50.56 us: 16 inputs, 4 * (78 + 1) clocks each; inverted.
const INMUX_SCAN: u32 = 78 << 6 | 1 << 5;

#[test]
fn inmux_filters_for_the_scans_it_is_told() {
    let mut fpga = turned_by_hand();
    // 5 scans short, 50 long.
    fpga.write_register(0x8000, 50 << 22 | 5 << 16 | INMUX_SCAN);
    assert_eq!(fpga.read_register(0x8000) & 0x1F, 15);
    fpga.write_register(0x8100, 1 << 9);
    wait(&mut fpga, MS);
    assert_eq!(fpga.read_register(0x8200), 0);
    fpga.set_input(8, true);
    fpga.set_input(9, true);
    wait(&mut fpga, 60_000);
    assert_eq!(fpga.read_register(0x8300), 0x300);
    // Raw within a scan, then counted 5 times, and seen the next time: 6 to 7 scans.
    wait(&mut fpga, 243_000);
    assert_eq!(fpga.read_register(0x8200), 0);
    wait(&mut fpga, 52_000);
    assert_eq!(fpga.read_register(0x8200), 0x100);
    wait(&mut fpga, 2_220_000);
    assert_eq!(fpga.read_register(0x8200), 0x100);
    wait(&mut fpga, 60_000);
    assert_eq!(fpga.read_register(0x8200), 0x300);
    fpga.set_input(8, false);
    wait(&mut fpga, 200_000);
    fpga.set_input(8, true);
    wait(&mut fpga, 200_000);
    assert_eq!(
        fpga.read_register(0x8200),
        0x300,
        "a short pulse does not get through"
    );
    // Without global invert, the opto-isolators show.
    fpga.write_register(0x8000, 78 << 6);
    wait(&mut fpga, 100_000);
    assert_eq!(fpga.read_register(0x8300), 0xFCFF);
}

#[test]
fn inmux_slots_that_are_too_short_for_the_multiplexer_shift_all_inputs_by_one() {
    for (divisor, expected) in [(7, 1 << 4), (6, 1 << 3), (5, 1 << 3)] {
        let mut fpga = turned_by_hand();
        fpga.write_register(0x8000, divisor << 6 | 1 << 5);
        fpga.set_input(4, true);
        wait(&mut fpga, MS);
        let slot = 40 * (divisor + 1);
        assert_eq!(fpga.read_register(0x8300), expected, "slots of {slot} ns");
    }
}

#[test]
fn an_input_that_chatters_adds_up_in_its_filter() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x8000, 8 << 16 | INMUX_SCAN);
    wait(&mut fpga, MS);
    // Two scans on and one off, which a filter that wants 8 in a row never lets through.
    for n in 0..27 {
        fpga.set_input(0, n % 3 != 2);
        wait(&mut fpga, 50_560);
    }
    assert_eq!(fpga.read_register(0x8200), 1);
}

#[test]
fn inmux_without_its_address_pins_reads_one_input_everywhere() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x8000, INMUX_SCAN);
    fpga.set_input(3, true);
    wait(&mut fpga, 110_000);
    assert_eq!(fpga.read_register(0x8300), 0x0008);
    set_up_pins(&mut fpga, &[]);
    wait(&mut fpga, 110_000);
    assert_eq!(fpga.read_register(0x8300), 0);
    fpga.set_input(15, true);
    wait(&mut fpga, 110_000);
    assert_eq!(fpga.read_register(0x8300), 0xFFFF);
}

#[test]
fn mpg_counters_count_once_or_four_times_a_cycle_and_up_when_b_leads() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x8000, INMUX_SCAN);
    fpga.write_register(0x8400, 0x0000_0100);
    for _ in 0..10 {
        for (a, b) in [(false, true), (true, true), (true, false), (false, false)] {
            for pair in [0, 2] {
                fpga.set_input(pair, a);
                fpga.set_input(pair + 1, b);
            }
            wait(&mut fpga, MS);
        }
    }
    assert_eq!(fpga.read_register(0x8400), 0x0000_280A);
    for _ in 0..13 {
        for (a, b) in [(true, false), (true, true), (false, true), (false, false)] {
            fpga.set_input(0, a);
            fpga.set_input(1, b);
            wait(&mut fpga, MS);
        }
    }
    assert_eq!(fpga.read_register(0x8400), 0x0000_28FD, "10 - 13 is 0xFD");
    fpga.write_register(0x8400, 0x0000_0001);
    assert_eq!(fpga.read_register(0x8400), 0x0000_28FD, "modes keep counts");
}

#[test]
fn ssr_outputs_need_their_drive_and_their_pins() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x7D00, 0b10_0001);
    assert!(!fpga.isolated_output(0), "no drive yet");
    fpga.write_register(0x7E00, 1 << 12 | 0x30);
    let frequency = fpga.ssr().expect("SSR").drive_frequency();
    assert!((frequency - 1e6).abs() < 1.0);
    let outputs: Vec<bool> = (0..6).map(|n| fpga.isolated_output(n)).collect();
    assert_eq!(outputs, [true, false, false, false, false, true]);
    set_up_pins(&mut fpga, &[19, 20, 21, 22, 23, 24]);
    assert!(!fpga.isolated_output(0), "no AC reference");
}
