//! An application that writes and does not read.

use std::time::Duration;

use mesa_hal::driver::{BoardState, EventKind};
use mesa_hal::{Clock, Driver, I7i77Analog, I7i77Field, I7i97, Settings};
use mesa_hal_sim::{Motor, SimFpga, machines};

const STALE_AFTER: u32 = 5;

fn started(fpga: SimFpga) -> Driver<SimFpga> {
    let mut settings = Settings::default();
    settings.fault_policy.stale_after = STALE_AFTER;
    Driver::start(fpga, settings).expect("a board")
}

fn cycle(driver: &mut Driver<SimFpga>, reads: bool) {
    if reads {
        let _ = driver.read().expect("the bus does not fail");
    }
    driver.write().expect("the bus does not fail");
    driver.bus_mut().wait(Duration::from_millis(1));
}

fn drive(driver: &mut Driver<SimFpga>) -> (f64, bool) {
    let signal = driver.bus_mut().drive_signal(0).expect("a drive");
    (signal.volts.round(), signal.enabled)
}

#[test]
fn writes_without_reads_invalidate_inputs_and_stop_the_drive() {
    let mut driver = started(machines::six_axes_7i97(Motor::default()));
    let card: I7i97 = driver.attach_board().expect("a 7I97");
    let (axis, count) = (card.analog_out[0], card.encoders[0].count);
    let mut events = driver.events();
    for _ in 0..50 {
        cycle(&mut driver, true);
        axis.enable(driver.pins_mut(), true);
        axis.set(driver.pins_mut(), 3.0);
    }
    assert_eq!(drive(&mut driver), (3.0, true));
    let told = |events: &mut mesa_hal::driver::Events| {
        let kinds = events.map(|event| event.kind);
        kinds
            .filter(|kind| matches!(kind, EventKind::NotRead { .. }))
            .count()
    };
    for missed in 1..100_u32 {
        axis.set(driver.pins_mut(), 3.0);
        axis.enable(driver.pins_mut(), true);
        cycle(&mut driver, false);
        let reading = driver.pins().read(count);
        let is_fresh = missed < STALE_AFTER;
        assert_eq!(reading.valid, is_fresh, "{missed} writes without a read");
        assert_eq!(reading.age.cycles, missed.into());
        assert!(reading.age.time > Duration::from_micros(900) * missed);
        let expected = if is_fresh { (3.0, true) } else { (0.0, false) };
        assert_eq!(
            drive(&mut driver),
            expected,
            "{missed} writes without a read"
        );
        assert_eq!(told(&mut events), usize::from(missed == STALE_AFTER));
        assert_eq!(driver.board_state(), BoardState::Running);
    }
    for _ in 0..20 {
        axis.set(driver.pins_mut(), 3.0);
        axis.enable(driver.pins_mut(), true);
        cycle(&mut driver, true);
        let reading = driver.pins().read(count);
        assert!(reading.valid && reading.age.cycles == 0, "{reading:?}");
        assert_eq!(drive(&mut driver), (0.0, false), "not re-armed");
    }
    let _ = driver.rearm().expect("the bus does not fail");
    for _ in 0..20 {
        cycle(&mut driver, true);
        axis.set(driver.pins_mut(), 3.0);
        axis.enable(driver.pins_mut(), true);
    }
    assert_eq!(drive(&mut driver), (3.0, true));
    assert_eq!(told(&mut events), 0);
}

#[test]
fn remotes_that_are_not_read_are_not_valid_and_off() {
    let mut driver = started(machines::six_axes_7i92(Motor::default()));
    let field: I7i77Field = driver.attach((0, 0)).expect("a 7I77");
    let analog: I7i77Analog = driver.attach((0, 1)).expect("a 7I77");
    let axis = analog.analog_out[0];
    for _ in 0..50 {
        cycle(&mut driver, true);
        axis.enable(driver.pins_mut(), true);
        axis.set(driver.pins_mut(), 3.0);
    }
    assert_eq!(drive(&mut driver), (3.0, true));
    for missed in 1..200_u32 {
        cycle(&mut driver, false);
        let is_valid = driver.pins().read(field.inputs[2].pin).valid;
        assert_eq!(is_valid, missed < STALE_AFTER, "{missed} writes");
    }
    assert_eq!(drive(&mut driver), (0.0, false));
    for _ in 0..1000 {
        cycle(&mut driver, true);
    }
    assert!(driver.pins().read(field.inputs[2].pin).valid);
    assert_eq!(drive(&mut driver), (0.0, false), "not re-armed");
}
