//! Parameters in the non-volatile memory of remotes: written before the driver is built, or at run
//! time by an operation with a documented cost. The truth is in the simulated remotes' EEPROMs.

use std::time::Duration;

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, fpga};
use mesa_hal::RemoteId;
use mesa_hal::boards::AttachError;
use mesa_hal::bus::BusErrorKind;
use mesa_hal::driver::{
    Board, BoardState, Configured, Driver, DriverError, RemoteWatchdog, Settings,
};
use mesa_hal::hal::{PinError, ShortName};
use mesa_hal::remote::ParameterError;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::SimFpga;

const ALL: [usize; 3] = [FIELD, ANALOG, OUTPUTS];

/// A value in the remote's EEPROM.
fn kept(machine: &Machine, channel: usize, name: &str) -> u64 {
    let parameters = machine.device(channel).parameters();
    let found = parameters.iter().find(|(known, _)| known == name);
    found.expect("parameter").1
}

fn shown(machine: &Machine, name: &str) -> u32 {
    let pins = machine.driver.pins();
    let name = format!("hm2_7i92.0.{name}");
    pins.param(pins.parameter::<u32>(&name).expect("parameter"))
}

#[test]
fn set_param_of_a_remote_parameter_is_refused_with_advice() {
    let mut machine = Machine::new();
    let pins = machine.driver.pins_mut();
    let name = "hm2_7i92.0.7i77.0.0.nvwatchdogtimeout";
    let parameter = pins.parameter::<u32>(name).unwrap();
    let refused = pins.set_param(parameter, 100).unwrap_err();
    let short = ShortName::new(name);
    assert_eq!(refused, PinError::InRemote { name: short });
    assert_eq!(refused.advice(), Some(advice::WRITE_REMOTE_PARAMETER));
    assert_eq!(pins.param(parameter), 50);
    assert_eq!(kept(&machine, FIELD, "nvwatchdogtimeout"), 50);
}

/// A board whose remotes are in setup mode.
fn discovered(fpga: SimFpga) -> Configured<SimFpga> {
    let board = Board::identify(fpga, Settings::default()).expect("a board");
    board.discover().expect("its remotes")
}

fn write(
    board: &mut Configured<SimFpga>,
    channel: usize,
    name: &str,
    value: u32,
) -> Result<(), DriverError> {
    board.write_remote_parameter((0, channel as u8), name, value)
}

#[test]
fn parameters_are_written_in_setup_mode_before_the_start() {
    let mut board = discovered(fpga());
    for (channel, name, value) in [
        (FIELD, "NVWatchDogTimeout", 100),
        (OUTPUTS, "nvwatchdogtimeout", 0),
        (OUTPUTS, "nvunitnumber", 0x7200_0009),
    ] {
        write(&mut board, channel, name, value).expect("it takes it");
    }
    let field = board.read_remote_parameter((0, FIELD as u8), "nvwatchdogtimeout");
    assert_eq!(field.expect("it is read").raw, 100);
    let mut machine = Machine::with(board.start().expect("all of them run"));
    assert_eq!(kept(&machine, FIELD, "nvwatchdogtimeout"), 100);
    assert_eq!(kept(&machine, ANALOG, "nvwatchdogtimeout"), 50);
    assert_eq!(kept(&machine, OUTPUTS, "nvwatchdogtimeout"), 0);
    assert_eq!(kept(&machine, OUTPUTS, "nvunitnumber"), 0x7200_0009);
    assert_eq!(shown(&machine, "7i77.0.0.nvwatchdogtimeout"), 100);
    assert_eq!(shown(&machine, "7i72.0.2.nvunitnumber"), 0x7200_0009);
    let hundred = RemoteWatchdog::Known(Duration::from_millis(100));
    assert_eq!(machine.status(FIELD).watchdog, hundred);
    assert_eq!(machine.status(OUTPUTS).watchdog, RemoteWatchdog::Off);
    let fifty = RemoteWatchdog::Known(Duration::from_millis(50));
    assert_eq!(machine.status(ANALOG).watchdog, fifty);
    machine.cycles(5);
    assert!(ALL.iter().all(|&channel| machine.is_valid(channel)));
    // A value that is already stored is not written again: such memory wears out.
    let changes = machine.device(FIELD).nonvolatile_changes();
    let driver = machine.driver;
    drop(driver);
    assert!(changes > 0);
}

