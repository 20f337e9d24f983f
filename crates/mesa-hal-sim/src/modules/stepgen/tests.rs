//! Step generators against the rules tick by tick, and what one costs.

use proptest::prelude::*;

use super::divider::Divider;
use super::generator::{Generator, Time};
use super::latch::Latch;
use super::stepped::{Stepped, SteppedMaster};

/// A write to one of the registers, and the number of ticks up to it.
#[derive(Clone, Copy, Debug)]
struct Write {
    register: u8,
    value: u32,
    after: u64,
}

/// Rates of all sizes, and small times, so that everything happens within few ticks.
fn writes() -> impl Strategy<Value = Vec<Write>> {
    let value = prop_oneof![
        any::<u32>(),
        (0_u32..32, any::<u32>()).prop_map(|(shift, word)| (word as i32 >> shift) as u32),
        0_u32..40,
        Just(u32::MAX),
        Just(0),
    ];
    let write = (0_u8..10, value, 1_u64..200);
    let write = write.prop_map(|(register, value, after)| Write {
        register,
        value,
        after,
    });
    proptest::collection::vec(write, 1..40)
}

fn write_stepped(one: &mut Stepped, master: &mut SteppedMaster, register: u8, value: u32) {
    let time = (value & 0x3F) as u16;
    match register {
        0 => one.rate = value as i32,
        1 => one.accum = u64::from(value) << 16 | one.accum & 0xFFFF,
        2 => one.mode = (value & 7) as u8,
        3 => one.dir_setup = time,
        4 => one.dir_hold = time,
        5 => one.step_len = time,
        6 => one.step_space = time,
        7 => {
            one.table.copy_within(..15, 1);
            one.table[0] = value as u8;
        }
        8 => (one.table_max, one.pointer) = ((value & 15) as u8, 0),
        _ => (master.rate, master.sum) = (value, 0),
    }
}

fn write(one: &mut Generator, divider: &mut Divider, register: u8, value: u32) {
    match register {
        0 => one.set_rate(value),
        1 => one.set_accum(value),
        2 => one.set_mode((value & 7) as u8),
        3 => one.set_time(Time::DirSetup, value & 0x3F),
        4 => one.set_time(Time::DirHold, value & 0x3F),
        5 => one.set_time(Time::StepLen, value & 0x3F),
        6 => one.set_time(Time::StepSpace, value & 0x3F),
        7 => one.push_entry(value),
        8 => one.set_table_max(value),
        _ => divider.set_rate(value),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn generator_run_by_events_matches_tick_by_tick(writes in writes()) {
        let (mut stepped, mut slow) = (Stepped::default(), SteppedMaster::default());
        let (mut generator, mut divider) = (Generator::new(false), Divider::default());
        let first = Write { register: 9, value: u32::MAX, after: 5 };
        for Write { register, value, after } in [first].into_iter().chain(writes) {
            write_stepped(&mut stepped, &mut slow, register, value);
            write(&mut generator, &mut divider, register, value);
            let mut expected = Vec::new();
            let mut shown = stepped.outputs();
            let mut before = 0;
            for tick in 1..=after {
                before = stepped.accum;
                stepped.tick(slow.adds);
                slow.tick();
                if stepped.outputs() != shown {
                    shown = stepped.outputs();
                    expected.push((tick, shown));
                }
            }
            let mut changes = Vec::new();
            generator.run(divider, after, |tick, outputs| changes.push((tick, outputs)));
            divider.advance(after);
            prop_assert_eq!(changes, expected);
            prop_assert_eq!(generator.accum(), (stepped.accum >> 16) as u32);
            prop_assert_eq!(generator.accum_before(), (before >> 16) as u32);
        }
    }

    #[test]
    fn latch_is_the_same_in_any_portions(
        levels in proptest::collection::vec((any::<bool>(), any::<bool>(), 1_u64..600, any::<u8>()), 1..12),
    ) {
        let moving = || {
            let mut generator = Generator::new(true);
            generator.set_rate(0x0123_4567);
            generator.set_time(Time::StepLen, 3);
            generator
        };
        let mut divider = Divider::default();
        divider.set_rate(u32::MAX);
        let (mut one, mut other) = (moving(), moving());
        for (index, probe, ticks, mode) in levels {
            for generator in [&mut one, &mut other] {
                generator.set_mode(mode);
                let latch = generator.latch_mut().expect("a latch");
                latch.index.set(index);
                latch.probe.set(probe);
            }
            one.run(divider, ticks, |_, _| {});
            for _ in 0..ticks {
                other.run(divider, 1, |_, _| {});
                divider.advance(1);
            }
            prop_assert_eq!(one.mode_word(), other.mode_word());
        }
    }
}

#[test]
fn pulse_of_255_ticks_passes_the_filter_and_one_of_254_does_not() {
    for (length, passes) in [(254, false), (255, true)] {
        let mut latch = Latch::default();
        latch.index.set(false);
        (0..300).for_each(|_| assert_eq!(latch.clock(0, 0), 0));
        latch.index.set(true);
        let mut taken = None;
        for tick in 1_u64..600 {
            if tick == length + 1 {
                latch.index.set(false);
            }
            // The accumulator is the number of ticks before this one.
            let left = latch.clock(0x30, (tick - 1) << 24);
            if left == 0x20 {
                taken = taken.or(Some(tick));
            }
        }
        // The value of 256 ticks after the edge of the pin.
        assert_eq!(taken, passes.then_some(257), "{length}");
    }
}

/// What a simulation costs is the number of events, between which a generator is quiet.
#[test]
fn generator_is_quiet_from_one_event_to_the_next() {
    let quiet_after = |rate: u32, master: u32, ticks: u64| {
        let mut generator = Generator::new(false);
        let mut divider = Divider::default();
        divider.set_rate(master);
        generator.set_rate(rate);
        generator.set_time(Time::StepLen, 200);
        generator.run(divider, ticks, |_, _| {});
        divider.advance(ticks);
        generator.quiet(&divider)
    };
    assert_eq!(quiet_after(0, u32::MAX, 10), u64::MAX);
    assert!(quiet_after(0x7FFF_FFFF, 0, 10) > 1 << 40);
    assert!(quiet_after(1, u32::MAX, 10) > 1 << 30);
    // Steps of 1 kHz: within a pulse up to its end, after it up to the next addition that crosses.
    let rate = 42_950;
    assert_eq!(quiet_after(rate, u32::MAX, 100_010), 194);
    assert_eq!(quiet_after(rate, u32::MAX, 101_000), 99_001);
    // At the highest rate the accumulator waits for the end of the pulse.
    assert_eq!(quiet_after(0x8000_0000, u32::MAX, 10), 195);
}
