//! A remote that reports a fault drives nothing: *all* its outputs are off within 60 ms of the
//! reply with the report, whatever the fault, and stay off until they are set again after
//! re-arming. The truth is the state of the simulated terminals, checked every 250 us.

use core::any::Any;
use core::ops::RangeInclusive;

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, device, fpga};
use mesa_hal::driver::{Board, OfflineReason, RemoteState, Settings, StopError};
use mesa_hal::lbp::RemoteFaults;
use mesa_hal_sim::SimFpga;
use mesa_hal_sim::devices::{Analog, Device, FieldIo, Outputs48, find_cable};
use mesa_hal_sim::remote::{Application, SimRemote};
use mesa_hal_sim::wire::RemoteEnd;

pub const MS: u64 = 1_000_000;
/// The remote's own 50 ms, and the time from a fault to the reply that reports it: one period.
const OFF_WITHIN: u64 = 61 * MS;
const STEP: u64 = 250_000;

/// Cause of a fault.
#[derive(Clone, Copy, Debug)]
enum Cause {
    /// The bit is set, and START clears it.
    Bit(RemoteFaults),
    /// The bit is set, and START does not clear it before its cause is gone.
    Stuck(RemoteFaults),
    Short,
    Hot,
    FieldVolts(f64),
}

fn change<A: Application>(end: &mut dyn RemoteEnd, faults: RemoteFaults, stuck: bool) -> bool {
    let any: &mut dyn Any = end;
    let Some(remote) = any.downcast_mut::<SimRemote<A>>() else {
        return false;
    };
    let kept = if stuck { faults } else { RemoteFaults::empty() };
    remote.configure(|config| config.stuck_faults = kept);
    remote.set_faults(faults);
    true
}

/// Sets bits in the fault byte directly, without the wire.
fn set_bits(machine: &mut Machine, channel: usize, faults: RemoteFaults, stuck: bool) {
    let end = machine
        .driver
        .bus_mut()
        .remote_mut(0, channel)
        .expect("remote");
    let end = find_cable(end).and_then(RemoteEnd::inner_mut).expect("end");
    let done = match channel {
        FIELD => change::<Device<FieldIo>>(end, faults, stuck),
        ANALOG => change::<Device<Analog>>(end, faults, stuck),
        _ => change::<Device<Outputs48>>(end, faults, stuck),
    };
    assert!(done, "channel {channel}");
}

impl Cause {
    fn begins(self, machine: &mut Machine, channel: usize) {
        match self {
            Self::Bit(faults) => set_bits(machine, channel, faults, false),
            Self::Stuck(faults) => set_bits(machine, channel, faults, true),
            _ => self.change(machine, channel, true),
        }
    }

    fn ends(self, machine: &mut Machine, channel: usize) {
        match self {
            Self::Bit(_) => {}
            // The bit stays set that START could not clear; only its cause is gone.
            Self::Stuck(faults) => {
                set_bits(machine, channel, RemoteFaults::empty(), false);
                set_bits(machine, channel, faults, false);
            }
            _ => self.change(machine, channel, false),
        }
    }

    /// Applies the external cause to the device.
    fn change(self, machine: &mut Machine, channel: usize, begins: bool) {
        let now = machine.now();
        let device = machine.device_mut(channel);
        let done = match self {
            Self::Hot => device.set_over_temperature(3, begins),
            Self::FieldVolts(volts) => {
                device.set_field_volts(now, if begins { volts } else { 24.0 })
            }
            _ => device.set_over_current(3, begins),
        };
        done.unwrap();
    }
}

/// Every fault byte with one bit, and the causes that set one in a device. The bit of the watchdog
/// comes without a bite, as on no real remote.
fn causes(channel: usize) -> Vec<Cause> {
    let bits = (0..8).map(|bit| RemoteFaults::from_bits_retain(1 << bit));
    let mut all: Vec<Cause> = bits
        .flat_map(|bit| [Cause::Bit(bit), Cause::Stuck(bit)])
        .collect();
    if channel != ANALOG {
        let volts = [3.0, 40.0].map(Cause::FieldVolts);
        all.extend([Cause::Short, Cause::Hot].into_iter().chain(volts));
    }
    all
}

/// The outputs that are on, by the device's numbers.
pub fn on(machine: &Machine, channel: usize) -> Vec<usize> {
    on_board(machine.driver.bus(), channel)
}

