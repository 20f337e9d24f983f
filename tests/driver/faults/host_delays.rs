//! One bad remote does not stop its port, however late the host and the network are, and their
//! delays are not blamed on remotes. The truth is the cables' losses, and the state of the
//! simulated terminals.

use std::time::Duration;

use crate::common::chance::Chance;
use crate::common::ethernet::{SimLink, WIRE, connect};
use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, World, fpga};
use crate::faults::remote_outputs::{all_of, on, on_board};
use mesa_hal::BoardState;
use mesa_hal::driver::{EventKind, OfflineReason, Pace, Settings};

const MS: u64 = 1_000_000;

fn settings(settings: &mut Settings) {
    settings.watchdog = Some(Duration::from_millis(100));
}

/// Runs cycles of a host that is occasionally late by 5 to 10 ms, before a write or after it.
fn late_cycles<B: World>(machine: &mut Machine<B>, chance: &mut Chance, count: usize) {
    for _ in 0..count {
        let _ = machine.driver.read();
        let place = chance.below(100);
        let late = (5 + chance.below(6)) * MS;
        if place == 0 {
            machine.pass_nanos(late);
        }
        machine.cards.set_all(machine.driver.pins_mut());
        let _ = machine.driver.write();
        if place == 1 || place == 2 {
            machine.pass_nanos(late);
        }
        machine.rest();
    }
}

#[test]
fn host_delays_and_an_unplugged_remote_affect_no_other_remote() {
    for seed in 0..20 {
        let mut machine = Machine::build(settings);
        let mut chance = Chance(seed);
        late_cycles(&mut machine, &mut chance, 200);
        machine.cable(FIELD).unplug();
        for _ in 0..60 {
            late_cycles(&mut machine, &mut chance, 50);
            for channel in [ANALOG, OUTPUTS] {
                assert_eq!(machine.status(channel).first_fault, None, "seed {seed}");
                assert_eq!(on(&machine, channel), all_of(channel), "seed {seed}");
            }
        }
        assert!(!machine.is_running(FIELD));
    }
}

/// Replies and requests that are late as well bring the bus down, after which the board's watchdog
/// bites.
#[test]
fn bus_that_goes_down_is_no_fault_of_a_remote() {
    let mut downs = 0;
    for seed in 0..12 {
        let mut machine: Machine<_> = Machine::on(connect(SimLink::new(fpga())), settings);
        let mut events = machine.driver.events();
        let late = |seed| {
            let mut chance = Chance(seed);
            Box::new(move |_: u64, _: &[u8]| {
                let late = if chance.one_in(8) {
                    chance.below(3 * MS)
                } else {
                    0
                };
                vec![WIRE + late]
            })
        };
        let link = machine.driver.bus_mut().link();
        (link.to_board, link.to_host) = (late(seed + 100), late(seed + 200));
        machine.cable(FIELD).unplug();
        let mut chance = Chance(seed);
        late_cycles(&mut machine, &mut chance, 2000);
        downs += usize::from(machine.driver.board_state() == BoardState::BusDown);
        for event in &mut events {
            if let EventKind::RemoteOffline { remote, reason } = event.kind {
                let is_blamed = matches!(reason, OfflineReason::TooManyFailures(_));
                assert!(
                    !is_blamed || usize::from(remote.id.channel) == FIELD,
                    "{seed}: {event}"
                );
            }
        }
        // With a good network everything but the remote without a cable recovers.
        let link = machine.driver.bus_mut().link();
        let good = || Box::new(|_: u64, _: &[u8]| vec![WIRE]);
        (link.to_board, link.to_host) = (good(), good());
        for _ in 0..300 {
            let _ = machine.driver.read();
            let _ = machine.driver.rearm();
            let _ = machine.driver.write();
            machine.rest();
        }
        for channel in [ANALOG, OUTPUTS] {
            assert!(
                machine.is_armed(channel) && machine.is_valid(channel),
                "{seed}"
            );
        }
    }
    assert!(downs > 3, "{downs} of 12 went down");
}

/// The host's clocks do not show how long a virtual machine was stopped: the board's watchdog does.
#[test]
fn second_read_reports_a_safe_board_after_an_uncounted_pause() {
    for pace in [Pace::Host, Pace::Board] {
        let settings = |settings: &mut Settings| settings.pace = pace;
        let mut machine: Machine<_> = Machine::on(connect(SimLink::new(fpga())), settings);
        let cycle = |machine: &mut Machine<_>| {
            let _ = machine.driver.read();
            machine.cards.set_all(machine.driver.pins_mut());
            let _ = machine.driver.write();
        };
        for _ in 0..50 {
            cycle(&mut machine);
            machine.rest();
        }
        for channel in [ANALOG, OUTPUTS] {
            assert_eq!(
                on_board(machine.driver.bus_mut().fpga(), channel),
                all_of(channel),
                "{pace:?}"
            );
        }
        machine.driver.bus_mut().link().stop_host(10_000 * MS);
        for channel in [ANALOG, OUTPUTS] {
            assert_eq!(
                on_board(machine.driver.bus_mut().fpga(), channel),
                [],
                "{pace:?}"
            );
        }
        cycle(&mut machine);
        machine.rest();
        cycle(&mut machine);
        // By the host's clock it was fed just now, and would only bite after a reset.
        let state = machine.driver.board_state();
        let is_safe = [BoardState::Reset, BoardState::WatchdogBitten].contains(&state);
        assert!(is_safe, "{pace:?}: {state:?}");
        let pins = machine.driver.pins();
        let board = pins.group_state(machine.driver.group()).expect("a group");
        assert!(!board.valid, "{pace:?}");
        for channel in [FIELD, ANALOG, OUTPUTS] {
            assert!(!machine.is_valid(channel), "{pace:?}");
            assert_eq!(
                on_board(machine.driver.bus_mut().fpga(), channel),
                [],
                "{pace:?}"
            );
        }
    }
}
