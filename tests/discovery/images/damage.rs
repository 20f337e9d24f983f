//! Damaged and missing data each have their own error.

use super::*;
use mesa_hal::{MesaError, advice};

#[test]
fn each_kind_of_damage_has_its_own_error() {
    let limits = [0.0, 1.0];
    let illegal = |record, expected: [&'static str; 3]| {
        let [field, found, expected] = expected;
        let found = found.into();
        let kind = ProblemKind::Illegal {
            field,
            found,
            expected,
        };
        assert_eq!(only_problem(record), kind);
    };
    illegal(vec![0xC7, 8], ["type", "0xC7", "A0 (data) or B0 (mode)"]);
    illegal(
        data(8, 2, 0x20, limits, "x"),
        ["direction", "0x20", "00 (input), 40 (both) or 80 (output)"],
    );
    illegal(data(0, 2, 0, limits, "x"), ["width", "0 bits", "1 to 64"]);
    illegal(data(65, 3, 0, limits, "x"), ["width", "65 bits", "1 to 64"]);
    illegal(
        data(16, 0x10, 0, limits, "x"),
        ["width", "16 bits", "32 or 64"],
    );
    illegal(
        data(8, 2, 0, [2.0, 1.0], "x"),
        ["range", "2 to 1", "the smaller limit first"],
    );
    illegal(
        data(8, 2, 0, limits, &"n".repeat(300)),
        [
            "name",
            "without end within 255 characters",
            "a zero behind it",
        ],
    );
}

/// The place of the record among the process data is certain, so that the remote can run.
#[test]
fn odd_record_is_reported_and_used() {
    for (record, text) in [
        (
            data(8, 0x99, 0, [0.0, 1.0], "x"),
            "its data type 0x99 is not known; its bits are kept as they are",
        ),
        (
            data(8, 2, 0, [1.0, f32::INFINITY], "x"),
            "its limits 1 to inf are not finite; its pins have a full scale of 1 instead",
        ),
        (
            data(8, 2, 0, [0.0, 1.0], &"n".repeat(60)),
            "its name has 60 characters, of which 48 are kept",
        ),
    ] {
        let (mut image, remote) = with_records(std::slice::from_ref(&record), 2, 0);
        let found = run(&mut image, &remote);
        let kinds = kinds(&found);
        assert!(matches!(kinds[..], [ProblemKind::Odd { .. }]), "{kinds:?}");
        assert_eq!(kinds[0].to_string(), text);
        let is_scale = text.contains("full scale");
        assert_eq!(kinds[0].advice() == Some(advice::CHECK_SCALE), is_scale);
        assert!(found.plan.is_ok());
    }
}

/// A remote that shows other contents in the place of its tables, such as erased or zeroed memory,
/// must not run without pins.
#[test]
fn remote_that_transfers_data_but_lists_none_is_a_problem() {
    let (mut image, remote) = with_records(&[], 5, 2);
    let found = run(&mut image, &remote);
    let sizes = ProblemKind::Sizes {
        rx: 4,
        tx: 2,
        plan_rx: 0,
        plan_tx: 0,
    };
    assert_eq!(kinds(&found), [sizes]);
    assert!(found.plan.is_err());
    // One byte is the fault byte of a remote without data.
    let (mut image, remote) = with_records(&[], 1, 0);
    assert_eq!(run(&mut image, &remote).problems, []);
}

/// Manual: 7I77, "DATA_LENGTH": up to 255 bits, but the registers have 96.
#[test]
fn oversized_process_data_is_reported_for_each_direction() {
    let wide = |direction| {
        let name = if direction == 0x00 {
            "wide in"
        } else {
            "wide out"
        };
        data(96, 1, direction, [0.0; 2], name)
    };
    let one = |direction| data(1, 1, direction, [0.0; 2], "one");
    let (mut image, remote) = with_records(&[wide(0x00), wide(0x80)], 13, 12);
    assert_eq!(run(&mut image, &remote).problems, []);

    let (mut image, remote) = with_records(&[wide(0x40), one(0x80)], 13, 12);
    let found = run(&mut image, &remote);
    assert_eq!(
        kinds(&found),
        [ProblemKind::RegistersTooSmall {
            direction: "output",
            bits: 97,
            limit: 96
        }]
    );
    assert_eq!(found.problems[0].record, 0x1200);

    let huge = data(255, 1, 0x00, [0.0; 2], "huge");
    let (mut image, remote) = with_records(&[huge], 13, 12);
    assert_eq!(
        kinds(&run(&mut image, &remote)),
        [ProblemKind::RegistersTooSmall {
            direction: "input",
            bits: 255,
            limit: 96
        }]
    );

    // RX 5 carries four bytes of data.
    let (mut image, remote) = with_records(&[data(33, 1, 0, [0.0; 2], "x")], 5, 0);
    let found = run(&mut image, &remote);
    assert_eq!(
        kinds(&found),
        [ProblemKind::Sizes {
            rx: 4,
            tx: 0,
            plan_rx: 5,
            plan_tx: 0
        }]
    );
    assert!(found.plan.is_err());
}

