use super::{MEMORY_ERROR, Memory};
use crate::bus::{Access, Clock, RegisterBus};
use crate::transport::{BusLog, RecordedEntry, Recording};
use core::time::Duration;
use proptest::prelude::*;

fn recording(capacity: usize) -> Recording<Memory> {
    Recording::new(Memory::default(), BusLog::new(capacity))
}

fn text<B: RegisterBus>(bus: &Recording<B>) -> String {
    bus.log.to_string()
}

fn words(log: &BusLog) -> Vec<u32> {
    let word = |entry: &RecordedEntry| match entry {
        RecordedEntry::Written { word, .. } => *word,
        other => panic!("{other:?}"),
    };
    log.entries().map(word).collect()
}

#[test]
fn every_word_is_logged_with_time_and_value() {
    let mut bus = recording(10);
    bus.write(0x5A00, 0x4000).unwrap();
    bus.wait(Duration::from_micros(10));
    let mut words = [0x11, 0, 0];
    let list = bus
        .prepare(
            &[Access::write(0x5A04, 0, 1), Access::read(0x5A00, 1, 2)],
            None,
        )
        .unwrap();
    let _ = bus.run(&list, &mut words).unwrap();
    assert_eq!(
        text(&bus),
        "# 4 entries, 0 earlier ones dropped; time in us\n\
         1.00 host write 0x5A00 0x00004000\n\
         12.00 host write 0x5A04 0x00000011\n\
         12.00 host read 0x5A00 0x00004000\n\
         12.00 host read 0x5A04 0x00000011\n"
    );
}

#[test]
fn list_is_logged_when_its_reply_is_taken() {
    let mut bus = recording(10);
    let list = bus.prepare(&[Access::read(0x1000, 0, 1)], None).unwrap();
    bus.start(&list, &[0]).unwrap();
    assert_eq!((bus.inner.started, bus.log.entries().len()), (1, 0));
    let reply = bus.finish(&list, &mut [0]).unwrap();
    assert!(text(&bus).ends_with("1.00 host read 0x1000 0x00000000\n"));
    assert_eq!(reply.slack, Some(Duration::from_micros(5)));
}

#[test]
fn failed_exchange_is_one_line_and_passed_on() {
    let mut bus = recording(10);
    bus.inner.fail_next = true;
    assert_eq!(bus.read(0x0100), Err(MEMORY_ERROR));
    assert!(text(&bus).ends_with("1.00 host failed 0x0100 ; Device, accesses=1\n"));
}

#[test]
fn log_without_room_is_off() {
    let mut bus = recording(0);
    bus.read(0).unwrap();
    assert_eq!((bus.log.entries().len(), bus.log.dropped()), (0, 0));
}

#[test]
fn frozen_log_keeps_its_entries_until_it_is_resumed() {
    let mut bus = recording(10);
    bus.write(0x1000, 1).unwrap();
    bus.log.freeze();
    bus.write(0x1000, 2).unwrap();
    assert!(bus.log.is_frozen() && bus.log.cause().is_none());
    assert_eq!(words(&bus.log), [1]);
    assert!(text(&bus).contains("# frozen by a call\n"));
    bus.log.resume();
    bus.write(0x1000, 3).unwrap();
    assert_eq!(words(&bus.log), [3]);
}

proptest! {
    #[test]
    fn log_keeps_the_last_words_in_order(capacity in 1usize..20, total in 0u32..60) {
        let mut bus = recording(capacity);
        for value in 0..total {
            bus.write(0x1000, value).unwrap();
        }
        let first = total.saturating_sub(capacity as u32);
        prop_assert_eq!(words(&bus.log), (first..total).collect::<Vec<_>>());
        prop_assert_eq!(bus.log.dropped(), u64::from(first));
    }

    #[test]
    fn trigger_freezes_the_log_after_its_number_of_entries(
        capacity in 1usize..20, after in 0usize..30, before in 0u32..40, rest in 0u32..60,
    ) {
        let is_met = |entry: &RecordedEntry| {
            matches!(entry, RecordedEntry::Written { address: 0x2000, .. })
        };
        let log = BusLog::new(capacity).freezing_on(is_met, after);
        let mut bus = Recording::new(Memory::default(), log);
        for value in 0..before {
            bus.write(0x1000, value).unwrap();
        }
        // The second one changes nothing.
        for value in before..=before + rest {
            bus.write(0x2000, value).unwrap();
        }
        let after = after.min(capacity - 1) as u32;
        prop_assert_eq!(bus.log.is_frozen(), rest >= after);
        let end = before + rest.min(after) + 1;
        let first = end.saturating_sub(capacity as u32);
        prop_assert_eq!(words(&bus.log), (first..end).collect::<Vec<_>>());
        let is_kept = bus.log.cause().is_some_and(|cause| bus.log.entries().any(|it| *it == cause));
        prop_assert_eq!(is_kept, bus.log.is_frozen());
    }
}
