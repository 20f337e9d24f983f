//! Tests of the runner on simulated boards, in virtual time.

use core::ops::ControlFlow;
use core::time::Duration;

use super::{Cycle, Runner};
use crate::bus::{Clock, Instant};
use crate::driver::{Driver, Settings};
use mesa_hal_sim::{Motor, SimFpga, machines};

fn runner() -> Runner<SimFpga> {
    let board = machines::six_axes_7i92(Motor::default());
    Runner::new(Driver::start(board, Settings::default()).expect("it starts"))
}

/// The start times of cycles, while `work` makes some of them longer.
fn begins(
    cycles: u64,
    mut work: impl FnMut(u64) -> Duration,
) -> (Vec<Instant>, super::RunStatistics) {
    let mut begins = Vec::new();
    let run = |cycle: &mut Cycle<'_, SimFpga>| {
        // Reading takes time on this bus, the same in each cycle.
        begins.push(cycle.pins().now());
        if cycle.number == cycles {
            return ControlFlow::Break(());
        }
        let took = work(cycle.number);
        cycle.driver.bus_mut().wait(took);
        ControlFlow::Continue(())
    };
    let ended = runner().run(run);
    assert_eq!(ended.stopped, Ok(()));
    (begins, ended.statistics)
}

/// The period in which each cycle starts; a read takes less than half of one.
fn periods(begins: &[Instant]) -> Vec<u64> {
    let first = begins[0];
    let micros = begins
        .iter()
        .map(|begin| begin.since(first).as_micros() as u64);
    micros.map(|micros| (micros + 500) / 1000).collect()
}

#[test]
fn cycles_begin_whole_periods_apart_at_any_cycle_time() {
    let (begins, statistics) = begins(50, |number| Duration::from_micros(number * 13));
    assert_eq!(periods(&begins), (0..=50).collect::<Vec<_>>());
    assert_eq!(statistics.cycles, 50);
    assert_eq!(statistics.skipped_periods, 0);
}

#[test]
fn long_cycle_skips_its_periods_and_delays_no_other() {
    let long = Duration::from_micros(2500);
    let (begins, statistics) = begins(10, |number| if number == 4 { long } else { Duration::ZERO });
    assert_eq!(periods(&begins), [0, 1, 2, 3, 4, 7, 8, 9, 10, 11, 12]);
    assert_eq!(statistics.skipped_periods, 2);
    assert!(statistics.longest >= long, "{statistics:?}");
}

#[test]
fn outputs_are_off_when_it_has_ended() {
    let output = |driver: &Driver<SimFpga>| {
        let name = "hm2_7i92.0.7i77.0.0.output-00";
        driver.pins().output::<bool>(name).expect("a pin")
    };
    let runner = runner();
    let output = output(&runner.driver);
    let mut was_on = false;
    let ended = runner.run(|cycle| {
        cycle.pins_mut().set(output, true);
        let device = cycle.driver.bus().remote(0, 0);
        let device = device
            .and_then(mesa_hal_sim::devices::find)
            .expect("a 7I77");
        was_on |= is_on(device);
        if cycle.number == 20 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    assert_eq!(ended.stopped, Ok(()));
    assert!(was_on);
    let device = ended
        .driver
        .bus()
        .remote(0, 0)
        .and_then(mesa_hal_sim::devices::find);
    assert!(!is_on(device.expect("a 7I77")));
}

#[test]
fn statistics_and_events_remain_readable_after_the_end() {
    let runner = runner().waiting_for_transfers(Duration::from_micros(500));
    let mut events = runner.driver.events();
    let mut last = None;
    let ended = runner.run(|cycle| {
        last = Some(cycle.driver.statistics());
        if cycle.number == 10 {
            cycle.driver.restart((0, 0));
        }
        match cycle.number {
            0..20 => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    });
    assert_eq!(ended.stopped, Ok(()));
    let (driver, last) = (&ended.driver, last.expect("cycles"));
    assert!(driver.statistics().reads > last.reads, "the last transfer");
    let port = driver.ports()[0].statistics();
    assert!(port.transfers > 15 && port.doit.count() > 15, "{port:?}");
    let restarted = events.next().expect("it was restarted");
    assert_eq!(restarted.cycle, 11);
    let group = driver.ports()[0].remotes().next().expect("one").pins.group;
    let state = driver.pins().group_state(group).expect("its own");
    assert!(!state.armed);
    let mut bus = ended.driver.into_bus();
    assert!(bus.motor(0).is_some());
}

#[test]
fn read_result_is_reported_in_its_own_cycle() {
    let mut told = [0, 0];
    let ended = runner().run(|cycle| {
        told[usize::from(cycle.read.is_err())] += 1;
        if cycle.number == 4 {
            cycle.driver.bus_mut().reset_for(2_500_000);
        }
        match cycle.number {
            0..20 => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    });
    assert!((2..=3).contains(&told[1]), "{told:?}");
    assert_eq!(ended.statistics.failed_reads, told[1]);
}

#[test]
fn reads_that_failed_before_the_run_are_not_those_of_the_run() {
    let mut driver = runner().driver;
    driver.bus_mut().reset_for(2_500_000);
    assert!(driver.read().is_err());
    assert!(driver.read().is_err());
    let mut failed = 0;
    let ended = Runner::new(driver).run(|cycle| {
        failed += u64::from(cycle.read.is_err());
        match cycle.number {
            0..20 => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    });
    assert!((1..20).contains(&failed), "{failed}");
    assert_eq!(ended.statistics.failed_reads, failed);
    assert!(ended.driver.statistics().read_errors >= failed + 2);
}

#[cfg(feature = "realtime")]
#[test]
fn signal_ends_it_with_the_ports_stopped() {
    let stop = super::Stop::on_signals().expect("handlers");
    let kill = format!("kill -TERM {}", std::process::id());
    let ended = runner().stop_on(stop).run(|cycle| {
        if cycle.number == 20 {
            let killed = std::process::Command::new("sh")
                .args(["-c", &kill])
                .status();
            assert!(killed.expect("a shell").success());
        }
        assert!(cycle.number < 1_000_000, "it does not end");
        ControlFlow::Continue(())
    });
    assert_eq!(ended.stopped, Ok(()));
    assert_eq!(
        ended
            .signal
            .map(|signal| std::format!("{signal}"))
            .as_deref(),
        Some("SIGTERM")
    );
}

fn is_on(device: &dyn mesa_hal_sim::devices::SimDevice) -> bool {
    let outputs = device.outputs().into_iter();
    let mut outputs = outputs.filter(|(name, _)| name == "output-00");
    matches!(
        outputs.next(),
        Some((_, mesa_hal_sim::devices::SignalValue::Bool(true)))
    )
}
