//! Requests that are under way, and those that wait in the board.

use super::*;

const READ: Access = Access::read(0x1000, 0, 2);

/// A bus whose board waits so long for its clock, and a list that is held back for up to 1 ms.
fn paced(held: Duration) -> (UdpBus<Network>, Prepared) {
    let mut bus = bus();
    bus.link().held = held.as_nanos() as u64;
    let list = bus.prepare_paced(&[READ], MS).unwrap();
    (bus, list.expect("a board that can wait"))
}

#[test]
fn a_list_that_writes_is_not_sent_before_its_words_are_there() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    let mut words = [0, 0, 42];
    bus.exchange_prepared(&cycle.write, &mut words).unwrap();
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    bus.link().registers.clear();
    bus.post(&cycle.write).unwrap();
    bus.wait(MS);
    assert!(bus.link().registers.is_empty(), "the words of the last one");
    words[2] = 43;
    bus.collect(&cycle.write, &mut words).unwrap();
    bus.wait(MS);
    assert_eq!(bus.link().registers[&0x2000], 43);
}

#[test]
fn a_request_under_way_that_nobody_takes_counts_as_lost_until_its_reply_comes() {
    let (mut bus, list) = paced(MS / 2);
    let cycle = Cycle::new(&mut bus);
    let mut words = [0; 3];
    bus.link().replies = vec![Fate::Lost];
    bus.exchange_prepared(&cycle.read, &mut words).unwrap_err();
    bus.post(&list).unwrap();
    bus.collect(&cycle.read, &mut words).unwrap();
    assert_eq!((bus.statistics().lost, bus.statistics().late), (2, 0));
    bus.wait(2 * MS);
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    assert_eq!((bus.statistics().lost, bus.statistics().late), (1, 1));
    // A buffer that is too small takes nothing, and a larger one still can.
    bus.post(&list).unwrap();
    let error = bus.collect(&list, &mut []).unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Invalid);
    bus.collect(&list, &mut words).unwrap();
    assert_eq!((bus.statistics().lost, bus.statistics().late), (1, 1));
}

#[test]
fn what_the_board_waits_does_not_make_a_reply_late_and_what_it_does_not_wait_does() {
    let (mut bus, list) = paced(MS);
    let mut words = [0; 2];
    bus.link().replies = vec![Fate::Arrives(700_000)];
    bus.exchange_prepared(&list, &mut words).unwrap();
    assert_eq!(bus.slack(), Some(MS));
    bus.link().held = 100_000;
    bus.link().replies = vec![Fate::Arrives(900_000)];
    let error = bus.exchange_prepared(&list, &mut words).unwrap_err();
    let late = UdpError::Late {
        request: bus.link().newest.request.unwrap(),
        waited: MS + MS / 100 * 3,
        by: MS / 100 * 13,
    };
    assert_eq!(error, late);
    // Nor does it help to say more than it may wait.
    bus.link().held = 0;
    bus.link().says_us = Some(u16::MAX);
    bus.link().replies = vec![Fate::Arrives(1_900_000)];
    assert!(bus.exchange_prepared(&list, &mut words).is_err());
}

#[test]
fn the_board_is_not_asked_to_wait_longer_than_it_can() {
    let mut bus = bus();
    let longest = Duration::from_micros(65_535);
    assert!(bus.prepare_paced(&[READ], longest).unwrap().is_some());
    let longer = longest + MS / 1000;
    assert!(bus.prepare_paced(&[READ], longer).unwrap().is_none());
}

#[test]
fn a_refusal_that_comes_with_another_packet_is_said_and_nothing_is_counted_twice() {
    let mut bus = bus();
    let cycle = Cycle::new(&mut bus);
    let mut words = [0, 0, 5];
    for write in [false, true] {
        bus.link().refusals = vec![true];
        let error = if write {
            bus.exchange_prepared(&cycle.write, &mut words)
        } else {
            bus.post(&cycle.read)
        };
        assert_eq!(error.unwrap_err().kind(), BusErrorKind::Refused);
    }
    bus.exchange_prepared(&cycle.read, &mut words).unwrap();
    let counted = bus.statistics();
    assert_eq!((counted.lost, counted.lost_writes), (0, 1));
    assert!(counted.doubts > 0, "the write was not executed");
}

#[test]
fn a_list_of_another_bus_is_refused() {
    let (mut one, mut other) = (bus(), bus());
    let list = one.prepare(&[READ]).unwrap();
    let _ = other.prepare(&[Access::write(0x2000, 0, 2)]).unwrap();
    let error = other.exchange_prepared(&list, &mut [0; 2]).unwrap_err();
    assert!(matches!(error, UdpError::NotPrepared { .. }), "{error}");
    assert!(other.post(&list).is_err());
}
