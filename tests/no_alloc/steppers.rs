//! Step generators in the cycle: commands, parameters, tables, latches and faults allocate nothing.

use std::time::Duration;

use allocation_counter::measure;
use mesa_hal::bus::{BusErrorKind, Clock};
use mesa_hal::driver::{BoardState, Driver, EventKind, Settings};
use mesa_hal::modules::stepgen::{StepgenPins, Stepgens};
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::{SimFpga, gtag, machines};

const CYCLES: u32 = 20_000;
const PERIOD: Duration = Duration::from_millis(1);

/// A 7I92 with a 7I76 whose step generators have an index and a probe.
fn started() -> (Driver<Faulty<SimFpga>>, Vec<StepgenPins>) {
    let mut firmware = machines::firmware_7i92_7i76();
    let module = firmware.module_mut(gtag::STEPGEN);
    module.expect("step generators").version = 0xC2;
    let bus = Faulty::new(SimFpga::new(firmware), 7);
    let driver = Driver::start(bus, Settings::default()).expect("it starts");
    let pins = driver.modules::<Stepgens>().flat_map(Stepgens::pins);
    let pins = pins.collect();
    (driver, pins)
}

/// What an application does in a cycle.
fn command(driver: &mut Driver<Faulty<SimFpga>>, all: &[StepgenPins], n: u32) {
    let pins = driver.pins_mut();
    for (axis, generator) in (0..).zip(all) {
        let place = match n % 500 {
            0 => f64::NAN,
            100..200 => 1e9,
            _ => f64::from((n / 50 + axis) % 7),
        };
        pins.set(generator.position_cmd, place);
        pins.set(generator.velocity_cmd, place - 3.0);
        pins.set(generator.control_type, (n / 1_000 + axis) % 2 == 1);
        pins.set(generator.enable, n % 300 > 5);
        pins.set(generator.position_reset, n.is_multiple_of(777));
        if let (Some(index), 0) = (generator.index_enable, n % 400) {
            pins.set(index, true);
        }
        // Some of them ask for too much.
        let times = [generator.steplen, generator.dirhold];
        for time in times {
            let ns = 2_000 + n % 4_000 * 50;
            let _ = pins.set_param(time, ns).map_err(drop);
        }
        let _ = pins.set_param(generator.step_type, n / 2_000 % 3);
        let _ = pins.set_param(generator.maxaccel, f64::from(n % 9) * 100.0);
    }
}

#[test]
fn step_generators_never_allocate_under_any_command_or_fault() {
    let (mut driver, all) = started();
    assert_eq!(all.len(), 5);
    let mut events = driver.events();
    let (mut allocations, mut moved, mut bites, mut said) = (0, false, 0, 0);
    for n in 0..CYCLES {
        if n.is_multiple_of(97) {
            let next = driver.bus().exchanges();
            let bus = driver.bus_mut();
            bus.fail_at(next, Fault::NotExecuted(BusErrorKind::Lost));
            bus.fail_at(next + 3, Fault::AckedButLost);
        }
        if n % 1_900 == 1_899 {
            driver.bus_mut().wait(PERIOD * 40);
        }
        command(&mut driver, &all, n);
        let info = measure(|| {
            let _ = std::hint::black_box(driver.read());
            if n.is_multiple_of(16) {
                let _ = std::hint::black_box(driver.rearm());
            }
            let _ = std::hint::black_box(driver.write());
        });
        allocations += info.count_total;
        bites += u32::from(driver.board_state() == BoardState::WatchdogBitten);
        moved |= driver.pins().read(all[4].counts).value.abs() > 3;
        let of_steps = |kind: EventKind| {
            matches!(
                kind,
                EventKind::StepTimeClipped { .. } | EventKind::StepRateLimited { .. }
            )
        };
        said += events.by_ref().filter(|event| of_steps(event.kind)).count();
        driver.bus_mut().wait(PERIOD);
    }
    assert_eq!(allocations, 0);
    assert!(moved && bites > 5 && said > 100, "{bites}, {said}");
}
