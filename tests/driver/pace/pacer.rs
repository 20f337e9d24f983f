//! A loop of the application's own, paced as a runner paces it.

use std::time::Duration;

use crate::common::machine::{Machine, fpga};
use mesa_hal::bus::{BusErrorKind, Clock};
use mesa_hal::driver::{Driver, Settings};
use mesa_hal::runner::Pacer;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::SimFpga;

/// Runs cycles of a loop, each of which takes the time of `work` besides its exchanges; returns the
/// sum of `dt` and the time of the simulator from the first start to the last.
fn run(cycles: u32, work: impl Fn(u32) -> Duration) -> (Pacer, Duration, Duration) {
    let mut driver = Machine::new().driver;
    let mut pacer = Pacer::new(&driver);
    let (mut sum, mut first) = (Duration::ZERO, None);
    for number in 0..cycles {
        let _ = pacer.read(&mut driver).expect("the bus is well");
        if first.replace(first.unwrap_or(pacer.begun())).is_some() {
            sum += pacer.dt();
        }
        driver.bus_mut().wait(work(number));
        pacer.write(&mut driver).expect("the bus is well");
    }
    let begun = pacer.begun().since(first.expect("a cycle"));
    (pacer, sum, begun)
}

#[test]
fn dt_is_time_between_starts_and_skipped_periods_are_counted() {
    let (pacer, sum, begun) = run(200, |number| Duration::from_micros(u64::from(number) * 4));
    assert_eq!(
        (sum, begun),
        (Duration::from_millis(199), Duration::from_millis(199))
    );
    assert_eq!(pacer.statistics().skipped_periods, 0);
    assert_eq!(pacer.statistics().cycles, 200);

    let long = |number: u32| Duration::from_micros(if number % 10 == 4 { 3_300 } else { 100 });
    let (pacer, sum, begun) = run(101, long);
    assert_eq!(sum, begun);
    assert_eq!(begun, Duration::from_millis(100 + 10 * 3));
    let statistics = pacer.statistics();
    assert_eq!(statistics.skipped_periods, 30);
    assert!(
        statistics.longest >= Duration::from_micros(3_300),
        "{statistics:?}"
    );
    assert_eq!(statistics.latest, Duration::ZERO, "the grid is absolute");
}

#[test]
fn failed_reads_and_writes_are_counted_and_the_grid_goes_on() {
    let bus = Faulty::new(fpga(), 3);
    let mut driver: Driver<Faulty<SimFpga>> =
        Driver::start(bus, Settings::default()).expect("it starts");
    let mut pacer = Pacer::new(&driver).sleeping();
    let mut sum = Duration::ZERO;
    let mut failed = [0, 0];
    let mut begin = None;
    for number in 0..100 {
        if number % 10 == 5 {
            let next = driver.bus_mut().exchanges();
            driver
                .bus_mut()
                .fail_at(next, Fault::NotExecuted(BusErrorKind::Lost));
            driver
                .bus_mut()
                .fail_at(next + 1, Fault::NotExecuted(BusErrorKind::Lost));
        }
        let read = pacer.read(&mut driver);
        failed[0] += u64::from(read.is_err());
        begin.get_or_insert(pacer.begun());
        sum += pacer.dt();
        failed[1] += u64::from(pacer.write(&mut driver).is_err());
    }
    let statistics = pacer.statistics();
    assert_eq!([statistics.failed_reads, statistics.failed_writes], failed);
    assert!(failed[0] >= 10 && failed[1] >= 1, "{failed:?}");
    let passed = pacer.begun().since(begin.expect("a cycle"));
    assert_eq!(
        sum,
        passed + driver.period(),
        "the first cycle has a period as well"
    );
}

/// The boards have clocks of their own here.
#[test]
fn requests_of_two_boards_begin_with_the_period_of_the_pacer() {
    let [mut first, mut second] = [(); 2].map(|()| Machine::new().driver);
    let mut pacer = Pacer::new(&first);
    let mut begun = None;
    for number in 0..100_u32 {
        pacer.wait(&mut first);
        let at = first.bus_mut().now();
        let begin = *begun.get_or_insert(at);
        assert_eq!(at.since(begin), first.period() * number);
        first.request_read();
        second.request_read();
        let report = pacer.read(&mut first).expect("the bus is well");
        assert!(report.is_good());
        assert_eq!((pacer.begun(), pacer.dt()), (at, first.period()));
        assert!(second.read().expect("the bus is well").is_good());
        second.write().expect("the bus is well");
        pacer.write(&mut first).expect("the bus is well");
        let period = second.period();
        second.bus_mut().wait(period);
    }
    let statistics = pacer.statistics();
    assert_eq!((statistics.cycles, statistics.skipped_periods), (100, 0));
}
