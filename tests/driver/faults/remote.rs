//! Faults of remotes and their cables: the state of the pins, the continued operation of the
//! others, safe outputs, and the recovery of a remote.

use std::time::Duration;

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS};
use mesa_hal::driver::{
    Failure, FaultPolicy, OfflineReason, Presence, RemoteConfig, RemoteState, SerialConfig,
};
use mesa_hal::sslbp::RemoteFaults;
use mesa_hal_sim::devices::{Device, FieldIo, Outputs48};
use mesa_hal_sim::remote::{Cable, Toward, WireFault};
use mesa_hal_sim::wire::RemoteEnd;

/// Outputs on, volts on, inputs on.
fn busy_machine(mode: u8) -> Machine {
    let remote = RemoteConfig {
        mode,
        presence: Presence::Required,
        ..RemoteConfig::default()
    };
    let mut config = SerialConfig::default();
    config.channels.insert(0, remote);
    let mut machine = Machine::build(|s| s.serial_ports = [(0, config)].into());
    switch_on(&mut machine);
    machine.cycles(5);
    assert!(are_outputs_on(&machine, FIELD));
    assert!(are_outputs_on(&machine, ANALOG));
    assert!(are_outputs_on(&machine, OUTPUTS));
    machine
}

/// The outputs that an application sets in each cycle.
fn switch_on(machine: &mut Machine) {
    machine.cards.set_one_of_each(machine.driver.pins_mut());
    machine.device_mut(FIELD).set_input(9, true).unwrap();
}

fn are_outputs_on(machine: &Machine, channel: usize) -> bool {
    let world = machine.device(channel).world();
    match channel {
        FIELD => world.output(3) == Some(true),
        OUTPUTS => world.output(7) == Some(true),
        _ => world.analog_output(1).is_some_and(|volts| volts > 4.9),
    }
}

/// Checks that the other two remotes transfer in every one of `cycles`.
fn others_go_on(machine: &mut Machine, channel: usize, cycles: usize) {
    let before: Vec<_> = transfers(machine);
    machine.cycles(cycles);
    for other in [FIELD, ANALOG, OUTPUTS]
        .into_iter()
        .filter(|&c| c != channel)
    {
        let done = transfers(machine)[other].0 - before[other].0;
        assert_eq!(done, cycles as u64, "transfers of channel {other}");
        assert_eq!(
            transfers(machine)[other].1,
            0,
            "failures of channel {other}"
        );
        assert!(machine.is_valid(other) && are_outputs_on(machine, other));
    }
}

fn transfers(machine: &Machine) -> Vec<(u64, u64)> {
    let of = |channel| {
        let status = machine.status(channel);
        (status.transfers, status.failures.total())
    };
    [FIELD, ANALOG, OUTPUTS].map(of).to_vec()
}

/// One fault of the wire, in one reply or request: checks its counter, the number of cycles without
/// valid inputs, and that nothing else happens.
fn one_wire_fault(
    channel: usize,
    toward: Toward,
    fault: WireFault,
    counted: &[Failure],
    invalid: usize,
) {
    let mut machine = busy_machine(0);
    machine.cable(channel).inject(toward, fault, 1);
    let mut invalid_cycles = 0;
    for _ in 0..10 {
        others_go_on(&mut machine, channel, 1);
        let input = machine.field_input(9);
        assert!(input.value, "{fault:?}: the last good value is kept");
        invalid_cycles += usize::from(!machine.is_valid(channel));
        assert!(
            machine.is_armed(channel),
            "{fault:?}: one bad transfer stops no machine"
        );
    }
    assert_eq!(invalid_cycles, invalid, "{toward:?} {fault:?}");
    let failures: Vec<_> = machine
        .status(channel)
        .failures
        .iter()
        .filter(|&(failure, count)| count > 0 && failure != Failure::Doubtful)
        .map(|(failure, count)| {
            assert_eq!(count, 1, "{fault:?}");
            failure
        })
        .collect();
    assert_eq!(failures, counted, "{toward:?} {fault:?}");
    assert!(are_outputs_on(&machine, channel));
}

#[test]
fn faults_of_one_reply_are_distinguished_and_cost_two_cycles() {
    use Failure::{Break, Crc, ExtraCharacters, Late, NoReply};
    let of = |channel, fault, counted: &[Failure], invalid| {
        one_wire_fault(channel, Toward::Fpga, fault, counted, invalid);
    };
    for channel in [FIELD, ANALOG, OUTPUTS] {
        of(channel, WireFault::Lost, &[NoReply], 2);
        of(channel, WireFault::Corrupted, &[Crc], 2);
        of(channel, WireFault::Short(1), &[NoReply], 2);
        of(channel, WireFault::Break, &[Break], 2);
    }
    // Extra characters behind the last of all replies spoil the next transfer.
    of(ANALOG, WireFault::Long(1), &[ExtraCharacters], 2);
    of(ANALOG, WireFault::Long(2), &[ExtraCharacters], 2);
    // Before the last reply they spoil none.
    of(FIELD, WireFault::Long(1), &[], 0);
    // The reply looks lost at first, and disturbs the transfer after it.
    of(ANALOG, WireFault::Late(90_000), &[Late], 4);
    of(ANALOG, WireFault::Late(700_000), &[Late], 4);
}

