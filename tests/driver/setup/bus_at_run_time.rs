//! A bus whose type is chosen at run time.

use crate::common::machine::fpga;
use mesa_hal::bus::{BusErrorKind, Clock, DynBus, RegisterBus};
use mesa_hal::driver::{Driver, Settings};
use mesa_hal::hal::{AnyValue, PinId};
use mesa_hal::transport::{Fault, Faulty};

/// All pins after some cycles with an output on and an analog output at 1.5 V.
fn run<B: RegisterBus + Clock>(bus: B) -> (Driver<B>, Vec<(AnyValue, bool)>) {
    let mut driver = Driver::start(bus, Settings::default()).expect("a complete machine");
    let output = driver
        .pins()
        .output::<bool>("hm2_7i92.0.7i77.0.0.output-03");
    let volts = driver
        .pins()
        .output::<f64>("hm2_7i92.0.7i77.0.1.analogout0");
    let (output, volts) = (output.expect("a pin"), volts.expect("a pin"));
    for _ in 0..20 {
        let _ = driver.read().expect("the bus does not fail");
        driver.pins_mut().set(output, true);
        driver.pins_mut().set(volts, 1.5);
        driver.write().expect("the bus does not fail");
        let period = driver.period();
        driver.bus_mut().wait(period);
    }
    let ids: Vec<PinId> = driver.pins().ids().collect();
    let all = ids.into_iter().map(|id| {
        let reading = driver.pins().read_any(id);
        (reading.value, reading.valid)
    });
    let all = all.collect();
    (driver, all)
}

#[test]
fn driver_works_the_same_on_a_bus_whose_type_is_hidden() {
    let (_, expected) = run(fpga());
    let (_, pins) = run(DynBus::new(fpga()));
    assert!(pins.iter().any(|(_, valid)| *valid), "inputs are read");
    assert_eq!(pins, expected);
}

#[test]
fn cycle_error_keeps_kind_and_text_with_a_hidden_bus_type() {
    let lost = Fault::NotExecuted(BusErrorKind::Lost);
    let failing = |exchange| {
        let mut bus = Faulty::new(fpga(), 1);
        bus.fail_at(exchange, lost);
        bus
    };
    let whole = Driver::start(failing(u64::MAX), Settings::default()).expect("complete");
    // The first exchange after the start.
    let exchange = whole.bus().exchanges();
    let mut own = Driver::start(failing(exchange), Settings::default()).expect("complete");
    let hidden = DynBus::new(failing(exchange));
    let mut hidden = Driver::start(hidden, Settings::default()).expect("complete");
    let own = own.read().expect_err("it is lost");
    let hidden = hidden.read().expect_err("it is lost");
    assert_eq!(
        (own.kind(), hidden.kind()),
        (BusErrorKind::Lost, BusErrorKind::Lost)
    );
    assert_eq!(hidden.to_string(), own.to_string());
}
