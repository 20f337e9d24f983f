//! A dropped driver logs the result that `stop` would have returned.

use crate::common::machine::{ANALOG, FIELD, Machine, fpga};
use crate::setup::log::logged;
use log::Level;
use mesa_hal::MesaError;
use mesa_hal::bus::BusErrorKind;
use mesa_hal::transport::{Fault, Faulty};

/// Outputs are on, and two cards can no longer be reached.
fn cut_off() -> Machine {
    let mut machine = Machine::new();
    machine.cards.set_one_of_each(machine.driver.pins_mut());
    machine.cycles(5);
    for channel in [FIELD, ANALOG] {
        let _ = machine.fpga().plug(0, channel, None);
    }
    machine
}

#[test]
fn dropped_driver_logs_the_remotes_that_stop_would_have_named() {
    let mut told = String::new();
    let log = logged(Level::Error, || {
        let (stopped, result) = cut_off().driver.stop();
        let error = result.expect_err("two are cut off");
        assert_eq!(error.not_reached.len(), 2, "{error}");
        let error = error.with_advice();
        told = format!("{}: was dropped: {error}", stopped.name());
    });
    assert_eq!(log, [""; 0], "who stops is told, and nothing is said twice");
    assert!(
        told.contains("its outputs are off only by its own watchdog"),
        "{told:?}"
    );
    assert_eq!(logged(Level::Error, || drop(cut_off().driver)), [told]);
}

#[test]
fn dropped_driver_whose_board_does_not_answer_logs_the_error() {
    let log = logged(Level::Error, || {
        let mut machine: Machine<_> = Machine::on(Faulty::new(fpga(), 1), |_| {});
        machine.cards.set_one_of_each(machine.driver.pins_mut());
        machine.cycles(5);
        let lost = Fault::NotExecuted(BusErrorKind::Unreachable);
        machine.driver.bus_mut().fail_randomly(lost, 1.0);
        drop(machine.driver);
    });
    let [said] = &log[..] else {
        panic!("{log:?}");
    };
    let begin = "hm2_7i92.0: was dropped: not all of it could be stopped: ";
    assert!(
        said.starts_with(begin) && said.contains("Unreachable"),
        "{said}"
    );
    assert_eq!(said.matches("was not reached").count(), 3, "{said}");
}

#[test]
fn driver_that_stops_without_an_error_logs_nothing() {
    let log = logged(Level::Error, || {
        let mut machine = Machine::new();
        machine.cards.set_one_of_each(machine.driver.pins_mut());
        machine.cycles(5);
        drop(machine.driver);
    });
    assert_eq!(log, [""; 0]);
}
