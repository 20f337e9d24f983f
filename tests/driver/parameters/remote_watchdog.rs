//! A remote uses a written watchdog time only from its next power-up on, and does not report the
//! time in use until then: the driver lets the watchdog bite. The truth is the time for which an
//! output of the simulated remote stays on without process data.

use std::time::Duration;

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, World, fpga};
use crate::common::once::Once;
use mesa_hal::RemoteId;
use mesa_hal::bus::{BusErrorKind, Clock};
use mesa_hal::driver::{
    Board, BoardState, Driver, DriverError, EventKind, RemoteWatchdog, Settings,
};
use mesa_hal::lbp::RemoteFaults;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::SimFpga;
use mesa_hal_sim::devices::{Device, Outputs48};
use mesa_hal_sim::remote::{SimRemote, Toward, WireFault};

const FIFTY: RemoteWatchdog = RemoteWatchdog::Known(Duration::from_millis(50));
const NAME: &str = "nvwatchdogtimeout";

/// A board whose 7I72 reports `written` and uses `used`: written, powered up with it, written
/// again, and found by another program.
fn board(used: u32, written: u32) -> SimFpga {
    let mut bus = fpga();
    for (millis, is_used) in [(used, true), (written, false)] {
        let board = Board::identify(bus, Settings::default()).expect("a board");
        let mut board = board.discover().expect("its remotes");
        board
            .write_remote_parameter((0, OUTPUTS as u8), NAME, millis)
            .expect("it takes it");
        let mut machine = Machine::with(board.start().expect("all of them run"));
        if is_used {
            let now = machine.now();
            machine.device_mut(OUTPUTS).set_power(now, false);
            machine.device_mut(OUTPUTS).set_power(now, true);
        }
        bus = machine.driver.shutdown().0;
        bus.wait(Duration::from_secs(1));
    }
    bus
}

fn runs(machine: &mut Machine) {
    machine.until(7000, |machine| {
        let all = [FIELD, ANALOG, OUTPUTS];
        machine.driver.rearm().unwrap().waiting == 0
            && all.iter().all(|&channel| machine.is_valid(channel))
    });
}

/// Time for which an output stays on without process data, up to 3 s, in ms.
fn stays_on(machine: &mut Machine) -> u64 {
    machine.cards.set_all(machine.driver.pins_mut());
    machine.cycles(3);
    assert_eq!(
        machine.device(OUTPUTS).world().output(47),
        Some(true),
        "it is on"
    );
    let begin = machine.now();
    let is_on = |machine: &Machine| machine.device(OUTPUTS).world().output(47) == Some(true);
    while is_on(machine) && machine.now() - begin < 3_000_000_000 {
        machine.pass_nanos(1_000_000);
    }
    (machine.now() - begin) / 1_000_000
}

#[test]
fn watchdog_other_than_last_written_is_found_and_counts_as_off() {
    for (used, written, proved, true_time) in [
        (50, 50, 50..=50, 49..=52),
        // The others have 50 ms, so that it gets no data for longer than its own 20.
        (50, 20, 60..=75, 49..=52),
        (20, 50, 50..=50, 19..=22),
        (5000, 50, 0..=0, 2999..=3001),
        (0, 50, 0..=0, 2999..=3001),
    ] {
        let what = format!("{used} ms in use, {written} written");
        let started = Driver::start(board(used, written), Settings::default());
        let mut machine = Machine::with(started.expect("all of them run"));
        let said = RemoteWatchdog::Known(Duration::from_millis(written.into()));
        assert_eq!(machine.status(OUTPUTS).watchdog, said, "{what}");
        runs(&mut machine);
        machine.cards.set_all(machine.driver.pins_mut());
        machine.cycles(3);
        machine.driver.prove_watchdogs().expect("the bus works");
        let found = machine.status(OUTPUTS).watchdog;
        let millis = found.time().map_or(0, |time| time.as_millis());
        assert!(proved.contains(&millis), "{what}: {found:?}");
        for channel in [FIELD, ANALOG] {
            assert_eq!(machine.status(channel).watchdog, FIFTY, "{what}");
        }
        // No output that was on comes on again by itself.
        for _ in 0..300 {
            machine.cycles(1);
            for channel in [FIELD, OUTPUTS] {
                let world = machine.device(channel).world();
                assert!((0..16).all(|n| world.output(n) == Some(false)), "{what}");
            }
        }
        assert_eq!(machine.driver.board_state(), BoardState::Running);
        runs(&mut machine);
        let time = stays_on(&mut machine);
        assert!(true_time.contains(&time), "{what}: {time} ms");
    }
}

