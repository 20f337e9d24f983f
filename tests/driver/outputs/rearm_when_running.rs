//! Groups that are to be armed as soon as they run, unless a new fault comes before. Everything is
//! commanded on in each cycle: the simulator's outputs show what follows.

use crate::common::ethernet::{self, SimLink, cut, good};
use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, device, fpga};
use mesa_hal::driver::{BoardState, EventKind, Events};
use mesa_hal::hal::{Output, PinError};
use mesa_hal::{Settings, UdpBus};
use mesa_hal_sim::devices::{Device, FieldIo, find_mut};
use mesa_hal_sim::remote::Cable;
use mesa_hal_sim::wire::RemoteEnd;

const ALL: [usize; 3] = [FIELD, ANALOG, OUTPUTS];
/// The channels of one cause.
const FIELD_ONLY: [bool; 3] = [true, false, false];

/// Long enough for every restart: the pauses of these tests are short.
const RECOVERED: usize = 400;

fn running() -> Machine {
    let short_pauses = |settings: &mut Settings| {
        let policy = &mut settings.fault_policy;
        policy.first_backoff = core::time::Duration::from_millis(50);
        policy.longest_backoff = core::time::Duration::from_millis(100);
    };
    let mut machine = Machine::build(short_pauses);
    commanded(&mut machine, 20);
    assert_eq!(on(&machine), [true; 3]);
    machine
}

/// Cycles in which everything is commanded on.
fn commanded(machine: &mut Machine, cycles: usize) {
    for _ in 0..cycles {
        let _ = machine.driver.read().expect("the bus is well");
        machine.cards.set_one_of_each(machine.driver.pins_mut());
        machine.finish();
    }
}

/// The outputs of each card in the simulator.
fn on(machine: &Machine) -> [bool; 3] {
    let world = |channel| device(machine.driver.bus(), channel).world();
    let volts = world(ANALOG).analog_output(1);
    [
        world(FIELD).output(3) == Some(true),
        volts.is_some_and(|volts| volts.abs() > 0.1),
        world(OUTPUTS).output(7) == Some(true),
    ]
}

fn events(machine: &Machine) -> Events {
    let mut events = machine.driver.events();
    events.by_ref().for_each(drop);
    events
}

fn kinds(events: &mut Events) -> Vec<EventKind> {
    events.by_ref().map(|event| event.kind).collect()
}

/// A fault, with its end.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trouble {
    /// The host stops for longer than the watchdog's time.
    Bite,
    Reset,
    /// The card of this channel is unplugged, until it is offline.
    Unplugged(usize),
    /// A short circuit at an output of the field I/O.
    OverCurrent,
    /// The port is switched off for some cycles.
    PortOff,
}

impl Trouble {
    const ALL: [Self; 6] = [
        Self::Bite,
        Self::Reset,
        Self::Unplugged(FIELD),
        Self::Unplugged(OUTPUTS),
        Self::OverCurrent,
        Self::PortOff,
    ];

    /// The cards that it takes.
    fn takes(self) -> [bool; 3] {
        match self {
            Self::Bite | Self::Reset | Self::PortOff => [true; 3],
            Self::Unplugged(channel) => ALL.map(|other| other == channel),
            Self::OverCurrent => FIELD_ONLY,
        }
    }

    fn begins(self, machine: &mut Machine) {
        match self {
            Self::Bite => machine.sleep(30),
            Self::Reset => machine.fpga().reload(),
            Self::Unplugged(channel) => machine.cable(channel).unplug(),
            Self::OverCurrent => over_current(machine, true),
            Self::PortOff => switch_port(machine, false),
        }
        // The card's own watchdog switches its outputs off.
        let cycles = if matches!(self, Self::Unplugged(_)) {
            75
        } else {
            5
        };
        commanded(machine, cycles);
    }

    fn ends(self, machine: &mut Machine) {
        match self {
            Self::Bite | Self::Reset => {}
            Self::Unplugged(channel) => machine.cable(channel).replug(),
            Self::OverCurrent => over_current(machine, false),
            Self::PortOff => switch_port(machine, true),
        }
    }
}

