//! The report of `stop` about the outputs is true: on success no output is on, and otherwise it
//! contains the remote with an output on and the means that switches it off. The truth is the state
//! of the simulated terminals.

use crate::common::ethernet::{self, SimLink, cut};
use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, fpga};
use crate::faults::remote_outputs::{MS, busy_machine_with_watchdog, cycle, named, on_board};
use mesa_hal::driver::RemoteWatchdog;
use mesa_hal::{MesaError, UdpBus, advice};
use mesa_hal_sim::SimFpga;

/// Stops the machine; returns the board, and the channels in the report.
fn stop(machine: Machine, what: &str) -> (SimFpga, Vec<usize>) {
    let (fpga, stopped) = machine.driver.shutdown();
    let named = named(stopped, &fpga, what);
    (fpga, named)
}

/// The channels with an output on, after the time.
fn lit(fpga: &mut SimFpga, millis: u64) -> Vec<usize> {
    fpga.advance_to(fpga.now() + millis * MS);
    let channels = [FIELD, ANALOG, OUTPUTS].into_iter();
    channels
        .filter(|&channel| !on_board(fpga, channel).is_empty())
        .collect()
}

#[test]
fn unplugged_remote_is_named_until_its_watchdog_time_is_over() {
    for cycles in (0..90).chain((90..700).step_by(5)) {
        let mut machine = busy_machine_with_watchdog(200);
        machine.cable(OUTPUTS).unplug();
        for _ in 0..cycles {
            cycle(&mut machine, |_| {});
        }
        let what = format!("{cycles} cycles");
        let (mut fpga, named) = stop(machine, &what);
        assert!(named.is_empty() || named == [OUTPUTS], "{what}: {named:?}");
        // The remote is offline after 40 cycles at the latest, and gets nothing from then on.
        assert!(cycles < 281 || named.is_empty(), "{what}: {named:?}");
        assert_eq!(lit(&mut fpga, 201), [0; 0], "{what}");
    }
}

#[test]
fn unreachable_remote_without_watchdog_is_named_after_any_time() {
    for cycles in [0, 10, 100, 1000, 20_000] {
        let mut machine = busy_machine_with_watchdog(0);
        machine.cable(OUTPUTS).unplug();
        for _ in 0..cycles {
            cycle(&mut machine, |_| {});
        }
        let (driver, stopped) = machine.driver.stop();
        let error = stopped.expect_err("it is on");
        let [remote] = &error.not_reached[..] else {
            panic!("{error}");
        };
        let place = (remote.remote.id.port, usize::from(remote.remote.id.channel));
        assert_eq!(place, (0, OUTPUTS), "{error}");
        assert_eq!(remote.watchdog, RemoteWatchdog::Off);
        assert_eq!(error.advice(), Some(advice::SWITCH_OFF_POWER));
        assert_eq!(lit(&mut driver.into_bus(), 1000), [OUTPUTS]);
    }
}

/// Outputs that were off when the cable was unplugged are off; and a remote that is plugged in
/// again was started, which switches off.
#[test]
fn remote_of_which_nothing_is_on_is_not_named() {
    for is_driven in [false, true] {
        let mut machine = busy_machine_with_watchdog(0);
        let pins = machine.driver.pins_mut();
        for output in machine.cards.outputs.outputs {
            pins.set(output.pin, is_driven);
        }
        machine.cycles(3);
        machine.cable(OUTPUTS).unplug();
        machine.cycles(300);
        if is_driven {
            machine.cable(OUTPUTS).replug();
            machine.until(7000, |machine| machine.is_valid(OUTPUTS));
            machine.cable(OUTPUTS).unplug();
            machine.cycles(300);
        }
        let (_, named) = stop(machine, "nothing is on");
        assert_eq!(named, [0; 0]);
    }
}

