//! A reset at any time of the start: the driver is never returned with any output on.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use mesa_hal::Settings;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{BoardState, Driver, DriverError};
use mesa_hal_sim::{ChangeCause, Director, SimFpga, machines};

/// Resets the FPGA at a given time, for a given time.
#[derive(Debug)]
struct Reset {
    at: Option<u64>,
    time: u64,
    /// Time since which a drive's input is not 0 V with an open switch, and the longest such time.
    on: Option<u64>,
    longest: Arc<AtomicU64>,
}

impl Reset {
    fn new(at: u64, time: u64) -> Self {
        Self {
            at: Some(at),
            time,
            on: None,
            longest: Arc::default(),
        }
    }
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

    fn drives(&mut self, fpga: &SimFpga, _: ChangeCause) {
        let now = SimFpga::now(fpga);
        if let Some(since) = self.on {
            self.longest.fetch_max(now - since, Ordering::Relaxed);
        }
        self.on = if on(fpga).is_empty() {
            None
        } else {
            self.on.or(Some(now))
        };
    }
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

/// Drives with a voltage other than 0 V, or an enable.
fn on(fpga: &SimFpga) -> Vec<usize> {
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
fn reset_at_any_moment_of_the_start_leaves_nothing_on() {
    let mut fpga = board();
    let begun = SimFpga::now(&fpga);
    let driver = Driver::start(fpga, settings()).expect("no reset");
    fpga = driver.shutdown().0;
    let end = SimFpga::now(&fpga);
    let (mut starts, mut failed) = (0, 0);
    for time in [0, 2_000] {
        for at in (begun..end).step_by(if time == 0 { 370 } else { 4_350 }) {
            let mut fpga = board();
            let reset = Reset::new(at, time);
            let longest = Arc::clone(&reset.longest);
            fpga.set_director(Box::new(reset));
            let told = format!("a reset of {time} ns at {at}");
            starts += 1;
            match Driver::start(fpga, settings()) {
                Ok(mut driver) => {
                    assert_eq!(on(driver.bus()), [], "{told}");
                    // Not longer than the rest of the exchange that writes the set-up.
                    let longest = longest.load(Ordering::Relaxed);
                    assert!(longest < 3_000, "{told}: on for {longest} ns");
                    // A reset after the last look is found by the cycle; otherwise all of the
                    // set-up is present.
                    for _ in 0..2 {
                        let _ = driver.read();
                        set_volts(&mut driver, 5.0);
                        let _ = driver.write();
                        driver.bus_mut().wait(Duration::from_micros(500));
                    }
                    let is_running = driver.board_state() == BoardState::Running;
                    let count = if is_running { 6 } else { 0 };
                    assert_eq!(on(driver.bus()).len(), count, "{told}");
                }
                Err(error) => {
                    let longest = longest.load(Ordering::Relaxed);
                    assert!(longest < 3_000, "{told}: on for {longest} ns");
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

/// Words that are read around a reset are no identity of the firmware.
#[test]
fn every_fault_can_be_rearmed_after_a_start_around_a_long_reset() {
    let (mut started, mut failed) = (0, 0);
    // The reset begins before the start, or at any time of it.
    for time in [2_000, 30_000, 300_000] {
        for at in (0..120_000).step_by(950) {
            let begun = 100_000;
            let mut fpga = board();
            fpga.set_director(Box::new(Reset::new(at, time)));
            fpga.wait(Duration::from_nanos(begun));
            let told = format!("a reset of {time} ns at {at}");
            let Ok(mut driver) = Driver::start(fpga, settings()) else {
                failed += 1;
                continue;
            };
            started += 1;
            for _ in 0..3 {
                driver.bus_mut().reload();
                for _ in 0..3 {
                    let _ = driver.read();
                    let _ = driver.write();
                    driver.bus_mut().wait(Duration::from_micros(500));
                }
                let rearmed = driver.rearm();
                assert!(rearmed.is_ok(), "{told}: {rearmed:?}");
                assert_eq!(driver.board_state(), BoardState::Running, "{told}");
            }
        }
    }
    println!("{started} started, {failed} failed");
    assert!(started > 100 && failed > 20, "{started}, {failed}");
}
