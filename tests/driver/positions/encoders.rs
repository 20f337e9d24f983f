//! Encoders that turn while the fault lasts.

use mesa_hal::Clock;

use super::*;

/// What is expected of the count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Count {
    /// It is that of the motor, and sure.
    Exact,
    /// It is that of the motor, and unsure.
    Estimate,
    /// It is unsure.
    Lost,
}

use Count::{Estimate, Exact, Lost};
use Trouble::{Cut, Deaf, Reset, ResetInStall, Stall};

impl<B: Rig> Machine<B> {
    pub(super) fn turn(&mut self, speed: f64) {
        let axis = self.axis;
        let motor = self.driver.bus_mut().fpga().motor(axis);
        let motor = motor.expect("a motor");
        motor.turn_by_hand(Some(speed));
    }

    /// The counts of the driver, and those of the motor.
    pub(super) fn counts(&mut self) -> (i32, f64) {
        let reading = self.driver.pins().read(self.encoder.counter.rawcounts);
        let axis = self.axis;
        let motor = self.driver.bus_mut().fpga().motor(axis);
        let motor = motor.expect("a motor");
        (reading.value, motor.counts())
    }

    pub(super) fn is_unsure(&self) -> bool {
        let pin = self.encoder.counter.count_unsure.expect("it has one");
        self.driver.pins().read(pin).value
    }

    pub(super) fn stand(&mut self) {
        self.turn(0.0);
        self.cycles(20);
    }

    /// The motor turns at this speed in counts per second while the trouble lasts.
    fn check(&mut self, trouble: Trouble, speed: f64, expected: Count) {
        let told = format!("{}, {trouble:?}, {speed}", self.name);
        let (count, motor) = self.counts();
        self.turn(speed / 1e3);
        self.cycles(150);
        assert!(!self.is_unsure(), "{told}");
        let _ = self.told(Positions::Encoders);
        self.happens(trouble);
        self.comes_back();
        self.cycles(20);
        let is_unsure = self.is_unsure();
        self.stand();
        assert_eq!(self.is_unsure(), is_unsure, "{told}");
        let (now, motor_now) = self.counts();
        let missing = motor_now - motor - f64::from(now.wrapping_sub(count));
        assert_eq!(is_unsure, expected != Exact, "{told}: {missing}");
        let most = match expected {
            Exact => 1.0,
            Estimate => 4.0,
            Lost => f64::INFINITY,
        };
        assert!(missing.abs() <= most, "{told}: {missing}");
        let events = self.told(Positions::Encoders);
        assert_eq!(events >> self.axis & 1 != 0, is_unsure, "{told}");
        // Homed.
        self.driver.pins_mut().set(self.encoder.counter.reset, true);
        self.cycles(2);
        self.driver
            .pins_mut()
            .set(self.encoder.counter.reset, false);
        self.cycles(150);
        assert!(!self.is_unsure(), "{told}");
    }
}

/// 20,000 counts in a second.
const FAST: f64 = 20_000.0;

/// Faults and what becomes of an encoder on pins of its own, and of a multiplexed one.
const FAULTS: [(Trouble, f64, Count, Count); 17] = [
    // Without a bite.
    (Cut(3), FAST, Exact, Exact),
    (Cut(15), -FAST, Exact, Exact),
    (Deaf(15), FAST, Exact, Exact),
    (Stall(50), FAST, Exact, Exact),
    (Stall(50), 400_000.0, Exact, Exact),
    (Stall(90), -400_000.0, Lost, Lost),
    // The bus is down, and the board has its set-up.
    (Cut(75), -FAST, Exact, Exact),
    (Deaf(75), FAST, Exact, Exact),
    // With a bite.
    (Cut(300), FAST, Exact, Estimate),
    (Deaf(300), -FAST, Exact, Estimate),
    (Stall(300), FAST, Exact, Estimate),
    (Cut(5_000), 2_000.0, Exact, Estimate),
    (Cut(5_000), 0.0, Exact, Estimate),
    (Stall(60_000), 0.0, Exact, Estimate),
    (Cut(5_000), FAST, Lost, Lost),
    (Reset, FAST, Lost, Lost),
    (ResetInStall(300), FAST, Lost, Lost),
];

fn all<B: Rig>(plain: &mut Machine<B>, muxed: &mut Machine<B>) {
    for (trouble, speed, of_plain, of_muxed) in FAULTS {
        plain.check(trouble, speed, of_plain);
        muxed.check(trouble, speed, of_muxed);
    }
}

#[test]
fn counts_match_the_motor_after_faults_of_an_embedded_bus() {
    let mut one = Machine::new(embedded(plain()), "embedded, plain");
    let mut other = Machine::new(embedded(muxed()), "embedded, muxed");
    all(&mut one, &mut other);
}

#[test]
fn counts_are_those_of_the_motor_after_faults_of_a_network() {
    let mut one = Machine::new(network(plain()), "network, plain");
    let mut other = Machine::new(network(muxed()), "network, muxed");
    all(&mut one, &mut other);
}

#[test]
fn counts_are_those_of_the_motor_after_faults_of_a_pci_bus() {
    let mut one = Machine::new(pci(plain()), "PCI, plain");
    let mut other = Machine::new(pci(muxed()), "PCI, muxed");
    all(&mut one, &mut other);
}

