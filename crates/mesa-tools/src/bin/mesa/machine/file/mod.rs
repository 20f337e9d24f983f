//! A machine described in a TOML file.
//!
//! An error contains its line, its key and the allowed values; an unknown key is an error.
//! `examples/mill.toml` and `examples/router.toml` have every key.

mod axis;
mod check;
#[cfg(test)]
mod tests;

use std::net::Ipv4Addr;
use std::path::Path;

use mesa_hal_sim::SimTerminal;
use serde::Deserialize;
use toml::Spanned;

use super::boards::Board;
use super::built::Machine;
use super::description::{Axis, Description, Estop, Mac, Remote, Switch, Wheel, Wire, check_slots};
use super::devices;
use super::slot::{PORT, Slot};
use crate::ui::files::bounded;
use axis::AxisTable;
use check::{Lines, Range};

/// Size limit of a description; no real one comes near it.
const MAX_BYTES: u64 = 1 << 20;

/// Limits of switches and handwheels.
const MAX_SWITCHES: usize = 64;
const MAX_WHEELS: usize = 8;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MachineTable {
    board: Option<Spanned<String>>,
    firmware: Option<Spanned<String>>,
    listen: Option<Ipv4Addr>,
    port: Option<u16>,
    mac: Option<Spanned<String>>,
    #[serde(default)]
    remote: Vec<RemoteTable>,
    #[serde(default)]
    axis: Vec<AxisTable>,
    #[serde(default)]
    switch: Vec<SwitchTable>,
    #[serde(default)]
    wheel: Vec<WheelTable>,
    estop: Option<EstopTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RemoteTable {
    #[serde(default)]
    port: u8,
    channel: Spanned<u8>,
    device: Spanned<String>,
    mode: Option<Spanned<u8>>,
    #[serde(default)]
    setup: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SwitchTable {
    name: Spanned<String>,
    axis: Spanned<String>,
    from: Option<Spanned<f64>>,
    to: Option<Spanned<f64>>,
    hysteresis: Option<Spanned<f64>>,
    bounce_ms: Option<Spanned<f64>>,
    #[serde(default)]
    normally_closed: bool,
    wire: Spanned<WireTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WheelTable {
    name: Spanned<String>,
    a: Spanned<WireTable>,
    b: Spanned<WireTable>,
    speed: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EstopTable {
    #[serde(default)]
    inputs: Vec<Spanned<WireTable>>,
    #[serde(default)]
    cuts_drives: bool,
    #[serde(default)]
    cuts_field: Vec<Spanned<Place>>,
}

/// A channel: its number on serial port 0, or `"PORT.CH"`.
#[derive(Deserialize)]
#[serde(untagged)]
enum Place {
    Channel(u8),
    Slot(String),
}

/// An input of a remote, an input of the board, or an I/O pin.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WireTable {
    port: Option<u8>,
    channel: Option<u8>,
    input: Option<u16>,
    pin: Option<u16>,
}

/// Reads the description in a file.
pub fn read(path: &Path) -> Result<Description, String> {
    let in_file = |error: String| format!("{}: {error}", path.display());
    let bytes = bounded(path, MAX_BYTES).map_err(|error| in_file(error.to_string()))?;
    let text = String::from_utf8(bytes);
    let text = text.map_err(|error| in_file(format!("no description of a machine: {error}")))?;
    let directory = path.parent().unwrap_or(Path::new(""));
    parse(&text, directory).map_err(in_file)
}

/// Parses a description; the files that it names are in `directory`.
fn parse(text: &str, directory: &Path) -> Result<Description, String> {
    let lines = Lines(text);
    let file: MachineTable = toml::from_str(text).map_err(|error| lines.not_toml(&error))?;
    let base = base(&lines, &file, directory)?;
    let mac = file.mac.as_ref().map(|mac| {
        let parsed: Result<Mac, String> = mac.get_ref().parse();
        parsed.map_err(|reason| lines.wrong(mac, "mac", &reason))
    });
    let remotes = remotes(&lines, &base.channels()?, &file.remote, directory)?;
    let axes = axis::axes(&lines, &file.axis, base.board)?;
    let machine = Description {
        listen: file.listen,
        port: file.port,
        mac: mac.transpose()?,
        remotes,
        switches: switches(&lines, &file.switch, &axes)?,
        axes,
        wheels: wheels(&lines, &file.wheel)?,
        estop: file.estop.map(|estop| chain(&lines, &estop)).transpose()?,
        ..base
    };
    // Building the machine checks the inputs and pins, which only the board knows.
    Machine::new(&machine).map_err(|error| error.to_string())?;
    Ok(machine)
}

/// The board by its name, or any board by the image of its firmware, with nothing connected.
fn base(lines: &Lines<'_>, file: &MachineTable, directory: &Path) -> Result<Description, String> {
    let keys = "allowed is one of `board` and `firmware`: the name of a board, or a file with the \
                identity memory of its firmware";
    match (&file.board, &file.firmware) {
        (Some(name), None) => {
            let board = Board::named(name.get_ref()).ok_or_else(|| {
                let allowed = format!("allowed are {}", Board::names());
                lines.wrong(name, "board", &allowed)
            })?;
            Description::of_board(board, Vec::new())
        }
        (None, Some(image)) => {
            let path = directory.join(image.get_ref());
            Description::of_firmware(&path, Vec::new())
                .map_err(|error| lines.wrong(image, "firmware", &error))
        }
        (Some(_), Some(image)) => Err(lines.wrong(image, "firmware", keys)),
        (None, None) => Err(format!("no board: {keys}")),
    }
}

fn remotes(
    lines: &Lines<'_>,
    channels: &[u8],
    tables: &[RemoteTable],
    directory: &Path,
) -> Result<Vec<Remote>, String> {
    let mut remotes = Vec::new();
    for table in tables {
        let device = table.device.get_ref();
        let device = if devices::is_known(device) {
            device.clone()
        } else {
            directory.join(device).display().to_string()
        };
        devices::build(&device, None, 0)
            .map_err(|error| lines.wrong(&table.device, "remote.device", &error.to_string()))?;
        if let Some(mode) = &table.mode {
            devices::build(&device, Some(*mode.get_ref()), 0)
                .map_err(|error| lines.wrong(mode, "remote.mode", &error.to_string()))?;
        }
        remotes.push(Remote {
            slot: Slot {
                port: table.port,
                channel: *table.channel.get_ref(),
            },
            device,
            mode: table.mode.as_ref().map(|mode| *mode.get_ref()),
            setup: table.setup,
        });
        check_slots(channels, &remotes)
            .map_err(|reason| lines.wrong(&table.channel, "remote.channel", &reason))?;
    }
    Ok(remotes)
}

fn switches(
    lines: &Lines<'_>,
    tables: &[SwitchTable],
    axes: &[Axis],
) -> Result<Vec<Switch>, String> {
    let mut switches: Vec<Switch> = Vec::new();
    for table in tables {
        let names = switches.iter().map(|switch| switch.name.as_str());
        let name = lines.name(&table.name, "switch.name", names)?;
        if switches.len() == MAX_SWITCHES {
            let reason = format!("allowed are {MAX_SWITCHES} switches");
            return Err(lines.wrong(&table.name, "switch.name", &reason));
        }
        let wanted = table.axis.get_ref();
        let axis = axes.iter().position(|axis| axis.name == *wanted);
        let axis = axis.ok_or_else(|| {
            let names: Vec<_> = axes.iter().map(|axis| axis.name.as_str()).collect();
            let reason = format!("there is no such axis; there are: {}", names.join(", "));
            lines.wrong(&table.axis, "switch.axis", &reason)
        })?;
        let end = |value: &Option<Spanned<f64>>, key: &str, none: f64| {
            let value = value.as_ref();
            value.map_or(Ok(none), |value| lines.number(value, key, Range::POSITION))
        };
        let from = end(&table.from, "switch.from", f64::NEG_INFINITY)?;
        let to = end(&table.to, "switch.to", f64::INFINITY)?;
        if (table.from.is_none() && table.to.is_none()) || from > to {
            let reason =
                "it needs `from`, `to` or both: the positions between which it is actuated";
            return Err(lines.wrong(&table.name, "switch.name", reason));
        }
        let number = |value: &Option<Spanned<f64>>, key: &str, range: Range| {
            let value = value.as_ref();
            value.map_or(Ok(0.0), |value| lines.number(value, key, range))
        };
        switches.push(Switch {
            name,
            axis,
            from,
            to,
            hysteresis: number(&table.hysteresis, "switch.hysteresis", Range::NOT_NEGATIVE)?,
            bounce_ms: number(&table.bounce_ms, "switch.bounce_ms", Range::BOUNCE)?,
            normally_closed: table.normally_closed,
            wire: wire(lines, &table.wire, "switch.wire")?,
        });
    }
    Ok(switches)
}

fn wheels(lines: &Lines<'_>, tables: &[WheelTable]) -> Result<Vec<Wheel>, String> {
    let mut wheels: Vec<Wheel> = Vec::new();
    for table in tables {
        let names = wheels.iter().map(|wheel| wheel.name.as_str());
        let name = lines.name(&table.name, "wheel.name", names)?;
        if wheels.len() == MAX_WHEELS {
            let reason = format!("allowed are {MAX_WHEELS} handwheels");
            return Err(lines.wrong(&table.name, "wheel.name", &reason));
        }
        let speed = table.speed.as_ref();
        wheels.push(Wheel {
            name,
            a: wire(lines, &table.a, "wheel.a")?,
            b: wire(lines, &table.b, "wheel.b")?,
            speed: speed.map_or(Ok(100.0), |speed| {
                lines.number(speed, "wheel.speed", Range::CLICKS)
            })?,
        });
    }
    Ok(wheels)
}

fn chain(lines: &Lines<'_>, table: &EstopTable) -> Result<Estop, String> {
    let inputs = table.inputs.iter();
    let inputs = inputs.map(|input| wire(lines, input, "estop.inputs"));
    let cut = |place: &Spanned<Place>| {
        let slot = match place.get_ref() {
            Place::Channel(channel) => Ok(Slot::channel(*channel)),
            Place::Slot(text) => text.parse(),
        };
        let slot = slot.map_err(|error| lines.wrong(place, "estop.cuts_field", &error))?;
        Ok::<_, String>((slot, lines.number_of(place.span().start)))
    };
    Ok(Estop {
        inputs: inputs.collect::<Result<_, _>>()?,
        cuts_drives: table.cuts_drives,
        cuts_field: table.cuts_field.iter().map(cut).collect::<Result<_, _>>()?,
    })
}

fn wire(lines: &Lines<'_>, table: &Spanned<WireTable>, key: &str) -> Result<Wire, String> {
    let terminal = match *table.get_ref() {
        WireTable {
            port,
            channel: Some(channel),
            input: Some(input),
            pin: None,
        } => SimTerminal::Remote {
            port: port.unwrap_or(PORT).into(),
            channel: channel.into(),
            input: input.into(),
        },
        WireTable {
            port: None,
            channel: None,
            input: Some(input),
            pin: None,
        } => SimTerminal::Board {
            input: input.into(),
        },
        WireTable {
            port: None,
            channel: None,
            input: None,
            pin: Some(pin),
        } => SimTerminal::Pin { pin: pin.into() },
        _ => {
            let allowed = "allowed are { channel = CH, input = N } for an input of a remote (with \
                           port = P on a serial port other than 0), { input = N } for one of the board, { pin = N } for an I/O pin";
            return Err(lines.wrong(table, key, allowed));
        }
    };
    Ok(Wire {
        terminal,
        line: lines.number_of(table.span().start),
    })
}
