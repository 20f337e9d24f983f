//! Snapshots on simulated boards, in virtual time, with readers in real threads.

use core::ops::ControlFlow;
use core::time::Duration;
use std::thread;
use std::vec::Vec;

use super::*;
use crate::driver::Settings;
use crate::hal::{Age, Output};
use crate::runner::Runner;
use mesa_hal_sim::remote::Cable;
use mesa_hal_sim::{Motor, SimFpga, devices, machines};

fn driver() -> Driver<SimFpga> {
    let board = machines::six_axes_7i92(Motor::default());
    Driver::start(board, Settings::default()).expect("it starts")
}

/// All analog outputs, which are far apart in a set, with other words in between.
fn outputs(driver: &Driver<SimFpga>) -> Vec<Output<f64>> {
    let name = |number| format!("hm2_7i92.0.7i77.0.1.analogout{number}");
    let outputs = (0..6).map(|number| driver.pins().output(&name(number)));
    outputs.map(|output| output.expect("a 7I77")).collect()
}

fn cycle(driver: &mut Driver<SimFpga>, writer: &mut SnapshotWriter) {
    let _ = driver.read().expect("the bus does not fail");
    driver.write().expect("the bus does not fail");
    writer.publish(driver).expect("its driver");
    driver.bus_mut().wait(Duration::from_millis(1));
}

#[test]
fn reader_in_another_thread_never_sees_a_torn_set() {
    let mut driver = driver();
    let outputs = outputs(&driver);
    let limit = driver.pins().output("hm2_7i92.0.led.CR01");
    let first: Output<bool> = limit.expect("there");
    let mut writer = SnapshotWriter::new(&driver);
    let reader = writer.reader();
    let (mut published, mut whole) = (0_u64, 0);
    thread::scope(|scope| {
        let readers = [0, 1].map(|_| {
            let reader = reader.clone();
            let outputs = &outputs;
            scope.spawn(move || read_until_the_end(&reader, outputs, first))
        });
        while published < 200_000 || (published < 20_000_000 && !readers[0].is_finished()) {
            // All outputs are the number of the set.
            published += 1;
            let pins = driver.pins_mut();
            for &output in &outputs {
                pins.set(output, published as f64);
            }
            pins.set(first, published.is_multiple_of(2));
            writer.publish(&driver).expect("its driver");
            if published.is_multiple_of(64) {
                thread::yield_now();
            }
        }
        drop(writer);
        for reader in readers {
            whole += reader.join().expect("no torn set");
        }
    });
    assert!(whole > 100, "{whole} whole sets of {published}");
}

/// Reads until the end, or until some thousands of consistent sets; returns their number.
fn read_until_the_end(
    reader: &SnapshotReader,
    outputs: &[Output<f64>],
    first: Output<bool>,
) -> u64 {
    let (mut whole, mut last) = (0, 0.0);
    let mut snapshot = None;
    while whole < 5000 && !reader.has_ended() {
        match &mut snapshot {
            None => snapshot = reader.read().ok(),
            Some(snapshot) => match reader.read_into(snapshot) {
                Ok(()) => {
                    let values: Vec<_> = outputs.iter().map(|&o| snapshot.read(o).value).collect();
                    let number = values[0];
                    assert!(values.iter().all(|&value| value == number), "{values:?}");
                    assert_eq!(snapshot.read(first).value, number % 2.0 == 0.0);
                    assert!(number >= last, "{number} after {last}");
                    (whole, last) = (whole + 1, number);
                }
                Err(error) => assert_eq!(error, SnapshotError::Torn { tries: TRIES }),
            },
        }
    }
    whole
}

#[test]
fn snapshot_matches_the_driver_for_every_pin_group_and_remote() {
    let mut driver = driver();
    let mut writer = SnapshotWriter::new(&driver);
    let reader = writer.reader();
    assert_eq!(reader.read().err(), Some(SnapshotError::NotYet));
    for n in 0..200 {
        if n == 50 {
            let end = driver.bus_mut().remote_mut(0, 0).expect("a remote");
            let cable: &mut Cable = devices::find_cable(end).expect("a cable");
            cable.unplug();
        }
        for (output, volts) in outputs(&driver).into_iter().zip([1.0, -2.0, 3.0]) {
            driver.pins_mut().set(output, volts);
        }
        cycle(&mut driver, &mut writer);
        same(&driver, &fresh(&driver, &mut writer));
    }
    let remotes: Vec<_> = reader.read().expect("published").remotes().collect();
    assert!(matches!(remotes[0].state, RemoteState::Offline { .. }));
    let since = remotes[0].since.since(remotes[1].since);
    let offline = Duration::from_millis(50)..Duration::from_millis(120);
    assert!(offline.contains(&since), "{since:?}");
    drop(writer);
    assert!(reader.has_ended());
    let last = reader.read().expect("the last one stays");
    assert_eq!(last.cycle(), driver.pins().cycle());
    is_not_fresh(&last);
}

/// A fresh snapshot, also on a busy host.
fn fresh(driver: &Driver<SimFpga>, writer: &mut SnapshotWriter) -> Snapshot {
    let mut tries = 0..1000;
    loop {
        writer.publish(driver).expect("its driver");
        let seen = writer.reader().read().expect("it was published");
        if seen.is_fresh() {
            return seen;
        }
        assert!(tries.next().is_some(), "never fresh: {:?}", seen.age());
    }
}

/// Asserts that no pin is valid and no group armed, and that all ages include that of the snapshot.
fn is_not_fresh(seen: &Snapshot) {
    assert!(!seen.is_fresh());
    for (info, reading) in seen.pins() {
        assert_eq!(reading.valid, info.role.is_param(), "{}", info.name);
        assert!(reading.age.time >= seen.age(), "{}", info.name);
        let group = seen.group_state(info.group).expect("its group");
        assert!(!group.valid && !group.armed, "{}", info.name);
    }
}