/// A port that was switched off has sent safe values, which an unplugged remote has missed.
#[test]
fn remote_that_has_missed_the_end_of_its_port_is_named() {
    for (millis, expected) in [(0, &[OUTPUTS][..]), (200, &[])] {
        let mut machine = busy_machine_with_watchdog(millis);
        let run = machine.output::<bool>("sserial.port-0.run");
        machine.cable(OUTPUTS).unplug();
        machine.driver.pins_mut().set(run, false);
        machine.cycles(300);
        let (mut fpga, named) = stop(machine, "the port is switched off");
        assert_eq!(named, expected);
        assert_eq!(lit(&mut fpga, 0), expected);
    }
}

/// The host was away for longer than the board's watchdog: the first read delivers the transfer of
/// before, with outputs on, and the board transmits nothing any more.
#[test]
fn transfer_from_before_the_bite_does_not_confirm_outputs_off() {
    for (away, cycles) in [(0, 0), (900, 0), (1001, 0), (1001, 3), (3000, 0), (3000, 3)] {
        let mut machine = busy_machine_with_watchdog(0);
        machine.sleep(away);
        for _ in 0..cycles {
            cycle(&mut machine, |_| {});
        }
        let what = format!("{away} ms, {cycles} cycles");
        let (mut fpga, named) = stop(machine, &what);
        let is_bitten = away > 1000;
        assert_eq!(named.contains(&OUTPUTS), is_bitten, "{what}: {named:?}");
        assert_eq!(lit(&mut fpga, 100).contains(&OUTPUTS), is_bitten, "{what}");
    }
}

/// All remotes are unplugged: the bus's own error does not hide the remotes that cannot be switched
/// off.
#[test]
fn bus_that_fails_hides_no_remote() {
    use mesa_hal::bus::BusErrorKind;
    use mesa_hal::transport::{Fault, Faulty};

    let mut machine: Machine<Faulty<SimFpga>> =
        Machine::on(Faulty::new(crate::common::machine::fpga(), 5), |_| {});
    machine.cards.set_all(machine.driver.pins_mut());
    machine.cycles(5);
    let bus = machine.driver.bus_mut();
    bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 1.0);
    let (_, stopped) = machine.driver.shutdown();
    let error = stopped.expect_err("nothing gets through");
    assert!(error.failed.is_some(), "{error}");
    let named: Vec<_> = error
        .not_reached
        .iter()
        .map(|not| not.remote.id.channel)
        .collect();
    assert_eq!(named, [0, 1, 2]);
    let said = error.to_string();
    assert!(
        said.contains("by its watchdog; 7i77.0.0 was not reached"),
        "{said}"
    );
}

/// While the network is away the board is not fed: its watchdog bites after 5 ms, and those of the
/// remotes 50 ms later.
#[test]
fn no_remote_is_named_when_a_silent_board_must_have_bitten() {
    let channels = [FIELD, ANALOG, OUTPUTS];
    for cycles in [1, 20, 150, 3_000] {
        let mut machine: Machine<UdpBus<SimLink>> = Machine::on(ethernet::bus(fpga()), |_| {});
        machine.cards.set_one_of_each(machine.driver.pins_mut());
        machine.cycles(20);
        machine.driver.bus_mut().link().to_board = cut();
        for _ in 0..cycles {
            let _ = machine.driver.read();
            let _ = machine.driver.write();
            machine.rest();
        }
        let is_lit = |fpga: &SimFpga, channel| !on_board(fpga, channel).is_empty();
        let lit = channels.map(|channel| is_lit(machine.fpga(), channel));
        assert_eq!(lit, [cycles < 50; 3], "{cycles} cycles");
        let (mut bus, stopped) = machine.driver.shutdown();
        let error = stopped.expect_err("nothing reaches the board");
        // The attempts to reach it take longer than the watchdogs' times.
        assert_eq!(error.not_reached, [], "{cycles} cycles");
        let fpga = bus.link().board.gateware_mut();
        assert_eq!(channels.map(|channel| is_lit(fpga, channel)), [false; 3]);
    }
}