#[test]
fn faults_of_one_request_are_survived_as_a_missing_reply() {
    use Failure::NoReply;
    for fault in [WireFault::Lost, WireFault::Corrupted, WireFault::Short(1)] {
        one_wire_fault(FIELD, Toward::Remote, fault, &[NoReply], 2);
    }
}

/// The whole sequence of a remote: lost, offline, back, safe, re-armed.
fn comes_back(
    mut machine: Machine,
    channel: usize,
    fail: impl FnOnce(&mut Machine),
    repair: impl FnOnce(&mut Machine),
) -> Machine {
    fail(&mut machine);
    let gone = machine.until(40, |machine| !machine.is_running(channel));
    assert!(!machine.is_valid(channel) && !machine.is_armed(channel));
    assert!(machine.bit(&format!("{}.running", prefix(&machine, ANALOG))));
    // The others are served while nothing is tried: 60 ms from a fault that the remote reports
    // itself.
    others_go_on(&mut machine, channel, 50);
    assert!(gone <= 22, "offline after {gone} cycles");
    repair(&mut machine);
    machine.until(11_000, |machine| machine.is_running(channel));
    machine.cycles(5);
    assert!(machine.is_valid(channel), "inputs come back by themselves");
    switch_on(&mut machine);
    machine.cycles(5);
    assert!(!machine.is_armed(channel));
    assert!(!are_outputs_on(&machine, channel), "outputs stay safe");
    let rearmed = machine.driver.rearm().unwrap();
    assert_eq!((rearmed.armed, rearmed.waiting), (1, 0));
    switch_on(&mut machine);
    machine.cycles(5);
    assert!(
        are_outputs_on(&machine, channel),
        "and follow again when asked to"
    );
    machine
}

fn prefix(machine: &Machine, channel: usize) -> String {
    let prefix = machine.status(channel).pins.prefix.clone();
    prefix.trim_start_matches("hm2_7i92.0.").to_owned()
}

#[test]
fn replugged_remote_comes_back_and_waits_to_be_armed() {
    for (channel, mode) in [(FIELD, 0), (FIELD, 2), (OUTPUTS, 0)] {
        comes_back(
            busy_machine(mode),
            channel,
            |machine| machine.cable(channel).unplug(),
            |machine| machine.cable(channel).replug(),
        );
    }
}

#[test]
fn remote_that_loses_power_comes_back_in_its_software_mode() {
    let power = |machine: &mut Machine, is_on| {
        let now = machine.now();
        machine.device_mut(FIELD).set_power(now, is_on);
    };
    for is_short in [false, true] {
        let fail = |machine: &mut Machine| {
            power(machine, false);
            if is_short {
                power(machine, true);
            }
        };
        let machine = comes_back(busy_machine(2), FIELD, fail, |machine| power(machine, true));
        assert_eq!(machine.device(FIELD).mode(), 2);
    }
}

/// While a remote with a fault is addressed, its other outputs stay on (FACTS 1.5). So it is not
/// addressed, and its inputs are lost as well.
#[test]
fn remote_reporting_a_fault_has_no_valid_input_until_it_is_gone() {
    let power: fn(&mut Machine, bool) = |machine, fails| {
        let (now, volts) = (machine.now(), if fails { 3.0 } else { 24.0 });
        let field = machine.device_mut(FIELD);
        field.set_field_volts(now, volts).unwrap();
    };
    let short: fn(&mut Machine, bool) = |machine, fails| {
        let field = machine.device_mut(FIELD);
        field.set_over_current(3, fails).unwrap();
    };
    for (change, pin, fault) in [
        (power, "low-voltage", RemoteFaults::LOW_VOLTAGE),
        (short, "over-current", RemoteFaults::OVER_CURRENT),
    ] {
        let pin = format!("7i77.0.0.fault-{pin}");
        let fail = |machine: &mut Machine| {
            change(machine, true);
            others_go_on(machine, FIELD, 3);
            assert!(machine.bit(&pin) && machine.status(FIELD).faults.contains(fault));
            assert!(!machine.field_input(9).valid, "{pin}");
        };
        let machine = comes_back(busy_machine(0), FIELD, fail, |machine| {
            change(machine, false);
        });
        assert!(!machine.bit(&pin));
    }
}

