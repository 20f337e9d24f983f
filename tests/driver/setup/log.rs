//! The driver's log messages.

use std::cell::RefCell;

use log::{Level, LevelFilter, Log, Metadata, Record};
use mesa_hal::driver::Driver;
use mesa_hal_sim::{SimFpga, SimModuleDescriptor, SimPinDescriptor, machines};

use crate::common::machine::start;

thread_local! {
    /// Messages logged by this thread, which runs one test.
    static LINES: RefCell<Vec<(Level, String)>> = const { RefCell::new(Vec::new()) };
}

struct Lines;

impl Log for Lines {
    fn enabled(&self, _: &Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &Record<'_>) {
        let line = (record.level(), record.args().to_string());
        LINES.with_borrow_mut(|lines| lines.push(line));
    }

    fn flush(&self) {}
}

/// The messages logged at this level while `work` runs.
pub fn logged(level: Level, work: impl FnOnce()) -> Vec<String> {
    // Another test may have set it already.
    let _ = log::set_logger(&Lines);
    log::set_max_level(LevelFilter::Info);
    LINES.take();
    work();
    let lines = LINES.take().into_iter();
    let lines = lines.filter(|(of, _)| *of == level);
    lines.map(|(_, line)| line).collect()
}

#[test]
fn modules_that_are_not_driven_are_in_the_log_with_their_pins() {
    let mut firmware = machines::firmware_7i92_7i77();
    // Two resolvers, on the last three pins.
    let resolver = SimModuleDescriptor {
        gtag: 0xC0,
        version: 2,
        instances: 2,
        base: 0xC000,
        registers: 10,
        multiple: 0x1FF,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.insert(2, resolver);
    let pins = firmware.pins.len();
    for (pin, secondary) in firmware.pins[pins - 3..].iter_mut().zip([0x81, 0x82, 0x83]) {
        *pin = SimPinDescriptor::new(0xC0, 0, secondary);
    }
    let mut remarks = Vec::new();
    let warnings = logged(Level::Warn, || {
        let driver: Driver<SimFpga> = start(SimFpga::new(firmware), |_| {}).expect("it starts");
        remarks.extend(driver.remarks().iter().map(ToString::to_string));
    });
    let [remark] = &remarks[..] else {
        panic!("{remarks:?}");
    };
    let said = ["Resolver", "(C0)", "2 "].map(|text| remark.contains(text));
    assert_eq!(said, [true; 3], "{remark}");
    let expected = format!("hm2_7i92.0: {remark}");
    assert!(warnings.contains(&expected), "{warnings:?}");
}

#[test]
fn driver_is_one_line_with_board_remotes_and_driven_modules() {
    let driver: Driver<SimFpga> = start(machines::i7i92_with_cards(), |_| {}).expect("it starts");
    let line = driver.to_string();
    let expected = "hm2_7i92.0 (MESA7I92): 3 remotes (7i77.0.0, 7i77.0.1, 7i72.0.2), 6 encoders";
    assert!(line.starts_with(expected), "{line}");
    assert!(
        !line.contains("missing") && line.lines().count() == 1,
        "{line}"
    );
    let driver: Driver<SimFpga> = start(machines::i7i97(1), |_| {}).expect("it starts");
    let line = driver.to_string();
    for part in [
        "hm2_7i97.0 (MESA7I97): 0 remotes, ",
        "6 encoders, 6 PWM generators, 16 isolated inputs, 6 isolated outputs",
    ] {
        assert!(line.contains(part), "{line}");
    }
}
