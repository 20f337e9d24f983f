//! Parameters of remotes that the cycle writes while their port is switched on again. The truth is
//! in the simulated remotes: their EEPROMs, and their outputs.

use crate::common::machine::{ANALOG, Embedded, FIELD, Machine, OUTPUTS, device, fpga};
use mesa_hal::Settings;
use mesa_hal::bus::BusErrorKind;
use mesa_hal::driver::{BoardState, DriverError, EventKind};
use mesa_hal::remote::ParameterError;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::SimFpga;

const ALL: [usize; 3] = [FIELD, ANALOG, OUTPUTS];
/// Cycles in which a port comes up after it was switched on, with a parameter to write.
const RESTARTED: usize = 400;
const NOT_EXECUTED: Fault = Fault::NotExecuted(BusErrorKind::Lost);
const EXECUTED: Fault = Fault::Executed(BusErrorKind::Lost);
const NAME: &str = "nvwatchdogtimeout";

type OnFaulty = Machine<Faulty<SimFpga>>;

/// A machine whose attempts to start a remote do not wait for long.
fn machine(fpga: SimFpga, seed: u64) -> OnFaulty {
    Machine::on(Faulty::new(fpga, seed), |settings: &mut Settings| {
        let policy = &mut settings.fault_policy;
        policy.first_backoff = core::time::Duration::from_millis(50);
        policy.longest_backoff = core::time::Duration::from_millis(100);
    })
}

fn kept(machine: &OnFaulty, channel: usize) -> u64 {
    let parameters = machine.device(channel).parameters();
    let found = parameters.iter().find(|(known, _)| known == NAME);
    found.expect("parameter").1
}

fn shown(machine: &OnFaulty, channel: usize) -> u64 {
    let prefix = &machine.status(channel).pins.prefix;
    let pins = machine.driver.pins();
    let parameter = pins.parameter::<u32>(&format!("{prefix}.{NAME}"));
    pins.param(parameter.expect("parameter")).into()
}

fn request(machine: &mut OnFaulty, channel: usize, millis: u32) {
    let remote = (0, channel as u8);
    let requested = machine
        .driver
        .request_remote_parameter(remote, NAME, millis);
    requested.expect("a value that it takes");
}

fn switch(machine: &mut OnFaulty, is_on: bool) {
    let run = machine.output::<bool>("sserial.port-0.run");
    machine.driver.pins_mut().set(run, is_on);
}

/// A cycle in which everything is commanded on, and that may fail.
fn cycle(machine: &mut OnFaulty) {
    let _ = machine.driver.read();
    machine.cards.set_one_of_each(machine.driver.pins_mut());
    let _ = machine.driver.write();
    machine.rest();
}

fn cycles(machine: &mut OnFaulty, count: usize) {
    for _ in 0..count {
        cycle(machine);
    }
}

fn is_any_output_on(machine: &OnFaulty) -> bool {
    let world = |channel| device(machine.driver.bus().look(), channel).world();
    let bits = |channel, count| (0..count).any(|n| world(channel).output(n) == Some(true));
    let volts = (0..6).filter_map(|n| world(ANALOG).analog_output(n));
    bits(FIELD, 16) || bits(OUTPUTS, 48) || volts.into_iter().any(|volts| volts.abs() > 0.01)
}

fn all_run(machine: &mut OnFaulty) -> bool {
    ALL.iter().all(|&channel| machine.is_running(channel))
}

/// Switches the port off and on; every output is off from then on.
fn restart_port(machine: &mut OnFaulty) {
    switch(machine, false);
    cycles(machine, 80);
    switch(machine, true);
}

/// Runs until all remotes run, and checks that no output comes on, although the application
/// commands them: they are not armed.
fn until_all_run(machine: &mut OnFaulty) -> usize {
    for n in 0..RESTARTED {
        assert!(!is_any_output_on(machine), "cycle {n}: an output is on");
        if n > 0 && all_run(machine) {
            return n;
        }
        cycle(machine);
    }
    panic!(
        "not within {RESTARTED} cycles: {:?}",
        machine.status(FIELD).state
    );
}

fn failures(machine: &OnFaulty) -> usize {
    let failed = |kind| matches!(kind, EventKind::ParameterNotWritten { .. });
    machine
        .driver
        .events()
        .filter(|event| failed(event.kind))
        .count()
}