#[test]
fn watchdog_that_is_off_by_its_parameter_is_not_waited_for() {
    let started = Driver::start(board(0, 0), Settings::default());
    let mut machine = Machine::with(started.expect("all of them run"));
    machine.cable(FIELD).unplug();
    machine.cable(ANALOG).unplug();
    machine.until(500, |machine| {
        !machine.is_running(FIELD) && !machine.is_running(ANALOG)
    });
    let before = machine.now();
    machine.driver.prove_watchdogs().expect("nothing is asked");
    assert_eq!(machine.now(), before);
    assert_eq!(machine.status(OUTPUTS).watchdog, RemoteWatchdog::Off);
}

/// The bus fails from any exchange of the call on: the result is an error, or a true statement
/// about a watchdog.
#[test]
fn bus_failure_never_reports_a_watchdog_better_than_it_is() {
    let mut has_failed = 0;
    for exchange in (0..40).step_by(5) {
        for count in [1, 2000] {
            let bus = Faulty::new(board(0, 50), 1);
            let driver = Driver::start(bus, Settings::default()).expect("all of them run");
            let mut machine = Machine::with(driver);
            machine.cycles(5);
            let bus = machine.driver.bus_mut();
            for failing in bus.exchanges() + exchange..bus.exchanges() + exchange + count {
                bus.fail_at(failing, Fault::NotExecuted(BusErrorKind::Lost));
            }
            match machine.driver.prove_watchdogs() {
                Ok(()) => assert_eq!(machine.status(OUTPUTS).watchdog, RemoteWatchdog::Off),
                Err(error) => {
                    has_failed += 1;
                    assert!(
                        matches!(
                            error,
                            DriverError::NotRunning { .. } | DriverError::NotHeard { .. }
                        ) || error.to_string().contains("Lost, injected"),
                        "{error}"
                    );
                }
            }
            let world = machine.driver.bus_mut().fpga();
            let device = crate::common::machine::device(world, OUTPUTS);
            assert!((0..48).all(|n| device.world().output(n) == Some(false)));
        }
    }
    assert!(has_failed > 2, "{has_failed}");
}

/// Without an answer nothing is known: neither that it bites, nor that it is off. Late replies are
/// an answer as soon as they are to queries after the silence.
#[test]
fn remote_without_reply_in_the_test_is_named_and_keeps_its_time() {
    let mut not_heard = 0;
    for (late, used) in (0..20).flat_map(|n| [(n * 50_000, 50), (n * 50_000, 0)]) {
        let what = format!("replies {late} ns late, {used} ms in use");
        let started = Driver::start(board(used, 50), Settings::default());
        let mut machine = Machine::with(started.expect("all of them run"));
        runs(&mut machine);
        if late == 0 {
            machine.cable(OUTPUTS).unplug();
        } else {
            let fault = WireFault::Late(late);
            machine
                .cable(OUTPUTS)
                .inject_by_chance(Toward::Fpga, fault, 1.0);
        }
        let truth = if used == 0 {
            RemoteWatchdog::Off
        } else {
            FIFTY
        };
        let found = machine.driver.prove_watchdogs();
        let watchdog = machine.status(OUTPUTS).watchdog;
        match found {
            Ok(()) => assert_eq!(watchdog, truth, "{what}"),
            Err(DriverError::NotHeard { remote }) => {
                not_heard += 1;
                assert_eq!(remote, RemoteId::new(0, OUTPUTS as u8), "{what}");
                assert_eq!(watchdog, FIFTY, "{what}");
            }
            Err(error) => panic!("{what}: {error}"),
        }
        assert!(late > 0 || found.is_err(), "{what}");
        for channel in [FIELD, ANALOG] {
            assert_eq!(machine.status(channel).watchdog, FIFTY, "{what}");
        }
        machine.cable(OUTPUTS).replug();
        machine.cable(OUTPUTS).heal();
        machine.cycles(100);
        runs(&mut machine);
        machine.driver.prove_watchdogs().expect("all are heard");
        assert_eq!(machine.status(OUTPUTS).watchdog, truth, "{what}");
    }
    println!("{not_heard} of 40 tests without an answer");
    assert!(not_heard > 10, "{not_heard}");
}