fn over_current(machine: &mut Machine, is_short: bool) {
    let end = machine.fpga().remote_mut(0, FIELD).expect("a remote");
    let card = find_mut(end).expect("a card");
    card.set_over_current(3, is_short).expect("an output");
}

fn run_pin(machine: &Machine) -> Output<bool> {
    machine.output("sserial.port-0.run")
}

fn switch_port(machine: &mut Machine, is_on: bool) {
    let run = run_pin(machine);
    machine.driver.pins_mut().set(run, is_on);
}

/// The board asks for its set-up by its flags, as an application that does not arm does.
fn clear_flags(machine: &mut Machine) {
    let io_error = machine.param::<bool>("io_error");
    machine.set_param(io_error, false);
    let has_bit = machine
        .driver
        .pins()
        .inout::<bool>("hm2_7i92.0.watchdog.has_bit");
    let has_bit = has_bit.expect("a pin");
    machine.driver.pins_mut().set(has_bit, false);
}

#[test]
fn one_call_arms_everything_however_long_it_takes_to_run() {
    for trouble in Trouble::ALL {
        for wait in [1, 300, 2_000] {
            let told = format!("{trouble:?}, {wait} cycles");
            let mut machine = running();
            let mut events = events(&machine);
            trouble.begins(&mut machine);
            if trouble == Trouble::PortOff {
                trouble.ends(&mut machine);
            }
            let rearmed = machine.driver.rearm_when_running();
            assert_eq!(rearmed.waiting, rearmed.rearm_pending, "{told}");
            assert_ne!(rearmed.rearm_pending, 0, "{told}");
            // A short circuit is sensed only while its output is on: the card would be armed, and
            // fail again.
            if matches!(trouble, Trouble::Unplugged(_)) {
                commanded(&mut machine, wait);
                let left = ALL.map(|channel| !trouble.takes()[channel]);
                assert_eq!(on(&machine), left, "{told}: not before it runs");
            }
            trouble.ends(&mut machine);
            commanded(&mut machine, RECOVERED);
            let kinds = kinds(&mut events);
            assert_eq!(on(&machine), [true; 3], "{told}: {kinds:#?}");
            let rearmed = machine.driver.rearm_when_running();
            assert_eq!((rearmed.armed, rearmed.waiting), (0, 0), "{told}");
        }
    }
}

/// Every pair of faults, the second one at some cycle after the call: what it takes stays off.
#[test]
fn new_fault_before_arming_cancels_it_for_affected_groups() {
    for first in Trouble::ALL {
        for second in Trouble::ALL {
            for after in [0, 1, 2, 5, 9, 20, 70] {
                let told = format!("{first:?}, {after} cycles, {second:?}");
                let mut machine = running();
                first.begins(&mut machine);
                if first == Trouble::PortOff {
                    first.ends(&mut machine);
                }
                let _ = machine.driver.rearm_when_running();
                first.ends(&mut machine);
                commanded(&mut machine, after);
                let was_running = machine.driver.board_state() == BoardState::Running;
                let is_sensed = on(&machine)[FIELD] && was_running && machine.is_running(FIELD);
                second.begins(&mut machine);
                let is_found = machine.driver.board_state() != BoardState::Running;
                second.ends(&mut machine);
                if is_found {
                    clear_flags(&mut machine);
                }
                commanded(&mut machine, 2 * RECOVERED);
                assert_eq!(machine.driver.board_state(), BoardState::Running, "{told}");
                for channel in ALL {
                    assert!(machine.is_running(channel), "{told}: {channel}");
                }
                let is_alone = matches!(first, Trouble::Unplugged(_) | Trouble::OverCurrent);
                let is_of_board = matches!(second, Trouble::Bite | Trouble::Reset);
                let is_same = is_alone && first.takes() == second.takes()
                    || is_of_board
                        && !was_running
                        && (first, second) != (Trouble::Bite, Trouble::Reset);
                let expected = second.takes().map(|is_taken| !is_taken);
                let is_on = on(&machine);
                // A fault of a card or a board that has not come back yet is the same fault going
                // on, and a short circuit that no reply has reported before the START is cleared by
                // it.
                let is_same = is_same || second == Trouble::OverCurrent && !is_sensed;
                assert!(
                    is_on == expected || is_same && is_on == [true; 3],
                    "{told}: {is_on:?}"
                );
                let _ = machine.driver.rearm().expect("the bus is well");
                commanded(&mut machine, 5);
                assert_eq!(on(&machine), [true; 3], "{told}: another call");
            }
        }
    }
}

