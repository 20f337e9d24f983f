use super::{MEMORY_ERROR, Memory};
use crate::bus::{Access, Clock, RegisterBus};
use crate::transport::{RecordedEntry, Recording};
use core::time::Duration;
use proptest::prelude::*;

fn text<B: RegisterBus>(bus: &Recording<B>) -> String {
    let mut out = Vec::new();
    bus.write_to(&mut out).unwrap();
    String::from_utf8(out).unwrap()
}

#[test]
fn every_word_is_logged_with_time_and_value() {
    let mut bus = Recording::new(Memory::default(), 10);
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
        "# 4 accesses, 0 earlier ones dropped; time in us\n\
         1.00 host write 0x5A00 0x00004000\n\
         12.00 host write 0x5A04 0x00000011\n\
         12.00 host read 0x5A00 0x00004000\n\
         12.00 host read 0x5A04 0x00000011\n"
    );
}

#[test]
fn a_list_is_logged_when_its_reply_is_taken() {
    let mut bus = Recording::new(Memory::default(), 10);
    let list = bus.prepare(&[Access::read(0x1000, 0, 1)], None).unwrap();
    bus.start(&list, &[0]).unwrap();
    assert_eq!((bus.inner.started, bus.entries.len()), (1, 0));
    let reply = bus.finish(&list, &mut [0]).unwrap();
    assert!(text(&bus).ends_with("1.00 host read 0x1000 0x00000000\n"));
    assert_eq!(reply.slack, Some(Duration::from_micros(5)));
}

#[test]
fn a_failed_exchange_is_one_line_and_passed_on() {
    let mut bus = Recording::new(Memory::default(), 10);
    bus.inner.fail_next = true;
    assert_eq!(bus.read(0x0100), Err(MEMORY_ERROR));
    assert!(text(&bus).ends_with("1.00 host failed 0x0100 ; Device, accesses=1\n"));
}

#[test]
fn a_log_without_room_records_nothing_and_counts() {
    let mut bus = Recording::new(Memory::default(), 0);
    bus.read(0).unwrap();
    assert_eq!((bus.entries.len(), bus.dropped), (0, 1));
}

proptest! {
    #[test]
    fn the_log_keeps_the_last_words_in_order(capacity in 0usize..20, total in 0u32..60) {
        let mut bus = Recording::new(Memory::default(), capacity);
        for value in 0..total {
            bus.write(0x1000, value).unwrap();
        }
        let kept: Vec<_> = bus
            .entries
            .iter()
            .map(|entry| match entry {
                RecordedEntry::Written { word, .. } => *word,
                other => panic!("{other:?}"),
            })
            .collect();
        let first = total.saturating_sub(capacity as u32);
        prop_assert_eq!(kept, (first..total).collect::<Vec<_>>());
        prop_assert_eq!(bus.dropped, u64::from(first));
    }
}
