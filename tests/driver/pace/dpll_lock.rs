//! The board's DPLL and the cycle are synchronous soon after the start, and the driver reports from
//! when on.
//!
//! The truth is the edges of the simulated DPLL, whose loop is that of the gateware, against the
//! time at which the host reads.

use crate::common::machine::start;
use std::time::Duration;

use mesa_hal::bus::Clock;
use mesa_hal::driver::{CycleReport, Driver};
use mesa_hal::modules::dpll::{Dpll, DpllPins};
use mesa_hal_sim::{SimFpga, machines};

const PERIOD: u64 = 1_000_000;

/// Limit that `CycleReport::locked` promises for the lock, in periods.
const PROMISED: u64 = 200;

/// A host with a period of its own.
#[derive(Clone, Copy, Debug)]
struct Host {
    /// Excess of its period over that of the board, in 1e-6.
    ppm: i64,
    /// From the read to the write, in nanoseconds.
    work: u64,
    /// Largest deviation of a read, earlier or later.
    jitter: u64,
}

struct Machine {
    driver: Driver<SimFpga>,
    dpll: DpllPins,
    host: Host,
    begin: u64,
    cycles: u64,
}

impl Machine {
    fn new(host: Host) -> Self {
        let driver = start(machines::i7i97(1), |s| {
            s.period = Duration::from_nanos(PERIOD);
        })
        .expect("a 7I97");
        let dpll = driver.modules::<Dpll>().next().expect("a DPLL").pins;
        let mut this = Self {
            driver,
            dpll,
            host,
            begin: 0,
            cycles: 0,
        };
        this.begin = this.driver.bus_mut().now().as_nanos() + PERIOD;
        this
    }

    /// Runs one cycle; returns how late the read was for the reference, in nanoseconds.
    fn cycle(&mut self) -> (CycleReport, i64) {
        self.cycles += 1;
        let period = PERIOD as i64 + self.host.ppm;
        let noise = (self.cycles * 7_919 % 1_009) as i64 - 504;
        let due = self.cycles as i64 * period + noise * self.host.jitter as i64 / 504;
        let due = self.begin + due as u64;
        let bus = self.driver.bus_mut();
        let now = bus.now().as_nanos();
        bus.wait(Duration::from_nanos(due - now));
        let late = lateness(self.driver.bus_mut());
        let report = self.driver.read().expect("the bus does not fail");
        self.driver.bus_mut().wait(Duration::from_nanos(
            self.host.work + self.cycles % 7 * 3_000,
        ));
        self.driver.write().expect("the bus does not fail");
        (report, late)
    }
}

/// Delay after the nearest rising edge of the reference, in nanoseconds; the largest number while
/// the loop stands still.
fn lateness(fpga: &mut SimFpga) -> i64 {
    let now = Clock::now(fpga).as_nanos();
    let dpll = fpga.dpll().expect("a DPLL");
    let (Some(next), Some(period)) = (dpll.next_edge(now, 0), dpll.period()) else {
        return i64::MAX;
    };
    let until = (next - now) as i64;
    let since = period.round() as i64 - until;
    if since < until { since } else { -until }
}

const fn host(ppm: i64, work: u64, jitter: u64) -> Host {
    Host { ppm, work, jitter }
}

const HOSTS: [Host; 6] = [
    host(0, 60_000, 0),
    host(20, 60_000, 3_000),
    host(-50, 300_000, 20_000),
    host(50, 300_000, 20_000),
    host(100, 20_000, 5_000),
    host(-100, 700_000, 30_000),
];

#[test]
fn dpll_locks_within_the_time_that_is_promised_and_stays_locked() {
    for host in HOSTS {
        let mut machine = Machine::new(host);
        let mut locked_at = None;
        for n in 1..=5_000 {
            let (report, late) = machine.cycle();
            if report.locked && locked_at.is_none() {
                locked_at = Some(n);
            }
            assert_eq!(report.locked, locked_at.is_some(), "{host:?}, cycle {n}");
            let allowed = 50_000 + host.jitter as i64;
            assert!(
                !report.locked || late.abs() < allowed,
                "{host:?}, cycle {n}: {late} ns"
            );
            let shown = machine.driver.pins().read(machine.dpll.phase_error_us);
            let differs = shown.value * 1e3 - late as f64;
            assert!(
                n < 3 || differs.abs() < 2_000.0,
                "cycle {n}: {shown:?}, {late} ns"
            );
        }
        let at = locked_at.expect("it locks");
        println!("{host:?}: locked after {at} periods");
        assert!((120..=PROMISED).contains(&at), "{host:?}: {at}");
    }
}

#[test]
fn timer_samples_before_the_read_by_the_time_of_its_pin() {
    for us in [-100.0, -250.0, 100.0] {
        let mut machine = Machine::new(HOSTS[1]);
        let [timer, ..] = machine.dpll.timer_us;
        machine.driver.pins_mut().set(timer, us);
        while !machine.cycle().0.locked {}
        for _ in 0..500 {
            let (report, reference) = machine.cycle();
            assert!(report.locked);
            let fpga = machine.driver.bus_mut();
            // The edges of both, from the same time on.
            let from = fpga.now().as_nanos();
            let dpll = fpga.dpll().expect("a DPLL");
            let edge = |output| dpll.next_edge(from, output).expect("it runs") as i64;
            let period = PERIOD as i64;
            let behind = (edge(1) - edge(0) + period + period / 2).rem_euclid(period) - period / 2;
            let expected = (us * 1e3) as i64;
            assert!((behind - expected).abs() < 2_000, "{us} us: {behind} ns");
            assert!(reference.abs() < 50_000);
        }
    }
}

#[test]
fn loop_that_was_lost_is_started_again() {
    let mut machine = Machine::new(HOSTS[2]);
    for _ in 0..PROMISED {
        let _ = machine.cycle();
    }
    assert!(machine.cycle().0.locked);
    machine.driver.bus_mut().reload();
    for _ in 0..20 {
        assert!(!machine.cycle().0.locked, "the board is not set up");
    }
    for _ in 0..3 {
        let _ = machine.driver.rearm();
        assert!(!machine.cycle().0.locked);
    }
    let mut locked = (0..PROMISED).map(|_| machine.cycle());
    assert!(locked.any(|(report, late)| report.locked && late.abs() < 70_000));

    // A frequency that the host does not have must not lock.
    let base = machine.dpll.base_freq_khz;
    machine.driver.pins_mut().set(base, 1.05);
    for n in 0..1_000 {
        let (report, _) = machine.cycle();
        // While the phase is set, the loop cannot run away.
        assert!(n < 110 || !report.locked, "{n}");
    }
}
