//! A reply that arrives after its transfer has failed, in the middle of the next one: nothing on
//! the wire numbers replies, so that it is taken for the reply to that one.

use crate::common::machine::{FIELD, Machine};
use mesa_hal::Clock;
use mesa_hal_sim::remote::{Toward, WireFault};

/// Inputs of the field I/O that count the cycles.
const BITS: usize = 6;

struct Rig {
    machine: Machine,
    /// The patterns, each with the time from which on the inputs have it.
    history: Vec<(u64, u32)>,
}

impl Rig {
    fn new() -> Self {
        Self {
            machine: Machine::new(),
            history: vec![(0, 0)],
        }
    }

    /// Sets other inputs in each cycle; returns the valid pattern and its age in nanoseconds.
    fn cycle(&mut self) -> Option<(u32, u64)> {
        let _ = self.machine.driver.read().expect("the bus does not fail");
        let now = self.machine.driver.pins().now().as_nanos();
        let pins = self.machine.driver.pins();
        let inputs = self.machine.cards.field.inputs;
        let shown = (0..BITS).try_fold((0, 0), |(pattern, _), n| {
            let reading = pins.read(inputs[n].pin);
            let age = reading.age.time.as_nanos() as u64;
            let bit = u32::from(reading.value) << n;
            reading.valid.then_some((pattern | bit, age))
        });
        if let Some((pattern, age)) = shown {
            let from = now - age;
            let ends = self.history.iter().skip(1).map(|(at, _)| *at);
            let spans = self.history.iter().zip(ends.chain([u64::MAX]));
            let was_true = |((_, shown), end): (&(u64, u32), u64)| *shown == pattern && end >= from;
            let newest = &self.history[self.history.len().saturating_sub(4)..];
            assert!(
                spans.into_iter().any(was_true),
                "{pattern} at {now}, {age} ns old: {newest:?}"
            );
        }
        self.machine.finish();
        let at = self.machine.driver.bus_mut().now().as_nanos();
        let pattern = self.history.len() as u32 % (1 << BITS);
        for n in 0..BITS {
            let device = self.machine.device_mut(FIELD);
            let set = device.set_input(n, pattern >> n & 1 != 0);
            set.expect("an input");
        }
        self.history.push((at, pattern));
        shown
    }
}

#[test]
fn age_covers_a_late_reply_taken_for_that_of_the_next_transfer() {
    let mut taken = 0;
    for late in (10_000..2_100_000).step_by(9_000) {
        let mut rig = Rig::new();
        for _ in 0..5 {
            rig.cycle();
        }
        let cable = rig.machine.cable(FIELD);
        cable.inject(Toward::Fpga, WireFault::Late(late), 1);
        let mut failed = 0;
        for _ in 0..6 {
            let shown = rig.cycle();
            failed += u32::from(shown.is_none());
            if let Some((_, age)) = shown {
                taken += u32::from(age > 1_500_000);
            }
        }
        for n in 0..10 {
            let shown = rig.cycle();
            let is_new = shown.is_some_and(|(_, age)| age < 1_100_000);
            assert!(is_new, "{late}, cycle {n}: {shown:?}");
        }
        assert!(late < 100_000 || failed > 0, "{late}");
    }
    assert!(taken > 100, "{taken} good transfers after a failed one");
}

/// Between START and the first transfer the gateware exchanges frames by itself. A late reply to
/// one of them is taken for the reply to the transfer.
#[test]
fn age_after_a_start_covers_late_replies_to_earlier_frames() {
    let mut restarted = 0;
    for late in (50_000..700_000).step_by(5_000) {
        let mut rig = Rig::new();
        for _ in 0..5 {
            rig.cycle();
        }
        let cable = rig.machine.cable(FIELD);
        cable.inject_by_chance(Toward::Fpga, WireFault::Late(late), 0.2);
        for _ in 0..6 {
            rig.machine.driver.restart((0, FIELD as u8));
            restarted += (0..15).filter(|_| rig.cycle().is_some()).count().min(1);
        }
    }
    assert!(restarted > 200, "{restarted} restarts with late replies");
}
