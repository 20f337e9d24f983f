//! What follows the period of the thread. The truth is the simulated board.

#[path = "../../../../../tests/common/ethernet.rs"]
#[allow(
    dead_code,
    unreachable_pub,
    reason = "shared with the tests of mesa-hal"
)]
mod ethernet;

use std::boxed::Box;

use super::*;

const PERIODS: [Duration; 3] = [
    Duration::from_micros(500),
    Duration::from_millis(1),
    Duration::from_millis(2),
];

impl Bench {
    fn float(&self, name: &str) -> f64 {
        f64::from_bits(self.bits(name))
    }

    /// Cycles of a thread that wakes up to 2 us late.
    fn run_in_time(&mut self, cycles: u32, mut look: impl FnMut(&Self, u32)) {
        let begun = self.cycle.driver.bus_mut().now();
        for cycle in 0..cycles {
            let late = Duration::from_micros((cycle % 3).into());
            let wakes = begun.after(self.period.saturating_mul(cycle) + late);
            let now = self.cycle.driver.bus_mut().now();
            self.wait(wakes.since(now));
            self.cycle.read(self.period);
            self.cycle.write(self.period);
            look(self, cycle);
        }
    }

    /// Time after the last write at which the board's watchdog bites.
    fn bites_after(&mut self) -> Duration {
        let begun = self.cycle.driver.bus_mut().now();
        while !self.fpga().watchdog().has_bitten() {
            self.wait(Duration::from_micros(10));
        }
        self.cycle.driver.bus_mut().now().since(begun)
    }
}

fn hostmot2() -> Settings {
    settings("num_encoders=6 sserial_port_0=000xxxxx")
}

#[test]
fn dpll_is_in_phase_with_threads_of_half_a_1_and_2_ms() {
    for period in PERIODS {
        let mut bench = Bench::with(hostmot2());
        assert_eq!(bench.float("dpll.base-freq-khz"), -1.0, "as with hostmot2");
        bench.period = period;
        let mut errors = Vec::new();
        bench.run_in_time(2_000, |bench, cycle| {
            if cycle >= 1_000 {
                errors.push(bench.float("dpll.phase-error-us").abs());
            }
        });
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        assert!(mean < 5.0, "{period:?}: {mean} us");
        let khz = 1e-3 / period.as_secs_f64();
        assert_eq!(bench.float("dpll.base-freq-khz"), khz);
    }
}

/// As a HAL file sets it between `loadrt` and `start`.
#[test]
fn frequency_that_the_user_has_set_stays() {
    let mut bench = Bench::with(hostmot2());
    bench.set("dpll.base-freq-khz", 1.5);
    bench.period = PERIODS[2];
    bench.run(10);
    assert_eq!(bench.float("dpll.base-freq-khz"), 1.5);
    let now = bench.cycle.driver.bus_mut().now().as_nanos();
    let dpll = bench.fpga().dpll().expect("a DPLL");
    let edge = |from| dpll.next_edge(from, 0).expect("it runs");
    let first = edge(now);
    let between = edge(first + 1) - first;
    assert!(between.abs_diff(666_666) < 2_000, "{between} ns");
}

#[test]
fn watchdog_bites_after_five_periods_and_at_least_5_ms() {
    for (period, millis) in PERIODS.into_iter().zip([5, 5, 10]) {
        let mut bench = Bench::with(hostmot2());
        bench.period = period;
        bench.run_in_time(100, |_, _| {});
        let time = Duration::from_millis(millis);
        let nanos = bench.bits("watchdog.timeout_ns");
        assert_eq!(Duration::from_nanos(nanos), time, "{period:?}");
        let bites = bench.bites_after();
        assert!(bites.abs_diff(time) < period, "{period:?}: {bites:?}");
    }
}

#[test]
fn reply_is_awaited_for_80_percent_of_the_period() {
    for period in PERIODS {
        let bus = ethernet::bus(machines::six_axes_7i97(Motor::default()));
        let driver = Driver::start(bus, hostmot2()).expect("the machine is complete");
        let (mut cycle, numbers, _) = cycle_of(driver);
        let packet_error = numbers["hm2_7i97.0.packet-error"];
        // Of a reply on its way back; the board has needed some time before.
        for percent in [10, 60, 85, 60, 85] {
            let delay = period.as_nanos() as u64 * percent / 100;
            cycle.driver.bus_mut().link().to_host = Box::new(move |_, _| vec![delay]);
            cycle.read(period);
            let is_late = cycle.memory.load(packet_error) != 0;
            assert_eq!(is_late, percent > 80, "{period:?}, {percent} %");
            cycle.write(period);
            cycle.driver.bus_mut().wait(period);
        }
    }
}

/// The cards switch off after 50 ms without data, which a thread of 30 ms does not feed three
/// times.
#[test]
fn refused_period_drives_nothing_and_is_repeated() {
    let mut bench = Bench::with(hostmot2());
    bench.set("7i77.0.0.output-03", true);
    bench.set("ssr.00.out-02", true);
    bench.period = Duration::from_millis(30);
    let writes = bench.cycle.driver.statistics().writes;
    for cycle in 0..600 {
        bench.run(1);
        assert!(bench.is_on("io_error"), "{cycle}");
        for flag in [
            "valid",
            "7i77.0.0.valid",
            "7i77.0.0.armed",
            "7i72.0.2.armed",
        ] {
            assert!(!bench.is_on(flag), "{flag} in cycle {cycle}");
        }
        assert!(!bench.output(FIELD, 3), "{cycle}");
    }
    assert_eq!(bench.cycle.driver.statistics().writes, writes, "written");
    let errors = bench.heard(Level::Error);
    assert!((3..=5).contains(&errors.len()), "in 18 s: {errors:?}");
    for error in errors {
        assert_eq!(
            error,
            "hm2_7i97.0.7i77.0.0: all outputs off: its watchdog bites after 50 ms, and a thread of 30 ms needs \
             60 ms; choose a faster thread, or set NVWatchDogTimeout by `mesa param`; then set \
             hm2_7i97.0.io_error to FALSE to try again"
        );
    }
}