#[test]
fn remote_failing_again_before_its_arming_stays_unarmed() {
    // The card comes back and fails again, at every cycle around its arming.
    for after in 1..120 {
        let mut machine = running();
        Trouble::Unplugged(OUTPUTS).begins(&mut machine);
        let _ = machine.driver.rearm_when_running();
        let restarts = machine.status(OUTPUTS).restarts;
        machine.cable(OUTPUTS).replug();
        commanded(&mut machine, after);
        machine.cable(OUTPUTS).unplug();
        commanded(&mut machine, 60);
        let had_run = machine.status(OUTPUTS).restarts > restarts;
        machine.cable(OUTPUTS).replug();
        commanded(&mut machine, RECOVERED);
        assert!(machine.is_running(OUTPUTS));
        assert_eq!(on(&machine), [true, true, !had_run], "{after} cycles");
    }
}

#[test]
fn other_device_or_new_fault_cancels_and_failed_retry_does_not() {
    let mut machine = running();
    let remote = machine.status(OUTPUTS).label;
    let mut told = events(&machine);
    Trouble::Unplugged(OUTPUTS).begins(&mut machine);
    let group = machine.status(OUTPUTS).pins.group;
    assert_eq!(machine.driver.rearm_group_when_running(group), Ok(false));
    commanded(&mut machine, 1_000);
    let is_coming = |machine: &Machine| {
        let state = machine.driver.pins().group_state(group);
        state.expect("a group").rearm_pending
    };
    assert!(is_coming(&machine), "ten attempts and more have failed");
    let mut description = FieldIo::description().expect("tables");
    description.unit = 0x1200_0003;
    let other = Device::remote(&description, FieldIo::new(false)).expect("a card");
    let other: Box<dyn RemoteEnd> = Box::new(Cable::new(Box::new(other), 9));
    let right = machine.fpga().plug(0, OUTPUTS, Some(other));
    commanded(&mut machine, RECOVERED);
    assert!(!is_coming(&machine));
    let cancelled = EventKind::RemoteRearmCancelled { remote };
    assert_eq!(
        kinds(&mut told)
            .into_iter()
            .filter(|kind| *kind == cancelled)
            .count(),
        1
    );
    machine.fpga().plug(0, OUTPUTS, right);
    machine.cable(OUTPUTS).replug();
    commanded(&mut machine, RECOVERED);
    assert!(machine.is_running(OUTPUTS));
    assert_eq!(on(&machine), [true, true, false]);

    // Unplugged, and with a short circuit when it is plugged in.
    let mut machine = running();
    Trouble::Unplugged(FIELD).begins(&mut machine);
    let _ = machine.driver.rearm_when_running();
    over_current(&mut machine, true);
    machine.cable(FIELD).replug();
    commanded(&mut machine, RECOVERED);
    over_current(&mut machine, false);
    commanded(&mut machine, RECOVERED);
    assert!(machine.is_running(FIELD));
    assert_eq!(on(&machine), [false, true, true]);
}