#[test]
fn shorter_watchdog_is_not_believed_before_the_next_power_up() {
    let mut board = discovered(fpga());
    write(&mut board, FIELD, "nvwatchdogtimeout", 20).expect("it takes it");
    let machine = Machine::with(board.start().expect("all of them run"));
    assert_eq!(kept(&machine, FIELD, "nvwatchdogtimeout"), 20);
    let fifty = RemoteWatchdog::Known(Duration::from_millis(50));
    assert_eq!(machine.status(FIELD).watchdog, fifty);
}

#[test]
fn unwritable_parameter_is_refused_with_reason_and_board_starts() {
    let mut absent = fpga();
    absent.plug(0, ANALOG, None);
    let mut board = discovered(absent);
    for (channel, name, value, expected) in [
        (
            0,
            "nvwatchdog",
            50,
            "7i77.0.0, parameter nvwatchdog: the remote has no parameter of that \
             name",
        ),
        (
            0,
            "nvwatchdogtimeout",
            65_536,
            "7i77.0.0, parameter nvwatchdogtimeout: 65536 does not fit: allowed is \
             0 to 65535",
        ),
        (
            0,
            "swrevision",
            1,
            "7i77.0.0, parameter swrevision: the parameter is read-only",
        ),
        (
            9,
            "nvwatchdogtimeout",
            100,
            "port 0, channel 9: no remote takes part",
        ),
        (
            ANALOG,
            "nvwatchdogtimeout",
            100,
            "port 0, channel 1: no remote takes part",
        ),
    ] {
        let error = write(&mut board, channel, name, value).unwrap_err();
        assert_eq!(error.to_string(), expected);
        let is_absent = matches!(error, DriverError::Attach(_));
        assert_eq!(error.advice() == Some(advice::LOOK_AT_MISSING), is_absent);
    }
    assert_eq!(board.missing().len(), 1);
    let elsewhere = board.read_remote_parameter((3, 0), "nvwatchdogtimeout");
    assert!(elsewhere.is_err());
    let driver = board.start().expect("the others run");
    assert_eq!(driver.ports()[0].remotes().count(), 2);
}

fn switch_on(machine: &mut Machine) {
    machine.cards.set_all(machine.driver.pins_mut());
}

fn are_on(machine: &Machine) -> Vec<bool> {
    let of = |(channel, output): (usize, usize)| {
        machine.device(channel).world().output(output) == Some(true)
    };
    let field = (0..16).map(|n| (FIELD, n));
    let outputs = (0..48).map(|n| (OUTPUTS, n));
    field.chain(outputs).chain([(ANALOG, 0)]).map(of).collect()
}

#[test]
fn run_time_parameter_write_switches_all_off_and_restarts_all() {
    // Also with a board's watchdog that is shorter than the call.
    for watchdog in [5, 1000] {
        let mut machine = Machine::build(|s| s.watchdog = Some(Duration::from_millis(watchdog)));
        switch_on(&mut machine);
        machine.cycles(5);
        assert!(are_on(&machine).into_iter().all(|on| on));
        let before = machine.now();
        machine
            .driver
            .write_remote_parameter((0, OUTPUTS as u8), "nvwatchdogtimeout", 200)
            .unwrap();
        let took = (machine.now() - before) / 1_000_000;
        assert!(took < 50, "{took} ms");
        assert_eq!(kept(&machine, OUTPUTS, "nvwatchdogtimeout"), 200);
        assert_eq!(shown(&machine, "7i72.0.2.nvwatchdogtimeout"), 200);
        let time = machine.status(OUTPUTS).watchdog.time();
        assert_eq!(time, Some(Duration::from_millis(200)));
        assert!(!are_on(&machine).into_iter().any(|on| on));
        for _ in 0..20 {
            switch_on(&mut machine);
            machine.cycles(1);
            assert!(!are_on(&machine).into_iter().any(|on| on), "not armed");
        }
        assert_eq!(machine.driver.board_state(), BoardState::Running);
        machine.until(200, |machine| {
            machine.driver.rearm().unwrap().waiting == 0
                && ALL.iter().all(|&channel| machine.is_valid(channel))
        });
        switch_on(&mut machine);
        machine.cycles(3);
        assert!(are_on(&machine).into_iter().all(|on| on));
    }
}

