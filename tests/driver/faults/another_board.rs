//! Another board, or another firmware, answers in the place of the driver's own.

use std::time::Duration;

use crate::common::machine::{Machine, fpga};
use crate::common::once::Once;
use mesa_hal::Clock;
use mesa_hal::driver::{BoardState, CycleError, EventKind};
use mesa_hal::hal::{Param, Role};
use mesa_hal::hostmot2::HostMot2;
use mesa_hal_sim::{SimFpga, machines};

#[test]
fn other_firmware_is_reported_in_one_line_without_extra_blanks() {
    let error = CycleError::OtherFirmware.to_string();
    for text in [error, EventKind::OtherFirmware.to_string()] {
        assert!(!text.contains("  ") && !text.contains('\n'), "{text}");
    }
}

/// Puts another board in the place of the machine's, at a later time of its clock.
fn swap(machine: &mut Machine, mut board: SimFpga) -> SimFpga {
    let bus = machine.driver.bus_mut();
    let late = Duration::from_nanos(bus.now().as_nanos()) + Duration::from_secs(1);
    board.wait(late);
    core::mem::replace(bus, board)
}

fn i7i97() -> SimFpga {
    machines::i7i97(1)
}

/// Number of driven pins, and true if the watchdog was ever set.
fn driven(board: &SimFpga) -> (usize, bool) {
    let pins = 0..board.firmware().pins.len();
    let driven = pins.filter(|&pin| board.is_driven(pin)).count();
    (driven, board.watchdog().is_running())
}

fn running() -> Machine {
    let mut machine = Machine::new();
    machine.cards.set_one_of_each(machine.driver.pins_mut());
    machine.cycles(20);
    assert!(driven(machine.driver.bus()).0 > 0);
    machine
}

/// Runs cycles that may fail.
fn cycles(machine: &mut Machine, count: usize) {
    for _ in 0..count {
        let _ = machine.driver.read();
        machine.finish();
    }
}

#[test]
fn other_board_gets_no_set_up_and_has_no_valid_value() {
    let mut machine = running();
    let mut events = machine.driver.events();
    let own = swap(&mut machine, i7i97());
    cycles(&mut machine, 10);
    assert_ne!(machine.driver.board_state(), BoardState::Running);
    events.by_ref().for_each(drop);
    let io_error: Param<bool> = machine.param("io_error");
    for by_flag in [false, true, false] {
        if by_flag {
            machine.set_param(io_error, false);
            machine.driver.write().expect("the bus is well");
        } else {
            assert_eq!(machine.driver.rearm(), Err(CycleError::OtherFirmware));
        }
        cycles(&mut machine, 50);
        assert_eq!(machine.driver.board_state(), BoardState::OtherFirmware);
        assert!(machine.driver.pins().param(io_error), "the flag is back");
        assert_eq!(driven(machine.driver.bus()), (0, false), "{by_flag}");
        let pins = machine.driver.pins();
        let mut looked = 0;
        for id in pins.ids() {
            let info = pins.info_of(id).expect("its own");
            // Values that the driver itself knows, such as faults, stay valid.
            let is_board = info.group == machine.driver.group();
            let kinds = [".input-", ".analogin", ".enc"];
            let is_remote = kinds.iter().any(|kind| info.name.contains(kind));
            if info.role == Role::Input && (is_board || is_remote) {
                assert!(!pins.read_any(id).valid, "{}", info.name);
                looked += 1;
            }
        }
        assert!(looked > 60, "{looked}");
    }
    let told: Vec<_> = events.by_ref().map(|event| event.kind).collect();
    let others = told
        .iter()
        .filter(|&&kind| kind == EventKind::OtherFirmware);
    assert_eq!(others.count(), 1, "{told:?}");

    // The driver's own board is present again, without its set-up.
    swap(&mut machine, fpga());
    drop(own);
    machine.rearm_all(300);
    assert_eq!(machine.driver.board_state(), BoardState::Running);
    assert!(driven(machine.driver.bus()).0 > 0);
}

#[test]
fn one_word_of_its_description_makes_it_another_firmware() {
    let mut machine = running();
    let mut other = fpga();
    let firmware = HostMot2::identify(&mut other).expect("a firmware");
    // The last pin descriptor.
    let last = 4 * (firmware.pins.len() as u16 - 1);
    let at = 0x0400 + firmware.idrom.offset_to_pins as u16 + last;
    other.override_rom(at, 0x1234_5678);
    swap(&mut machine, other);
    cycles(&mut machine, 10);
    assert_eq!(machine.driver.rearm(), Err(CycleError::OtherFirmware));
    assert_eq!(driven(machine.driver.bus()), (0, false));
}

#[test]
fn end_of_a_driver_leaves_another_board_alone() {
    let mut machine = running();
    swap(&mut machine, i7i97());
    cycles(&mut machine, 3);
    let (board, stopped) = machine.driver.shutdown();
    // Its own board has not been fed for a second, so that its remotes are off.
    assert_eq!(stopped, Ok(()));
    assert_eq!(driven(&board), (0, false));
    assert!(!board.watchdog().has_bitten(), "it was never touched");
}

/// A board that is being reset, or whose FPGA has no HostMot2, drives nothing that a stop could
/// switch off.
#[test]
fn end_of_a_driver_leaves_what_is_no_hostmot2_alone() {
    let mut machine = running();
    let mut events = machine.driver.events();
    let mut other = i7i97();
    other.override_rom(0x0100, 0x1234_5678);
    swap(&mut machine, other);
    cycles(&mut machine, 10);
    assert_eq!(machine.driver.board_state(), BoardState::BusDown);
    let written = machine.fpga().counters().writes;
    let (board, stopped) = machine.driver.shutdown();
    let error = stopped.expect_err("remotes that were not reached");
    assert_eq!((error.failed, error.not_reached.len()), (None, 3));
    assert_eq!(board.counters().writes, written);
    assert!(events.all(|event| event.kind != EventKind::OtherFirmware));
}

#[test]
fn reset_while_the_set_up_is_written_again_is_no_other_firmware() {
    let mut failed = 0;
    for nanos in (0..120_000).step_by(600) {
        let mut machine = running();
        machine.fpga().reload();
        machine.cycles(3);
        assert_eq!(machine.driver.board_state(), BoardState::Reset);
        let at = machine.now() + nanos;
        let reset = Once::at(at, |fpga| fpga.reset_for(5_000_000));
        machine.fpga().set_director(reset);
        let told = format!("{nanos} ns after the beginning");
        let rearmed = machine.driver.rearm();
        assert_ne!(rearmed, Err(CycleError::OtherFirmware), "{told}");
        failed += u32::from(machine.driver.board_state() != BoardState::Running);
        cycles(&mut machine, 10);
        assert_ne!(machine.driver.board_state(), BoardState::OtherFirmware);
        let _ = machine.driver.rearm().expect("the bus is well");
        assert_eq!(machine.driver.board_state(), BoardState::Running, "{told}");
    }
    assert!(failed > 20, "{failed} were in the middle of it");
}
