//! Pins of the application's own, beside those of the board.

use std::ops::ControlFlow;
use std::thread;
use std::time::Duration;

use crate::common::machine::fpga;
use mesa_hal::bus::Clock;
use mesa_hal::hal::{Age, HalType, PinError, Spec};
use mesa_hal::runner::{
    CommandError, CommandQueue, Edge, Runner, Scope, ScopeRange, ScopeState, SnapshotWriter,
    Trigger,
};
use mesa_hal::{Board, Driver, InOut, Input, Output, Settings};
use mesa_hal_sim::SimFpga;

/// Cycles of the application.
const CYCLES: u64 = 20_000;

struct Own {
    state: Input<u32>,
    count: Input<i32>,
    error: Input<f64>,
    is_homed: Input<bool>,
    speed: Output<f64>,
    step: InOut<i32>,
}

fn started() -> (Driver<SimFpga>, Own) {
    let mut board = Board::identify(fpga(), Settings::default()).expect("a board");
    let mut make = board.own_pins("mill").expect("a prefix");
    let speed = Spec {
        limits: Some((-10.0, 10.0)),
        ..Spec::from("speed")
    };
    let own = Own {
        state: make.input("state").expect("a pin"),
        count: make.input("count").expect("a pin"),
        error: make.input("x.error").expect("a pin"),
        is_homed: make.input("x.is-homed").expect("a pin"),
        speed: make.output(speed, 1.0).expect("a pin"),
        step: make.inout("step").expect("a pin"),
    };
    (board.start().expect("it starts"), own)
}

fn cycle(driver: &mut Driver<SimFpga>) {
    let _ = driver.read().expect("the bus is well");
    driver.write().expect("the bus is well");
    driver.bus_mut().wait(Duration::from_millis(1));
}