#[test]
fn wrong_name_or_value_at_run_time_stops_nothing() {
    let mut machine = Machine::new();
    switch_on(&mut machine);
    machine.cycles(5);
    let driver = &mut machine.driver;
    let channel = FIELD as u8;
    let result = driver.write_remote_parameter((0, channel), "nothing", 1);
    assert!(matches!(
        result,
        Err(DriverError::Parameter {
            source: ParameterError::Unknown,
            ..
        })
    ));
    let result = driver.write_remote_parameter((0, channel), "nvbaudrate", -1);
    assert!(matches!(
        result,
        Err(DriverError::Parameter {
            source: ParameterError::DoesNotFit { .. },
            ..
        })
    ));
    let result = driver.write_remote_parameter((0, 5), "nvbaudrate", 9);
    assert!(matches!(
        result,
        Err(DriverError::Attach(AttachError::NoRemote {
            remote: RemoteId { channel: 5, .. },
            ..
        }))
    ));
    let result = driver.write_remote_parameter((1, channel), "nvbaudrate", 9);
    assert!(matches!(
        result,
        Err(DriverError::Attach(AttachError::NoRemote {
            remote: RemoteId { port: 1, .. },
            ..
        }))
    ));
    for _ in 0..5 {
        assert!(machine.cycle().is_good());
        assert!(are_on(&machine).into_iter().all(|on| on));
    }
}

#[test]
fn absent_remote_is_an_error_and_the_others_come_back() {
    let mut machine = Machine::new();
    machine.cycles(5);
    machine.cable(FIELD).unplug();
    machine.cycles(40);
    let result = machine
        .driver
        .write_remote_parameter((0, FIELD as u8), "nvwatchdogtimeout", 100);
    assert!(matches!(result, Err(DriverError::Missing(_))));
    assert_eq!(kept(&machine, FIELD, "nvwatchdogtimeout"), 50);
    machine.until(300, |machine| {
        let _ = machine.driver.rearm().unwrap();
        [ANALOG, OUTPUTS].iter().all(|&n| machine.is_valid(n))
    });
}

#[test]
fn parameter_write_restores_the_watchdog_and_fails_after_a_bite() {
    let mut machine = Machine::new();
    machine.cycles(5);
    let write = |machine: &mut Machine, value: u32| {
        let driver = &mut machine.driver;
        driver.write_remote_parameter((0, FIELD as u8), "nvwatchdogtimeout", value)
    };
    write(&mut machine, 100).unwrap();
    machine.pass_nanos(7_000_000);
    let _ = machine.driver.read().unwrap();
    assert_eq!(machine.driver.board_state(), BoardState::WatchdogBitten);
    let result = write(&mut machine, 200);
    assert!(matches!(result, Err(DriverError::NotRunning { .. })));
    assert_eq!(kept(&machine, FIELD, "nvwatchdogtimeout"), 100);
}

#[test]
fn watchdog_that_the_period_can_not_feed_is_not_written() {
    let text = "7i77.0.1: the remote's watchdog (NVWatchDogTimeout in ms) bites after 1 ms, \
                and is fed once in a period of 1 ms; a write or transfer that is lost must not let it \
                bite, so it needs 2 x 1 ms = 2 ms";
    let error = write(&mut discovered(fpga()), ANALOG, "NVWatchDogTimeout", 1).unwrap_err();
    assert_eq!(error.to_string(), text);
    assert_eq!(error.advice(), Some(advice::LENGTHEN_WATCHDOG));

    let mut machine = Machine::new();
    let mut write = |value: u32| {
        let (driver, analog) = (&mut machine.driver, ANALOG as u8);
        driver.write_remote_parameter((0, analog), "nvwatchdogtimeout", value)
    };
    assert_eq!(write(1).unwrap_err().to_string(), text);
    write(2).unwrap();
    write(0).unwrap();
    assert_eq!(kept(&machine, ANALOG, "nvwatchdogtimeout"), 0);
}