#[test]
fn snapshot_of_a_hanging_cycle_ages_and_is_not_valid() {
    let mut driver = driver();
    let mut writer = SnapshotWriter::new(&driver);
    let reader = writer.reader();
    for _ in 0..5 {
        cycle(&mut driver, &mut writer);
    }
    let before = fresh(&driver, &mut writer);
    let input = driver.pins().input("hm2_7i92.0.7i77.0.0.input-02");
    let input: crate::hal::Input<bool> = input.expect("there");
    assert!(before.read(input).valid);
    thread::sleep(MAX_AGE + Duration::from_millis(10));
    let seen = reader.read().expect("the last one stays");
    assert!(!seen.has_ended && seen.age() > MAX_AGE);
    is_not_fresh(&seen);
    assert!(before.read(input).valid, "as it was when it was taken");
    same(&driver, &fresh(&driver, &mut writer));
}

#[test]
fn run_that_ends_or_panics_leaves_nothing_that_looks_valid() {
    let name = "hm2_7i92.0.7i77.0.0.output-03";
    for panics in [false, true] {
        let mut runner = Runner::new(driver());
        let reader = runner.snapshot();
        let output = runner.driver.pins().output::<bool>(name).expect("there");
        let mut was_on = false;
        let run = std::panic::AssertUnwindSafe(|| {
            runner.run(|cycle| {
                cycle.pins_mut().set(output, true);
                if cycle.number == 20 {
                    was_on = reader.read().expect("published").read(output).value;
                    assert!(!panics, "a defect of the application");
                    return ControlFlow::Break(());
                }
                ControlFlow::Continue(())
            })
        });
        let ended = std::panic::catch_unwind(run);
        assert_eq!(ended.is_err(), panics);
        assert!(was_on);
        let last = reader.read().expect("the last one stays");
        is_not_fresh(&last);
        if !panics {
            assert!(!last.read(output).value, "what the stop has left");
        }
    }
}

fn same(driver: &Driver<SimFpga>, seen: &Snapshot) {
    let pins = driver.pins();
    assert_eq!((seen.cycle(), seen.time()), (pins.cycle(), pins.now()));
    assert_eq!(seen.board().0, driver.board_state());
    assert_eq!(seen.driver_statistics(), driver.statistics());
    assert_eq!(seen.bus_statistics(), driver.bus().statistics());
    assert_eq!(seen.pins().count(), pins.infos().len());
    // Ages include the time up to the taking of the snapshot.
    let later = |age: Age| Age {
        time: age.time.saturating_add(seen.age()),
        ..age
    };
    for (id, (info, reading)) in pins.ids().zip(seen.pins()) {
        assert_eq!(Some(info), pins.info_of(id));
        let mut is = pins.read_any(id);
        is.age = later(is.age);
        assert_eq!(reading, is, "{}", info.name);
    }
    for group in pins.groups() {
        let mut is = pins.group_state(group).expect("its own");
        is.age = later(is.age);
        assert_eq!(seen.group_state(group), Some(is));
    }
    let remotes: Vec<_> = remotes(driver).collect();
    assert_eq!(remotes.len(), seen.remotes().count());
    for (is, seen) in remotes.into_iter().zip(seen.remotes()) {
        assert_eq!(seen.label.id.channel, is.started.channel.index());
        assert_eq!((seen.label, seen.group), (is.label, is.pins.group));
        assert_eq!((seen.state, seen.faults), (is.state, is.faults));
        assert_eq!(seen.first_fault, is.first_fault);
        let counts = (seen.transfers, seen.failures, seen.restarts);
        assert_eq!(counts, (is.transfers, is.failures.total(), is.restarts));
    }
}

#[test]
fn another_driver_is_not_published_and_its_handles_read_nothing() {
    let (mut driver, other) = (driver(), driver());
    let mut writer = SnapshotWriter::new(&driver);
    assert_eq!(writer.publish(&other), Err(PinError::ForeignHandle));
    let reader = writer.reader();
    assert_eq!(reader.read().err(), Some(SnapshotError::NotYet));
    cycle(&mut driver, &mut writer);
    let seen = reader.read().expect("published");
    let foreign = outputs(&other)[0];
    assert!(!seen.read(foreign).valid);
    assert_eq!(seen.read_any(foreign.into()), None);
    assert_eq!(seen.group_state(other.group()), None);
}

#[test]
fn runner_shows_its_cycles_and_takes_commands_before_the_work() {
    let mut runner = Runner::new(driver());
    let reader = runner.snapshot();
    let sender = runner.commands(8);
    let output = outputs(&runner.driver)[0];
    let watch = reader.clone();
    let ended = runner.run(|cycle| {
        if cycle.number == 0 {
            assert_eq!(watch.read().err(), Some(SnapshotError::NotYet));
            sender.set(output, 3.25).expect("there is room");
            return ControlFlow::Continue(());
        }
        let seen = watch.read().expect("the cycle before was published");
        assert_eq!(seen.run_statistics().cycles, cycle.number);
        let expected = if cycle.number == 1 { 0.0 } else { 3.25 };
        assert_eq!(seen.read(output).value, expected);
        assert_eq!(cycle.pins().commanded(output), 3.25);
        if cycle.number == 3 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    assert_eq!(ended.stopped, Ok(()));
    assert!(reader.has_ended());
    assert_eq!(
        reader.read().expect("the last").run_statistics(),
        ended.statistics
    );
    assert!(sender.rearm().is_err(), "the queue has no reader");
}
