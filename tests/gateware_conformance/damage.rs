//! Proof that the comparison can fail: recordings are altered in memory, and every alteration must
//! be found.

use crate::DIRECTORY;
use crate::common::recording::sslbp::{Entry, Event, Transcript};
use crate::common::recording::{self, Recording};
use crate::fpga_side::replay;

/// Far more than the tolerance.
const SHIFT: u64 = 60_000;

fn recording(name: &str) -> Transcript {
    Transcript::own(DIRECTORY, name)
}

fn differs(transcript: &Transcript) -> bool {
    !replay(transcript).differences.is_empty()
}

/// Alters one entry after the other.
fn unnoticed(name: &str, alter: impl Fn(&mut Entry) -> bool) -> (usize, Vec<usize>) {
    recording::unnoticed(&recording(name), differs, alter)
}

#[test]
fn recordings_themselves_replay_without_a_difference() {
    for name in ["t05_passthrough", "t10b_back_to_back"] {
        assert_eq!(replay(&recording(name)).differences, Vec::new());
    }
}

#[test]
fn every_register_value_that_is_altered_is_found() {
    for name in ["t10b_back_to_back", "t03b_setup_states"] {
        let (altered, missed) = unnoticed(name, |entry| match &mut entry.event {
            Event::Read { value, .. } => {
                *value ^= 0x0000_0010;
                true
            }
            _ => false,
        });
        assert!(altered > 20, "{name} has values to alter");
        assert_eq!(missed, Vec::<usize>::new(), "{name}");
    }
}

#[test]
fn every_byte_of_the_fpga_that_is_altered_is_found() {
    for name in ["t06d_badmode", "t26_7i64"] {
        let (altered, missed) = unnoticed(name, |entry| match &mut entry.event {
            Event::FromFpga { bytes, .. } => {
                let last = bytes.len() - 1;
                bytes[last] ^= 0x40;
                true
            }
            _ => false,
        });
        assert!(altered > 15, "{name} has bursts to alter");
        assert_eq!(missed, Vec::<usize>::new(), "{name}");
    }
}

#[test]
fn every_wait_that_is_altered_is_found() {
    let (altered, missed) = unnoticed("t07a_doit_1of8", |entry| match &mut entry.event {
        Event::Poll { waited, .. } => {
            *waited += SHIFT + *waited / 10;
            true
        }
        _ => false,
    });
    assert!(altered > 10);
    assert_eq!(missed, Vec::<usize>::new());
}

#[test]
fn reply_that_differs_from_the_recorded_one_shows_in_registers() {
    let (altered, missed) = unnoticed("t11_fault", |entry| match &mut entry.event {
        Event::ToFpga { bytes, .. } if bytes.len() == 6 && entry.time > 2_000_000 => {
            // A wrong CRC.
            bytes[5] ^= 0x55;
            true
        }
        _ => false,
    });
    assert!(altered > 3);
    assert_eq!(missed, Vec::<usize>::new());
}

#[test]
fn burst_too_many_or_too_few_is_found() {
    let original = recording("t06d_badmode");
    let bursts = original
        .entries
        .iter()
        .enumerate()
        .filter(|(_, entry)| matches!(entry.event, Event::FromFpga { .. }));
    for (index, entry) in bursts {
        let mut fewer = original.clone();
        fewer.entries.remove(index);
        assert!(differs(&fewer), "line {} removed", entry.line);
        let mut more = original.clone();
        more.entries.insert(index, entry.clone());
        assert!(differs(&more), "line {} twice", entry.line);
    }
}
