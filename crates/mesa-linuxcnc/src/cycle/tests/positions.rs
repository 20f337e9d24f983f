//! Positions of a board that waits until the operator acts. The truth is the motor.

use mesa_hal_sim::{AxisWiring, DriveSource, MotorConfig};

use super::*;

/// A 7I92 with a 7I76, whose encoder is on pins of its own, on a motor that is turned by hand.
struct Axis(Bench);

impl Axis {
    fn new() -> Self {
        let mut fpga = machines::i7i92_7i76();
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Nothing,
            encoder: 0,
            motor: Motor::new(MotorConfig::default()).expect("a motor"),
        });
        let settings = settings("num_stepgens=1 sserial_port_0=0xxxxxxx");
        let driver = Driver::start(Faulty::new(fpga, 1), settings);
        let (cycle, numbers, heard) = cycle_of(driver.expect("the machine is complete"));
        // Of the board, under the name that the bench has for all boards.
        let numbers = numbers.into_iter().map(|(name, number)| {
            let name = name.replace("hm2_7i92.0.", "hm2_7i97.0.");
            (name, number)
        });
        let mut axis = Self(Bench {
            cycle,
            numbers: numbers.collect(),
            heard,
            period: PERIOD,
        });
        axis.0.run(150);
        axis
    }

    fn turn(&mut self, counts_per_second: f64) {
        let motor = self.0.fpga().motor(0).expect("a motor");
        motor.turn_by_hand(Some(counts_per_second / 1e3));
    }

    /// Counts of the motor that the encoder does not have.
    fn missing(&mut self) -> f64 {
        let motor = self.0.fpga().motor(0).expect("a motor");
        let counts = motor.counts();
        counts - f64::from(self.0.bits("encoder.00.rawcounts") as u32 as i32)
    }
}

/// A minute, in which the axis turns by a multiple of what its counter has.
#[test]
fn positions_are_followed_while_io_error_is_set() {
    let mut axis = Axis::new();
    let missing = axis.missing();
    axis.turn(20_000.0);
    axis.0.run(100);
    axis.0.lose_packets();
    axis.0.run(100);
    assert!(axis.0.is_on("io_error"));
    let errors = axis.0.bits("packet-error-total");
    let writes = axis.0.cycle.driver.statistics().writes;
    axis.0.run(200);
    axis.0.cycle.driver.bus_mut().heal();
    for _ in 0..6 {
        axis.0.run(5_000);
        axis.turn(-5_000.0);
        axis.0.run(5_000);
        axis.turn(20_000.0);
    }
    axis.turn(0.0);
    axis.0.run(20);
    // Read, and neither written nor shown; those that failed are not counted again.
    assert_eq!(axis.0.cycle.driver.statistics().writes, writes);
    assert_eq!(axis.0.bits("packet-error-total"), errors);
    assert!(axis.0.is_on("io_error") && !axis.0.is_on("valid"));
    assert!(axis.missing() > 100_000.0);
    axis.0.set("io_error", false);
    axis.0.run(200);
    assert!(!axis.0.is_on("io_error") && axis.0.is_on("valid"));
    assert!(!axis.0.is_on("encoder.00.count-unsure"));
    let lost = axis.missing() - missing;
    assert!(lost.abs() <= 1.0, "{lost} counts");
}

/// A board that does not answer must not cost the thread the time of a reply in each period.
#[test]
fn board_that_is_away_is_looked_for_once_in_10_ms() {
    let mut axis = Axis::new();
    axis.0.lose_packets();
    axis.0.run(100);
    assert!(axis.0.is_on("io_error"));
    let before = exchanges(&axis.0);
    axis.0.run(1_000);
    let looks = exchanges(&axis.0) - before;
    assert!((90..=101).contains(&looks), "{looks}");
}

/// What the board has lost is known before the operator acts, who then acts once.
#[test]
fn reset_is_found_while_the_board_waits_for_the_operator() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench.fpga().reset_for(1_000_000_000);
    bench.run(1_100);
    assert_eq!(bench.cycle.driver.board_state(), BoardState::Reset);
    assert!(bench.is_on("io_error") && !bench.is_on("armed"));
    let errors = bench.heard(Level::Error);
    let told = errors.last().expect("an error");
    assert!(told.contains("reset or lost power"), "{errors:#?}");
    bench.set("io_error", false);
    bench.run(300);
    assert_eq!(bench.outputs(), [true; 3]);
    assert!(bench.is_on("armed") && !bench.is_on("io_error"));
}

/// A write that is lost in one of the first cycles, as on a computer that is busy with LinuxCNC's
/// start.
#[test]
fn doubt_at_the_start_is_on_no_screen_and_a_loss_is() {
    for in_cycle in [1, 20, 80] {
        let mut bench = Bench::new();
        bench.run(in_cycle);
        let next = exchanges(&bench);
        let bus = bench.cycle.driver.bus_mut();
        bus.fail_at(next + 1, Fault::AckedButLost);
        bench.run(300);
        assert!(bench.is_on("encoder.00.count-unsure"), "{in_cycle}");
        assert_eq!(bench.heard(Level::Error), [""; 0], "{in_cycle}");
        bench.wait(Duration::from_secs(1));
        bench.run(10);
        bench.set("watchdog.has_bit", false);
        bench.run(100);
        let errors = bench.heard(Level::Error);
        let told = "hm2_7i97.0: position unsure of encoders 00, 01, 02, 03, 04, 05; home again";
        let told = errors.iter().filter(|error| **error == told);
        assert_eq!(told.count(), 1, "{errors:#?}");
    }
}
