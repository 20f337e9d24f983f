//! The board is reset, and nothing that stood before may look true: whatever its remotes do at
//! that time.

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, start};
use mesa_hal::bus::Clock;
use mesa_hal::driver::{BoardState, Driver, SerialConfig};
use mesa_hal::hal::Input;
use mesa_hal::sim::{MotorConfig, machines};

#[test]
fn a_board_that_is_reset_while_its_remotes_are_away_is_found_out_at_once() {
    let mut machine = Machine::new();
    machine.cycles(5);
    for channel in [FIELD, ANALOG, OUTPUTS] {
        machine.cable(channel).unplug();
    }
    machine.cycles(200);
    machine.driver.bus_mut().reload();
    assert_eq!(machine.cycle().board, BoardState::Reset);
    for channel in [FIELD, ANALOG, OUTPUTS] {
        machine.cable(channel).replug();
    }
    machine.cycles(20);
    assert_eq!(machine.driver.board_state(), BoardState::Reset);
    machine.until(6000, |machine| {
        machine
            .driver
            .rearm()
            .is_ok_and(|rearmed| rearmed.waiting == 0)
    });
}

#[test]
fn encoders_of_a_board_without_remotes_do_not_jump_when_it_is_reset() {
    let fpga = machines::six_axes_7i92(MotorConfig::default());
    let no_remotes = SerialConfig {
        channels: [].into(),
    };
    let mut driver = start(fpga, |s| s.serial_ports = [(0, no_remotes)].into()).unwrap();
    let counts: Vec<Input<i32>> = (0..6)
        .map(|n| {
            driver
                .pins()
                .input(&format!("hm2_7i92.0.encoder.{n:02}.count"))
        })
        .collect::<Result<_, _>>()
        .unwrap();
    let step = |driver: &mut Driver<mesa_hal::sim::SimFpga>| {
        let report = driver.read().unwrap();
        driver.write().unwrap();
        driver.bus_mut().wait(std::time::Duration::from_millis(1));
        report
    };
    for _ in 0..3 {
        let _ = step(&mut driver);
    }
    for axis in 0..6 {
        let motor = driver.bus_mut().motor(axis).unwrap();
        motor.turn_by_hand(Some(10.0 * (axis as f64 + 1.0)));
    }
    for _ in 0..1000 {
        let _ = step(&mut driver);
    }
    for axis in 0..6 {
        let motor = driver.bus_mut().motor(axis).unwrap();
        motor.turn_by_hand(Some(0.0));
    }
    for _ in 0..3 {
        let _ = step(&mut driver);
    }
    let before: Vec<_> = counts.iter().map(|&pin| driver.pins().read(pin)).collect();
    assert!(before.iter().all(|reading| reading.valid));
    assert!(
        before.iter().any(|reading| reading.value.abs() > 500),
        "{before:?}"
    );
    driver.bus_mut().reload();
    assert_eq!(step(&mut driver).board, BoardState::Reset);
    for (&pin, before) in counts.iter().zip(&before) {
        let now = driver.pins().read(pin);
        assert_eq!((now.valid, now.value), (false, before.value));
    }
}

/// A board that was reset drives its pins as plain outputs when only their directions are written:
/// low, which switches on whatever is enabled by a low pin.
#[test]
fn a_board_that_lost_its_set_up_drives_no_pin_before_it_is_re_armed() {
    for bite in [false, true] {
        let mut machine = Machine::new();
        machine.cycles(5);
        if bite {
            machine.sleep(20);
        } else {
            machine.driver.bus_mut().reload();
        }
        for n in 0..1500 {
            let _ = machine.cycle();
            let fpga = machine.driver.bus_mut();
            let directions = [0x1100, 0x1104].map(|at| fpga.read_register(at));
            assert_eq!(directions, [0, 0], "bite: {bite}, cycle {n}");
            assert_ne!(machine.driver.board_state(), BoardState::Running);
        }
        machine.until(100, |machine| {
            machine
                .driver
                .rearm()
                .is_ok_and(|rearmed| rearmed.waiting == 0)
        });
        assert_eq!(machine.driver.board_state(), BoardState::Running);
    }
}