/// A reader in another thread: whatever it takes, all values are those of one cycle.
#[test]
fn snapshot_has_the_values_of_the_same_cycle_as_the_boards() {
    let (driver, own) = started();
    let transfers = "hm2_7i92.0.sserial.port-0.transfers";
    let transfers = driver.pins().input::<u64>(transfers).expect("a pin");
    let mut runner = Runner::new(driver);
    let snapshots = runner.snapshot();
    let (state, count) = (own.state, own.count);
    let reader = thread::spawn(move || {
        let mut seen = 0;
        while !snapshots.has_ended() {
            let Ok(snapshot) = snapshots.read() else {
                continue;
            };
            if snapshot.cycle() > CYCLES {
                // The driver is stopped, which takes cycles of its own.
                continue;
            }
            let own = snapshot.read(state).value;
            assert_eq!(u64::from(own), snapshot.cycle());
            let before = snapshot.read(count).value;
            assert_eq!(before as u64, snapshot.read(transfers).value);
            seen += 1;
        }
        seen
    });
    let ended = runner.run(|cycle| {
        let number = cycle.pins().cycle() as u32;
        let done = cycle.pins().read(transfers).value as i32;
        let pins = cycle.pins_mut();
        pins.show(own.state, number);
        pins.show(own.count, done);
        if cycle.number % 200 == 0 {
            thread::sleep(Duration::from_millis(1));
        }
        if cycle.number < CYCLES {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    });
    ended.stopped.expect("outputs off");
    assert!(reader.join().expect("all of one cycle") > 10);
}

#[test]
fn own_pins_of_any_type_are_invalid_until_set_then_have_an_age() {
    let (mut driver, own) = started();
    let mut writer = SnapshotWriter::new(&driver);
    let reader = writer.reader();
    cycle(&mut driver);
    writer.publish(&driver).expect("its own");
    let seen = reader.read().expect("published");
    let error = seen.read(own.error);
    assert_eq!((error.valid, error.age), (false, Age::NEVER));
    driver.pins_mut().show(own.error, -0.125);
    driver.pins_mut().show(own.is_homed, true);
    driver.pins_mut().show(own.count, -7);
    writer.publish(&driver).expect("its own");
    let seen = reader.read().expect("published");
    assert_eq!(seen.read(own.error).ok(), Some(-0.125));
    assert_eq!(seen.read(own.is_homed).ok(), Some(true));
    assert_eq!(seen.read(own.count).ok(), Some(-7));
    assert_eq!(seen.read(own.state).ok(), None, "not shown yet");
    assert_eq!(seen.read(own.error).age.cycles, 0);
    for _ in 0..50 {
        cycle(&mut driver);
    }
    let age = driver.pins().read(own.error);
    assert_eq!(
        (age.valid, age.age.cycles),
        (true, 50),
        "an application that hangs shows"
    );
    // Nothing that fails makes it invalid.
    driver.bus_mut().reload();
    for _ in 0..5 {
        cycle(&mut driver);
    }
    assert!(driver.pins().read(own.error).valid);
    driver.pins_mut().show(own.error, f64::NAN);
    let error = driver.pins().read(own.error);
    assert_eq!((error.value, error.valid), (-0.125, false));
    assert_eq!(driver.pins().rejections(own.error).not_finite, 1);
    let named = driver.pins().input::<f64>("mill.x.error");
    assert_eq!(named, Ok(own.error));
    let info = driver.pins().info(own.state).expect("its own");
    assert_eq!(info.hal_type, HalType::U32);
}

#[test]
fn pin_of_the_board_shows_nothing_of_the_application() {
    let (mut driver, _) = started();
    cycle(&mut driver);
    let input = driver.pins().input::<bool>("hm2_7i92.0.7i77.0.0.input-00");
    let input = input.expect("a pin");
    assert_eq!(driver.pins().foreign_handles(), 0);
    driver.pins_mut().show(input, true);
    assert_eq!(driver.pins().foreign_handles(), 1);
    assert!(!driver.pins().read(input).value);
    let mut board = Board::identify(fpga(), Settings::default()).expect("a board");
    let taken = board.own_pins("hm2_7i92.0").map(drop);
    assert!(
        matches!(taken, Err(PinError::NameTaken { .. })),
        "{taken:?}"
    );
    let empty = board.own_pins("").map(drop);
    assert!(matches!(empty, Err(PinError::BadName { .. })), "{empty:?}");
    assert_eq!(board.pins().groups().count(), 3, "one of the application");
}

#[test]
fn commands_of_another_thread_are_taken_once_within_limits() {
    let (mut driver, own) = started();
    let mut queue = CommandQueue::new(&driver, 8);
    let sender = queue.sender();
    let shown = sender.set_any(own.state.into(), 1_u32.into());
    assert!(matches!(
        shown,
        Err(CommandError::Pin(PinError::NotSettable { .. }))
    ));
    assert_eq!(driver.pins_mut().command(own.speed), 1.0, "its safe value");
    for (sent, taken) in [(2.5, 2.5), (99.0, 10.0), (f64::NAN, 1.0)] {
        sender.set(own.speed, sent).expect("sent");
        queue.take(&mut driver);
        assert_eq!(driver.pins_mut().command(own.speed), taken);
        cycle(&mut driver);
    }
    sender.set(own.step, -3).expect("sent");
    queue.take(&mut driver);
    assert_eq!(driver.pins_mut().take(own.step), -3);
    assert_eq!(driver.pins_mut().take(own.step), 0);
    // A fault of the board takes no command from the application.
    driver.bus_mut().reload();
    for _ in 0..5 {
        cycle(&mut driver);
    }
    sender.set(own.speed, 4.0).expect("sent");
    queue.take(&mut driver);
    assert_eq!(driver.pins_mut().command(own.speed), 4.0);
    assert_eq!(sender.statistics().refused, 0);
}

#[test]
fn scope_is_triggered_by_a_value_of_the_application() {
    let (driver, own) = started();
    let trigger = Trigger {
        pin: own.error.into(),
        level: 1.0,
        edge: Edge::Rising,
    };
    let range = ScopeRange {
        before: 3,
        cycles: 8,
    };
    let recorded = [own.error.into(), own.state.into()];
    let mut scope = Scope::new(driver.pins(), &recorded, trigger, range).expect("possible");
    let ended = Runner::new(driver).run(|cycle| {
        let number = cycle.number;
        let pins = cycle.pins_mut();
        pins.show(own.error, number as f64 / 50.0);
        pins.show(own.state, number as u32);
        match scope.sample(cycle.pins()) {
            ScopeState::Done => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    });
    ended.stopped.expect("outputs off");
    let at = scope.rows().find(|row| row.offset == 0).expect("recorded");
    let values: Vec<_> = at.values().flatten().collect();
    assert_eq!(values, [1.0.into(), 50_u32.into()]);
}
