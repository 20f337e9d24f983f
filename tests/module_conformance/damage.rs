//! Proof that the comparison can fail: recordings are altered in memory, and every alteration must
//! be found.

use crate::common::recording::{self, Recording, own_directory};
use crate::transcript::{Entry, Event, Level, Transcript};
use crate::{DIRECTORY, family};

fn recording(name: &str) -> Transcript {
    Transcript::own(DIRECTORY, name)
}

fn differs(transcript: &Transcript) -> bool {
    let (_, replay) = family(&transcript.name).expect("a known family");
    !replay(transcript).differences.is_empty()
}

/// Alters one entry after the other.
fn unnoticed(name: &str, alter: impl Fn(&mut Entry) -> bool) -> (usize, Vec<usize>) {
    recording::unnoticed(&recording(name), differs, alter)
}

#[test]
fn every_register_value_that_is_altered_is_found() {
    for (name, bit) in [
        ("wd02_pet", 1),
        ("io02_random3", 1),
        ("im03_mpg", 1),
        ("enc14_disarm", 4),
    ] {
        let (altered, missed) = unnoticed(name, |entry| match &mut entry.event {
            Event::Read { word, .. } => {
                word.value ^= bit;
                true
            }
            _ => false,
        });
        assert!(altered > 15, "{name} has values to alter");
        assert_eq!(missed, Vec::<usize>::new(), "{name}");
    }
}

#[test]
fn every_level_of_a_pin_that_is_altered_is_found() {
    for name in ["wd01_bite", "io02_random1", "ssr01_drive", "led01"] {
        let (altered, missed) = unnoticed(name, |entry| match &mut entry.event {
            Event::Pin { level, .. } => {
                *level = match level {
                    Level::Low => Level::High,
                    _ => Level::Low,
                };
                true
            }
            _ => false,
        });
        assert!(altered > 10, "{name} has levels to alter");
        assert_eq!(missed, Vec::<usize>::new(), "{name}");
    }
}

#[test]
fn every_edge_that_is_missing_is_found() {
    let original = recording("ssr01_drive");
    for (index, entry) in original.entries.iter().enumerate() {
        let is_edge = matches!(entry.event, Event::Pin { .. }) && entry.time > 80;
        if is_edge {
            let mut fewer = original.clone();
            fewer.entries.remove(index);
            assert!(differs(&fewer), "line {} removed", entry.line);
        }
    }
}

#[test]
fn bite_that_comes_a_clock_earlier_or_later_is_found() {
    for shift in [-10, 10] {
        let (altered, missed) = unnoticed("wd01_bite", |entry| {
            let is_bite = matches!(entry.event, Event::Pin { .. }) && entry.time == 2050;
            if is_bite {
                entry.time = entry.time.saturating_add_signed(shift);
            }
            is_bite
        });
        assert_eq!((altered, missed), (3, vec![]));
    }
}

#[test]
fn every_edge_and_duty_of_a_pwm_that_is_altered_is_found() {
    for name in ["pwm09_dbuf", "pwm06_rate"] {
        let (altered, missed) = unnoticed(name, |entry| {
            let is_edge = matches!(entry.event, Event::Pin { .. }) && entry.time > 20_000;
            if is_edge {
                entry.time += 5;
            }
            is_edge
        });
        assert!(altered > 15, "{name} has edges to alter");
        assert_eq!(missed, Vec::<usize>::new(), "{name}");
    }
    let original = recording("pwm07_offset");
    for index in 0..original.duties.len() {
        let mut copy = original.clone();
        copy.duties[index].high += 5;
        assert!(differs(&copy), "duty {index}");
    }
}

#[test]
fn file_that_is_cut_off_in_a_line_can_not_be_read() {
    let path = own_directory(DIRECTORY).join("wd01_bite.txt");
    let text = std::fs::read_to_string(path).expect("a recording of the project");
    for end in 1..text.len() {
        let cut = &text[..end];
        if !cut.ends_with('\n') {
            assert!(Transcript::parse("wd01_bite", cut).is_err(), "{end} bytes");
        }
    }
}

#[test]
fn file_of_no_family_is_not_taken_for_another() {
    for name in ["pw01", "io", "iox1", "pwmx", "serial01", "inm01"] {
        let known = ["io"].contains(&name);
        assert_eq!(family(name).is_some(), known, "{name}");
    }
}

#[test]
fn every_step_generator_edge_shifted_by_one_clock_is_found() {
    for (name, shift) in [
        ("sg19_reverse", 10),
        ("sg21_zero", -10),
        ("sg25_quad", 10),
        ("sg27_table", -10),
        ("sg33_wd", 10),
    ] {
        let (altered, missed) = unnoticed(name, |entry| {
            let is_edge = matches!(entry.event, Event::Pin { .. }) && entry.time > 400;
            if is_edge {
                entry.time = entry.time.saturating_add_signed(shift);
            }
            is_edge
        });
        assert!(altered > 25, "{name} has edges to alter");
        assert_eq!(missed, Vec::<usize>::new(), "{name}");
    }
}

#[test]
fn every_altered_level_and_register_of_a_generator_is_found() {
    for (name, bit) in [
        ("sg01_reset", 1),
        ("sg23_updown", 1),
        ("sg31_port", 2),
        ("sg35_latency", 1),
        ("sg38_master", 1),
        ("sg45_idxdpll", 0x100),
    ] {
        let (altered, missed) = unnoticed(name, |entry| match &mut entry.event {
            Event::Pin { level, .. } => {
                *level = match level {
                    Level::Low => Level::High,
                    _ => Level::Low,
                };
                true
            }
            Event::Read { word, .. } if word.driven != 0 => {
                word.value ^= bit;
                true
            }
            _ => false,
        });
        assert!(altered > 40, "{name} has values to alter");
        assert_eq!(missed, Vec::<usize>::new(), "{name}");
    }
}

#[test]
fn step_that_is_missing_or_added_is_found() {
    let original = recording("sg21_zero");
    for (index, entry) in original.entries.iter().enumerate() {
        if matches!(entry.event, Event::Pin { .. }) && entry.time > 400 {
            let mut fewer = original.clone();
            fewer.entries.remove(index);
            assert!(differs(&fewer), "line {} removed", entry.line);
        }
    }
    let quiet = original.entries.iter().position(|entry| entry.time > 3_430);
    let mut more = original.clone();
    let index = quiet.expect("a time without steps");
    for (time, level) in [(3_500, Level::High), (3_810, Level::Low)] {
        let pin = "STEP0".to_owned();
        let mut entry = more.entries[index].clone();
        (entry.time, entry.event) = (time, Event::Pin { pin, level });
        let at = more.entries.partition_point(|other| other.time <= time);
        more.entries.insert(at, entry);
    }
    assert!(differs(&more));
}
