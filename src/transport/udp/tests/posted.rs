//! Requests in flight, and requests that wait in the board.

use super::*;
use crate::bus::BusError;

const READ: Access = Access::read(0x1000, 0, 2);

fn hold(limit: Duration) -> Hold {
    Hold { before: 0, limit }
}

/// A bus whose board waits this long for its clock, and a list that is held back for up to 1 ms.
fn paced(held: Duration) -> (UdpBus<Network>, AccessList) {
    let mut bus = bus();
    bus.link().held = held.as_nanos() as u64;
    let list = bus.prepare(&[READ], Some(hold(MS))).unwrap();
    (bus, list)
}

#[test]
fn list_writes_its_start_words_and_reads_follow_the_hold() {
    let mut bus = bus();
    bus.link().held = 300_000;
    let accesses = [Access::write(0x2000, 2, 1), READ];
    let before = 1;
    let list = bus
        .prepare(&accesses, Some(Hold { before, limit: MS }))
        .unwrap();
    let mut words = [0, 0, 42];
    bus.start(&list, &words).unwrap();
    words[2] = 43;
    let reply = bus.finish(&list, &mut words).unwrap();
    assert_eq!(bus.link().registers[&0x2000], 42);
    assert_eq!(reply.slack, Some(MS * 3 / 10));
    let link = bus.link();
    let bytes = link.executed.last().unwrap();
    let place = |part: &[u8]| bytes.windows(part.len()).position(|at| at == part);
    let write = place(&42_u32.to_le_bytes()).unwrap();
    let wait = place(&[0x81, 0x51, 0x06, 0x00]).unwrap();
    let read = place(&[0x82, 0x42, 0x00, 0x10]).unwrap();
    assert!(write < wait && wait < read, "{bytes:02X?}");
}

#[test]
fn unclaimed_request_counts_as_lost_until_its_reply_arrives() {
    let (mut bus, list) = paced(MS / 2);
    let cycle = Cycle::new(&mut bus);
    let mut words = [0; 3];
    bus.link().replies = vec![Fate::Lost];
    bus.run(&cycle.read, &mut words).unwrap_err();
    bus.start(&list, &words).unwrap();
    bus.run(&cycle.read, &mut words).unwrap();
    assert_eq!((bus.statistics().lost, bus.statistics().late), (2, 0));
    bus.wait(2 * MS);
    bus.run(&cycle.read, &mut words).unwrap();
    assert_eq!((bus.statistics().lost, bus.statistics().late), (1, 1));
    // A buffer that is too small takes nothing, and a larger one still can.
    bus.start(&list, &words).unwrap();
    let error = bus.finish(&list, &mut []).unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Invalid);
    bus.finish(&list, &mut words).unwrap();
    assert_eq!((bus.statistics().lost, bus.statistics().late), (1, 1));
}

#[test]
fn reply_is_late_except_for_the_time_the_board_waited() {
    let (mut bus, list) = paced(MS);
    let mut words = [0; 2];
    bus.link().replies = vec![Fate::Arrives(700_000)];
    let reply = bus.run(&list, &mut words).unwrap();
    assert_eq!(reply.slack, Some(MS));
    bus.link().held = 100_000;
    bus.link().replies = vec![Fate::Arrives(900_000)];
    let error = bus.run(&list, &mut words).unwrap_err();
    let late = BusError::Late {
        request: bus.link().newest.request.unwrap(),
        waited: MS + MS / 100 * 3,
        by: MS / 100 * 13,
    };
    assert_eq!(error, late);
    // Reporting a longer wait than allowed does not help either.
    bus.link().held = 0;
    bus.link().says_us = Some(u16::MAX);
    bus.link().replies = vec![Fate::Arrives(1_900_000)];
    assert!(bus.run(&list, &mut words).is_err());
}

#[test]
fn board_is_not_asked_to_wait_longer_than_it_can() {
    let mut bus = bus();
    let longest = Duration::from_micros(65_535);
    assert!(bus.prepare(&[READ], Some(hold(longest))).is_ok());
    let longer = longest + MS / 1000;
    let error = bus.prepare(&[READ], Some(hold(longer))).unwrap_err();
    assert!(matches!(error, BusError::LongHold { limit } if limit == longer));
}

#[test]
fn refusal_on_another_packet_is_reported_and_counted_once() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    let mut words = [0, 0, 5];
    for write in [false, true] {
        bus.link().refusals = vec![true];
        let list = if write { &cycle.write } else { &cycle.read };
        let error = bus.start(list, &words).unwrap_err();
        assert_eq!(error.kind(), BusErrorKind::Refused);
    }
    let reply = bus.run(&cycle.read, &mut words).unwrap();
    let counted = bus.statistics();
    assert_eq!((counted.lost, counted.lost_writes), (0, 1));
    assert_eq!((reply.certain, reply.lost_writes), (false, 1));
}

#[test]
fn reply_is_taken_only_by_the_list_that_was_started() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    let other = bus.prepare(&[READ], None).unwrap();
    let mut words = [0; 3];
    assert_eq!(bus.finish(&other, &mut words), Err(BusError::NotStarted));
    bus.start(&cycle.read, &words).unwrap();
    assert_eq!(bus.finish(&other, &mut words), Err(BusError::NotStarted));
    bus.finish(&cycle.read, &mut words).unwrap();
    assert_eq!(words, [1, 2, 0]);
    assert_eq!(
        bus.finish(&cycle.read, &mut words),
        Err(BusError::NotStarted)
    );
}
