//! Doubts before an application has a position: nothing is lost then.

use super::*;

/// A board whose packets are in doubt in one of the first cycles.
fn in_doubt(cycle: u64) -> Machine<UdpBus<SimLink>> {
    let mut machine = Machine::fresh(network(muxed()), "at the start");
    machine.cycles(cycle);
    machine.driver.bus_mut().cut();
    machine.cycle();
    machine.driver.bus_mut().mend();
    machine
}

#[test]
fn doubt_in_the_first_reads_is_shown_and_is_no_loss() {
    for cycle in [1, 5, 50, 90] {
        let mut machine = in_doubt(cycle);
        machine.cycles(150);
        assert!(machine.is_unsure(), "{cycle}");
        assert_eq!(machine.told(Positions::Encoders), 0, "{cycle}");
        // It is homed without an index, and nothing shows it; then it is lost.
        machine.happens(Trouble::Stall(300));
        machine.comes_back();
        machine.cycles(20);
        assert!(machine.is_unsure(), "{cycle}");
        let told = machine.told(Positions::Encoders);
        assert_eq!(told, 0b11_1111, "{cycle}");
    }
}

#[test]
fn bite_in_the_first_reads_is_no_loss() {
    let mut machine = Machine::fresh(embedded(muxed()), "at the start");
    machine.cycles(20);
    machine.happens(Trouble::Stall(300));
    machine.comes_back();
    machine.cycles(150);
    assert!(machine.is_unsure());
    assert_eq!(machine.told(Positions::Encoders), 0);
}

/// From then on the application has a position.
#[test]
fn doubt_after_a_reset_is_a_loss() {
    let mut machine = Machine::fresh(network(muxed()), "at the start");
    machine.cycles(20);
    let (reset, axis) = (machine.encoder.counter.reset, machine.axis);
    machine.driver.pins_mut().set(reset, true);
    machine.cycles(2);
    machine.driver.pins_mut().set(reset, false);
    machine.cycles(2);
    machine.driver.bus_mut().cut();
    machine.cycle();
    machine.driver.bus_mut().mend();
    machine.cycles(20);
    assert!(machine.is_unsure());
    assert_eq!(machine.told(Positions::Encoders), 1 << axis);
}

#[test]
fn generator_that_was_not_enabled_has_nothing_to_lose() {
    for is_enabled in [false, true] {
        let mut machine = Machine::fresh(embedded(plain()), "at the start");
        machine.cycles(5);
        machine.run(is_enabled.then_some(1.0));
        machine.cycles(20);
        machine.run(None);
        machine.cycles(20);
        machine.happens(Trouble::Stall(300));
        machine.comes_back();
        machine.cycles(20);
        assert!(machine.is_step_unsure());
        let told = machine.told(Positions::StepGenerators);
        assert_eq!(told & 1 != 0, is_enabled, "{told:b}");
    }
}
