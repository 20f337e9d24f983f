//! Commands for the remotes, and their display.

use std::fs;
use std::path::Path;

use mesa_hal_sim::{
    devices::{SignalValue, WorldError},
    remote::{Cable, Toward, WireFault, firmware_file},
};

use super::answer::{line, number, on_off, probability, wrong};
use crate::machine::built::Machine;
use crate::machine::slot::Slot;
use crate::ui::files::probe;

/// Executes a command for the remote in a slot.
pub fn command(
    machine: &mut Machine,
    command: &str,
    slot: Slot,
    words: &[&str],
) -> Result<(), String> {
    let now = machine.board.time();
    match (command, words) {
        ("unplug", []) => machine.cable(slot)?.unplug(),
        ("plug", []) => machine.cable(slot)?.replug(),
        ("wire", ["heal"]) => machine.cable(slot)?.heal(),
        ("wire", [toward, fault, how @ ..]) => spoil(machine.cable(slot)?, toward, fault, how)?,
        ("input", [n, state]) => {
            let (n, on) = (number(n)?, on_off(state)?);
            world(machine.device(slot)?.set_input(n, on))?;
        }
        ("volts", [n, volts]) => {
            let (n, volts) = (number(n)?, number(volts)?);
            world(machine.device(slot)?.set_input_volts(n, volts))?;
        }
        ("field", [volts]) => {
            let volts = number(volts)?;
            world(machine.device(slot)?.set_field_volts(now, volts))?;
        }
        ("power", [state]) => machine.device(slot)?.set_power(now, on_off(state)?),
        ("jumper", ["setup"]) => machine.device(slot)?.set_setup_jumper(now, true),
        ("jumper", ["operate"]) => machine.device(slot)?.set_setup_jumper(now, false),
        ("firmware", [revision, file]) => {
            let image = firmware_file(machine.device(slot)?.card(), number(revision)?, 6000);
            let path = Path::new(file);
            let done = if machine.is_rehearsal {
                probe(path)
            } else {
                fs::write(path, image)
            };
            done.map_err(|error| format!("{file}: {error}"))?;
        }
        ("shorted", [n, state]) => {
            let (n, on) = (number(n)?, on_off(state)?);
            world(machine.device(slot)?.set_over_current(n, on))?;
        }
        ("hot", [n, state]) => {
            let (n, on) = (number(n)?, on_off(state)?);
            world(machine.device(slot)?.set_over_temperature(n, on))?;
        }
        _ => return Err(wrong(command)),
    }
    Ok(())
}

fn world(done: Result<(), WorldError>) -> Result<(), String> {
    done.map_err(|error| error.to_string())
}

fn spoil(cable: &mut Cable, toward: &str, fault: &str, how: &[&str]) -> Result<(), String> {
    let toward = match toward {
        "remote" => Toward::Remote,
        "fpga" => Toward::Fpga,
        _ => return Err(format!("`{toward}`: expected remote or fpga")),
    };
    let fault = match fault.split_once('=') {
        None if fault == "lost" => WireFault::Lost,
        None if fault == "corrupted" => WireFault::Corrupted,
        None if fault == "break" => WireFault::Break,
        Some(("short", n)) => WireFault::Short(number(n)?),
        Some(("long", n)) => WireFault::Long(number(n)?),
        Some(("late", us)) => WireFault::Late(u64::from(number::<u32>(us)?) * 1000),
        _ => return Err(format!("`{fault}` is no wire fault; try help")),
    };
    let has_room = match how {
        [count] => cable.inject(toward, fault, number(count)?),
        ["chance", chance] => cable.inject_by_chance(toward, fault, probability(chance)?),
        _ => return Err(wrong("wire")),
    };
    if has_room {
        Ok(())
    } else {
        Err("too many wire faults at a time; `wire CH heal` ends them".to_owned())
    }
}

/// State, inputs and outputs of a remote.
pub fn show(text: &mut String, machine: &mut Machine, slot: Slot) {
    let name = |what: &str| format!("remote.{slot}.{what}");
    let remote = machine
        .description
        .remotes
        .iter()
        .find(|remote| remote.slot == slot);
    if let Some(remote) = remote {
        line(text, &name("device"), &remote.device);
    }
    if let Ok(cable) = machine.cable(slot) {
        line(text, &name("plugged"), u8::from(cable.is_plugged()));
        for (way, toward) in [("requests", Toward::Remote), ("replies", Toward::Fpga)] {
            let counts = cable.counts(toward);
            line(text, &name(&format!("{way}.sent")), counts.bursts);
            line(text, &name(&format!("{way}.intact")), counts.intact);
        }
    }
    let Ok(device) = machine.device(slot) else {
        return;
    };
    line(text, &name("powered"), u8::from(device.is_powered()));
    line(text, &name("mode"), device.mode());
    line(text, &name("revision"), device.revision());
    line(
        text,
        &name("bootloader"),
        u8::from(device.is_in_bootloader()),
    );
    line(
        text,
        &name("faults"),
        format_args!("{:02x}", device.faults().bits()),
    );
    for (parameter, value) in device.parameters() {
        line(text, &name(&format!("parameter.{parameter}")), value);
    }
    for (signal, value) in device.inputs().into_iter().chain(device.outputs()) {
        let value = match value {
            SignalValue::Bool(on) => u8::from(on).to_string(),
            SignalValue::Volts(volts) => format!("{volts:.4}"),
            SignalValue::Count(count) => count.to_string(),
            SignalValue::Number(number) => format!("{number:.6}"),
        };
        line(text, &name(&signal), value);
    }
}
