//! What an exchange does with the registers.

use mesa_pci::BoardKind;
use mesa_pci::simulated::SimulatedRegisters;
use mesa_wire::MesaError;
use mesa_wire::bus::{Access, BusError, BusErrorKind, RegisterBus};

use crate::folder::{Folder, Served, device, peek, plain, poke};

/// A board that keeps all accesses; a read of `COUNTER` counts.
#[derive(Default)]
struct Journal {
    accesses: Vec<(char, u16, u32)>,
    count: u32,
}

const COUNTER: u16 = 0x2000;

impl SimulatedRegisters for Journal {
    fn advance_to(&mut self, _: u64) {}

    fn read(&mut self, address: u16) -> u32 {
        let word = match address {
            0x0100 => 0x55AA_CAFE,
            COUNTER => {
                self.count += 1;
                self.count
            }
            _ => u32::from(address) | 0x1_0000,
        };
        self.accesses.push(('r', address, word));
        word
    }

    fn write(&mut self, address: u16, value: u32) {
        self.accesses.push(('w', address, value));
    }
}

#[test]
fn bus_loads_and_stores_words_of_the_mapped_file() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    poke(&folder, 0x1000, 5);
    poke(&folder, 0xFFFC, 6);
    let mut bus = device(root.path()).open().expect("a board");
    let list = [
        Access::read(0x1000, 0, 1),
        Access::write(0x1004, 1, 2),
        Access::read(0xFFFC, 3, 1),
    ];
    let mut words = [0, 8, 9, 0];
    bus.exchange(&list, &mut words).expect("exchanged");
    assert_eq!(words, [5, 8, 9, 6]);
    assert_eq!(
        [0x1000, 0x1004, 0x1008].map(|at| peek(&folder, at)),
        [5, 8, 9]
    );
}

#[test]
fn accesses_arrive_once_in_order_even_if_the_value_is_unchanged() {
    let root = Folder::new();
    let served = Served::start(root.path(), Journal::default());
    let mut bus = device(root.path()).open().expect("a board");
    let list = [
        Access::write(0x1000, 0, 1),
        Access::write(0x1000, 0, 1),
        Access::read(COUNTER, 1, 1),
        Access::read(COUNTER + 4, 2, 2),
        Access::write(0x1000, 0, 1),
        Access::read(COUNTER, 4, 1),
    ];
    let mut words = [7, 0, 0, 0, 0];
    let list = bus.prepare(&list, None).expect("a list");
    let reply = bus.run(&list, &mut words).expect("a reply");
    assert_eq!(
        (words, reply.certain),
        ([7, 1, 0x1_2004, 0x1_2008, 2], true)
    );
    drop(bus);
    let accesses = served.end().accesses;
    let expected = [
        ('r', 0x0100, 0x55AA_CAFE),
        ('w', 0x1000, 7),
        ('w', 0x1000, 7),
        ('r', COUNTER, 1),
        ('r', COUNTER + 4, 0x1_2004),
        ('r', COUNTER + 8, 0x1_2008),
        ('w', 0x1000, 7),
        ('r', COUNTER, 2),
    ];
    assert_eq!(accesses, expected);
}

#[test]
fn more_writes_than_the_log_holds_arrive_all() {
    let root = Folder::new();
    let served = Served::start(root.path(), Journal::default());
    let mut bus = device(root.path()).open().expect("a board");
    let mut words: Vec<u32> = (0..10_000).collect();
    bus.exchange(&[Access::write(0x1000, 0, 10_000)], &mut words)
        .expect("exchanged");
    drop(bus);
    let accesses = served.end().accesses;
    let written = accesses.into_iter().filter(|&(way, ..)| way == 'w');
    assert!(written.map(|(_, _, word)| word).eq(0..10_000));
}