#[test]
fn table_that_loops_or_never_ends_is_cut_off() {
    let mut image = Image::default();
    image.put(0x1000, &good());
    image.put_words(0x100, &[0x1000, 0x1000, 0]);
    let found = run(&mut image, &started(0x100, 0, 13, 12));
    assert_eq!(kinds(&found), [ProblemKind::RepeatedEntry { entry: 1 }]);
    assert_eq!(found.descriptor.process_data.len(), 1);

    // Every word points to a record of its own, for the whole memory.
    let words: Vec<u16> = (0..0x400).map(|n| 0x1000 + n).collect();
    image.put_words(0x8000, &words);
    let found = run(&mut image, &started(0x8000, 0, 13, 12));
    let without_end = ProblemKind::TableWithoutEnd { entries: 255 };
    assert!(kinds(&found).contains(&without_end));

    image.put_words(0xFFFC, &[0x1000, 0x1001]);
    let found = run(&mut image, &started(0xFFFC, 0, 13, 12));
    assert!(kinds(&found).contains(&ProblemKind::TableWithoutEnd { entries: 2 }));
}

#[test]
fn record_at_the_end_of_the_address_space_is_an_error() {
    let mut image = Image::default();
    image.put(0xFFF0, &data(8, 2, 0, [0.0, 1.0], "long name")[..16]);
    image.put_words(0x100, &[0xFFF0, 0]);
    let found = run(&mut image, &started(0x100, 0, 13, 12));
    assert_eq!(kinds(&found), [ProblemKind::PastEnd]);
}

/// A remote whose memory ends in the middle of a double is read with smaller accesses.
#[test]
fn last_bytes_of_a_memory_are_read_one_by_one() {
    let mut image = Image::default();
    let record = good();
    let end = 0x1000 + record.len() as u16;
    image.put(0x1000, &record);
    image.put_words(0x100, &[0x1000, 0]);
    image.missing = Some(end..=0xFFFF);
    let found = run(&mut image, &started(0x100, 0, 2, 0));
    assert_eq!(found.problems, []);
    assert_eq!(found.descriptor.process_data[0].name, "Good");
}

#[test]
fn read_that_fails_costs_its_record_only() {
    let (mut image, remote) = with_records(&[good(), good(), good()], 13, 12);
    image.missing = Some(0x1204..=0x1205);
    let found = run(&mut image, &remote);
    assert_eq!(kinds(&found), [ProblemKind::ReadFailed { address: 0x1204 }]);
    assert_eq!(found.problems[0].record, 0x1200);
    assert_eq!(found.read_error, Some("no reply at 0x1204".to_owned()));
    assert_eq!(found.descriptor.process_data.len(), 2);
    assert!(found.plan.is_err());
}

#[test]
fn remote_that_is_gone_is_given_up_soon() {
    let mut image = Image {
        missing: Some(0..=0xFFFF),
        ..Image::default()
    };
    let found = run(&mut image, &started(0x100, 0x200, 13, 12));
    assert_eq!(
        kinds(&found),
        [
            ProblemKind::ReadFailed { address: 0x100 },
            ProblemKind::ReadFailed { address: 0x200 },
        ]
    );
    assert!(found.accesses <= 6);
}

/// Of a hundred unreadable records, four are tried.
#[test]
fn abandoned_discovery_is_reported_once() {
    let mut image = Image::default();
    let words: Vec<u16> = (0..100).map(|n| 0x2000 + 0x40 * n).collect();
    image.put_words(0x100, &words);
    image.put_words(0x100 + 200, &[0]);
    image.missing = Some(0x2000..=0x6000);
    let found = run(&mut image, &started(0x100, 0, 13, 12));
    let (failed, gave_up): (Vec<_>, Vec<_>) = kinds(&found)
        .into_iter()
        .partition(|kind| matches!(kind, ProblemKind::ReadFailed { .. }));
    assert_eq!((failed.len(), gave_up.len()), (4, 1));
    assert!(matches!(gave_up[0], ProblemKind::GaveUp { .. }));
}
