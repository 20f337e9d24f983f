//! A reset of the FPGA between any two accesses of a read: no pin shows a value as valid that the
//! board did not have.

use crate::common::machine::{ANALOG, Machine, fpga};
use crate::common::once::Once;
use crate::common::watch::Watch;
use mesa_hal::Settings;
use mesa_hal::driver::Driver;
use mesa_hal_sim::{DEFAULT_ACCESS_COST, Motor, machines};

/// All inputs of the 7I77 are on and all its encoders have counted.
fn running() -> Machine {
    let mut fpga = fpga();
    machines::wire_7i77(&mut fpga, 0, ANALOG, 0, |_| Motor::default());
    let mut machine = Machine::with(Driver::start(fpga, Settings::default()).expect("complete"));
    for axis in 0..6 {
        machine.turn(axis, 2.0);
    }
    for input in 0..32 {
        let device = machine.device_mut(crate::common::machine::FIELD);
        device.set_input(input, true).expect("input");
    }
    machine.cycles(200);
    for axis in 0..6 {
        machine.turn(axis, 0.0);
    }
    machine.cycles(20);
    machine
}

#[test]
fn reset_between_accesses_of_a_read_leaves_no_false_valid_input() {
    let mut resets = 0;
    for access in 0..200 {
        let mut machine = running();
        let field = machine.cards.field;
        let encoders: Vec<_> = (0..6)
            .map(|n| {
                let name = format!("hm2_7i92.0.encoder.{n:02}.count");
                machine.driver.pins().input::<i32>(&name).expect("pin")
            })
            .collect();
        let before: Vec<_> = encoders
            .iter()
            .map(|&pin| machine.driver.pins().read(pin))
            .collect();
        assert!(
            before.iter().all(|count| count.valid && count.value > 50),
            "{before:?}"
        );
        let at = machine.now() + access * DEFAULT_ACCESS_COST + DEFAULT_ACCESS_COST / 2;
        let watch = Watch::since_a_loss(machine.fpga());
        watch.seen().reset_at = Some(at);
        let _ = machine.driver.read().expect("the bus works");
        let is_reset = machine.now() > at;
        let pins = machine.driver.pins();
        for (n, input) in field.inputs.iter().enumerate() {
            let [is, not] = [pins.read(input.pin), pins.read(input.not)];
            assert!(is.value || !is.valid, "access {access}: input {n}: {is:?}");
            assert!(
                !not.value || !not.valid,
                "access {access}: input {n}: {not:?}"
            );
        }
        for (&pin, before) in encoders.iter().zip(&before) {
            let now = pins.read(pin);
            assert!(
                !now.valid || now.value == before.value,
                "access {access}: {before:?}, then {now:?}"
            );
        }
        if !is_reset {
            break;
        }
        resets += 1;
    }
    println!("{resets} moments of a reset");
    assert!((20..199).contains(&resets), "{resets}");
}

/// All words read from then on are ones, also in the middle of a read.
#[test]
fn long_reset_between_any_two_accesses_of_a_read_is_no_bite() {
    let mut resets = 0;
    for access in 0..200 {
        let driver = Driver::start(fpga(), Settings::default());
        let mut machine = Machine::with(driver.expect("complete"));
        machine.cycles(20);
        let at = machine.now() + access * DEFAULT_ACCESS_COST + DEFAULT_ACCESS_COST / 2;
        let reset = Once::at(at, |fpga| fpga.reset_for(3_000_000));
        machine.fpga().set_director(reset);
        let _ = machine.driver.read();
        if machine.now() <= at {
            break;
        }
        for _ in 0..20 {
            let _ = machine.driver.write();
            machine.pass_nanos(1_000_000);
            let _ = machine.driver.read();
        }
        let counted = machine.driver.statistics();
        let counted = (counted.resets, counted.watchdog_bites);
        assert_eq!(counted, (1, 0), "access {access}");
        resets += 1;
    }
    assert!((20..199).contains(&resets), "{resets}");
}