pub fn on_board(fpga: &SimFpga, channel: usize) -> Vec<usize> {
    let world = device(fpga, channel).world();
    let (digital, analog) = match channel {
        FIELD => (16, 0),
        OUTPUTS => (48, 0),
        _ => (6, 6),
    };
    let switches = (0..digital).filter(|&n| world.output(n) == Some(true));
    let volts = (0..analog).filter(|&n| world.analog_output(n).is_some_and(|v| v.abs() > 0.001));
    switches.chain(volts.map(|n| 100 + n)).collect()
}

pub fn all_of(channel: usize) -> Vec<usize> {
    match channel {
        FIELD => (0..16).collect(),
        OUTPUTS => (0..48).collect(),
        _ => (0..6).chain(100..106).collect(),
    }
}

/// The outputs that an application sets in every cycle, whatever the driver reports.
fn switch_all_on(machine: &mut Machine) {
    machine.cards.set_all(machine.driver.pins_mut());
}

fn busy_machine() -> Machine {
    let mut machine = Machine::new();
    for _ in 0..5 {
        cycle(&mut machine, |_| {});
    }
    for channel in [FIELD, ANALOG, OUTPUTS] {
        assert_eq!(on(&machine, channel), all_of(channel));
    }
    machine
}

/// Runs one period of 1 ms in small steps; `look` is called after each.
pub fn cycle(machine: &mut Machine, mut look: impl FnMut(&Machine)) {
    let end = (machine.now() / MS + 1) * MS;
    let _ = machine.driver.read().expect("the bus does not fail");
    look(machine);
    switch_all_on(machine);
    machine.driver.write().expect("the bus does not fail");
    pass(machine, end, look);
}

fn pass(machine: &mut Machine, until: u64, mut look: impl FnMut(&Machine)) {
    while machine.now() < until {
        let step = STEP.min(until - machine.now());
        machine.pass_nanos(step);
        look(machine);
    }
}

/// Returns a check that fails if any output of the remote is on at `from` or later.
fn off_from(from: u64, channel: usize, what: String) -> impl FnMut(&Machine) {
    move |machine| {
        if machine.now() >= from {
            let on = on(machine, channel);
            let late = (machine.now() - from) / 1000;
            assert!(on.is_empty(), "{what}: {on:?} are on, {late} us too late");
        }
    }
}

#[test]
fn outputs_are_off_within_60_ms_of_any_fault_until_rearmed() {
    for channel in [FIELD, ANALOG, OUTPUTS] {
        for cause in causes(channel) {
            let mut machine = busy_machine();
            cause.begins(&mut machine, channel);
            let what = format!("channel {channel}, {cause:?}");
            let mut look = off_from(machine.now() + OFF_WITHIN, channel, what.clone());
            for n in 0..420 {
                if n == 150 {
                    cause.ends(&mut machine, channel);
                }
                cycle(&mut machine, &mut look);
                let is_armed = machine.is_armed(channel);
                assert!(n == 0 || !is_armed, "{what}: armed in cycle {n}");
            }
            comes_back(&mut machine, channel, &what, &mut look);
        }
    }
}

/// Checks that the remote runs again, and drives the outputs set after it was re-armed.
fn comes_back(machine: &mut Machine, channel: usize, what: &str, mut look: impl FnMut(&Machine)) {
    for _ in 0..2000 {
        if machine.is_running(channel) && machine.is_valid(channel) {
            break;
        }
        cycle(machine, &mut look);
    }
    assert!(machine.is_running(channel), "{what}");
    switch_all_on(machine);
    let rearmed = machine.driver.rearm().unwrap();
    assert_eq!((rearmed.armed, rearmed.waiting), (1, 0), "{what}");
    machine.driver.write().unwrap();
    let end = machine.now() + MS;
    pass(machine, end, &mut look);
    for _ in 0..4 {
        cycle(machine, |_| {});
    }
    assert_eq!(on(machine, channel), all_of(channel), "{what}");
}

/// The channels that `stop` reports; checks that they include every one that has an output on.
pub fn named(stopped: Result<(), StopError>, fpga: &SimFpga, what: &str) -> Vec<usize> {
    let not_reached = stopped.map_or_else(
        |error| {
            assert_eq!(error.failed, None, "{what}: the bus does not fail");
            error.not_reached
        },
        |()| Vec::new(),
    );
    let named: Vec<_> = not_reached
        .iter()
        .map(|not| usize::from(not.remote.id.channel))
        .collect();
    for channel in [FIELD, ANALOG, OUTPUTS] {
        let is_off = on_board(fpga, channel).is_empty();
        assert!(
            is_off || named.contains(&channel),
            "{what}: {channel} is on"
        );
    }
    named
}