/// A card of another kind, and one of the same kind with another unit number.
#[test]
fn another_device_on_the_channel_is_not_taken_over() {
    let mut description = FieldIo::description().unwrap();
    description.unit = 0x1200_0002;
    let twin = Device::remote(&description, FieldIo::new(false)).unwrap();
    let others: [(Box<dyn RemoteEnd>, u32); 2] = [
        (Box::new(Outputs48::i7i72().unwrap()), 0x7200_0001),
        (Box::new(twin), description.unit),
    ];
    for (other, unit) in others {
        let mut machine = busy_machine(0);
        let cable: Box<dyn RemoteEnd> = Box::new(Cable::new(other, 9));
        let right = machine.fpga().plug(0, FIELD, Some(cable));
        machine.until(2000, |machine| {
            let RemoteState::Offline { reason, .. } = machine.status(FIELD).state else {
                return false;
            };
            matches!(reason, OfflineReason::AnotherDevice { found, .. } if found.unit_number == unit)
        });
        machine.cycles(100);
        assert!(!machine.is_valid(FIELD));
        let world = machine.device(FIELD).world();
        let is_off = (0..48).all(|n| world.output(n) != Some(true));
        assert!(is_off, "it gets nothing");
        machine.fpga().plug(0, FIELD, right);
        machine.until(11_000, |machine| machine.is_running(FIELD));
    }
}

#[test]
fn attempts_to_bring_a_remote_back_never_starve_the_others() {
    let mut machine = busy_machine(0);
    machine.cable(FIELD).unplug();
    let mut longest = 0;
    for _ in 0..3000 {
        let _ = machine.cycle();
        let group = machine.status(ANALOG).pins.group;
        let age = machine.driver.pins().group_state(group).unwrap().age;
        longest = longest.max(age.time.as_micros());
        assert!(machine.is_armed(ANALOG) && are_outputs_on(&machine, ANALOG));
    }
    assert!(machine.driver.ports()[0].statistics().starts >= 3);
    assert!(longest < 25_000, "{longest} us, and watchdogs allow 50 ms");
    assert!(longest > 10_000, "an attempt does take that long");
}

#[test]
fn application_restarts_remotes_without_automatic_recovery() {
    let mut machine = Machine::build(|s| {
        s.fault_policy = mesa_hal::driver::FaultPolicy {
            automatic: false,
            ..Default::default()
        }
    });
    machine.cycles(5);
    machine.cable(FIELD).unplug();
    machine.until(40, |machine| !machine.is_running(FIELD));
    machine.cable(FIELD).replug();
    machine.cycles(2000);
    assert!(!machine.is_running(FIELD));
    machine.driver.restart((0, FIELD as u8));
    machine.until(10, |machine| machine.is_running(FIELD));
}

/// The values of LinuxCNC 2.9 on the same simulated machine: 3 in normal operation, 0 when `run` is
/// false, 2 for the first cycle after START, 4 on the way to the stop.
#[test]
fn port_state_is_3_in_operation_and_0_when_off_as_in_linuxcnc() {
    let mut machine = Machine::new();
    let state = |machine: &Machine| {
        ["", "2", "3"].map(|n| {
            let name = format!("hm2_7i92.0.sserial.port-0.port_state{n}");
            let pin = machine.driver.pins().input::<u32>(&name).unwrap();
            machine.driver.pins().read(pin).value
        })
    };
    let mut seen = Vec::new();
    let mut watch = |machine: &mut Machine, cycles: usize| {
        seen.clear();
        for _ in 0..cycles {
            machine.cycles(1);
            seen.push(state(machine));
        }
        seen.dedup();
        seen.clone()
    };
    assert_eq!(watch(&mut machine, 10), [[2, 0, 0], [3, 0, 0]]);
    let run = "hm2_7i92.0.sserial.port-0.run";
    let run = machine.driver.pins().output::<bool>(run).unwrap();
    machine.driver.pins_mut().set(run, false);
    assert_eq!(watch(&mut machine, 10), [[3, 0, 0], [4, 0, 0], [0, 0, 0]]);
    machine.driver.pins_mut().set(run, true);
    let started = watch(&mut machine, 20);
    assert_eq!(started.first(), Some(&[0, 0, 0]));
    assert_eq!(started[started.len() - 2..], [[2, 0, 0], [3, 0, 0]]);
    // One remote is absent: the port is in operation, and occasionally tries to start it.
    machine.cable(FIELD).unplug();
    assert_eq!(
        watch(&mut machine, 200),
        [[3, 0, 0], [3, 1, 0], [3, 2, 0], [3, 0, 0]]
    );
    for channel in [ANALOG, OUTPUTS] {
        machine.cable(channel).unplug();
    }
    machine.cycles(60);
    assert_eq!(state(&machine)[0], 0, "no remote runs");
}

#[test]
fn pauses_without_end_are_a_policy_like_any_other() {
    let policy = FaultPolicy {
        first_backoff: Duration::MAX,
        longest_backoff: Duration::MAX,
        ..FaultPolicy::default()
    };
    let mut machine = Machine::build(|s| s.fault_policy = policy);
    machine.cable(FIELD).unplug();
    machine.until(40, |machine| !machine.is_running(FIELD));
    machine.cycles(300);
    assert!(machine.is_running(ANALOG) && machine.is_valid(OUTPUTS));
}
