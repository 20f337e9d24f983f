use super::*;
use crate::advice::{self, MesaError};
use crate::driver::{BoardState, RemoteState, Settings};
use crate::hal::{HalType, ShortName};
use mesa_hal_sim::{Motor, SimFpga, machines};

fn driver() -> Driver<SimFpga> {
    let board = machines::six_axes_7i92(Motor::default());
    Driver::start(board, Settings::default()).expect("it starts")
}

fn cycle(driver: &mut Driver<SimFpga>, queue: &mut CommandQueue) -> u32 {
    let _ = driver.read().expect("the bus does not fail");
    let count = queue.take(driver);
    driver.write().expect("the bus does not fail");
    driver.bus_mut().wait(core::time::Duration::from_millis(1));
    count
}

#[test]
fn full_queue_is_reported_and_a_cycle_takes_sixteen_commands() {
    let mut driver = driver();
    let mut queue = CommandQueue::new(&driver, 20);
    let sender = queue.sender();
    let output = "hm2_7i92.0.7i77.0.0.output-00";
    let output = driver.pins().output::<bool>(output).expect("there");
    for _ in 0..20 {
        sender.set(output, true).expect("there is room");
    }
    let full = sender.set(output, false).expect_err("there is none");
    assert_eq!(full, CommandError::Full { capacity: 20 });
    assert_eq!(full.advice(), Some(advice::CHECK_CYCLE));
    assert_eq!(cycle(&mut driver, &mut queue), 16);
    assert_eq!(cycle(&mut driver, &mut queue), 4);
    assert_eq!(cycle(&mut driver, &mut queue), 0);
    // The ring wraps around.
    for n in 0..50_u32 {
        sender.set(output, n % 2 == 0).expect("there is room");
        assert_eq!(cycle(&mut driver, &mut queue), 1);
        assert_eq!(driver.pins().commanded(output), n % 2 == 0);
    }
    let statistics = sender.statistics();
    assert_eq!((statistics.sent, statistics.taken), (70, 70));
    assert_eq!(statistics.refused, 0);
    drop(queue);
    assert_eq!(sender.rearm(), Err(CommandError::Ended));
}

#[test]
fn commands_from_before_a_fault_or_for_another_driver_are_void() {
    let mut driver = driver();
    let mut queue = CommandQueue::new(&driver, 64);
    let sender = queue.sender();
    let name = "hm2_7i92.0.7i77.0.0.output-00";
    let output = driver.pins().output::<bool>(name).expect("there");
    let group = driver.pins().info(output).expect("there").group;
    let is_armed = |driver: &Driver<SimFpga>| {
        let state = driver.pins().group_state(group);
        state.expect("there").armed
    };
    for _ in 0..20 {
        sender.set(output, true).expect("there is room");
    }
    sender.rearm().expect("there is room");
    assert_eq!(cycle(&mut driver, &mut queue), 16);
    assert!(is_armed(&driver));
    // The other five wait when the fault is found: their outputs are no longer armed.
    driver.restart((0, 0));
    assert!(!is_armed(&driver));
    assert_eq!(cycle(&mut driver, &mut queue), 5);
    assert!(!is_armed(&driver));
    assert_eq!(sender.statistics().refused, 5);
    // A command sent afterwards counts again, once the group is armed.
    for _ in 0..200 {
        cycle(&mut driver, &mut queue);
    }
    sender.set(output, true).expect("there is room");
    assert_eq!(cycle(&mut driver, &mut queue), 1);
    assert_eq!(sender.statistics().refused, 6);
    sender.rearm_group(group).expect("there is room");
    sender.set(output, true).expect("there is room");
    assert_eq!(cycle(&mut driver, &mut queue), 2);
    assert!(is_armed(&driver) && driver.pins().commanded(output));
    assert_eq!(sender.statistics().refused, 6);

    let mut other = self::driver();
    other.restart((0, 0));
    sender.rearm().expect("there is room");
    assert_eq!(cycle(&mut other, &mut queue), 0);
    assert_eq!(sender.statistics().refused, 7);
}

