//! Switches, handwheels and the emergency stop on the inputs of an FPGA and of its remotes.

use super::SimFpga;
use super::fabric::Fabric;
use crate::devices::find_mut;
use crate::modules::Inputs;
use crate::wire::{Nanos, RemoteEnd};
use crate::world::{Change, EstopConfig, SimTerminal, Switch, SwitchConfig, Wheel, WheelConfig};

/// Field power of a remote while an emergency stop does not cut it.
const FIELD_VOLTS: f64 = 24.0;

impl SimFpga {
    /// Wires a switch on an axis to an input, which follows the switch from now on; returns its
    /// index. Plug in the remote first. A switch on an axis that does not exist never changes.
    pub fn add_switch(&mut self, config: SwitchConfig) -> usize {
        self.fabric.settle();
        let position = self.fabric.plant.position(config.axis).unwrap_or(f64::NAN);
        let Fabric { plant, now, .. } = &mut self.fabric;
        let index = plant.installation.add_switch(*now, config, position);
        self.fabric.settle();
        index
    }

    /// The switches, up to date.
    pub fn switches(&mut self) -> &[Switch] {
        self.fabric.settle();
        &self.fabric.plant.installation.switches
    }

    /// Wires a handwheel to two inputs; returns its index.
    pub fn add_wheel(&mut self, config: WheelConfig) -> usize {
        self.fabric.plant.installation.add_wheel(config)
    }

    /// The handwheels, up to date.
    pub fn wheels(&mut self) -> &[Wheel] {
        self.fabric.settle();
        &self.fabric.plant.installation.wheels
    }

    /// Turns a handwheel by clicks, at its speed, from now on. `false` if the wheel does not exist,
    /// or if more than a million clicks would be pending.
    pub fn turn_wheel(&mut self, wheel: usize, clicks: i64) -> bool {
        self.fabric.settle();
        let now = self.fabric.now;
        let wheel = self.fabric.plant.installation.wheels.get_mut(wheel);
        wheel.is_some_and(|wheel| wheel.turn(now, clicks))
    }

    /// Wires a closed emergency-stop chain, in place of the previous one. Plug in the remotes
    /// first.
    pub fn set_estop(&mut self, config: EstopConfig) {
        self.fabric.plant.installation.estop = Some(config);
        self.press_estop(false);
    }

    /// The emergency-stop chain.
    pub fn estop(&self) -> Option<&EstopConfig> {
        self.fabric.plant.installation.estop.as_ref()
    }

    /// True if the emergency stop is pressed.
    pub fn is_estop_pressed(&self) -> bool {
        self.fabric.plant.installation.pressed
    }

    /// Presses or releases the emergency stop; `false` without a chain. Its inputs change at the
    /// same time, and the power that it cuts is switched off or on again.
    pub fn press_estop(&mut self, pressed: bool) -> bool {
        self.fabric.settle();
        let Some(estop) = self.fabric.plant.installation.estop.clone() else {
            return false;
        };
        if estop.cuts_drives {
            self.fabric.plant.power_drives(!pressed);
        }
        for &(port, channel) in &estop.cuts_field {
            let volts = if pressed { 0.0 } else { FIELD_VOLTS };
            let now = self.fabric.now;
            let device = self.fabric.remote_mut(port, channel).and_then(find_mut);
            // A card without field power has nothing to switch.
            let _ = device.map(|device| device.set_field_volts(now, volts));
        }
        self.fabric
            .plant
            .installation
            .press(self.fabric.now, pressed);
        self.fabric.settle();
        true
    }

    /// Sets the signal at an input from now on, like a wire.
    pub fn set_terminal(&mut self, terminal: SimTerminal, on: bool) {
        self.fabric.settle();
        self.fabric.put_on(&Change {
            at: self.fabric.now,
            terminal,
            on,
        });
    }
}

impl Fabric {
    /// Applies the changes of switches and wheels up to now to their inputs, in order.
    pub(super) fn take_signals(&mut self) {
        while let Some(change) = self.plant.installation.take(self.now) {
            self.put_on(&change);
        }
    }