#[test]
fn shutdown_does_not_keep_the_outputs_of_a_faulty_remote_alive() {
    for channel in [FIELD, ANALOG, OUTPUTS] {
        for (cause, n) in causes(channel).into_iter().zip((0..6).cycle()) {
            let mut machine = busy_machine();
            cause.begins(&mut machine, channel);
            for _ in 0..n {
                cycle(&mut machine, |_| {});
            }
            let (mut fpga, stopped) = machine.driver.shutdown();
            let what = format!("channel {channel}, {cause:?}, {n} cycles");
            let named = named(stopped, &fpga, &what);
            assert!(named.iter().all(|&other| other == channel), "{what}");
            let from = fpga.now() + OFF_WITHIN;
            fpga.advance_to(from);
            for _ in 0..100 * MS / STEP {
                let on = on_board(&fpga, channel);
                assert_eq!(on, [], "channel {channel}, {cause:?}, {n} cycles");
                fpga.advance_to(fpga.now() + STEP);
            }
        }
    }
}

#[test]
fn shutdown_switches_others_off_at_once_during_a_remote_restart() {
    let without_watchdog = || busy_machine_with_watchdog(0);
    for (is_absent, machine) in [
        (false, &busy_machine as &dyn Fn() -> Machine),
        (true, &busy_machine),
        (false, &without_watchdog),
        (true, &without_watchdog),
    ] {
        for wait in 0..24 {
            let mut machine = machine();
            if is_absent {
                machine.cable(FIELD).unplug();
                machine.until(100, |machine| !machine.is_running(FIELD));
            }
            machine.driver.restart((0, FIELD as u8));
            for _ in 0..wait {
                cycle(&mut machine, |_| {});
            }
            let what = format!("absent: {is_absent}, {wait} cycles");
            let begin = machine.now();
            let (fpga, stopped) = machine.driver.shutdown();
            let named = named(stopped, &fpga, &what);
            assert!(named.iter().all(|&channel| channel == FIELD), "{what}");
            // A START that waits for a remote which does not answer takes 17 ms (FACTS 5.7).
            let took = fpga.now() - begin;
            assert!(took < 20 * MS, "{what}: {took} ns");
            for channel in [ANALOG, OUTPUTS] {
                assert_eq!(on_board(&fpga, channel), [], "{what}, channel {channel}");
            }
        }
    }
}

#[test]
fn constant_restart_and_rearm_do_not_keep_old_outputs_on() {
    for cause in [Cause::Short, Cause::Hot, Cause::FieldVolts(3.0)] {
        let mut machine = busy_machine();
        cause.begins(&mut machine, FIELD);
        let mut look = off_from(machine.now() + OFF_WITHIN, FIELD, format!("{cause:?}"));
        cycle(&mut machine, &mut look);
        let _ = machine.driver.read().unwrap();
        assert!(!machine.is_running(FIELD), "told");
        for _ in 0..300 {
            machine.driver.restart((0, FIELD as u8));
            let _ = machine.driver.rearm().unwrap();
            cycle(&mut machine, &mut look);
        }
    }
}

/// The host stops for longer than the watchdogs of the remotes and of the board permit.
#[test]
fn bitten_remotes_are_back_at_once_but_off_until_rearmed() {
    let mut machine = Machine::build(|s| s.watchdog = Some(std::time::Duration::from_millis(500)));
    for _ in 0..5 {
        cycle(&mut machine, |_| {});
    }
    let until = machine.now() + 70 * MS;
    pass(&mut machine, until, |_| {});
    let mut away = 0;
    let mut seen = None;
    for _ in 0..300 {
        cycle(&mut machine, |machine| {
            for channel in [FIELD, ANALOG, OUTPUTS] {
                assert_eq!(on(machine, channel), [], "channel {channel}");
            }
        });
        away += usize::from(!machine.is_valid(FIELD));
        if let Some(reason) = reason(&machine, FIELD) {
            assert!(machine.bit("7i77.0.0.fault-watchdog"));
            seen = Some(reason);
        }
    }
    assert_eq!(seen, Some(OfflineReason::Watchdog));
    assert!(away < 10, "{away} cycles");
    assert_eq!(machine.driver.rearm().unwrap().armed, 3);
    for _ in 0..4 {
        cycle(&mut machine, |_| {});
    }
    for channel in [FIELD, ANALOG, OUTPUTS] {
        assert_eq!(on(&machine, channel), all_of(channel));
    }
}

fn reason(machine: &Machine, channel: usize) -> Option<OfflineReason> {
    match machine.status(channel).state {
        RemoteState::Offline { reason, .. } | RemoteState::Restarting { reason } => Some(reason),
        _ => None,
    }
}