#[test]
fn remote_keeps_a_written_watchdog_and_uses_it_after_power_up() {
    let mut machine = Machine::build(|s| s.watchdog = Some(Duration::from_secs(1)));
    machine.cycles(5);
    let driver = &mut machine.driver;
    driver
        .write_remote_parameter((0, OUTPUTS as u8), "nvwatchdogtimeout", 200)
        .unwrap();
    machine.until(200, |machine| {
        machine.driver.rearm().unwrap().waiting == 0 && machine.is_valid(OUTPUTS)
    });
    let bites_after = |machine: &mut Machine| {
        switch_on(machine);
        machine.cycles(3);
        let begin = machine.now();
        while machine.device(OUTPUTS).world().output(47) == Some(true) {
            machine.pass_nanos(1_000_000);
        }
        (machine.now() - begin) / 1_000_000
    };
    let first = bites_after(&mut machine);
    assert!((49..=52).contains(&first), "{first} ms");
    let now = machine.now();
    machine.device_mut(OUTPUTS).set_power(now, false);
    machine.device_mut(OUTPUTS).set_power(now, true);
    machine.until(10, |machine| !machine.is_running(OUTPUTS));
    machine.until(7000, |machine| {
        machine.driver.rearm().unwrap().waiting == 0 && machine.is_valid(OUTPUTS)
    });
    let second = bites_after(&mut machine);
    assert!((199..=202).contains(&second), "{second} ms");
}

/// The bus fails from any exchange of the call on, for two exchanges or to its end. The last
/// command to the port, in setup mode or not, does not count as the cycle's: no remote runs, and
/// none is valid, before the cycle has started it.
#[test]
fn failed_parameter_write_leaves_nothing_the_cycle_takes_as_own() {
    let lost = Fault::NotExecuted(BusErrorKind::Lost);
    let late = Fault::Executed(BusErrorKind::Late);
    for (fault, exchanges) in [(lost, 2), (late, 2), (lost, 2000), (late, 2000)] {
        let driver = Driver::start(Faulty::new(fpga(), 1), Settings::default()).unwrap();
        let mut machine = Machine::with(driver);
        machine.cycles(5);
        let mut write = |from: u64, value: u32| {
            let first = machine.driver.bus().exchanges();
            for exchange in first + from..first + from + exchanges {
                machine.driver.bus_mut().fail_at(exchange, fault);
            }
            let starts = machine.driver.ports()[0].statistics().starts;
            let (driver, channel) = (&mut machine.driver, FIELD as u8);
            let _ = driver.write_remote_parameter((0, channel), "nvwatchdogtimeout", value);
            let used = machine.driver.bus().exchanges() - first;
            machine.driver.bus_mut().heal();
            // The bus may have failed before anything was stopped.
            let mut is_started = ALL.iter().all(|&channel| machine.is_running(channel));
            let mut left = 500;
            while !(ALL.iter().all(|&channel| machine.is_valid(channel))
                && machine.driver.rearm().unwrap().waiting == 0)
            {
                let _ = machine.cycle();
                let _ = machine.driver.rearm().unwrap();
                is_started |= machine.driver.ports()[0].statistics().starts > starts;
                let taken =
                    |&channel: &usize| machine.is_running(channel) || machine.is_valid(channel);
                assert!(is_started || !ALL.iter().any(taken), "from exchange {from}");
                left -= 1;
                assert!(left > 0, "from exchange {from}: they do not come back");
            }
            used
        };
        let mut from = 0;
        while from < write(from, if from % 2 == 0 { 100 } else { 200 }) {
            from += 1;
        }
        assert!(from > 50, "{from}");
    }
}

#[test]
fn usual_board_watchdog_time_is_resent_if_lost() {
    let mut last = 0;
    for is_lost in [false, true] {
        let mut machine: Machine<_> = Machine::on(Faulty::new(fpga(), 1), |_| {});
        machine.cycles(5);
        let bus = machine.driver.bus_mut();
        let before = bus.exchanges();
        if is_lost {
            bus.fail_at(before + last, Fault::NotExecuted(BusErrorKind::Lost));
        }
        let driver = &mut machine.driver;
        let written = driver.write_remote_parameter((0, FIELD as u8), "nvwatchdogtimeout", 100_u32);
        written.expect("it takes it");
        last = machine.driver.bus_mut().exchanges() - before - 1;
        machine.cycles(20);
        assert_eq!(machine.driver.statistics().resets, 0, "{is_lost}");
    }
}
