//! The time that a cycle advances by, where the board paces.

use std::time::Duration;

use mesa_hal::bus::Clock;
use mesa_hal::runner::Pacer;

use super::{PERIOD, Pace, cut, good, machine};

#[test]
fn dt_adds_up_to_the_time_of_the_board_whatever_is_late_or_lost() {
    let mut driver = machine(Pace::Board);
    let mut pacer = Pacer::new(&driver);
    let (mut sum, mut begun, mut failed) = (Duration::ZERO, None, 0);
    let mut last = None;
    for number in 0..400_u64 {
        let read = pacer.read(&mut driver);
        // The write, which requests the next read, is lost.
        let is_lost = number % 50 == 20;
        driver.bus_mut().link().to_board = if is_lost { cut() } else { good() };
        failed += u64::from(read.is_err());
        let now = driver.pins().now();
        if begun.replace(begun.unwrap_or(now)).is_some() {
            sum += pacer.dt();
        }
        last = read.is_ok().then_some(now).or(last);
        // Some cycles take more than two periods.
        let micros = if number % 40 == 11 { 2_400 } else { 100 };
        driver.bus_mut().wait(Duration::from_micros(micros));
        let _ = pacer.write(&mut driver);
    }
    let passed = last.expect("a read").since(begun.expect("a read"));
    let differs = sum.abs_diff(passed);
    assert!(differs <= PERIOD, "{sum:?} of {passed:?}");
    assert!(sum >= PERIOD * 410, "periods were missed: {sum:?}");
    let statistics = pacer.statistics();
    assert_eq!(statistics.failed_reads, failed);
    assert_eq!(
        (statistics.skipped_periods, statistics.latest),
        (0, Duration::ZERO)
    );
    assert!(failed > 4, "{failed}");
}