#[test]
fn parameter_is_written_when_its_port_is_switched_on_again() {
    let mut machine = machine(fpga(), 0);
    cycles(&mut machine, 20);
    assert!(is_any_output_on(&machine));
    request(&mut machine, FIELD, 100);
    request(&mut machine, OUTPUTS, 70);
    request(&mut machine, OUTPUTS, 200);
    cycles(&mut machine, 50);
    assert_eq!(ALL.map(|channel| kept(&machine, channel)), [50; 3]);
    assert!(is_any_output_on(&machine), "a request stops nothing");
    restart_port(&mut machine);
    let took = until_all_run(&mut machine);
    assert!(took < 150, "{took} cycles");
    assert_eq!(ALL.map(|channel| kept(&machine, channel)), [100, 50, 200]);
    assert_eq!(ALL.map(|channel| shown(&machine, channel)), [100, 50, 200]);
    assert_eq!(failures(&machine), 0);
    machine.rearm_all(100);
    cycles(&mut machine, 5);
    assert!(is_any_output_on(&machine));
    // A second restart finds nothing to write; nor does a value that is there already.
    let changes = |machine: &OnFaulty| machine.device(FIELD).nonvolatile_changes();
    let before = changes(&machine);
    request(&mut machine, FIELD, 100);
    for _ in 0..2 {
        restart_port(&mut machine);
        until_all_run(&mut machine);
    }
    assert_eq!((changes(&machine), kept(&machine, FIELD)), (before, 100));
}

/// A restart of one remote alone, in between, does not use the request up.
#[test]
fn port_that_was_not_stopped_writes_at_its_next_whole_restart() {
    let mut machine = machine(fpga(), 0);
    cycles(&mut machine, 20);
    request(&mut machine, FIELD, 100);
    switch(&mut machine, false);
    cycle(&mut machine);
    switch(&mut machine, true);
    cycles(&mut machine, 200);
    assert!(machine.driver.restart((0, OUTPUTS as u8)));
    cycles(&mut machine, 200);
    assert!(all_run(&mut machine));
    assert_eq!(kept(&machine, FIELD), 50);
    machine.fpga().reload();
    cycles(&mut machine, 3);
    assert_ne!(machine.driver.board_state(), BoardState::Running);
    machine.until(RESTARTED, |machine| {
        let _ = machine.driver.rearm();
        machine.driver.board_state() == BoardState::Running && all_run(machine)
    });
    assert_eq!((kept(&machine, FIELD), shown(&machine, FIELD)), (100, 100));
}

#[test]
fn impossible_parameter_request_is_refused_at_once() {
    let mut machine = machine(fpga(), 0);
    let refused = |machine: &mut OnFaulty, channel, name, value: i32| {
        let refused = machine
            .driver
            .request_remote_parameter((0, channel), name, value);
        refused.expect_err("refused")
    };
    let unknown = refused(&mut machine, 0, "nothing", 1);
    let is_unknown = matches!(
        unknown,
        DriverError::Parameter {
            source: ParameterError::Unknown,
            ..
        }
    );
    assert!(is_unknown, "{unknown}");
    let negative = refused(&mut machine, 0, "nvbaudrate", -1);
    let does_not_fit = matches!(
        negative,
        DriverError::Parameter {
            source: ParameterError::DoesNotFit { .. },
            ..
        }
    );
    assert!(does_not_fit, "{negative}");
    let short = refused(&mut machine, 0, NAME, 1);
    assert!(
        matches!(short, DriverError::WatchdogTooShort { .. }),
        "{short}"
    );
    let absent = refused(&mut machine, 5, NAME, 100);
    assert!(matches!(absent, DriverError::Attach(_)), "{absent}");
    restart_port(&mut machine);
    until_all_run(&mut machine);
    assert_eq!(ALL.map(|channel| kept(&machine, channel)), [50; 3]);
}

#[test]
fn remote_that_is_not_there_keeps_its_value_and_the_others_run() {
    let mut machine = machine(fpga(), 0);
    cycles(&mut machine, 20);
    machine.cable(FIELD).unplug();
    request(&mut machine, FIELD, 100);
    request(&mut machine, ANALOG, 100);
    restart_port(&mut machine);
    machine.until(RESTARTED, |machine| {
        machine.is_running(ANALOG) && machine.is_running(OUTPUTS)
    });
    assert_eq!(failures(&machine), 1);
    let values = |machine: &OnFaulty| {
        [FIELD, ANALOG].map(|channel| (kept(machine, channel), shown(machine, channel)))
    };
    assert_eq!(values(&machine), [(50, 50), (100, 100)]);
    machine.cable(FIELD).replug();
    until_all_run(&mut machine);
    request(&mut machine, FIELD, 100);
    restart_port(&mut machine);
    until_all_run(&mut machine);
    assert_eq!(values(&machine), [(100, 100); 2]);
}

