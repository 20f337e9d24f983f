//! A command that is given between two faults of a remote.

use crate::common::machine::{Machine, OUTPUTS, World};

/// The remote is unplugged until it is offline, then comes back.
fn away_and_back<B: World>(machine: &mut Machine<B>, channel: usize) {
    machine.cable(channel).unplug();
    machine.until(40, |machine| !machine.is_running(channel));
    machine.cable(channel).replug();
    machine.until(6000, |machine| machine.is_running(channel));
    machine.cycles(3);
}

#[test]
fn command_between_two_faults_does_not_return_on_rearm() {
    let mut machine = Machine::new();
    machine.cycles(3);
    let output = machine.cards.outputs.outputs[7].pin;
    away_and_back(&mut machine, OUTPUTS);
    machine.driver.pins_mut().set(output, true);
    away_and_back(&mut machine, OUTPUTS);
    let _ = machine.driver.rearm().unwrap();
    machine.cycles(3);
    assert!(machine.is_armed(OUTPUTS));
    let world = machine.device(OUTPUTS).world();
    assert_eq!(world.output(7), Some(false));
}
