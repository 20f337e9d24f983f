//! Motors, switches, handwheels and emergency stop of a machine: construction from its plan,
//! display and console commands.

use std::fmt::Write;
use std::time::Duration;

use mesa_hal_sim::{
    AxisWiring, DriveSource, EstopConfig, Inputs, Motor, OUTPUT_PIN, SimTerminal, SwitchConfig,
    WheelConfig, machines,
};

use super::console::{line, number, on_off};
use super::devices;
use super::machine::{Machine, PORT};
use super::plan::{Plan, Wire, index_of};

/// Speed limit of a motor turned by hand: above any real one, and low enough that positions stay
/// finite numbers.
const FASTEST: f64 = 1e6;

/// Analog outputs of a 7I77.
const OUTPUTS_7I77: u8 = 6;

/// Builds the mechanics of the machine's plan. Without axes, a motor on each analog output turns
/// the encoder of the same number.
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
        for &(channel, line) in &estop.cuts_field {
            let device = machine.device(channel.into());
            device.map_err(|error| format!("line {line}: estop.cuts_field: {error}"))?;
        }
        let channels = estop.cuts_field.iter();
        machine.fpga().set_estop(EstopConfig {
            inputs: estop.inputs.iter().map(|wire| wire.terminal).collect(),
            cuts_drives: estop.cuts_drives,
            cuts_field: channels
                .map(|&(channel, _)| (PORT, channel.into()))
                .collect(),
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
    let remotes = machine.remotes.iter();
    let analog = remotes.filter(|remote| remote.device == devices::ANALOG);
    let analog: Vec<_> = analog.map(|remote| remote.channel).collect();
    let (kind, own) = (machine.kind, machine.kind.own_outputs());
    let mut wire = |output: u8, encoder: usize, motor: Motor| {
        let of_card = |output: u8| {
            let card = analog.get(usize::from(output / OUTPUTS_7I77));
            card.map(|&channel| machines::output_7i77(PORT, channel, output % OUTPUTS_7I77))
        };
        let source = match output.checked_sub(own) {
            None => DriveSource::Pwm {
                unit: output.into(),
            },
            Some(output) => of_card(output).unwrap_or(DriveSource::Nothing),
        };
        machine.fpga().wire_axis(AxisWiring {
            source,
            encoder,
            motor,
        });
    };
    if plan.axes.is_empty() {
        for output in 0..kind.axes() as u8 {
            wire(output, output.into(), Motor::default());
        }
    }
    for axis in &plan.axes {
        wire(axis.output, axis.encoder, axis.motor);
    }
}

/// Checks that an input exists.
fn check(machine: &mut Machine, terminal: SimTerminal) -> Result<(), String> {
    match terminal {
        SimTerminal::Remote { channel, input, .. } => {
            let device = machine.device(channel)?;
            let done = device.set_input(input, false);
            done.map_err(|error| format!("channel {channel}: {error}"))
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
        let (name, output, encoder) = (&axis.name, axis.output, axis.encoder);
        let _ = writeln!(
            text,
            "axis {number}: {name}, analog output {output}, encoder {encoder}"
        );
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
        SimTerminal::Remote { channel, input, .. } => format!("channel {channel} input {input}"),
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
    let axis = axis_of(machine, axis)?;
    if let Some(motor) = machine.fpga().motor(axis) {
        motor.turn_by_hand(speed);
    }
    Ok(())
}

/// Jams an axis, or releases it.
pub fn stall(machine: &mut Machine, axis: &str, state: &str) -> Result<(), String> {
    let (axis, blocked) = (axis_of(machine, axis)?, on_off(state)?);
    if let Some(motor) = machine.fpga().motor(axis) {
        motor.block(blocked);
    }
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

fn axis_of(machine: &mut Machine, word: &str) -> Result<usize, String> {
    let count = machine.fpga().axes();
    let names = machine.plan.axes.iter().map(|axis| axis.name.as_str());
    index_of("axis", word, names, count)
}

/// Motors, switches, handwheels and emergency stop.
pub fn show(text: &mut String, machine: &mut Machine) {
    let plan = machine.plan.clone();
    let fpga = machine.fpga();
    for axis in 0..fpga.axes() {
        let signal = fpga.drive_signal(axis).unwrap_or_default();
        let Some(motor) = fpga.motor(axis) else {
            continue;
        };
        let name = |what: &str| format!("motor.{axis}.{what}");
        if let Some(plan) = plan.axes.get(axis) {
            line(text, &name("name"), &plan.name);
        }
        for (what, value) in [
            ("position", motor.position()),
            ("velocity", motor.velocity()),
            ("counts", motor.counts()),
            ("volts", signal.volts),
        ] {
            line(text, &name(what), format_args!("{value:.4}"));
        }
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
