use super::{MEMORY_ERROR, Memory};
use crate::bus::{Access, BusError, BusErrorKind, RegisterBus, Reply};
use crate::transport::{Fault, Faulty};
use core::time::Duration;
use proptest::prelude::*;

#[test]
fn each_kind_is_injected_at_the_exchange_that_was_named() {
    for kind in [BusErrorKind::Lost, BusErrorKind::Late, BusErrorKind::Other] {
        for fault in [Fault::NotExecuted(kind), Fault::Executed(kind)] {
            let mut bus = Faulty::new(Memory::default(), 1);
            bus.fail_at(1, fault);
            let accesses = [Access::write(0x1000, 0, 1), Access::read(0x1004, 1, 1)];
            let mut words = [7, 99];
            bus.exchange(&accesses, &mut words).unwrap();
            assert_eq!(words, [7, 0]);
            let mut words = [8, 99];
            let error = bus.exchange(&accesses, &mut words).unwrap_err();
            assert_eq!(error, BusError::Injected { kind, exchange: 1 });
            assert_eq!(error.kind(), kind);
            assert_eq!(words, [8, 99], "a failed exchange changes no word");
            let executed = matches!(fault, Fault::Executed(_));
            assert_eq!(bus.inner.words[&0x1000], if executed { 8 } else { 7 });
            assert_eq!(bus.inner.exchanges, 1 + usize::from(executed));
            assert!(bus.read(0x1004).is_ok());
        }
    }
}

#[test]
fn silently_lost_write_is_reported_with_the_next_reply() {
    let mut bus = Faulty::new(Memory::default(), 1);
    bus.fail_at(0, Fault::AckedButLost);
    bus.fail_at(1, Fault::AckedButLost);
    let write = bus.prepare(&[Access::write(0x1000, 0, 1)], None).unwrap();
    let read = bus.prepare(&[Access::read(0x1000, 0, 1)], None).unwrap();
    assert_eq!(bus.run(&write, &mut [5]), Ok(Reply::UNKNOWN));
    assert!(bus.inner.words.is_empty());
    assert_eq!(bus.statistics().lost_writes, 0);
    let mut words = [9];
    let reply = bus.run(&read, &mut words).unwrap();
    assert_eq!((reply.certain, reply.lost_writes, words), (false, 1, [0]));
    assert_eq!(bus.statistics().lost_writes, 1);
    let reply = bus.run(&read, &mut words).unwrap();
    assert_eq!((reply.certain, reply.lost_writes), (true, 0));
}

/// The set-up reads a value again while `doubts` grows, so plain exchanges have to count them too.
#[test]
fn silently_lost_write_is_a_doubt_of_the_next_plain_read() {
    let mut bus = Faulty::new(Memory::default(), 1);
    bus.fail_at(0, Fault::AckedButLost);
    bus.write(0x1000, 5).unwrap();
    bus.write(0x1004, 6).unwrap();
    assert_eq!(bus.statistics().doubts, 0);
    assert_eq!(bus.read(0x1000), Ok(0));
    assert_eq!(bus.statistics().doubts, 1);
    assert_eq!(bus.statistics().lost_writes, 1);
    assert_eq!(bus.read(0x1004), Ok(6));
    assert_eq!(bus.statistics().doubts, 1);
}

#[test]
fn list_is_held_by_the_bus_inside_and_fails_as_a_whole() {
    let mut bus = Faulty::new(Memory::default(), 1);
    bus.inner.words.insert(0x1000, 7);
    assert!(bus.can_hold());
    let list = bus.prepare(&[Access::read(0x1000, 0, 1)], None).unwrap();
    bus.fail_at(0, Fault::NotExecuted(BusErrorKind::Lost));
    let mut words = [0];
    bus.start(&list, &words).unwrap();
    let error = bus.finish(&list, &mut words).unwrap_err();
    assert_eq!(error.kind(), BusErrorKind::Lost);
    assert_eq!((bus.inner.started, bus.inner.exchanges), (0, 0));
    bus.start(&list, &words).unwrap();
    let reply = bus.finish(&list, &mut words).unwrap();
    assert_eq!((words, bus.exchanges()), ([7], 2));
    assert_eq!(reply.slack, Some(Duration::from_micros(5)));
}

#[test]
fn errors_of_the_bus_inside_are_passed_on() {
    let mut bus = Faulty::new(Memory::default(), 1);
    bus.inner.fail_next = true;
    let error = bus.read(0).unwrap_err();
    assert_eq!(error, MEMORY_ERROR);
    assert_eq!(error.kind(), BusErrorKind::Device);
}

#[test]
fn faults_come_as_often_as_asked_for_and_stop_when_healed() {
    let seed = 42;
    let mut bus = Faulty::new(Memory::default(), seed);
    bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 0.1);
    bus.fail_randomly(Fault::Executed(BusErrorKind::Late), 0.05);
    let list = bus.prepare(&[Access::read(0, 0, 1)], None).unwrap();
    for _ in 0..20_000 {
        let _ = bus.run(&list, &mut [0]);
    }
    let statistics = bus.statistics();
    assert!((1_800..2_200).contains(&statistics.lost), "seed {seed}");
    assert!((750..1_050).contains(&statistics.late), "seed {seed}");
    bus.heal();
    for _ in 0..1_000 {
        let _ = bus.run(&list, &mut [0]).unwrap();
    }
    assert_eq!(bus.statistics(), statistics);
}

proptest! {
    #[test]
    fn same_seed_makes_the_same_faults(seed: u64) {
        let run = || {
            let mut bus = Faulty::new(Memory::default(), seed);
            bus.fail_randomly(Fault::Executed(BusErrorKind::Short), 0.3);
            (0..100).map(|_| bus.read(0).is_err()).collect::<Vec<_>>()
        };
        prop_assert_eq!(run(), run());
    }
}
