//! Motors, switches, handwheels and emergency stop of a machine: construction from its plan,
//! display and console commands.

use std::fmt::Write;
use std::time::Duration;

use mesa_hal_sim::{
    AxisWiring, DriveSource, EstopConfig, Inputs, Motor, OUTPUT_PIN, SimFpga, SimTerminal, Stepper,
    StepperWiring, SwitchConfig, WheelConfig, machines,
};

use super::console::{line, number, on_off};
use super::devices;
use super::machine::Machine;
use super::options::Board;
use super::plan::{MoverPlan, Plan, Wire, index_of};
use super::slot::Slot;

/// Speed limit of a motor turned by hand: above any real one, and low enough that positions stay
/// finite numbers.
const FASTEST: f64 = 1e6;

/// Analog outputs of a 7I77.
const OUTPUTS_7I77: u8 = 6;

/// Builds the mechanics of the machine's plan. Without axes, a motor on each analog output turns
/// the encoder of the same number, and each step generator has a stepper motor.
pub fn build(machine: &mut Machine) -> Result<(), String> {
    let plan = machine.plan.clone();
    wire_motors(machine, &plan);
    check_wires(machine, &plan)?;
    for switch in &plan.switches {
        let bounce = Duration::from_secs_f64(switch.bounce_ms / 1e3);
        machine.fpga().add_switch(SwitchConfig {
            axis: switch.axis,
            from: switch.from,
            to: switch.to,
            hysteresis: switch.hysteresis,
            bounce: bounce.as_nanos() as u64,
            normally_closed: switch.normally_closed,
            terminal: switch.wire.terminal,
        });
    }
    for wheel in &plan.wheels {
        machine.fpga().add_wheel(WheelConfig {
            a: wheel.a.terminal,
            b: wheel.b.terminal,
            speed: wheel.speed,
        });
    }
    if let Some(estop) = &plan.estop {
        for &(slot, line) in &estop.cuts_field {
            let device = machine.device(slot);
            device.map_err(|error| format!("line {line}: estop.cuts_field: {error}"))?;
        }
        let slots = estop.cuts_field.iter();
        machine.fpga().set_estop(EstopConfig {
            inputs: estop.inputs.iter().map(|wire| wire.terminal).collect(),
            cuts_drives: estop.cuts_drives,
            cuts_field: slots.map(|(slot, _)| slot.indices()).collect(),
        });
    }
    Ok(())
}