/// The board keeps the long time that it got for the operation until a write of the cycle arrives:
/// that is no sign of a reset, or of another program.
#[test]
fn long_board_watchdog_time_that_stays_is_not_taken_for_a_reset() {
    let mut has_stayed = [0; 2];
    let started = || {
        let bus = Faulty::new(fpga(), 1);
        let settings = Settings {
            bus_error_limit: 20,
            ..Settings::default()
        };
        let driver = Driver::start(bus, settings).expect("all of them run");
        let mut machine = Machine::with(driver);
        machine.rearm_all(100);
        machine
    };
    let call = |machine: &mut Machine<Faulty<SimFpga>>, proves| {
        if proves {
            machine.driver.prove_watchdogs()
        } else {
            let outputs = (0, OUTPUTS as u8);
            machine.driver.write_remote_parameter(outputs, NAME, 50)
        }
    };
    // Everywhere in the call.
    let places = [true, false].map(|proves| {
        let mut machine = started();
        let before = machine.driver.bus_mut().exchanges();
        call(&mut machine, proves).expect("the bus works");
        let count = machine.driver.bus_mut().exchanges() - before;
        (0..count).map(move |exchange| (exchange, proves))
    });
    for (exchange, proves) in places.into_iter().flatten() {
        let mut machine = started();
        let mut events = machine.driver.events();
        while events.next().is_some() {}
        let bus = machine.driver.bus_mut();
        for failing in bus.exchanges() + exchange..bus.exchanges() + exchange + 6 {
            bus.fail_at(failing, Fault::NotExecuted(BusErrorKind::Lost));
        }
        let done = call(&mut machine, proves);
        let time = |machine: &mut Machine<Faulty<SimFpga>>| {
            machine.driver.bus_mut().fpga().read_register(0x0C00)
        };
        let usual = (Settings::default().watchdog_time().as_nanos() / 10) as u32;
        let longer = usual + 1..1 << 31;
        has_stayed[usize::from(proves)] += u32::from(longer.contains(&time(&mut machine)));
        for _ in 0..20 {
            // Exchanges that fail can be left.
            let _ = (machine.driver.read(), machine.driver.write());
            machine.pass_nanos(1_000_000);
        }
        let what = format!("{done:?}, exchange {exchange}, proves: {proves}");
        for event in events.by_ref() {
            assert_ne!(event.kind, EventKind::BoardReset, "{what}");
        }
        assert_eq!(machine.driver.board_state(), BoardState::Running, "{what}");
        assert!(time(&mut machine) <= usual, "{what}");
    }
    assert!(!has_stayed.contains(&0), "{has_stayed:?}");
}

#[test]
fn bite_that_is_reported_together_with_another_fault_is_a_bite() {
    let started = Driver::start(fpga(), Settings::default());
    let mut machine = Machine::with(started.expect("all of them run"));
    runs(&mut machine);
    // Before it bites, and while it is not addressed.
    let later = Once::at(machine.now() + 20_000_000, |fpga| {
        let remote = fpga.device_mut::<SimRemote<Device<Outputs48>>>(0, OUTPUTS);
        let remote = remote.expect("a 7I72");
        remote.set_faults(remote.faults() | RemoteFaults::ILLEGAL_MODE);
    });
    machine.fpga().set_director(later);
    machine.driver.prove_watchdogs().expect("the bus works");
    let status = machine.status(OUTPUTS);
    assert!(
        status.faults.contains(RemoteFaults::ILLEGAL_MODE),
        "{:?}",
        status.faults
    );
    assert_eq!(status.watchdog, FIFTY);
}

/// Remotes that are about to stop, because the application has just switched their port off, are
/// not tested; so their watchdogs keep their state.
#[test]
fn watchdogs_of_a_port_that_is_switched_off_are_not_judged() {
    let started = Driver::start(fpga(), Settings::default());
    let mut machine = Machine::with(started.expect("all of them run"));
    let run = machine
        .driver
        .pins()
        .output("hm2_7i92.0.sserial.port-0.run");
    let run = run.expect("a port");
    for cycles in [0, 1, 2, 3, 100] {
        runs(&mut machine);
        machine.driver.pins_mut().set(run, false);
        machine.cycles(cycles);
        machine.driver.prove_watchdogs().expect("the bus works");
        for channel in [FIELD, ANALOG, OUTPUTS] {
            let found = machine.status(channel).watchdog;
            assert_eq!(found, FIFTY, "channel {channel}, after {cycles} cycles");
        }
        machine.driver.pins_mut().set(run, true);
    }
    runs(&mut machine);
}