#[test]
fn refused_period_is_reported_in_hal_terms() {
    for (micros, watchdog_ns, about) in [
        (20, 5_000_000, "port 0: a transfer takes up to "),
        (2_000, 3_000_000, "set watchdog.timeout_ns; then set "),
        (
            900_000,
            4_000_000_000_u32,
            "choose a period of 1 us to 800 ms; ",
        ),
    ] {
        let mut bench = Bench::with(hostmot2());
        bench.set("watchdog.timeout_ns", watchdog_ns);
        bench.period = Duration::from_micros(micros);
        bench.run(1);
        let errors = bench.heard(Level::Error);
        let [error] = &errors[..] else {
            panic!("{errors:?}");
        };
        let begin = "hm2_7i97.0: all outputs off: ";
        let end = "; then set hm2_7i97.0.io_error to FALSE to try again";
        assert!(error.starts_with(begin) && error.ends_with(end), "{error}");
        assert!(error.contains(about), "{error}");
        assert!(error.len() <= 250, "{} characters: {error}", error.len());
    }
}

#[test]
fn refused_period_is_tried_again_when_io_error_is_cleared() {
    let mut bench = Bench::with(hostmot2());
    bench.period = PERIODS[2];
    bench.set("watchdog.timeout_ns", 3_000_000_u32);
    bench.run(10);
    bench.set("io_error", false);
    bench.run(2);
    assert!(bench.is_on("io_error"), "refused again");
    let errors = bench.heard.lock().expect("no panic").len();
    assert_eq!(errors, 2, "once for each try");
    bench.set("watchdog.timeout_ns", 20_000_000_u32);
    bench.set("io_error", false);
    bench.run(3);
    // The board's watchdog has bitten meanwhile.
    for flag in ["io_error", "watchdog.has_bit"] {
        bench.set(flag, false);
        bench.run(20);
    }
    assert!(!bench.is_on("io_error") && bench.is_on("valid"));
    assert_eq!(bench.cycle.driver.period(), PERIODS[2]);
}

/// A firmware with step generators and without cards.
#[test]
fn periods_of_50_us_to_50_ms_are_accepted() {
    for micros in [50, 200, 2_700, 3_000, 12_000, 30_000, 50_000] {
        let machine = machines::six_axes_7i97(Motor::default());
        let settings = settings("num_encoders=6 sserial_port_0=xxxxxxxx");
        let driver = Driver::start(Faulty::new(machine, 1), settings);
        let (cycle, numbers, heard) = cycle_of(driver.expect("the machine is complete"));
        let period = Duration::from_micros(micros);
        let mut bench = Bench {
            cycle,
            numbers,
            heard,
            period,
        };
        bench.set("ssr.00.out-02", true);
        bench.run(20);
        assert!(bench.is_on("valid"), "{micros} us: {:?}", bench.heard);
        assert_eq!(bench.cycle.driver.period(), period);
        let khz = 1e3 / micros as f64;
        let shown = bench.float("dpll.base-freq-khz");
        let expected = if micros > 10_400 { -1.0 } else { khz };
        assert_eq!(shown, expected, "{micros} us");
    }
}

/// Without cards, whose watchdogs are too short for such a thread.
#[test]
fn dpll_that_cannot_follow_is_an_error_where_a_timer_is_set() {
    let words = "num_encoders=6 sserial_port_0=xxxxxxxx";
    let alone = "board: the DPLL cannot follow a thread of 12 ms, and stays at 1 kHz";
    let note = format!("{alone}; no timer-number is set, so nothing depends on it");
    let error = format!(
        "{alone}: encoder.timer-number = 1 latches positions up to 1 ms before they are read; set it to -1, or \
         choose a faster thread"
    );
    let none: &[&str] = &[];
    for (millis, before, after, notes, errors) in [
        (12, -1, -1, &[&*note][..], none),
        (12, 1, 1, none, &[&*error]),
        // Set while the thread runs.
        (12, -1, 1, &[&note], &[&error]),
        (10, 1, 1, none, none),
    ] {
        let settings = settings(words);
        let mut bench = Bench::with(settings);
        bench.period = Duration::from_millis(millis);
        for timer in [before, after] {
            bench.set("encoder.timer-number", timer);
            bench.run(100);
        }
        let about = |level| {
            let heard = bench.heard(level).into_iter();
            heard
                .filter(|text| text.contains("DPLL"))
                .collect::<Vec<_>>()
        };
        let told = format!("{millis} ms, {before}, {after}");
        assert_eq!(about(Level::Note), notes, "{told}");
        assert_eq!(about(Level::Error), errors, "{told}");
    }
    // By the user: nobody expects that it follows.
    let settings = settings(words);
    let mut bench = Bench::with(settings);
    bench.period = Duration::from_millis(12);
    bench.set("dpll.base-freq-khz", 2.0);
    bench.set("encoder.timer-number", 1);
    bench.run(100);
    let is_about = |text: &String| text.contains("DPLL");
    for level in [Level::Note, Level::Error] {
        assert!(!bench.heard(level).iter().any(is_about), "{level:?}");
    }
}