#[test]
fn group_of_an_off_port_is_refused_and_each_cancel_is_reported() {
    let mut machine = running();
    let group = machine.status(FIELD).pins.group;
    Trouble::PortOff.begins(&mut machine);
    let refused = machine.driver.rearm_group_when_running(group);
    assert!(
        matches!(refused, Err(PinError::PortOff { .. })),
        "{refused:?}"
    );
    let rearmed = machine.driver.rearm_when_running();
    assert_eq!(
        (rearmed.armed, rearmed.waiting, rearmed.rearm_pending),
        (0, 3, 0)
    );
    Trouble::PortOff.ends(&mut machine);
    commanded(&mut machine, RECOVERED);
    assert_eq!(on(&machine), [false; 3]);

    // The rising edge of the port's pin: that port's remotes are wanted.
    Trouble::PortOff.begins(&mut machine);
    let mut told = events(&machine);
    Trouble::PortOff.ends(&mut machine);
    assert_eq!(machine.driver.rearm_when_running().rearm_pending, 3);
    commanded(&mut machine, 1);
    Trouble::PortOff.begins(&mut machine);
    let is_cancelled = |kind: &EventKind| matches!(kind, EventKind::RemoteRearmCancelled { .. });
    assert_eq!(
        kinds(&mut told)
            .iter()
            .filter(|kind| is_cancelled(kind))
            .count(),
        3
    );

    let mut machine = running();
    let mut told = events(&machine);
    Trouble::Bite.begins(&mut machine);
    assert_eq!(machine.driver.rearm_when_running().rearm_pending, 4);
    Trouble::Reset.begins(&mut machine);
    let cancelled = EventKind::RearmCancelled { groups: 4 };
    assert!(kinds(&mut told).contains(&cancelled));
    let _ = machine.driver.rearm_when_running();
    assert_eq!(machine.driver.cancel_rearm(), 4);
    commanded(&mut machine, RECOVERED);
    assert_eq!(machine.driver.board_state(), BoardState::Running);
    assert_eq!(on(&machine), [false; 3], "withdrawn");
}

/// The board is away until the bus is down, and may have lost its configuration by then, which is
/// found when it answers again.
#[test]
fn no_event_reports_outputs_safe_while_they_are_on() {
    for is_reset in [false, true] {
        for wait in 0..8 {
            for is_before in [false, true] {
                let told = format!("reset {is_reset}, {wait} cycles, in the write {is_before}");
                let mut machine: Machine<UdpBus<SimLink>> =
                    Machine::on(ethernet::bus(fpga()), |_| {});
                let cycle = |machine: &mut Machine<UdpBus<SimLink>>, asks: bool| {
                    let _ = machine.driver.read();
                    if asks {
                        let _ = machine.driver.rearm_when_running();
                    }
                    machine.cards.set_one_of_each(machine.driver.pins_mut());
                    let _ = machine.driver.write();
                    machine.rest();
                };
                (0..20).for_each(|_| cycle(&mut machine, false));
                let mut events = machine.driver.events();
                events.by_ref().for_each(drop);
                let link = machine.driver.bus_mut().link();
                link.to_board = cut();
                if is_reset {
                    let now = link.time();
                    link.resets.push((now, 100_000_000));
                }
                (0..300).for_each(|_| cycle(&mut machine, false));
                assert_eq!(machine.driver.board_state(), BoardState::BusDown, "{told}");
                machine.driver.bus_mut().link().to_board = good();
                if is_before {
                    let _ = machine.driver.rearm_when_running();
                }
                (0..wait).for_each(|_| cycle(&mut machine, false));
                if !is_before {
                    cycle(&mut machine, true);
                }
                (0..400).for_each(|_| cycle(&mut machine, false));
                let kinds = kinds(&mut events);
                let fpga = machine.fpga();
                let is_on = device(fpga, FIELD).world().output(3) == Some(true);
                let act = |kind: &EventKind| matches!(kind, EventKind::Rearmed { .. });
                let last_act = kinds.iter().rposition(act).expect("it was asked for");
                let safe = |kind: &EventKind| kind.makes_safe() && kind.remote().is_none();
                let last_safe = kinds.iter().rposition(safe).expect("the bus was down");
                assert_eq!(is_on, last_act > last_safe, "{told}: {kinds:#?}");
            }
        }
    }
}
