//! A period that the application knows only when its cycle begins. The truth is the simulated
//! board: the time after which its watchdog bites, and the edges of its DPLL.

use std::time::Duration;

use crate::common::ethernet::bus;
use crate::common::machine::{fpga, start};
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{Defaults, DriverError, Pace, SerialPort};
use mesa_hal::modules::dpll::Dpll;
use mesa_hal::{Driver, Settings};
use mesa_hal_sim::{Motor, SimFpga, machines};

const MICRO: u64 = 1_000;

fn micros(count: u64) -> Duration {
    Duration::from_micros(count)
}

/// A 7I97, which has a DPLL.
fn six_axes() -> SimFpga {
    machines::six_axes_7i97(Motor::default())
}

fn cycles<B: RegisterBus + Clock>(
    driver: &mut Driver<B>,
    count: u64,
    mut look: impl FnMut(&Driver<B>),
) {
    let (begun, period) = (driver.bus_mut().now(), driver.period());
    for n in 1..=count {
        let _ = driver.read().expect("the bus is well");
        driver.write().expect("the bus is well");
        look(driver);
        let next = begun.after(period.saturating_mul(n as u32));
        let left = next.since(driver.bus_mut().now());
        driver.bus_mut().wait(left);
    }
}

/// Time after the last write at which the board's watchdog bites.
fn bites_after(driver: &mut Driver<SimFpga>) -> Duration {
    let begun = driver.bus_mut().now();
    while !driver.bus().watchdog().has_bitten() {
        driver.bus_mut().wait(micros(10));
    }
    driver.bus_mut().now().since(begun)
}

#[test]
fn watchdog_and_dpll_follow_a_period_set_before_the_first_write() {
    let of_board = [(500, 5_000), (1_000, 5_000), (2_000, 10_000)];
    let of_board = of_board.map(|(period, bites)| (period, bites, Defaults::Board));
    // There the frequency is -1 at first.
    let of_linuxcnc = [(500, 5_000, Defaults::LinuxCnc)];
    for (period, bites, defaults) in of_board.into_iter().chain(of_linuxcnc) {
        let mut driver =
            start(six_axes(), |settings| settings.defaults = defaults).expect("a 7I97");
        driver.set_period(micros(period)).expect("not yet written");
        assert_eq!(driver.period(), micros(period));
        let dpll = driver.modules::<Dpll>().next().expect("a DPLL").pins;
        let (mut n, mut errors) = (0_u64, Vec::new());
        cycles(&mut driver, 2_000, |driver| {
            n += 1;
            if n > 1_000 {
                errors.push(driver.pins().read(dpll.phase_error_us).value);
            }
        });
        let khz = driver.pins().commanded(dpll.base_freq_khz);
        assert_eq!(khz, 1e3 / period as f64);
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let worst = errors
            .iter()
            .fold(0.0, |worst: f64, error| worst.max((error - mean).abs()));
        assert!(
            mean.abs() < 5.0 && worst < 5.0,
            "{period} us: {mean} us, {worst} us"
        );
        let is = bites_after(&mut driver);
        let late = is.saturating_sub(micros(bites - period));
        assert!(
            is + micros(period) >= micros(bites) && late < micros(2 * period),
            "{period} us: {is:?}"
        );
    }
}

#[test]
fn set_watchdog_is_kept_and_refuses_a_too_long_period() {
    let bus = six_axes();
    let mut driver =
        start(bus, |settings| settings.watchdog = Some(micros(7_000))).expect("a 7I97");
    let refused = driver.set_period(micros(4_000));
    assert!(
        matches!(refused, Err(DriverError::WatchdogTooShort { .. })),
        "{refused:?}"
    );
    assert_eq!(driver.period(), micros(1_000));
    driver.set_period(micros(2_000)).expect("fed three times");
    cycles(&mut driver, 100, |_| {});
    let bites = bites_after(&mut driver);
    assert!((micros(4_900)..micros(7_100)).contains(&bites), "{bites:?}");
}

/// As a HAL file sets them between `loadrt` and `start`.
#[test]
fn values_set_by_the_application_survive_a_new_period() {
    let mut driver = start(six_axes(), |_| {}).expect("a 7I97");
    let dpll = driver.modules::<Dpll>().next().expect("a DPLL").pins;
    let timeout = driver.pins().parameter("hm2_7i97.0.watchdog.timeout_ns");
    let timeout = timeout.expect("it is there");
    driver
        .pins_mut()
        .set_param(timeout, 20_000_000)
        .expect("20 ms");
    driver.pins_mut().set(dpll.base_freq_khz, 1.5);
    driver.set_period(micros(2_000)).expect("not yet written");
    driver.set_period(micros(500)).expect("not yet written");
    assert_eq!(driver.pins().param::<u32>(timeout), 20_000_000);
    assert_eq!(driver.pins().commanded(dpll.base_freq_khz), 1.5);
    cycles(&mut driver, 100, |_| {});
    let bites = bites_after(&mut driver);
    assert!(
        (micros(19_000)..micros(20_100)).contains(&bites),
        "{bites:?}"
    );
}