#[test]
fn counts_are_followed_while_the_board_waits_to_be_re_armed() {
    let mut machine = Machine::new(network(plain()), "waiting");
    let (count, motor) = machine.counts();
    machine.turn(20.0);
    machine.cycles(50);
    machine.happens(Cut(300));
    // A minute, in which the axis turns by much more than a counter has.
    for _ in 0..10 {
        machine.cycles(3_000);
        machine.turn(-5.0);
        machine.cycles(3_000);
        machine.turn(40.0);
    }
    assert_ne!(machine.driver.board_state(), BoardState::Running);
    machine.comes_back();
    machine.stand();
    let (now, motor_now) = machine.counts();
    assert!(motor_now - motor > 400_000.0);
    let missing = motor_now - motor - f64::from(now.wrapping_sub(count));
    assert!(missing.abs() <= 1.0, "{missing}");
    assert!(!machine.is_unsure());
}

/// The select line of multiplexed encoders is a pin that the set-up lets go of.
#[test]
fn bus_that_was_down_leaves_multiplexed_encoders_sure() {
    let mut machine = Machine::new(network(muxed()), "bus down");
    let _ = machine.told(Positions::Encoders);
    machine.happens(Cut(75));
    assert_eq!(machine.driver.board_state(), BoardState::BusDown);
    machine.comes_back();
    machine.cycles(50);
    assert_eq!(machine.told(Positions::Encoders), 0);
    assert!(!machine.is_unsure());
}

/// A machine whose encoder turns, and whose bus was down for 75 ms.
fn out_of_reach(fpga: fn() -> SimFpga) -> (Machine<Faulty<SimFpga>>, f64) {
    let mut machine = Machine::new(embedded(fpga()), "out of reach");
    let (count, motor) = machine.counts();
    machine.turn(20.0);
    machine.cycles(50);
    machine.driver.bus_mut().cut();
    machine.cycles(75);
    assert_eq!(machine.driver.board_state(), BoardState::BusDown);
    (machine, motor - f64::from(count))
}

/// The machine is re-armed. Returns true if its count is unsure; one that is sure is that of the
/// motor.
fn is_unsure_after_a_re_arm(
    (mut machine, zero): (Machine<Faulty<SimFpga>>, f64),
    what: &str,
) -> bool {
    machine.driver.bus_mut().mend();
    let _ = machine.driver.rearm();
    machine.comes_back();
    machine.stand();
    let (count, motor) = machine.counts();
    let missing = motor - f64::from(count) - zero;
    let is_unsure = machine.is_unsure();
    assert!(
        missing.abs() <= 1.0 || is_unsure,
        "{what}: {missing} missing"
    );
    is_unsure
}

/// A re-arm of a board that was only out of reach reads, then writes its set-up again: whatever
/// happens between these accesses, a count is that of the motor, or it is unsure.
#[test]
fn reset_within_a_re_arm_leaves_no_wrong_count_sure() {
    for fpga in [plain, muxed] {
        let is_unsure = |access: u64| {
            let (mut machine, zero) = out_of_reach(fpga);
            let fpga = machine.driver.bus_mut().fpga();
            let at = SimFpga::now(fpga) + access * DEFAULT_ACCESS_COST + DEFAULT_ACCESS_COST / 2;
            Watch::since_a_loss(fpga).seen().reset_at = Some(at);
            is_unsure_after_a_re_arm((machine, zero), &format!("reset at access {access}"))
        };
        let unsure = (0..200).filter(|access| is_unsure(*access)).count();
        assert!(unsure > 20, "{unsure}");
    }
}

/// The select line of multiplexed encoders is released.
#[test]
fn bite_within_a_re_arm_leaves_no_wrong_count_sure() {
    let is_unsure = |wait: u64| {
        let (mut machine, zero) = out_of_reach(muxed);
        let bus = machine.driver.bus_mut();
        bus.wait(Duration::from_nanos(wait));
        is_unsure_after_a_re_arm((machine, zero), &format!("re-armed {wait} ns later"))
    };
    // The watchdog bites between these.
    let (mut before, mut after) = (0, 40_000_000);
    while after - before > DEFAULT_ACCESS_COST {
        let middle = u64::midpoint(before, after);
        if is_unsure(middle) {
            after = middle;
        } else {
            before = middle;
        }
    }
    for access in 0..400 {
        is_unsure(
            (before + 200 * DEFAULT_ACCESS_COST).saturating_sub(access * DEFAULT_ACCESS_COST),
        );
    }
    assert!(!is_unsure(0) && before > 0 && is_unsure(after), "{before}");
}

#[test]
fn unsure_encoders_are_one_event() {
    let mut machine = Machine::new(network(muxed()), "one event");
    let _ = machine.told(Positions::Encoders);
    machine.happens(Cut(300));
    machine.comes_back();
    machine.cycles(50);
    let told: Vec<_> = machine
        .events
        .by_ref()
        .map(|event| event.kind.with_advice().to_string())
        .collect();
    let unsure: Vec<_> = told.iter().filter(|text| text.contains("unsure")).collect();
    assert_eq!(
        unsure,
        ["position unsure of encoders 00, 01, 02, 03, 04, 05; home again"]
    );
    let kind = EventKind::PositionUnsure {
        of: Positions::Encoders,
        first: 32,
        mask: 0x8000_0001,
    };
    assert_eq!(
        kind.with_advice().to_string(),
        "position unsure of encoders 32, 63; home again"
    );
    assert!(kind.is_fault());
}