#[test]
fn set_up_writes_are_forced_by_a_read_cycle_writes_by_the_next() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    poke(&folder, 0x1000, 5);
    let mut bus = device(root.path()).open().expect("a board");
    let counts = |bus: &mesa_pci::PciBus| {
        let counts = bus.counts();
        (counts.reads, counts.writes, counts.forced)
    };
    assert_eq!(counts(&bus), (1, 0, 0), "the cookie");
    bus.exchange(&[Access::write(0x1000, 0, 2)], &mut [1, 2])
        .expect("set-up");
    assert_eq!(counts(&bus), (2, 2, 1));
    let list = [Access::write(0x1000, 0, 1), Access::read(0x1004, 1, 1)];
    bus.exchange(&list, &mut [1, 0]).expect("set-up");
    assert_eq!(counts(&bus), (3, 3, 1), "the read at the end has forced it");
    let write = bus
        .prepare(&[Access::write(0x1000, 0, 1)], None)
        .expect("a list");
    let read = bus
        .prepare(&[Access::read(0x1000, 0, 1)], None)
        .expect("a list");
    let reply = bus.run(&write, &mut [1]).expect("posted");
    assert_eq!((counts(&bus), reply.certain), ((3, 4, 1), false));
    let reply = bus.run(&read, &mut [0]).expect("read");
    assert_eq!((counts(&bus), reply.certain), ((4, 4, 1), true));
    bus.write_all(&[Access::write(0x1000, 0, 1)], &mut [1])
        .expect("posted");
    assert_eq!(counts(&bus), (4, 5, 1));
}

#[test]
fn board_that_vanishes_fails_the_list_and_no_word_changes() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    let mut bus = device(root.path()).open().expect("a board");
    poke(&folder, 0x1004, u32::MAX);
    let list = bus
        .prepare(&[Access::read(0x1000, 0, 2)], None)
        .expect("a list");
    let mut words = [7, 7];
    bus.run(&list, &mut words)
        .expect("all ones are a value while the cookie is there");
    assert_eq!((words, bus.counts().doubted), ([0, u32::MAX], 1));
    poke(&folder, 0x0100, u32::MAX);
    let mut words = [7, 7];
    let error = bus.run(&list, &mut words).expect_err("vanished");
    assert_eq!(words, [7, 7]);
    assert_eq!(error.kind(), BusErrorKind::Lost);
    assert!(
        error
            .to_string()
            .contains("0000:05:00.0: the board does not answer"),
        "{error}"
    );
    assert!(error.advice().is_some());
    let error = bus.write(0x1000, 1).expect_err("a forced write");
    assert!(matches!(
        error,
        BusError::Vanished {
            cookie: u32::MAX,
            ..
        }
    ));
}

#[test]
fn simulated_board_is_taken_from_the_bus_and_put_back() {
    let root = Folder::new();
    let served = Served::start(root.path(), Journal::default());
    let mut bus = device(root.path()).open().expect("a board");
    assert_eq!(bus.read(0x3000), Ok(0x1_3000));
    served.unplug(true);
    // The simulator looks every millisecond.
    let gone = (0..1000).find_map(|_| bus.read(0x3000).err());
    assert!(matches!(gone, Some(BusError::Vanished { .. })), "{gone:?}");
    served.unplug(false);
    assert!((0..1000).any(|_| bus.read(0x3000) == Ok(0x1_3000)));
    drop(served.end());
    let error = bus.read(0x3000).expect_err("no simulator");
    assert!(matches!(error, BusError::Unanswered { .. }), "{error}");
}

#[test]
fn access_that_cannot_be_is_refused_before_anything_is_accessed() {
    let root = Folder::new();
    let folder = plain(root.path(), BoardKind::I5i25);
    let mut bus = device(root.path()).open().expect("a board");
    for bad in [
        Access::write(0x1002, 0, 1),
        Access::write(0xFFFC, 0, 2),
        Access::write(0x1000, 1, 2),
        Access::read(0x1000, u16::MAX, u16::MAX),
    ] {
        let list = [Access::write(0x3000, 0, 1), bad];
        let error = bus.exchange(&list, &mut [5, 5]).expect_err("refused");
        assert_eq!(error.kind(), BusErrorKind::Invalid);
        assert_eq!(peek(&folder, 0x3000), 0);
    }
}
