//! Pins of LinuxCNC's encoders beside the count: the position between two counts, and an index that
//! leaves the count as it is.

use mesa_hal_sim::SimFpga;

use crate::boards::board_7i97::{Machine, board};

const AXIS: usize = 0;

/// Turns the shaft at this number of counts per second.
fn turn(machine: &mut Machine<SimFpga>, counts_per_second: f64) {
    let motor = machine.fpga().motor(AXIS).expect("an axis");
    let counts = motor.config().counts_per_unit;
    motor.turn_by_hand(Some(counts_per_second / counts));
}

fn shaft(machine: &mut Machine<SimFpga>) -> f64 {
    machine.fpga().motor(AXIS).expect("an axis").counts()
}

#[test]
fn interpolated_position_follows_the_shaft_between_counts() {
    let mut machine = board();
    let position = machine.input::<f64>("encoder.00.position");
    let interpolated = machine.input::<f64>("encoder.00.position-interpolated");
    for speed in [40.0, -170.0, 900.0] {
        turn(&mut machine, speed);
        machine.cycles(200);
        let origin = |machine: &mut Machine<SimFpga>| {
            let now = machine.driver.pins().read(interpolated).value;
            now - shaft(machine)
        };
        let first = origin(&mut machine);
        let (mut coarse, mut fine) = (0.0_f64, 0.0_f64);
        for _ in 0..100 {
            machine.cycles(1);
            let way = shaft(&mut machine) + first;
            let pins = machine.driver.pins();
            coarse = coarse.max((pins.read(position).value - way).abs());
            fine = fine.max((pins.read(interpolated).value - way).abs());
        }
        // A read comes up to a period after the sample.
        let late = speed.abs() * 0.001;
        assert!(fine < 0.1 + late, "{speed}: {fine} of a count");
        assert!(fine < coarse, "{speed}: {fine}, {coarse}");
    }
    machine
        .fpga()
        .motor(AXIS)
        .expect("an axis")
        .turn_by_hand(Some(0.0));
    machine.cycles(1_000);
    let pins = machine.driver.pins();
    assert_eq!(pins.read(interpolated).value, pins.read(position).value);
}

#[test]
fn index_leaves_the_count_where_no_clear_on_index_asks() {
    let mut machine = board();
    let keeps = machine.output::<bool>("encoder.00.no_clear_on_index");
    let latched = machine.input::<i32>("encoder.00.count-latched");
    let encoder = machine.cards.encoders[AXIS];
    let motor = machine.fpga().motor(AXIS).expect("an axis");
    let per_turn = f64::from(motor.config().counts_per_revolution);
    turn(&mut machine, 5_000.0);
    machine.cycles(100);
    for asked in [true, false] {
        machine.driver.pins_mut().set(keeps, asked);
        machine.driver.pins_mut().set(encoder.index_enable, true);
        let offset = |machine: &Machine<SimFpga>| {
            let pins = machine.driver.pins();
            let raw = pins.read(encoder.rawcounts).value;
            raw.wrapping_sub(pins.read(encoder.count).value)
        };
        let before = offset(&machine);
        let mut cycles = 0;
        while machine.driver.pins().read(encoder.index_enable).value {
            machine.cycles(1);
            cycles += 1;
            assert!(cycles < 5_000, "no index");
        }
        let at = machine.driver.pins().read(latched).value;
        if asked {
            assert_eq!(offset(&machine), before, "the count is as it was");
            // The shaft and the counts began together.
            let beside = f64::from(at).rem_euclid(per_turn);
            let beside = beside.min(per_turn - beside);
            assert!(beside <= 2.0, "latched {at}, {beside} beside an index");
        } else {
            assert_ne!(offset(&machine), before, "the count begins at the index");
            assert_eq!(at, 0);
        }
    }
}