/// A single fault of the bus, in each exchange from the switch on.
#[test]
fn no_lost_packet_leaves_a_wrong_value_or_an_output_on() {
    for fault in [NOT_EXECUTED, EXECUTED, Fault::AckedButLost] {
        for n in (0..180).step_by(4) {
            let mut machine = machine(fpga(), n);
            cycles(&mut machine, 5);
            request(&mut machine, FIELD, 100);
            restart_port(&mut machine);
            let exchange = machine.driver.bus().exchanges() + n;
            machine.driver.bus_mut().fail_at(exchange, fault);
            until_all_run(&mut machine);
            let values = (kept(&machine, FIELD), shown(&machine, FIELD));
            assert_eq!(values, (100, 100), "{fault:?} in exchange {n}");
        }
    }
}

/// What ends the write in the middle.
#[derive(Clone, Copy, Debug)]
enum End {
    SwitchedOff,
    Reset,
    Bite,
    Unplugged,
    OtherUse,
}

/// A write that ends in its middle, in each of its cycles: the value that the pin shows is the
/// remote's own, no output comes on, and the next write succeeds.
#[test]
fn write_that_ends_in_its_middle_leaves_nothing_behind() {
    for end in [
        End::SwitchedOff,
        End::Reset,
        End::Bite,
        End::Unplugged,
        End::OtherUse,
    ] {
        for n in (0..48).step_by(3) {
            let mut machine = machine(fpga(), n);
            cycles(&mut machine, 5);
            request(&mut machine, FIELD, 100);
            restart_port(&mut machine);
            for _ in 0..n {
                cycle(&mut machine);
                assert!(!is_any_output_on(&machine), "{end:?} {n}");
            }
            match end {
                End::SwitchedOff => switch(&mut machine, false),
                End::Reset => machine.fpga().reload(),
                End::Bite => machine.sleep(30),
                End::Unplugged => machine.cable(FIELD).unplug(),
                End::OtherUse => {
                    let driver = &mut machine.driver;
                    let written = driver.write_remote_parameter((0, OUTPUTS as u8), NAME, 90);
                    written.expect("it is there");
                }
            }
            for _ in 0..120 {
                cycle(&mut machine);
                assert!(!is_any_output_on(&machine), "{end:?} {n}");
            }
            switch(&mut machine, true);
            machine.cable(FIELD).replug();
            let is_up = |machine: &mut OnFaulty| {
                let _ = machine.driver.rearm();
                machine.driver.board_state() == BoardState::Running && all_run(machine)
            };
            machine.until(2 * RESTARTED, is_up);
            assert_eq!(kept(&machine, FIELD), shown(&machine, FIELD), "{end:?} {n}");
            request(&mut machine, FIELD, 80);
            restart_port(&mut machine);
            until_all_run(&mut machine);
            assert_eq!(
                (kept(&machine, FIELD), shown(&machine, FIELD)),
                (80, 80),
                "{end:?} {n}"
            );
        }
    }
}

/// The first write is given up at each of its steps, and the value is requested anew meanwhile.
#[test]
fn newer_of_two_requests_is_written_whenever_the_first_fails() {
    for wait in [3, 6, 10, 20, 60] {
        let mut machine = machine(fpga(), 1);
        cycles(&mut machine, 20);
        request(&mut machine, FIELD, 1000);
        restart_port(&mut machine);
        cycles(&mut machine, wait);
        machine.cable(FIELD).unplug();
        cycles(&mut machine, 20);
        request(&mut machine, FIELD, 100);
        cycles(&mut machine, 800);
        machine.cable(FIELD).replug();
        // A remote whose watchdog has 1 s is silent for longer than that before it is started.
        cycles(&mut machine, 2_000);
        restart_port(&mut machine);
        cycles(&mut machine, RESTARTED);
        assert_eq!(kept(&machine, FIELD), 100, "after {wait} cycles");
        assert_eq!(shown(&machine, FIELD), 100, "after {wait} cycles");
    }
}
