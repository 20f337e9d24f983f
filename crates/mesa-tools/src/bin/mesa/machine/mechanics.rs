//! Motors, switches, handwheels and emergency stop of a machine: construction from its
//! description.

use std::fmt::Write;
use std::time::Duration;

use mesa_hal_sim::{
    AxisWiring, DriveSource, EstopConfig, Inputs, Motor, OUTPUT_PIN, SimFpga, SimTerminal, Stepper,
    StepperWiring, SwitchConfig, WheelConfig, machines,
};

use super::boards::Board;
use super::description::{Description, Mover, Wire};
use super::devices::{self, device};
use super::slot::Slot;

/// Analog outputs of a 7I77.
const OUTPUTS_7I77: u8 = 6;

/// Builds the mechanics of a machine, whose remotes are plugged in. Without axes, a motor on each
/// analog output turns the encoder of the same number, and each step generator has a stepper motor.
pub fn build(fpga: &mut SimFpga, machine: &Description) -> Result<(), String> {
    wire_motors(fpga, machine);
    check_wires(fpga, machine)?;
    for switch in &machine.switches {
        let bounce = Duration::from_secs_f64(switch.bounce_ms / 1e3);
        fpga.add_switch(SwitchConfig {
            axis: switch.axis,
            from: switch.from,
            to: switch.to,
            hysteresis: switch.hysteresis,
            bounce: bounce.as_nanos() as u64,
            normally_closed: switch.normally_closed,
            terminal: switch.wire.terminal,
        });
    }
    for wheel in &machine.wheels {
        fpga.add_wheel(WheelConfig {
            a: wheel.a.terminal,
            b: wheel.b.terminal,
            speed: wheel.speed,
        });
    }
    if let Some(estop) = &machine.estop {
        for &(slot, line) in &estop.cuts_field {
            let device = device(fpga, slot);
            device.map_err(|error| format!("line {line}: estop.cuts_field: {error}"))?;
        }
        let slots = estop.cuts_field.iter();
        fpga.set_estop(EstopConfig {
            inputs: estop.inputs.iter().map(|wire| wire.terminal).collect(),
            cuts_drives: estop.cuts_drives,
            cuts_field: slots.map(|(slot, _)| slot.indices()).collect(),
        });
    }
    Ok(())
}

/// Checks that each wire has a terminal of its own.
fn check_wires(fpga: &mut SimFpga, machine: &Description) -> Result<(), String> {
    let switches = machine.switches.iter();
    let mut wires: Vec<Wire> = switches.map(|switch| switch.wire).collect();
    wires.extend(machine.wheels.iter().flat_map(|wheel| [wheel.a, wheel.b]));
    wires.extend(machine.estop.iter().flat_map(|estop| &estop.inputs));
    for (number, wire) in wires.iter().enumerate() {
        let line = wire.line;
        check(fpga, wire.terminal).map_err(|error| format!("line {line}: {error}"))?;
        let mut before = wires.iter().take(number);
        if let Some(other) = before.find(|other| other.terminal == wire.terminal) {
            return Err(format!(
                "line {line}: {} has a wire already, in line {}",
                place(wire.terminal),
                other.line
            ));
        }
    }
    Ok(())
}

fn wire_motors(fpga: &mut SimFpga, machine: &Description) {
    if machine.axes.is_empty() {
        for mover in usual_axes(machine.board) {
            wire_motor(fpga, machine, &mover);
        }
    }
    for axis in &machine.axes {
        wire_motor(fpga, machine, &axis.mover);
    }
}

/// A motor on each output and generator: first the outputs of the board and of its 7I77, then the
/// generators and the spindle of its 7I76.
fn usual_axes(board: &Board) -> Vec<Mover> {
    let servo = |output| Mover::Servo {
        output,
        encoder: output.into(),
        motor: Motor::default(),
    };
    let stepper = |generator| Mover::Stepper {
        generator,
        encoder: None,
        motor: Stepper::default(),
    };
    let spindle = board.spindle();
    let servos = (0..board.outputs).filter(|&output| Some(output) != spindle);
    let steppers = (0..board.generators).map(stepper);
    let servos = servos.map(servo).chain(steppers);
    servos.chain(spindle.map(servo)).collect()
}

