//! The board is reset, and no earlier value may appear valid: whatever its remotes do at that time.

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS};
use mesa_hal::driver::{BoardState, SerialConfig};
use mesa_hal_sim::{Motor, SimFpga, machines};

#[test]
fn reset_with_all_remotes_unplugged_is_detected_next_cycle() {
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
    machine.rearm_all(6000);
}

#[test]
fn encoders_of_a_board_without_remotes_do_not_jump_on_reset() {
    let fpga = machines::six_axes_7i92(Motor::default());
    let no_remotes = SerialConfig {
        channels: [].into(),
    };
    let mut machine = Machine::<_, ()>::on(fpga, |s| s.serial_ports = [(0, no_remotes)].into());
    let counts = [0, 1, 2, 3, 4, 5].map(|n| machine.input::<i32>(&format!("encoder.{n:02}.count")));
    let turn = |machine: &mut Machine<SimFpga, ()>, speed: f64, cycles| {
        for axis in 0..6 {
            machine.turn(axis, speed * (axis as f64 + 1.0));
        }
        machine.cycles(cycles);
    };
    machine.cycles(3);
    turn(&mut machine, 10.0, 1000);
    turn(&mut machine, 0.0, 3);
    let before = counts.map(|pin| machine.driver.pins().read(pin));
    assert!(before.iter().all(|reading| reading.valid));
    let is_far = before.iter().any(|reading| reading.value.abs() > 500);
    assert!(is_far, "{before:?}");
    machine.fpga().reload();
    assert_eq!(machine.cycle().board, BoardState::Reset);
    for (pin, before) in counts.into_iter().zip(before) {
        let now = machine.driver.pins().read(pin);
        assert_eq!((now.valid, now.value), (false, before.value));
    }
}

/// An emergency-stop chain that needs valid inputs waits for the operator's re-arm, not for ever.
#[test]
fn inputs_of_a_reset_board_are_valid_again_after_the_re_arm() {
    for bite in [false, true] {
        let mut machine = Machine::new();
        let chain = |machine: &Machine| machine.field_input(7).ok();
        machine
            .device_mut(FIELD)
            .set_input(7, true)
            .expect("an input");
        machine.cycles(5);
        assert_eq!(chain(&machine), Some(true));
        if bite {
            machine.sleep(100);
        } else {
            machine.driver.bus_mut().reload();
        }
        machine.cycles(200);
        assert_eq!(chain(&machine), None);
        let rearmed = machine.driver.rearm().expect("the board answers");
        assert_eq!(rearmed.waiting, rearmed.rearm_pending);
        let cycles = machine.until(6000, |machine| chain(machine) == Some(true));
        assert!(machine.is_armed(FIELD), "after {cycles} cycles");
        let safe = machine.cards.field.outputs[3];
        assert!(!machine.driver.pins().commanded(safe.pin));
    }
}

/// A board that was reset drives its pins as plain outputs when only their directions are written:
/// low, which switches on every device that is enabled by a low pin.
#[test]
fn board_that_lost_its_set_up_drives_no_pin_until_rearmed() {
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
        machine.rearm_all(100);
        assert_eq!(machine.driver.board_state(), BoardState::Running);
    }
}
