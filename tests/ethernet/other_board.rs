//! Another board with the same firmware answers at the same address.

use crate::common::ethernet::{SimLink, bus};
use crate::common::machine::Machine;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{BoardState, CycleError};
use mesa_hal::transport::udp::UdpBus;
use mesa_hal_sim::{BoardConfig, SimBoard, machines};

type OnNetwork = Machine<UdpBus<SimLink>>;

fn config() -> BoardConfig {
    BoardConfig::new("7I92")
}

/// Puts a board in the place of the one that answers.
fn swap(
    machine: &mut OnNetwork,
    mut board: SimBoard<mesa_hal_sim::SimFpga>,
) -> SimBoard<mesa_hal_sim::SimFpga> {
    let bus = machine.driver.bus_mut();
    board.advance_to(bus.now().as_nanos());
    core::mem::replace(&mut bus.link().board, board)
}

fn volts(machine: &mut OnNetwork) -> f64 {
    crate::common::ethernet::volts(machine.driver.bus_mut())
}

fn driven(machine: &mut OnNetwork) -> usize {
    let fpga = machine.fpga();
    let pins = 0..fpga.firmware().pins.len();
    pins.filter(|&pin| fpga.is_driven(pin)).count()
}

fn switch_on(machine: &mut OnNetwork) {
    let analog = machine.cards.analog;
    let pins = machine.driver.pins_mut();
    pins.set(analog.analog_out[0].volts, 5.0);
    pins.set(analog.analogena.pin, true);
}

/// Runs cycles that may fail.
fn cycles(machine: &mut OnNetwork, count: usize) {
    for _ in 0..count {
        let _ = machine.driver.read();
        switch_on(machine);
        let _ = machine.driver.write();
        machine.rest();
    }
}

#[test]
fn board_with_another_mac_or_name_gets_no_set_up_and_no_voltage() {
    let mut mac = config();
    mac.mac[5] ^= 1;
    let mut name = config();
    name.name[3] = b'3';
    for other in [mac, name] {
        let mut machine = OnNetwork::on(bus(machines::i7i92_with_cards()), |_| {});
        cycles(&mut machine, 20);
        assert!((volts(&mut machine) - 5.0).abs() < 0.1);
        let own = swap(
            &mut machine,
            SimBoard::new(other, machines::i7i92_with_cards()),
        );
        cycles(&mut machine, 20);
        assert_ne!(machine.driver.board_state(), BoardState::Running);
        for _ in 0..3 {
            assert_eq!(machine.driver.rearm(), Err(CycleError::OtherFirmware));
            cycles(&mut machine, 30);
            assert_eq!(machine.driver.board_state(), BoardState::OtherFirmware);
            assert_eq!((volts(&mut machine), driven(&mut machine)), (0.0, 0));
        }
        // The first board is back.
        swap(&mut machine, own);
        cycles(&mut machine, 5);
        assert_eq!((volts(&mut machine), driven(&mut machine)), (0.0, 0));
        let _ = machine.driver.rearm().expect("its own board");
        cycles(&mut machine, 200);
        assert_eq!(machine.driver.board_state(), BoardState::Running);
        assert!((volts(&mut machine) - 5.0).abs() < 0.1);
    }
}

#[test]
fn same_board_after_a_pause_is_the_same() {
    let mut machine = OnNetwork::on(bus(machines::i7i92_with_cards()), |_| {});
    cycles(&mut machine, 20);
    machine.sleep(300);
    cycles(&mut machine, 10);
    assert_eq!(machine.driver.board_state(), BoardState::WatchdogBitten);
    let _ = machine.driver.rearm().expect("its own board");
    cycles(&mut machine, 200);
    assert!((volts(&mut machine) - 5.0).abs() < 0.1);
}