fn wire_motor(fpga: &mut SimFpga, machine: &Description, mover: &Mover) {
    match *mover {
        Mover::Servo {
            output,
            encoder,
            motor,
        } => {
            let source = source(machine, output);
            fpga.wire_axis(AxisWiring {
                source,
                encoder,
                motor,
            });
        }
        Mover::Stepper {
            generator,
            encoder,
            motor,
        } => {
            fpga.wire_stepper(StepperWiring {
                generator,
                encoder,
                motor,
            });
        }
    }
}

/// An analog output of the board or of its cards.
fn source(machine: &Description, output: u8) -> DriveSource {
    let board = machine.board;
    let Some(of_card) = output.checked_sub(board.own_outputs) else {
        return DriveSource::Pwm {
            unit: output.into(),
        };
    };
    let on = |device: &str, card: u8| {
        let remotes = machine.remotes.iter();
        let mut found = remotes.filter(|remote| remote.device == device);
        found.nth(card.into()).map(|remote| remote.slot.indices())
    };
    let source = if board.spindle() == Some(output) {
        let spindle = on(devices::I7I76, 0);
        spindle.map(|(port, channel)| machines::spindle_7i76(port, channel))
    } else {
        let analog = on(devices::ANALOG, of_card / OUTPUTS_7I77);
        analog.map(|(port, channel)| machines::output_7i77(port, channel, of_card % OUTPUTS_7I77))
    };
    source.unwrap_or(DriveSource::Nothing)
}

/// Checks that an input exists.
fn check(fpga: &mut SimFpga, terminal: SimTerminal) -> Result<(), String> {
    match terminal {
        SimTerminal::Remote { input, .. } => {
            let slot = Slot::of(terminal).ok_or("no such channel")?;
            let device = device(fpga, slot)?;
            let done = device.set_input(input, false);
            done.map_err(|error| format!("channel {slot}: {error}"))
        }
        SimTerminal::Board { input } => {
            let count = fpga.inputs().map_or(0, Inputs::count);
            if input < count {
                Ok(())
            } else {
                Err(format!("input {input}: this board has {count}"))
            }
        }
        SimTerminal::Pin { pin } => {
            let pins = &fpga.firmware().pins;
            match pins.get(pin) {
                None => Err(format!("pin {pin}: this board has {}", pins.len())),
                Some(found) if found.secondary != 0 && found.pin & OUTPUT_PIN != 0 => Err(format!(
                    "pin {pin}: it is an output of a module of the firmware; `mesa info` lists them"
                )),
                Some(_) => Ok(()),
            }
        }
    }
}

/// Readable list of axes, switches, handwheels and emergency stop.
pub fn inventory(machine: &Description, text: &mut String) {
    for (number, axis) in machine.axes.iter().enumerate() {
        let driven = match axis.mover {
            Mover::Servo { output, .. } => format!("analog output {output}"),
            Mover::Stepper { generator, .. } => format!("step generator {generator}"),
        };
        let encoder = axis.mover.encoder();
        let encoder = encoder.map_or_else(String::new, |n| format!(", encoder {n}"));
        let _ = writeln!(text, "axis {number}: {}, {driven}{encoder}", axis.name);
    }
    for switch in &machine.switches {
        let axis = machine.axes.get(switch.axis).map_or("", |axis| &axis.name);
        let wire = place(switch.wire.terminal);
        let _ = writeln!(text, "switch {} on axis {axis}: {wire}", switch.name);
    }
    for wheel in &machine.wheels {
        let (a, b) = (place(wheel.a.terminal), place(wheel.b.terminal));
        let _ = writeln!(text, "handwheel {}: {a} and {b}", wheel.name);
    }
    if let Some(estop) = &machine.estop {
        let places = estop.inputs.iter().map(|wire| place(wire.terminal));
        let places: Vec<_> = places.collect();
        let _ = writeln!(text, "emergency stop: {}", places.join(", "));
    }
}

fn place(terminal: SimTerminal) -> String {
    match terminal {
        SimTerminal::Remote { input, .. } => match Slot::of(terminal) {
            Some(slot) => format!("channel {slot} input {input}"),
            None => format!("input {input} of no channel"),
        },
        SimTerminal::Board { input } => format!("input {input} of the board"),
        SimTerminal::Pin { pin } => format!("pin {pin}"),
    }
}