    fn put_on(&mut self, change: &Change) {
        let &Change { at, terminal, on } = change;
        match terminal {
            SimTerminal::Remote {
                port,
                channel,
                input,
            } => {
                let device = self.remote_mut(port, channel).and_then(find_mut);
                // A wire to an input that the card does not have has no effect.
                let _ = device.map(|device| device.set_input(input, on));
            }
            SimTerminal::Board { input } => self.set_input(at, input, on),
            SimTerminal::Pin { pin } => {
                self.io.drive(pin, Some(on));
                self.pin_driven(pin);
            }
        }
    }

    /// Switches the current into an isolated input on or off.
    pub(super) fn set_input(&mut self, at: Nanos, input: usize, on: bool) {
        if let Some(inputs) = self.modules.first_mut::<Inputs>() {
            inputs.set_terminal(at, input, on);
        }
    }

    /// Mutable access to the remote plugged into a channel.
    pub(super) fn remote_mut(&mut self, port: usize, channel: usize) -> Option<&mut dyn RemoteEnd> {
        self.modules.port_mut(port)?.remote_mut(channel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::{SignalValue, find};
    use crate::{Motor, MotorConfig, machines};

    const MS: Nanos = 1_000_000;
    const CHANNEL: usize = 0;
    const ON_BOARD: SimTerminal = SimTerminal::Board { input: 3 };

    fn on_remote(input: usize) -> SimTerminal {
        SimTerminal::Remote {
            port: 0,
            channel: CHANNEL,
            input,
        }
    }

    fn switch(from: f64, terminal: SimTerminal) -> SwitchConfig {
        SwitchConfig {
            axis: 0,
            from,
            to: f64::INFINITY,
            hysteresis: 0.0,
            bounce: 0,
            normally_closed: false,
            terminal,
        }
    }

    fn machine() -> SimFpga {
        let motor = Motor::new(MotorConfig {
            stops: [-1.0, 8.0],
            drag: 50.0,
            ..MotorConfig::default()
        });
        let mut fpga = machines::six_axes_7i97(motor.expect("a motor"));
        fpga.add_switch(switch(5.0, ON_BOARD));
        fpga.add_switch(switch(6.0, on_remote(7)));
        fpga
    }

    fn input(fpga: &SimFpga, n: usize) -> bool {
        let device = fpga.remote(0, CHANNEL).and_then(find).expect("a device");
        device.inputs()[n].1 == SignalValue::Bool(true)
    }

    #[test]
    fn inputs_follow_an_axis_over_its_switches_up_to_the_stop() {
        let mut fpga = machine();
        fpga.motor(0).expect("axis").turn_by_hand(Some(10.0));
        let mut seen = Vec::new();
        for now in 1..=1000 {
            fpga.advance_to(now * MS);
            let board = fpga.inputs().expect("inputs").terminal(3);
            seen.push((board, input(&fpga, 7)));
        }
        // 10 units per second: 5 units after half a second, the stop at 8.
        assert_eq!(seen.iter().filter(|(board, _)| *board).count(), 501);
        assert_eq!(seen.iter().filter(|(_, remote)| *remote).count(), 401);
        assert!(seen.is_sorted(), "each goes on once");
        assert_eq!(fpga.motor(0).expect("axis").position(), 8.0);
        fpga.motor(0).expect("axis").turn_by_hand(Some(-10.0));
        fpga.advance_to(2000 * MS);
        assert!(!fpga.inputs().expect("inputs").terminal(3));
        assert!(!input(&fpga, 7));
    }

    #[test]
    fn input_of_the_board_is_on_in_its_register_at_the_switch() {
        let mut fpga = machine();
        // The address lines of InMux are driven, and its inputs scanned in 50 us, inverted.
        for pin_register in [0x1100, 0x1104, 0x1108, 0x1200, 0x1204, 0x1208] {
            fpga.write_register(pin_register, 0x1_FFFF);
        }
        fpga.write_register(0x8000, 78 << 6 | 1 << 5);
        fpga.motor(0).expect("axis").turn_by_hand(Some(10.0));
        fpga.advance_to(499 * MS);
        assert_eq!(fpga.read_register(0x8300), 0);
        fpga.advance_to(502 * MS);
        assert_eq!(fpga.read_register(0x8300), 1 << 3);
    }

    #[test]
    fn emergency_stop_cuts_everything_in_one_moment() {
        let mut fpga = machine();
        fpga.set_estop(EstopConfig {
            inputs: vec![SimTerminal::Board { input: 9 }, on_remote(20)],
            cuts_drives: true,
            cuts_field: vec![(0, CHANNEL)],
        });
        assert!(fpga.inputs().expect("inputs").terminal(9) && input(&fpga, 20));
        fpga.motor(0).expect("axis").turn_by_hand(Some(10.0));
        fpga.advance_to(700 * MS);
        assert!(input(&fpga, 7));
        fpga.motor(0).expect("axis").turn_by_hand(None);
        assert!(fpga.press_estop(true));
        assert!(!fpga.inputs().expect("inputs").terminal(9));
        assert!(!input(&fpga, 20) && !input(&fpga, 7), "no field power");
        assert!(fpga.inputs().expect("inputs").terminal(3), "of the board");
        // 50 units/s² from 10 units/s: coasts for 0.2 s over 1 unit, up to the stop at 8.
        fpga.advance_to(1000 * MS);
        let motor = fpga.motor(0).expect("axis");
        assert!(!motor.is_powered() && motor.velocity() == 0.0);
        assert!(
            (motor.position() - 8.0).abs() < 1e-3,
            "{}",
            motor.position()
        );
        assert!(fpga.press_estop(false));
        assert!(input(&fpga, 20) && input(&fpga, 7));
        assert!(fpga.motor(0).expect("axis").is_powered());
    }

    #[test]
    fn handwheel_is_counted_by_the_card_it_is_wired_to() {
        let mut fpga = machines::six_axes_7i92(Motor::default());
        fpga.add_wheel(WheelConfig {
            a: on_remote(16),
            b: on_remote(17),
            speed: 100.0,
        });
        let count = |fpga: &SimFpga| {
            let device = fpga.remote(0, CHANNEL).and_then(find).expect("a device");
            let inputs = device.inputs();
            let found = inputs.iter().find(|(name, _)| name == "enc0");
            found.expect("an MPG counter").1
        };
        assert!(fpga.turn_wheel(0, 12));
        fpga.advance_to(200 * MS);
        assert_eq!(count(&fpga), SignalValue::Count(12));
        assert!(fpga.turn_wheel(0, -3));
        fpga.advance_to(400 * MS);
        assert_eq!(count(&fpga), SignalValue::Count(9));
        assert_eq!(fpga.wheels()[0].clicks(), 9);
        assert!(!fpga.turn_wheel(1, 1));
    }

    #[test]
    fn handwheel_loses_supply_in_an_estop_and_has_its_levels_after() {
        let mut fpga = machines::six_axes_7i92(Motor::default());
        fpga.add_wheel(WheelConfig {
            a: on_remote(16),
            b: on_remote(17),
            speed: 250.0,
        });
        fpga.set_estop(EstopConfig {
            inputs: vec![on_remote(20)],
            cuts_drives: false,
            cuts_field: vec![(0, CHANNEL)],
        });
        let levels = |fpga: &SimFpga| [input(fpga, 16), input(fpga, 17)];
        // Edges at 1, 2, 3, 4 ms: A up, B up, A down, B down.
        let course = [[false, false], [true, false], [true, true], [false, true]];
        for (pressed, released) in [(0, 1), (1, 2), (2, 3), (3, 0), (1, 3), (2, 0)] {
            let start = fpga.now();
            assert!(fpga.turn_wheel(0, 3));
            let after = |edges: u64| start + edges * MS + MS / 2;
            fpga.advance_to(after(4 + pressed));
            assert_eq!(levels(&fpga), course[pressed as usize]);
            assert!(fpga.press_estop(true));
            assert_eq!(levels(&fpga), [false; 2], "its supply is off");
            fpga.advance_to(after(8 + released));
            assert_eq!(levels(&fpga), [false; 2], "turned without supply");
            assert!(fpga.press_estop(false));
            assert_eq!(
                levels(&fpga),
                course[released as usize],
                "{pressed} {released}"
            );
            fpga.advance_to(start + 20 * MS);
            assert_eq!(levels(&fpga), course[0]);
        }
    }
}