#[test]
fn first_reason_of_a_fault_is_kept_until_re_armed() {
    let mut machine = busy_machine();
    let now = machine.now();
    let field = machine.device_mut(FIELD);
    field.set_field_volts(now, 3.0).unwrap();
    let low = mesa_hal::sslbp::RemoteFaults::LOW_VOLTAGE;
    let mut attempts = 0;
    while attempts < 3 {
        cycle(&mut machine, |_| {});
        let status = machine.status(FIELD);
        if let Some(reason) = reason(&machine, FIELD) {
            assert_eq!(reason, OfflineReason::FieldPower(low));
            assert_eq!(status.first_fault, Some(OfflineReason::FieldPower(low)));
        }
        attempts = machine.driver.ports()[0].statistics().starts;
    }
    let now = machine.now();
    let field = machine.device_mut(FIELD);
    field.set_field_volts(now, 24.0).unwrap();
    machine.until(2000, |machine| machine.is_valid(FIELD));
    let first = machine.status(FIELD).first_fault;
    assert_eq!(
        first,
        Some(OfflineReason::FieldPower(low)),
        "still not re-armed"
    );
    // Another fault before the re-arming changes nothing.
    machine.cable(FIELD).unplug();
    machine.until(40, |machine| !machine.is_running(FIELD));
    assert_eq!(machine.status(FIELD).first_fault, first);
    machine.cable(FIELD).replug();
    machine.until(2000, |machine| machine.is_valid(FIELD));
    let _ = machine.driver.rearm().unwrap();
    cycle(&mut machine, |_| {});
    assert_eq!(machine.status(FIELD).first_fault, None);
}

/// The range that the tests above cover is the whole fault byte.
#[test]
fn every_bit_of_the_fault_byte_has_a_name() {
    let bits: RangeInclusive<u8> = 0..=7;
    assert!(
        bits.map(|bit| RemoteFaults::from_bits(1 << bit))
            .all(|f| f.is_some())
    );
}

/// A 7I72 that has been powered up with this watchdog, and drives all its outputs.
pub fn busy_machine_with_watchdog(millis: u32) -> Machine {
    let settings = Settings {
        watchdog: Some(std::time::Duration::from_secs(1)),
        ..Settings::default()
    };
    let board = Board::identify(fpga(), settings).expect("a board");
    let mut board = board.discover().expect("its remotes");
    board
        .write_remote_parameter((0, 2), "nvwatchdogtimeout", millis)
        .expect("it takes it");
    let mut machine = Machine::with(board.start().expect("all of them run"));
    cycle(&mut machine, |_| {});
    let now = machine.now();
    machine.device_mut(OUTPUTS).set_power(now, false);
    machine.device_mut(OUTPUTS).set_power(now, true);
    machine.until(10, |machine| !machine.is_running(OUTPUTS));
    machine.until(7000, |machine| {
        machine.driver.rearm().unwrap().waiting == 0 && machine.is_valid(OUTPUTS)
    });
    // Two restarts have 60 ms between them.
    for _ in 0..80 {
        cycle(&mut machine, |_| {});
    }
    assert_eq!(on(&machine, OUTPUTS), all_of(OUTPUTS));
    machine
}

#[test]
fn faulty_remote_gets_no_data_and_is_off_within_its_watchdog() {
    for (millis, off_within) in [(20, 21), (200, 201), (600, 601)] {
        for cause in [Cause::Hot, Cause::Short, Cause::FieldVolts(3.0)] {
            let mut machine = busy_machine_with_watchdog(millis);
            cause.begins(&mut machine, OUTPUTS);
            let what = format!("watchdog of {millis} ms, {cause:?}");
            let mut look = off_from(machine.now() + off_within * MS, OUTPUTS, what.clone());
            for _ in 0..2 * off_within + 200 {
                cycle(&mut machine, &mut look);
            }
            cause.ends(&mut machine, OUTPUTS);
            comes_back(&mut machine, OUTPUTS, &what, &mut look);
        }
    }
}

/// Nothing but a START switches it off, so it gets one at once.
#[test]
fn remote_whose_watchdog_is_off_is_started_again_at_once() {
    for cause in [Cause::Short, Cause::Bit(RemoteFaults::NO_ENABLE)] {
        let mut machine = busy_machine_with_watchdog(0);
        let watchdog = machine.status(OUTPUTS).watchdog;
        assert_eq!(watchdog, mesa_hal::driver::RemoteWatchdog::Off);
        cause.begins(&mut machine, OUTPUTS);
        let mut look = off_from(machine.now() + 8 * MS, OUTPUTS, format!("{cause:?}"));
        for _ in 0..200 {
            cycle(&mut machine, &mut look);
        }
    }
}
