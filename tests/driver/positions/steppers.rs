//! Step generators that run while the fault lasts.

use super::*;
use Trouble::{Cut, Deaf, Reset, ResetInStall, Retimed, Stall};

/// Steps that pins make that are released and driven again, and rounding.
const EDGES: f64 = 3.0;

impl<B: Rig> Machine<B> {
    fn stepgen(&self) -> StepgenPins {
        self.generator.expect("a generator")
    }

    /// The steps of the driver, and those of the motor.
    pub(super) fn steps(&mut self) -> (f64, f64) {
        let shown = self.driver.pins().read(self.stepgen().position_fb).value;
        let motor = self.driver.bus_mut().fpga().stepper(1).expect("a motor");
        (shown * SCALE, motor.commanded() as f64)
    }

    pub(super) fn is_step_unsure(&self) -> bool {
        self.driver
            .pins()
            .read(self.stepgen().position_unsure)
            .value
    }

    pub(super) fn run(&mut self, speed: Option<f64>) {
        let (pins, to) = (self.stepgen(), self.driver.pins_mut());
        to.set(pins.control_type, true);
        to.set(pins.enable, speed.is_some());
        to.set(pins.velocity_cmd, speed.unwrap_or_default());
    }

    /// The motor runs at this speed in steps per second while the trouble lasts; `within`: the most
    /// by which the position may be wrong, in steps; `None` for any.
    fn check_steps(&mut self, trouble: Trouble, speed: f64, unsure: bool, within: Option<f64>) {
        let told = format!("{}, {trouble:?}, {speed}", self.name);
        let (shown, motor) = self.steps();
        self.run(Some(speed / SCALE));
        self.cycles(100);
        assert!(!self.is_step_unsure(), "{told}");
        let _ = self.told(Positions::StepGenerators);
        self.happens(trouble);
        self.comes_back();
        self.run(None);
        self.cycles(50);
        assert_eq!(self.is_step_unsure(), unsure, "{told}");
        let (now, motor_now) = self.steps();
        let wrong = (now - shown) - (motor_now - motor);
        if let Some(within) = within {
            assert!(wrong.abs() <= within, "{told}: {wrong}");
        }
        let events = self.told(Positions::StepGenerators);
        assert_eq!(events & 1 != 0, unsure, "{told}");
        let reset = self.stepgen().position_reset;
        self.driver.pins_mut().set(reset, true);
        self.cycles(2);
        self.driver.pins_mut().set(reset, false);
        self.cycles(150);
        assert!(!self.is_step_unsure(), "{told}");
    }

    fn check_all_steps(&mut self) {
        for speed in [5_000.0_f64, -5_000.0, 20_000.0] {
            // Those of a millisecond.
            let estimate = Some(speed.abs() / 1e3 + EDGES);
            // Without a bite.
            self.check_steps(Cut(3), speed, false, Some(1.5));
            self.check_steps(Cut(8), speed, false, Some(1.5));
            self.check_steps(Deaf(8), speed, false, Some(1.5));
            self.check_steps(Stall(50), speed, false, Some(1.5));
            // The bus is down, and the board has its set-up.
            self.check_steps(Cut(75), speed, false, Some(1.5));
            self.check_steps(Deaf(75), speed, false, Some(1.5));
            // With one.
            self.check_steps(Stall(300), speed, true, estimate);
            self.check_steps(Retimed(300), speed, true, estimate);
            self.check_steps(Cut(300), speed, true, estimate);
            self.check_steps(Cut(5_000), speed, true, estimate);
            self.check_steps(Deaf(300), speed, true, estimate);
            self.check_steps(Reset, speed, true, None);
            self.check_steps(ResetInStall(300), speed, true, None);
        }
    }
}

#[test]
fn positions_match_the_motor_after_faults_of_an_embedded_bus() {
    Machine::new(embedded(plain()), "embedded").check_all_steps();
}

#[test]
fn positions_are_those_of_the_motor_after_faults_of_a_network() {
    Machine::new(network(plain()), "network").check_all_steps();
}

#[test]
fn positions_are_those_of_the_motor_after_faults_of_a_pci_bus() {
    Machine::new(pci(plain()), "PCI").check_all_steps();
}
