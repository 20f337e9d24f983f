//! One call of `rearm` after a bite or a reset of the board arms everything that comes up because
//! of it.

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, device};
use mesa_hal::driver::{BoardState, EventKind};
use mesa_hal_sim::SimFpga;

const ALL: [usize; 3] = [FIELD, ANALOG, OUTPUTS];

/// Cause of the loss of the board's set-up.
#[derive(Clone, Copy, Debug)]
enum Loss {
    /// The host stops for this number of milliseconds.
    Bite(u64),
    Reset,
}

impl Loss {
    const ALL: [Self; 4] = [Self::Bite(20), Self::Bite(48), Self::Bite(200), Self::Reset];

    fn happens(self, machine: &mut Machine) {
        match self {
            Self::Bite(millis) => machine.sleep(millis),
            Self::Reset => machine.fpga().reload(),
        }
        machine.cycles(4);
        assert_ne!(machine.driver.board_state(), BoardState::Running);
    }
}

fn running() -> Machine {
    let mut machine = Machine::new();
    machine.cards.set_one_of_each(machine.driver.pins_mut());
    machine.cycles(20);
    assert_eq!(on(machine.driver.bus()), [true; 3]);
    machine
}

fn on(fpga: &SimFpga) -> [bool; 3] {
    let world = |channel| device(fpga, channel).world();
    let volts = world(ANALOG).analog_output(1);
    [
        world(FIELD).output(3) == Some(true),
        volts.is_some_and(|volts| volts.abs() > 0.1),
        world(OUTPUTS).output(7) == Some(true),
    ]
}

fn armed(machine: &Machine) -> [bool; 4] {
    let board = machine.driver.group();
    let board = machine.driver.pins().group_state(board).expect("a group");
    let [field, analog, outputs] = ALL.map(|channel| machine.is_armed(channel));
    [field, analog, outputs, board.armed]
}

#[test]
fn one_rearm_after_bite_or_reset_arms_all_and_switches_none_on() {
    for loss in Loss::ALL {
        for wait in [0, 1, 7, 40, 100] {
            let told = format!("{loss:?}, {wait} cycles later");
            let mut machine = running();
            loss.happens(&mut machine);
            machine.cycles(wait);
            machine.cards.set_all(machine.driver.pins_mut());
            let mut events = machine.driver.events();
            events.by_ref().for_each(drop);
            let rearmed = machine.driver.rearm().expect("the bus is well");
            assert_eq!((rearmed.armed, rearmed.waiting), (0, 4), "{told}");
            assert_eq!(rearmed.rearm_pending, 4, "{told}");
            let cycles = machine.until(200, |machine| armed(machine) == [true; 4]);
            machine.cycles(20);
            assert_eq!(armed(&machine), [true; 4], "{told}: {cycles} cycles");
            assert_eq!(on(machine.driver.bus()), [false; 3], "{told}");
            let rearmed = |kind: &EventKind| matches!(kind, EventKind::Rearmed { .. });
            let kinds: Vec<_> = events.by_ref().map(|event| event.kind).collect();
            assert_eq!(kinds.iter().filter(|kind| rearmed(kind)).count(), 1);
            machine.cards.set_one_of_each(machine.driver.pins_mut());
            machine.cycles(5);
            assert_eq!(on(machine.driver.bus()), [true; 3], "{told}");
        }
    }
}

#[test]
fn new_loss_before_everything_is_up_voids_the_call() {
    for first in Loss::ALL {
        for second in [Loss::Bite(20), Loss::Reset] {
            // The watchdog has its own time from the first write on.
            for after in 1..12 {
                let mut machine = running();
                first.happens(&mut machine);
                let _ = machine.driver.rearm().expect("the bus is well");
                machine.cycles(after);
                second.happens(&mut machine);
                let io_error = machine.param::<bool>("io_error");
                let has_bit = machine
                    .driver
                    .pins()
                    .inout::<bool>("hm2_7i92.0.watchdog.has_bit");
                machine.set_param(io_error, false);
                machine
                    .driver
                    .pins_mut()
                    .set(has_bit.expect("a pin"), false);
                machine.cycles(300);
                let told = format!("{first:?}, {after} cycles, {second:?}");
                assert_eq!(machine.driver.board_state(), BoardState::Running, "{told}");
                assert_eq!(armed(&machine), [false; 4], "{told}");
            }
        }
    }
}

#[test]
fn remote_with_a_fault_of_its_own_waits_for_another_call() {
    for before in [true, false] {
        let mut machine = running();
        if before {
            machine.cable(OUTPUTS).unplug();
            machine.cycles(100);
        }
        Loss::Reset.happens(&mut machine);
        if !before {
            machine.cable(OUTPUTS).unplug();
        }
        machine.cycles(100);
        let rearmed = machine.driver.rearm().expect("the bus is well");
        assert_eq!(rearmed.rearm_pending, if before { 3 } else { 4 });
        machine.cycles(400);
        assert_eq!(armed(&machine), [true, true, false, true]);
        machine.cable(OUTPUTS).replug();
        machine.until(6_000, |machine| machine.is_running(OUTPUTS));
        machine.cycles(100);
        assert_eq!(armed(&machine), [true, true, false, true]);
        assert_eq!(machine.driver.rearm().expect("the bus is well").armed, 1);
    }
}

#[test]
fn one_reset_is_one_event_however_soon_it_is_cleared() {
    for wait in 0..8 {
        let mut machine = running();
        let mut events = machine.driver.events();
        events.by_ref().for_each(drop);
        machine.fpga().reload();
        machine.until(10, |machine| {
            machine.driver.board_state() == BoardState::Reset
        });
        machine.cycles(wait);
        let _ = machine.driver.rearm().expect("the bus is well");
        machine.until(200, |machine| armed(machine) == [true; 4]);
        assert_eq!(armed(&machine), [true; 4], "{wait} cycles later");
        let kinds: Vec<_> = events.by_ref().map(|event| event.kind).collect();
        let count = |kind| kinds.iter().filter(|told| **told == kind).count();
        let told = [EventKind::BoardReset, EventKind::BoardSetUp].map(count);
        assert_eq!(told, [1, 1], "{wait} cycles later: {kinds:?}");
    }
}