#[test]
fn invalid_or_late_period_is_refused_and_changes_no_value() {
    type Refused = Result<(), DriverError>;
    let mut driver = start(fpga(), |_| {}).expect("a 7I92");
    let names: Vec<_> = driver.pins().ids().collect();
    let values = |driver: &Driver<SimFpga>| -> Vec<_> {
        names
            .iter()
            .map(|pin| driver.pins().read_any(*pin).value)
            .collect()
    };
    let before = values(&driver);
    let expect = |driver: &mut Driver<SimFpga>, micros, is: fn(&Refused) -> bool| {
        let refused = driver.set_period(Duration::from_micros(micros));
        assert!(is(&refused), "{micros} us: {refused:?}");
        assert_eq!(driver.period(), Duration::from_millis(1));
        assert_eq!(values(driver), before, "{micros} us");
    };
    expect(&mut driver, 0, |refused| {
        matches!(refused, Err(DriverError::BadPeriod { .. }))
    });
    expect(&mut driver, 900_000, |refused| {
        matches!(refused, Err(DriverError::BadPeriod { .. }))
    });
    expect(&mut driver, 20, |refused| {
        matches!(refused, Err(DriverError::PeriodTooShort { .. }))
    });
    // The remotes' watchdogs bite after 50 ms.
    expect(&mut driver, 40_000, |refused| {
        matches!(refused, Err(DriverError::WatchdogTooShort { .. }))
    });
    cycles(&mut driver, 1, |_| {});
    let late = driver.set_period(micros(2_000));
    assert!(matches!(late, Err(DriverError::PeriodInUse)), "{late:?}");

    let paced = |settings: &mut Settings| settings.pace = Pace::Board;
    let mut driver = start(bus(six_axes()), paced).expect("a 7I97");
    let refused = driver.set_period(micros(2_000));
    assert!(
        matches!(refused, Err(DriverError::PeriodInUse)),
        "{refused:?}"
    );
}

#[test]
fn refused_period_makes_everything_safe() {
    let mut driver = start(six_axes(), |_| {}).expect("a 7I97");
    let relay = driver.pins().output("hm2_7i97.0.ssr.00.out-02");
    let relay = relay.expect("it is there");
    driver.pins_mut().set(relay, true);
    let refused = driver.set_period(micros(30_000));
    assert!(refused.is_err(), "the cards switch off after 50 ms");
    let remotes = driver.ports().iter().flat_map(SerialPort::remotes);
    let groups = remotes.map(|remote| remote.pins.group);
    for group in groups.chain([driver.group()]) {
        let state = driver.pins().group_state(group).expect("its own");
        assert!(!state.armed, "{group:?}");
    }
    cycles(&mut driver, 20, |_| {});
    assert!(!driver.pins().commanded(relay));
    driver
        .rearm()
        .expect("the board runs")
        .armed
        .checked_sub(1)
        .expect("armed");
    driver.pins_mut().set(relay, true);
    cycles(&mut driver, 20, |_| {});
    assert!(driver.pins().commanded(relay));
}

/// The prescale of 8 bits ends at 10.4 ms with 100 MHz.
#[test]
fn dpll_that_cannot_follow_the_period_is_left_alone() {
    let no_cards = |settings: &mut Settings| {
        settings
            .serial_ports
            .insert(0, "xxxxxxxx".parse().expect("words"));
    };
    for period in [12_000, 30_000, 50_000] {
        let mut set = start(six_axes(), no_cards).expect("a 7I97");
        set.set_period(micros(period)).expect("not yet written");
        let of_settings = start(six_axes(), |settings| {
            no_cards(settings);
            settings.period = micros(period);
        });
        for mut driver in [set, of_settings.expect("a 7I97")] {
            assert_eq!(driver.period(), micros(period));
            cycles(&mut driver, 20, |_| {});
            let dpll = driver.modules::<Dpll>().next().expect("a DPLL");
            assert_eq!(dpll.khz(), 1.0, "{period} us");
            let state = driver.pins().group_state(driver.group()).expect("its own");
            assert!(state.valid && state.armed, "{period} us");
        }
    }
}

#[test]
fn deadline_of_a_reply_is_that_of_the_period() {
    // Replies that take 1.2 ms are too late for 1 ms, and in time for 2 ms.
    for (period, in_time) in [(1_000, false), (2_000, true)] {
        let mut driver = start(bus(six_axes()), |_| {}).expect("a 7I97");
        for period in [500, period] {
            driver.set_period(micros(period)).expect("not yet written");
        }
        driver.bus_mut().link().to_host = Box::new(|_, _| vec![1_200 * MICRO]);
        let read = driver.read();
        assert_eq!(read.is_ok(), in_time, "{period} us: {read:?}");
    }
}