#[test]
fn output_is_switched_off_whatever_else_fails_meanwhile() {
    let mut driver = driver();
    let mut queue = CommandQueue::new(&driver, 8);
    let sender = queue.sender();
    let name = "hm2_7i92.0.7i77.0.0.output-00";
    let coolant = driver.pins().output::<bool>(name).expect("there");
    sender.set(coolant, true).expect("there is room");
    cycle(&mut driver, &mut queue);
    assert!(driver.pins().commanded(coolant));
    // In the same cycle the other half of the card fails.
    sender.set(coolant, false).expect("there is room");
    driver.restart((0, 1));
    assert_eq!(cycle(&mut driver, &mut queue), 1);
    assert!(!driver.pins().commanded(coolant));
    assert_eq!(sender.statistics().refused, 0);
}

/// The output is switched on in a queue of 300 commands; after a fault the application itself
/// re-arms, while the rest of the queue waits.
#[test]
fn output_stays_off_for_commands_from_before_a_rearmed_fault() {
    let mut driver = driver();
    let mut queue = CommandQueue::new(&driver, 400);
    let sender = queue.sender();
    let name = "hm2_7i92.0.7i77.0.0.output-00";
    let coolant = driver.pins().output::<bool>(name).expect("there");
    let group = driver.pins().info(coolant).expect("there").group;
    for n in 0..300 {
        sender.set(coolant, n < 299).expect("there is room");
    }
    cycle(&mut driver, &mut queue);
    driver.restart((0, 0));
    while driver.pins_mut().rearm(group).is_err() {
        let _ = driver.read().expect("the bus does not fail");
        driver.write().expect("the bus does not fail");
        driver.bus_mut().wait(core::time::Duration::from_millis(1));
    }
    for _ in 0..20 {
        cycle(&mut driver, &mut queue);
        assert!(!driver.pins().commanded(coolant));
    }
    let statistics = sender.statistics();
    assert_eq!((statistics.taken, statistics.refused), (300, 283));
    // A command sent now was sent after the fault.
    sender.set(coolant, true).expect("there is room");
    cycle(&mut driver, &mut queue);
    assert!(driver.pins().commanded(coolant));
}

#[test]
fn switch_off_commands_are_never_refused() {
    let mut driver = driver();
    let mut queue = CommandQueue::new(&driver, 8);
    let sender = queue.sender();
    let name = "hm2_7i92.0.7i77.0.0.output-00";
    let coolant = driver.pins().output::<bool>(name).expect("there");
    let group = driver.pins().info(coolant).expect("there").group;
    cycle(&mut driver, &mut queue);
    // Sent before the fault, or while the group is not armed: off is off.
    sender.set(coolant, false).expect("there is room");
    driver.restart((0, 0));
    cycle(&mut driver, &mut queue);
    sender.set(coolant, false).expect("there is room");
    cycle(&mut driver, &mut queue);
    // Sent before, taken after the application has switched the output on again.
    sender.set(coolant, false).expect("there is room");
    while driver.pins_mut().rearm(group).is_err() {
        let _ = driver.read().expect("the bus does not fail");
        driver.write().expect("the bus does not fail");
        driver.bus_mut().wait(core::time::Duration::from_millis(1));
    }
    driver.pins_mut().set(coolant, true);
    cycle(&mut driver, &mut queue);
    assert!(!driver.pins().commanded(coolant));
    assert_eq!(sender.statistics().refused, 0);
}

#[test]
fn minus_zero_volts_are_as_safe_as_zero() {
    let mut driver = driver();
    let mut queue = CommandQueue::new(&driver, 8);
    let sender = queue.sender();
    let name = "hm2_7i92.0.7i77.0.1.analogout0";
    let drive = driver.pins().output::<f64>(name).expect("there");
    let group = driver.pins().info(drive).expect("there").group;
    cycle(&mut driver, &mut queue);
    sender.set(drive, -0.0).expect("there is room");
    driver.restart((0, 1));
    while driver.pins_mut().rearm(group).is_err() {
        let _ = driver.read().expect("the bus does not fail");
        driver.write().expect("the bus does not fail");
        driver.bus_mut().wait(core::time::Duration::from_millis(1));
    }
    driver.pins_mut().set(drive, 5.0);
    cycle(&mut driver, &mut queue);
    assert_eq!(driver.pins().commanded(drive), 0.0);
    assert_eq!(sender.statistics().refused, 0);
}

