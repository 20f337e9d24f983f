//! A board that is listened to beside the driver that runs it.

use std::collections::BTreeMap;

use crate::common::machine::{Machine, fpga};
use mesa_hal::bus::{Access, BusError, BusErrorKind, Phase, ReadSlot};
use mesa_hal::driver::{BoardState, Listener};
use mesa_hal::hal::{AnyValue, Input, PinMaker, PinStore};
use mesa_hal::modules::{ListenCycle, Module, RegisterError, Registrar};
use mesa_hal::transport::{BusLog, Fault, Faulty, RecordedEntry, Recording};
use mesa_hal::{Board, CycleError, RegisterBus, Settings};
use mesa_hal_sim::SimFpga;

type Recorded = Recording<Faulty<SimFpga>>;

fn machine() -> Machine<Recorded> {
    let mut machine = Machine::on(
        Recording::new(Faulty::new(fpga(), 3), BusLog::new(10_000)),
        |_| {},
    );
    machine.cycles(20);
    machine.driver.bus_mut().log.resume();
    machine
}

fn listener<B: RegisterBus + mesa_hal::Clock>(bus: B) -> Listener<B> {
    let board = Board::identify(bus, Settings::default()).expect("a 7I92");
    board.listen().expect("a 7I92")
}

#[test]
fn listener_writes_nothing_and_the_driver_runs_on() {
    let mut machine = machine();
    let mut listener = listener(machine.driver.bus_mut());
    for _ in 0..10 {
        listener.read().expect("a board");
    }
    assert!(listener.shown().count() > 20);
    drop(listener);
    let log = &machine.driver.bus().log;
    let writes = log
        .entries()
        .filter(|entry| matches!(entry, RecordedEntry::Written { .. }));
    assert_eq!((writes.count(), log.is_frozen()), (0, false));
    assert!(log.entries().len() > 100);
    machine.cycles(20);
    assert_eq!(machine.driver.board_state(), BoardState::Running);
    assert_eq!(machine.driver.statistics().watchdog_bites, 0);
}

#[test]
fn values_end_with_a_failed_read_and_with_another_board() {
    let mut machine = machine();
    let bus = machine.driver.bus_mut();
    let mut listener = listener(bus);
    listener.read().expect("a board");
    let pin = listener
        .pins()
        .id("hm2_7i92.0.watchdog.has_bit")
        .expect("a pin");
    assert_eq!(listener.value(pin), Some(false.into()));
    let faulty = &mut listener.bus_mut().inner;
    let next = faulty.exchanges();
    for exchange in next..next + 2 {
        faulty.fail_at(exchange, Fault::NotExecuted(BusErrorKind::Lost));
    }
    for n in 1..3 {
        match listener.read() {
            Err(CycleError::Read { consecutive, .. }) => assert_eq!(consecutive, n),
            other => panic!("{other:?}"),
        }
        assert_eq!(listener.value(pin), None);
        assert_eq!(listener.shown().count(), 0);
    }
    listener.read().expect("it answers again");
    assert_eq!(listener.value(pin), Some(false.into()));
    listener.bus_mut().inner.inner.reset_for(1_000_000_000);
    let absent = listener.read();
    assert!(absent.is_err(), "{absent:?}");
    assert_eq!(listener.value(pin), None);
}

/// Count of the first encoder of the 7I92.
const COUNT: u16 = 0x3600;

/// The count of the first encoder, as a pin of the application's own.
#[derive(Debug)]
struct Own {
    counter: ReadSlot,
    pin: Input<u32>,
    foreign: Input<u32>,
}

impl Own {
    fn register(r: &mut Registrar<'_>) -> Result<Input<u32>, RegisterError> {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "other.");
        let foreign = make.input("word")?;
        let pin = r.maker("own.").input("counter")?;
        let counter = r.image.read(Phase::Data, COUNT);
        r.add(Self {
            counter,
            pin,
            foreign,
        });
        Ok(pin)
    }
}

impl Module for Own {
    fn listen(&mut self, cycle: &mut ListenCycle<'_>) {
        let word = cycle.words.word(self.counter);
        cycle.show(self.pin, word);
        cycle.show(self.foreign, !word);
    }
}

#[test]
fn own_module_shows_its_pin_and_no_pin_of_another_store() {
    let mut machine = machine();
    let mut board = Board::identify(machine.driver.bus_mut(), Settings::default()).expect("a 7I92");
    let pin = board.add(Own::register).expect("a module");
    let mut listener = board.listen().expect("a 7I92");
    assert_eq!(listener.value(pin), None, "before the first read");
    listener.read().expect("a board");
    let word = listener.bus_mut().read(COUNT).expect("a board");
    assert_eq!(listener.value(pin), Some(word.into()));
    let first = listener
        .pins()
        .infos()
        .first()
        .map(|info| info.name.clone());
    let first = listener
        .pins()
        .id(&first.expect("pins"))
        .expect("the first");
    assert_ne!(listener.value(first), Some((!word).into()));
}

/// A board that is reloaded in the middle of an exchange: from then on its registers read as ones.
struct Vanishing {
    fpga: SimFpga,
    /// Number of words of an exchange that still come from the board.
    left: Option<usize>,
}

impl mesa_hal::bus::BusLayer for Vanishing {
    type Inner = SimFpga;

    fn inner(&self) -> &SimFpga {
        &self.fpga
    }

    fn inner_mut(&mut self) -> &mut SimFpga {
        &mut self.fpga
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.fpga.exchange(accesses, words)?;
        if let Some(left) = self.left {
            words
                .iter_mut()
                .skip(left)
                .for_each(|word| *word = u32::MAX);
        }
        Ok(())
    }
}

/// Each value of a look that succeeds was read before.
#[test]
fn board_that_goes_in_the_middle_of_a_look_has_no_values() {
    let bus = Vanishing {
        fpga: fpga(),
        left: None,
    };
    let mut listener = listener(bus);
    listener.read().expect("a board");
    let values = |listener: &Listener<Vanishing>| -> BTreeMap<String, AnyValue> {
        let shown = listener.shown();
        shown
            .map(|(info, value)| (info.name.clone(), value))
            .collect()
    };
    let complete = values(&listener);
    let (mut absent, mut read) = (0, 0);
    for left in 0..40 {
        listener.bus_mut().left = Some(left);
        let result = listener.read();
        let shown = values(&listener);
        if result.is_err() {
            let is_absent = matches!(
                result,
                Err(CycleError::NotThere {
                    found: u32::MAX,
                    ..
                })
            );
            assert!(is_absent, "{left}: {result:?}");
            assert!(shown.is_empty(), "{left}: {shown:?}");
            absent += 1;
        } else {
            let same = shown
                .iter()
                .all(|(name, value)| complete.get(name) == Some(value));
            assert!(same, "{left}: {shown:?}, not {complete:?}");
            read += 1;
        }
    }
    assert!(absent > 15 && read > 0, "{absent} absent, {read} read");
    listener.bus_mut().left = None;
    listener.read().expect("a board again");
    assert_eq!(values(&listener), complete);
}
