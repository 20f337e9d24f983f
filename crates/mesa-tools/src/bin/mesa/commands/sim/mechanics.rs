//! Commands for motors, handwheels and emergency stop, and the display of the mechanics.

use mesa_hal_sim::{Motor, SimFpga};

use super::answer::{line, number, on_off};
use crate::machine::built::Machine;

/// Speed limit of a motor turned by hand: above any real one, and low enough that positions stay
/// finite numbers.
const FASTEST: f64 = 1e6;

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
    let names = machine
        .description
        .wheels
        .iter()
        .map(|wheel| wheel.name.as_str());
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
    let names = machine
        .description
        .axes
        .iter()
        .map(|axis| axis.name.as_str());
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
    let described = machine.description.clone();
    let fpga = machine.fpga();
    for axis in 0..fpga.axes() {
        if let Some(described) = described.axes.get(axis) {
            line(text, &format!("motor.{axis}.name"), &described.name);
        }
        show_motor(text, fpga, axis);
    }
    for (switch, described) in fpga.switches().iter().zip(&described.switches) {
        let state = u8::from(switch.is_actuated());
        line(text, &format!("switch.{}", described.name), state);
    }
    for (wheel, described) in fpga.wheels().iter().zip(&described.wheels) {
        line(
            text,
            &format!("wheel.{}.clicks", described.name),
            wheel.clicks(),
        );
        let turning = u8::from(wheel.is_turning());
        line(text, &format!("wheel.{}.turning", described.name), turning);
    }
    if fpga.estop().is_some() {
        line(text, "estop", u8::from(fpga.is_estop_pressed()));
    }
}

/// Index of the item that a word names, by its name or by its number.
fn index_of<'a>(
    what: &str,
    word: &str,
    names: impl ExactSizeIterator<Item = &'a str>,
    count: usize,
) -> Result<usize, String> {
    let names: Vec<&str> = names.collect();
    let by_number = word.parse().ok().filter(|&index| index < count);
    let index = names.iter().position(|name| *name == word).or(by_number);
    index.ok_or_else(|| match (count, names.is_empty()) {
        (0, _) => format!("there is no {what} `{word}`: this machine has none"),
        (_, true) => format!("there is no {what} {word}: there are 0 to {}", count - 1),
        (_, false) => format!(
            "there is no {what} `{word}`: there are {}",
            names.join(", ")
        ),
    })
}