#[test]
fn rearm_command_takes_effect_if_sent_after_the_fault_was_shown() {
    for is_after in [true, false] {
        let mut runner = crate::runner::Runner::new(driver());
        let (reader, sender) = (runner.snapshot(), runner.commands(4));
        let mut states = Vec::new();
        let ended = runner.run(|cycle| {
            states.push(cycle.driver.board_state());
            let shown = reader.read().map(|seen| seen.board().0);
            let is_shown = shown == Ok(BoardState::WatchdogBitten);
            if cycle.number == 10 {
                if !is_after {
                    sender.rearm().expect("there is room");
                }
                cycle
                    .driver
                    .bus_mut()
                    .wait(core::time::Duration::from_secs(1));
            } else if is_after && is_shown && states.len() < 15 {
                sender.rearm().expect("there is room");
            }
            match cycle.number {
                0..30 => core::ops::ControlFlow::Continue(()),
                _ => core::ops::ControlFlow::Break(()),
            }
        });
        assert_eq!(ended.stopped, Ok(()));
        assert!(states.contains(&BoardState::WatchdogBitten), "{states:?}");
        let expected = if is_after {
            BoardState::Running
        } else {
            BoardState::WatchdogBitten
        };
        assert_eq!(states.last(), Some(&expected), "{is_after}: {states:?}");
    }
}

#[test]
fn invalid_commands_are_refused_when_sent() {
    let driver = driver();
    let sender = CommandQueue::new(&driver, 4).sender();
    let other = self::driver();
    let pins = other.pins();
    let output = "hm2_7i92.0.7i77.0.0.output-00";
    let foreign = pins.output::<bool>(output).expect("there");
    let own = |name| driver.pins().id(name).expect("there");
    let float = AnyValue::from(1.0);
    for (sent, why) in [
        (sender.set(foreign, true), PinError::ForeignHandle),
        (sender.rearm_group(other.group()), PinError::ForeignHandle),
        (
            sender.set_any(own("hm2_7i92.0.7i77.0.0.input-00"), true.into()),
            PinError::NotSettable {
                name: ShortName::new("hm2_7i92.0.7i77.0.0.input-00"),
            },
        ),
        (
            sender.set_any(own(output), float),
            PinError::WrongType {
                name: ShortName::new(output),
                expected: HalType::Bit,
                value: float,
                limits: None,
            },
        ),
    ] {
        assert_eq!(sent, Err(CommandError::Pin(why)));
    }
    let remote = RemoteId::new(0, 7);
    let nothing = sender.restart(remote);
    assert_eq!(nothing, Err(CommandError::NoRemote { remote }));
    assert_eq!(sender.statistics(), CommandStatistics::default());
}

#[test]
fn commands_set_parameters_restart_remotes_and_rearm_all() {
    let mut driver = driver();
    let mut queue = CommandQueue::new(&driver, 8);
    let sender = queue.sender();
    cycle(&mut driver, &mut queue);
    let limit = driver
        .pins()
        .parameter::<f64>("hm2_7i92.0.7i77.0.1.analogout0-maxlim")
        .expect("there");
    sender.set_param(limit, 2.5).expect("sent");
    let nothing = sender.set_param(limit, f64::NAN);
    let refused = nothing.expect_err("no limit").to_string();
    assert!(
        refused.contains("analogout0-maxlim` cannot be set to NaN"),
        "{refused}"
    );
    sender.restart((0, 0)).expect("sent");
    cycle(&mut driver, &mut queue);
    assert_eq!(driver.pins().param(limit), 2.5);
    assert_eq!(sender.statistics().refused, 0);
    let remote = driver.remote((0, 0)).expect("there");
    assert_ne!(remote.state, RemoteState::Running);
    let group = remote.pins.group;
    for _ in 0..200 {
        cycle(&mut driver, &mut queue);
    }
    let armed = |driver: &Driver<SimFpga>| {
        let state = driver.pins().group_state(group);
        state.expect("a group").armed
    };
    assert!(!armed(&driver), "it waits for that");
    sender.rearm_group(group).expect("sent");
    cycle(&mut driver, &mut queue);
    assert!(armed(&driver));

    driver.bus_mut().wait(core::time::Duration::from_secs(1));
    for _ in 0..3 {
        cycle(&mut driver, &mut queue);
    }
    assert_eq!(driver.board_state(), BoardState::WatchdogBitten);
    sender.rearm().expect("sent");
    cycle(&mut driver, &mut queue);
    assert_eq!(driver.board_state(), BoardState::Running);
}

