//! A board gets its set-up back without an output that is armed.

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, fpga};
use mesa_hal::bus::{BusErrorKind, Clock};
use mesa_hal::driver::BoardState;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::SimFpga;
use mesa_hal_sim::devices::SignalValue;

const ALL: [usize; 3] = [FIELD, ANALOG, OUTPUTS];

/// A machine with outputs on, which has just been reset.
fn reset_machine() -> Machine<Faulty<SimFpga>> {
    let mut machine: Machine<_> = Machine::on(Faulty::new(fpga(), 1), |_| {});
    machine.cycles(5);
    machine.cards.set_all(machine.driver.pins_mut());
    machine.cycles(5);
    machine.fpga().reload();
    assert_eq!(machine.cycle().board, BoardState::Reset);
    machine
}

fn is_any_output_on(machine: &Machine<Faulty<SimFpga>>) -> bool {
    let on = SignalValue::Bool(true);
    let cards = [FIELD, OUTPUTS].map(|channel| machine.device(channel).outputs());
    cards.iter().flatten().any(|(_, value)| *value == on)
}

#[test]
fn restored_board_shows_its_inputs_and_arms_nothing() {
    let mut machine = reset_machine();
    machine.driver.restore().expect("the bus does not fail");
    assert_eq!(machine.driver.board_state(), BoardState::Running);
    machine.until(6_000, |machine| ALL.iter().all(|&n| machine.is_valid(n)));
    for _ in 0..200 {
        machine.cards.set_all(machine.driver.pins_mut());
        machine.cycles(1);
        let board = machine.driver.pins().group_state(machine.driver.group());
        let board = board.expect("a group");
        assert!(board.valid && !board.armed && !board.rearm_pending);
        assert!(
            ALL.iter()
                .all(|&n| machine.is_valid(n) && !machine.is_armed(n))
        );
        assert!(!is_any_output_on(&machine));
    }
    // The operator decides.
    let rearmed = machine.driver.rearm().expect("the bus does not fail");
    assert_eq!((rearmed.waiting, rearmed.rearm_pending), (0, 0));
    machine.cards.set_all(machine.driver.pins_mut());
    machine.cycles(5);
    assert!(is_any_output_on(&machine));
}

#[test]
fn board_that_runs_is_not_restored() {
    let mut machine = Machine::new();
    machine.cycles(5);
    machine.cards.set_one_of_each(machine.driver.pins_mut());
    machine.cycles(5);
    let before = machine.driver.bus_mut().now();
    machine.driver.restore().expect("nothing is exchanged");
    assert_eq!(machine.driver.bus_mut().now(), before);
    assert!(ALL.iter().all(|&n| machine.is_armed(n)));
}

#[test]
fn failed_restore_leaves_the_board_safe_and_is_repeated() {
    let mut machine = reset_machine();
    let next = machine.driver.bus().exchanges();
    let lost = Fault::NotExecuted(BusErrorKind::Lost);
    for n in 0..20 {
        machine.driver.bus_mut().fail_at(next + n, lost);
    }
    assert!(machine.driver.restore().is_err());
    assert_eq!(machine.driver.board_state(), BoardState::Reset);
    let restored = |machine: &mut Machine<_>| machine.driver.restore().is_ok();
    assert!((0..40).any(|_| restored(&mut machine)));
    assert_eq!(machine.driver.board_state(), BoardState::Running);
    assert!(ALL.iter().all(|&n| !machine.is_armed(n)));
}
