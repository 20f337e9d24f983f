//! Inputs are valid while they are younger than `stale_after`, in every view of them, and however
//! many failures the driver is configured to tolerate.

use std::time::Duration;

use mesa_hal::bus::{BusErrorKind, Clock};
use mesa_hal::driver::{BoardState, Driver};
use mesa_hal::hal::GroupId;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal::{I7i97, Settings};
use mesa_hal_sim::{Motor, SimFpga, machines};

fn started(fpga: SimFpga, stale_after: u32) -> Driver<Faulty<SimFpga>> {
    let mut settings = Settings {
        bus_error_limit: 50,
        watchdog: Some(Duration::from_secs(1)),
        ..Settings::default()
    };
    settings.fault_policy.stale_after = stale_after;
    let mut driver = Driver::start(Faulty::new(fpga, 1), settings).expect("a board");
    for _ in 0..50 {
        let _ = driver.read().expect("the bus does not fail");
        driver.write().expect("the bus does not fail");
        driver.bus_mut().wait(Duration::from_millis(1));
    }
    driver
}

/// Makes every read fail; returns the ages up to which each group was valid.
fn valid_up_to(driver: &mut Driver<Faulty<SimFpga>>, groups: &[GroupId]) -> Vec<u64> {
    let fault = Fault::NotExecuted(BusErrorKind::Unreachable);
    driver.bus_mut().fail_randomly(fault, 1.0);
    let mut ages = vec![0; groups.len()];
    for _ in 0..20 {
        let _ = driver.read().expect_err("every exchange fails");
        let _ = driver.write();
        driver.bus_mut().wait(Duration::from_millis(1));
        for (age, group) in ages.iter_mut().zip(groups) {
            let state = driver.pins().group_state(*group).expect("its own");
            if state.valid {
                *age = state.age.cycles;
            }
        }
    }
    assert_eq!(driver.board_state(), BoardState::Running);
    ages
}

#[test]
fn encoders_and_remotes_are_valid_up_to_the_same_age() {
    for stale_after in [1, 5, 12] {
        let last = u64::from(stale_after) - 1;
        let mut driver = started(machines::six_axes_7i97(Motor::default()), stale_after);
        let card: I7i97 = driver.attach_board().expect("a 7I97");
        let count = card.encoders[0].count;
        assert!(driver.pins().read(count).valid);
        let board = driver.pins().info(count).expect("a pin").group;
        assert_eq!(valid_up_to(&mut driver, &[board]), [last]);
        assert!(!driver.pins().read(count).valid);

        let mut driver = started(machines::six_axes_7i92(Motor::default()), stale_after);
        let groups: Vec<_> = driver.pins().groups().skip(1).collect();
        assert!(groups.len() >= 3, "the board and two remotes");
        let ages = valid_up_to(&mut driver, &groups);
        assert_eq!(ages, vec![last; groups.len()]);
        // Values that the driver knows by itself stay valid.
        let own = driver.pins().groups().next().expect("its own");
        assert!(driver.pins().group_state(own).expect("its own").valid);
    }
}

#[test]
fn reading_is_available_up_to_its_age_limit_after_failed_reads() {
    let mut driver = started(machines::six_axes_7i92(Motor::default()), 5);
    let name = "hm2_7i92.0.7i77.0.0.input-00";
    let input = driver.pins().input::<bool>(name).expect("an input");
    let fault = Fault::NotExecuted(BusErrorKind::Unreachable);
    driver.bus_mut().fail_randomly(fault, 1.0);
    for age in 1..10 {
        let _ = driver.read().expect_err("every exchange fails");
        let _ = driver.write();
        driver.bus_mut().wait(Duration::from_millis(1));
        let reading = driver.pins().read(input);
        assert_eq!(reading.age.cycles, age);
        assert_eq!(reading.within(3).is_some(), age <= 3);
        assert_eq!(reading.ok().is_some(), age < 5);
    }
    // A value that was never known is not known within any time.
    let foreign = mesa_hal::hal::Input::<bool>::default();
    assert_eq!(driver.pins().read(foreign).within(u64::MAX), None);
}