/// Every refused command has its reason, and every other one its outcome.
#[test]
fn every_refused_command_has_a_reason() {
    use super::CommandOutcome::{AfterFault, Done, Ended, NotArmed, NotRunning, PortOff};
    use super::CommandOutcome::{OtherDriver, Unknown, Waiting};
    let mut driver = driver();
    let mut queue = CommandQueue::new(&driver, 4);
    let sender = queue.sender();
    let lamp = driver
        .pins()
        .output::<bool>("hm2_7i92.0.7i77.0.0.output-00");
    let lamp = lamp.expect("there");
    let run = driver
        .pins()
        .output::<bool>("hm2_7i92.0.sserial.port-0.run");
    let run = run.expect("there");
    let group = driver.pins().info(lamp).expect("there").group;
    assert_eq!(sender.outcome(0), Unknown, "never sent");
    let on = sender.set(lamp, true).expect("sent");
    assert_eq!(sender.outcome(on), Waiting);
    cycle(&mut driver, &mut queue);
    assert_eq!(sender.outcome(on), Done);

    // Sent before a fault, and executed after it.
    let late = sender.rearm_when_running().expect("sent");
    driver.restart((0, 0));
    let unarmed = sender.set(lamp, true).expect("sent");
    cycle(&mut driver, &mut queue);
    assert_eq!(sender.outcome(late), AfterFault);
    assert_eq!(sender.outcome(unarmed), NotArmed);
    let early = sender.rearm_group(group).expect("sent");
    let wanted = sender.rearm_group_when_running(group).expect("sent");
    cycle(&mut driver, &mut queue);
    assert_eq!(
        (sender.outcome(early), sender.outcome(wanted)),
        (NotRunning, Done)
    );
    for _ in 0..200 {
        cycle(&mut driver, &mut queue);
    }
    assert!(driver.pins().group_state(group).expect("there").armed);

    driver.pins_mut().set(run, false);
    cycle(&mut driver, &mut queue);
    cycle(&mut driver, &mut queue);
    let off = sender.rearm_group_when_running(group).expect("sent");
    cycle(&mut driver, &mut queue);
    assert_eq!(sender.outcome(off), PortOff);
    assert_eq!(sender.outcome(late), Unknown, "the queue holds four");
    let refused = sender.statistics().refused;
    assert_eq!(refused, 4);

    let foreign = sender.set(lamp, false).expect("sent");
    cycle(&mut self::driver(), &mut queue);
    assert_eq!(sender.outcome(foreign), OtherDriver);
    let last = sender.set(lamp, false).expect("sent");
    drop(queue);
    assert_eq!(sender.outcome(last), Ended);
    assert!(Ended.is_refused() && !Waiting.is_refused());
}

/// The watchdog has bitten: the set-up is written again, and the card is armed when it runs.
#[test]
fn everything_is_armed_as_soon_as_it_runs() {
    let mut driver = driver();
    let mut queue = CommandQueue::new(&driver, 8);
    let sender = queue.sender();
    cycle(&mut driver, &mut queue);
    driver.bus_mut().wait(core::time::Duration::from_secs(1));
    for _ in 0..3 {
        cycle(&mut driver, &mut queue);
    }
    assert_eq!(driver.board_state(), BoardState::WatchdogBitten);
    let sent = sender.rearm_when_running().expect("sent");
    for _ in 0..200 {
        cycle(&mut driver, &mut queue);
    }
    assert_eq!(sender.outcome(sent), CommandOutcome::Done);
    assert_eq!(driver.board_state(), BoardState::Running);
    let mut groups = driver.pins().groups();
    let is_armed = |group| {
        driver
            .pins()
            .group_state(group)
            .is_some_and(|state| state.armed)
    };
    assert!(groups.all(is_armed));
}