/// Checks that each wire has a terminal of its own.
fn check_wires(machine: &mut Machine, plan: &Plan) -> Result<(), String> {
    let mut wires: Vec<Wire> = plan.switches.iter().map(|switch| switch.wire).collect();
    wires.extend(plan.wheels.iter().flat_map(|wheel| [wheel.a, wheel.b]));
    wires.extend(plan.estop.iter().flat_map(|estop| &estop.inputs));
    for (number, wire) in wires.iter().enumerate() {
        let line = wire.line;
        check(machine, wire.terminal).map_err(|error| format!("line {line}: {error}"))?;
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

fn wire_motors(machine: &mut Machine, plan: &Plan) {
    if plan.axes.is_empty() {
        for mover in usual_axes(machine.kind) {
            wire_motor(machine, &mover);
        }
    }
    for axis in &plan.axes {
        wire_motor(machine, &axis.mover);
    }
}

/// A motor on each output and generator: first the outputs of the board and of its 7I77, then the
/// generators and the spindle of its 7I76.
fn usual_axes(kind: Board) -> Vec<MoverPlan> {
    let servo = |output| MoverPlan::Servo {
        output,
        encoder: output.into(),
        motor: Motor::default(),
    };
    let stepper = |generator| MoverPlan::Stepper {
        generator,
        encoder: None,
        motor: Stepper::default(),
    };
    let outputs = kind.outputs() as u8;
    let spindle = kind.spindle();
    let servos = (0..outputs).filter(|&output| Some(output) != spindle);
    let steppers = (0..kind.generators()).map(stepper);
    let servos = servos.map(servo).chain(steppers);
    servos.chain(spindle.map(servo)).collect()
}

fn wire_motor(machine: &mut Machine, mover: &MoverPlan) {
    match *mover {
        MoverPlan::Servo {
            output,
            encoder,
            motor,
        } => {
            let source = source(machine, output);
            machine.fpga().wire_axis(AxisWiring {
                source,
                encoder,
                motor,
            });
        }
        MoverPlan::Stepper {
            generator,
            encoder,
            motor,
        } => {
            machine.fpga().wire_stepper(StepperWiring {
                generator,
                encoder,
                motor,
            });
        }
    }
}

/// An analog output of the board or of its cards.
fn source(machine: &Machine, output: u8) -> DriveSource {
    let kind = machine.kind;
    let Some(of_card) = output.checked_sub(kind.own_outputs()) else {
        return DriveSource::Pwm {
            unit: output.into(),
        };
    };
    let on = |device: &str, card: u8| {
        let remotes = machine.remotes.iter();
        let mut found = remotes.filter(|remote| remote.device == device);
        found.nth(card.into()).map(|remote| remote.slot.indices())
    };
    let source = if kind.spindle() == Some(output) {
        let spindle = on(devices::I7I76, 0);
        spindle.map(|(port, channel)| machines::spindle_7i76(port, channel))
    } else {
        let analog = on(devices::ANALOG, of_card / OUTPUTS_7I77);
        analog.map(|(port, channel)| machines::output_7i77(port, channel, of_card % OUTPUTS_7I77))
    };
    source.unwrap_or(DriveSource::Nothing)
}

/// Checks that an input exists.
fn check(machine: &mut Machine, terminal: SimTerminal) -> Result<(), String> {
    match terminal {
        SimTerminal::Remote { input, .. } => {
            let slot = Slot::of(terminal).ok_or("no such channel")?;
            let device = machine.device(slot)?;
            let done = device.set_input(input, false);
            done.map_err(|error| format!("channel {slot}: {error}"))
        }
        SimTerminal::Board { input } => {
            let count = machine.fpga().inputs().map_or(0, Inputs::count);
            if input < count {
                Ok(())
            } else {
                Err(format!("input {input}: this board has {count}"))
            }
        }
        SimTerminal::Pin { pin } => {
            let pins = &machine.fpga().firmware().pins;
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

/// Readable list of the plan's items.
pub fn inventory(plan: &Plan, text: &mut String) {
    for (number, axis) in plan.axes.iter().enumerate() {
        let driven = match axis.mover {
            MoverPlan::Servo { output, .. } => format!("analog output {output}"),
            MoverPlan::Stepper { generator, .. } => format!("step generator {generator}"),
        };
        let encoder = axis.mover.encoder();
        let encoder = encoder.map_or_else(String::new, |n| format!(", encoder {n}"));
        let _ = writeln!(text, "axis {number}: {}, {driven}{encoder}", axis.name);
    }
    for switch in &plan.switches {
        let axis = plan.axes.get(switch.axis).map_or("", |axis| &axis.name);
        let wire = place(switch.wire.terminal);
        let _ = writeln!(text, "switch {} on axis {axis}: {wire}", switch.name);
    }
    for wheel in &plan.wheels {
        let (a, b) = (place(wheel.a.terminal), place(wheel.b.terminal));
        let _ = writeln!(text, "handwheel {}: {a} and {b}", wheel.name);
    }
    if let Some(estop) = &plan.estop {
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

/// Turns a motor by hand, or releases it.
pub fn turn(machine: &mut Machine, axis: &str, speed: &str) -> Result<(), String> {
    let speed = match speed {
        "free" => None,
        _ => Some(number::<f64>(speed)?),
    };
    if speed.is_some_and(|speed| !(-FASTEST..=FASTEST).contains(&speed)) {
        return Err(format!("expected a speed from -{FASTEST} to {FASTEST}"));
    }
    servo(machine, axis)?.turn_by_hand(speed);
    Ok(())
}

/// Jams an axis, or releases it.
pub fn stall(machine: &mut Machine, axis: &str, state: &str) -> Result<(), String> {
    let blocked = on_off(state)?;
    servo(machine, axis)?.block(blocked);
    Ok(())
}

/// Turns a handwheel.
pub fn turn_wheel(machine: &mut Machine, clicks: &str, wheel: &str) -> Result<(), String> {
    let clicks: i64 = number(clicks)?;
    let names = machine.plan.wheels.iter().map(|wheel| wheel.name.as_str());
    let count = names.len();
    let wheel = index_of("handwheel", wheel, names, count)?;
    if machine.fpga().turn_wheel(wheel, clicks) {
        Ok(())
    } else {
        Err("no more than a million clicks wait to be turned".to_owned())
    }
}

/// Presses the emergency stop (`on`), or releases it.
pub fn estop(machine: &mut Machine, state: &str) -> Result<(), String> {
    if machine.fpga().press_estop(on_off(state)?) {
        Ok(())
    } else {
        Err("this machine has no emergency stop".to_owned())
    }
}

/// The motor of an axis, which is no stepper motor.
fn servo<'a>(machine: &'a mut Machine, axis: &str) -> Result<&'a mut Motor, String> {
    let number = axis_of(machine, axis)?;
    let motor = machine.fpga().motor(number);
    motor.ok_or_else(|| format!("axis {axis} has a stepper motor, which pulses alone turn"))
}

fn axis_of(machine: &mut Machine, word: &str) -> Result<usize, String> {
    let count = machine.fpga().axes();
    let names = machine.plan.axes.iter().map(|axis| axis.name.as_str());
    index_of("axis", word, names, count)
}

/// The motor of an axis, of either kind.
fn show_motor(text: &mut String, fpga: &mut SimFpga, axis: usize) {
    let name = |what: &str| format!("motor.{axis}.{what}");
    let mut number = |what: &str, value: f64| line(text, &name(what), format_args!("{value:.4}"));
    if let Some(motor) = fpga.stepper(axis).copied() {
        number("position", motor.position());
        number("velocity", motor.velocity());
        number("counts", motor.counts());
        line(text, &name("steps"), motor.steps());
        line(text, &name("commanded-steps"), motor.commanded());
        line(text, &name("lost-steps"), motor.lost());
        line(text, &name("overshot-steps"), motor.overshot());
        line(text, &name("powered"), u8::from(motor.is_powered()));
        return;
    }
    let signal = fpga.drive_signal(axis).unwrap_or_default();
    let Some(motor) = fpga.motor(axis) else {
        return;
    };
    number("position", motor.position());
    number("velocity", motor.velocity());
    number("counts", motor.counts());
    number("volts", signal.volts);
    let states = [
        ("enabled", signal.enabled),
        ("powered", motor.is_powered()),
        ("stalled", motor.is_blocked()),
        ("at-stop", motor.is_at_stop()),
    ];
    for (what, state) in states {
        line(text, &name(what), u8::from(state));
    }
}

/// Motors, switches, handwheels and emergency stop.
pub fn show(text: &mut String, machine: &mut Machine) {
    let plan = machine.plan.clone();
    let fpga = machine.fpga();
    for axis in 0..fpga.axes() {
        if let Some(plan) = plan.axes.get(axis) {
            line(text, &format!("motor.{axis}.name"), &plan.name);
        }
        show_motor(text, fpga, axis);
    }
    for (switch, plan) in fpga.switches().iter().zip(&plan.switches) {
        let state = u8::from(switch.is_actuated());
        line(text, &format!("switch.{}", plan.name), state);
    }
    for (wheel, plan) in fpga.wheels().iter().zip(&plan.wheels) {
        line(text, &format!("wheel.{}.clicks", plan.name), wheel.clicks());
        let turning = u8::from(wheel.is_turning());
        line(text, &format!("wheel.{}.turning", plan.name), turning);
    }
    if fpga.estop().is_some() {
        line(text, "estop", u8::from(fpga.is_estop_pressed()));
    }
}
