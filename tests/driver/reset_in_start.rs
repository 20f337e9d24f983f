//! A reset at any moment of the start: the driver is not given back with anything on.

use std::time::Duration;

use mesa_hal::Settings;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{BoardState, Driver, DriverError};
use mesa_hal::sim::{Cause, Director, SimFpga, machines};

/// Resets the FPGA at a time, for so long.
#[derive(Debug)]
struct Reset {
    at: Option<u64>,
    time: u64,
}

impl Director for Reset {
    fn due(&self) -> Option<u64> {
        self.at
    }

    fn act(&mut self, fpga: &mut SimFpga) {
        self.at = None;
        match self.time {
            0 => fpga.reload(),
            time => fpga.reset_for(time),
        }
    }

    fn drives(&mut self, _: &SimFpga, _: Cause) {}
}

/// A 7I97 without remotes, whose bus takes 20 ns for a register.
fn board() -> SimFpga {
    let mut fpga = machines::i7i97(1);
    fpga.set_access_cost(20);
    fpga
}

fn settings() -> Settings {
    Settings {
        serial_ports: [(0, "xxxxxxxx".parse().expect("no channels"))].into(),
        ..Settings::default()
    }
}

/// Drives that see something else than 0 V, or an enable.
fn on(fpga: &mut SimFpga) -> Vec<usize> {
    let is_on = |&n: &usize| {
        let output = fpga.analog_output(n);
        output.enabled || output.volts.abs() > 1e-9
    };
    (0..6).filter(is_on).collect()
}

fn set_volts(driver: &mut Driver<SimFpga>, volts: f64) {
    for n in 0..6 {
        let pins = driver.pins_mut();
        let name = |name| format!("hm2_7i97.0.pwmgen.{n:02}.{name}");
        let value = pins.output(&name("value")).expect("a pin");
        let enable = pins.output(&name("enable")).expect("a pin");
        pins.set(value, volts);
        pins.set(enable, true);
    }
}

#[test]
fn a_reset_at_any_moment_of_the_start_leaves_nothing_on() {
    let mut fpga = board();
    let begun = SimFpga::now(&fpga);
    let driver = Driver::start(fpga, settings()).expect("no reset");
    fpga = driver.shutdown().0;
    let end = SimFpga::now(&fpga);
    let (mut starts, mut failed) = (0, 0);
    for time in [0, 2_000] {
        for at in (begun..end).step_by(if time == 0 { 150 } else { 2_350 }) {
            let mut fpga = board();
            fpga.set_director(Box::new(Reset { at: Some(at), time }));
            let told = format!("a reset of {time} ns at {at}");
            starts += 1;
            match Driver::start(fpga, settings()) {
                Ok(mut driver) => {
                    assert_eq!(on(driver.bus_mut()), [], "{told}");
                    // A reset after the last look is found by the cycle; otherwise all of the
                    // set-up is there.
                    for _ in 0..2 {
                        let _ = driver.read();
                        set_volts(&mut driver, 5.0);
                        let _ = driver.write();
                        driver.bus_mut().wait(Duration::from_micros(500));
                    }
                    let is_running = driver.board_state() == BoardState::Running;
                    let count = if is_running { 6 } else { 0 };
                    assert_eq!(on(driver.bus_mut()).len(), count, "{told}");
                }
                Err(error) => {
                    failed += 1;
                    let is_named = matches!(
                        error,
                        DriverError::Unsteady { .. } | DriverError::Identify(_)
                    );
                    assert!(is_named || time > 0, "{told}: {error}");
                }
            }
        }
    }
    println!("{starts} starts, {failed} failed");
    assert!(starts > 1_000 && failed > 0 && failed < starts);
}
