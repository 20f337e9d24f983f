//! Results that do not depend on the phase of the firmware loop in the gateware must not depend on
//! it in the simulator: all pauses of the host and all latencies of the remotes are moved by up to
//! 2 microseconds, as by the recorder (index.txt, "PHASE"), and nothing may change except times and
//! the chatter state that CS shows. Always on the project's own transcripts.

use mesa_hal_sim::wire::Nanos;

use crate::DIRECTORY;
use crate::common::recording::sslbp::{Event, Transcript};
use crate::common::recording::{Difference, Recording, files, own_directory};
use crate::fpga_side::replay_with;
use crate::phase::PhaseRule;

/// The transcript with every pause of the host and every latency of a remote longer by `shift`.
fn shifted(original: &Transcript, shift: Nanos) -> Transcript {
    let mut copy = original.clone();
    let mut later = 0;
    let mut previous = 0;
    for entry in &mut copy.entries {
        let pause = entry.time - previous;
        previous = entry.time;
        if matches!(entry.event, Event::Write { .. }) && pause > LONG_PAUSE {
            later += shift;
        }
        entry.time += later;
        match &mut entry.event {
            Event::FromFpga { start, .. } => *start += later,
            Event::ToFpga { start, .. } => {
                *start += later + shift;
                entry.time += shift;
            }
            _ => {}
        }
    }
    copy.entries.sort_by_key(|entry| entry.time);
    copy
}

/// True if only a time differs, or a number of chatter frames.
fn is_time(difference: &Difference) -> bool {
    difference.expected.contains(" ns") || difference.expected.ends_with(" chatter frames")
}

/// Shorter pauses are those between two accesses of one action.
const LONG_PAUSE: Nanos = 5_000;

#[test]
fn register_values_and_bytes_do_not_depend_on_the_phase() {
    let mut failed = 0;
    for shift in (400..=2_000).step_by(400) {
        for path in files(&own_directory(DIRECTORY)) {
            let transcript = Transcript::load(&path).expect("a readable transcript");
            if PhaseRule::of(&transcript.name).is_needed() {
                continue;
            }
            let outcome = replay_with(&shifted(&transcript, shift), PhaseRule::chatter());
            let changed: Vec<_> = outcome
                .differences
                .iter()
                .filter(|difference| !is_time(difference))
                .collect();
            if !changed.is_empty() {
                failed += 1;
                println!("{}, {shift} ns later:", transcript.name);
                for difference in changed.iter().take(6) {
                    println!(
                        "    line {}: {}; {}",
                        difference.line, difference.expected, difference.actual
                    );
                }
            }
        }
    }
    assert_eq!(failed, 0, "files whose values changed");
}
