//! Console commands.

use mesa_hal_sim::{UdpCounters, UdpFace};

use super::agenda::parse_time;
use super::answer::{Answer, line, number, on_off, probability, wrong};
use super::face::Face;
use super::{mechanics, remotes};
use crate::board::pattern::is_match;
use crate::machine::built::Machine;
use crate::machine::slot::Slot;

pub const HELP: &str = "\
help                       this text
show [all|network|board|motors|time|CH|PATTERN]
                           outputs, motors, counters; without anything: all. PATTERN:
                           names with *, such as motor.*.position
input board N on|off       let current flow into an isolated input of a 7I97
pin N high|low|free        drive an I/O pin of the FPGA from outside
leds fpga|packets          give the user LEDs to the FPGA, or let them count packets
turn AXIS SPEED|free       turn a motor by hand (units a second), or let it go
stall AXIS [on|off]        jam an axis, or free it; AXIS: its number or its name
wheel CLICKS [WHEEL]       turn a handwheel
estop on|off               press the emergency stop, or release it
reset TIME                 let the board lose its configuration, and be away for TIME (1s, 300ms), as
                           in a dip of its supply
input CH N on|off          digital input of the remote on channel CH (PORT.CH on a serial
                           port other than 0)
volts CH N VOLTS           voltage on an input of a remote
field CH VOLTS             field power of a remote (0 drops it)
power CH on|off            supply of a remote
jumper CH setup|operate    put a remote's jumper there, and switch it off and on
firmware CH REVISION FILE  write a firmware file for a remote, to update it with
shorted CH N on|off        short the load of an output
hot CH N on|off            overheat the driver of an output
unplug CH, plug CH         pull a remote's connector, put it back
wire CH TOWARD FAULT COUNT spoil the next COUNT bursts; TOWARD: remote or fpga;
                           FAULT: lost, corrupted, short=N, long=N, late=US, break
wire CH TOWARD FAULT chance P
                           spoil each burst with probability P
wire CH heal               end all wire faults
bus off|on                 take a board on the PCI bus from it, put it back
loss P, late P, dup P      lose, delay, double packets with probability P from now on
at TIME COMMAND            do it later: 2.5s since the start, +2.5s or +200ms from now
agenda                     what waits for its time
wait until NAME VALUE|>X|<X [within TIME]
                           answer when a value that `show` prints is that; 60 s at most
source FILE                do what the lines of a file say, up to the first error
boards                     all boards of this process; @BOARD COMMAND is for one of them,
                           by its number or its name; without, a command is for the first
quit                       stop
";

/// Executes a command line.
pub fn answer(machine: &mut Machine, face: &mut Face, line: &str) -> Answer {
    // A wait inside a packet leaves the board's time ahead of its gateware and of the machine.
    machine.board.advance_to(machine.board.time());
    let words: Vec<&str> = line.split_whitespace().collect();
    let done = match words[..] {
        ["quit"] => return Answer::quit(),
        ["show"] | ["show", "all"] => Ok(show_all(machine, face)),
        ["show", what] => show(machine, face, what),
        ["loss" | "late" | "dup", chance] => set_mishap(face, words[0], chance).map(nothing),
        ["bus", state] => on_off(state)
            .and_then(|on| face.set_on_bus(on))
            .map(nothing),
        _ => order(machine, &words),
    };
    Answer::of(done)
}

/// Executes a command on a throw-away machine, to find the reason for which it would be refused
/// later.
pub fn rehearse(machine: &mut Machine, line: &str) -> Result<(), String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let done = match words[..] {
        ["quit"] => Ok(String::new()),
        ["loss" | "late" | "dup", chance] => probability(chance).map(|_| String::new()),
        ["bus", state] => on_off(state).map(|_| String::new()),
        _ => order(machine, &words),
    };
    done.map(drop)
}

/// Executes a command that concerns the machine alone.
fn order(machine: &mut Machine, words: &[&str]) -> Result<String, String> {
    match *words {
        [] => Ok(String::new()),
        ["help"] => Ok(HELP.to_owned()),
        ["input", "board", input, state] => set_board_input(machine, input, state),
        ["pin", pin, level] => drive_pin(machine, pin, level),
        ["turn", axis, speed] => mechanics::turn(machine, axis, speed).map(nothing),
        ["stall", axis] => mechanics::stall(machine, axis, "on").map(nothing),
        ["stall", axis, state] => mechanics::stall(machine, axis, state).map(nothing),
        ["wheel", clicks] => mechanics::turn_wheel(machine, clicks, "0").map(nothing),
        ["wheel", clicks, wheel] => mechanics::turn_wheel(machine, clicks, wheel).map(nothing),
        ["estop", state] => mechanics::estop(machine, state).map(nothing),
        ["reset", time] => reset(machine, time).map(nothing),
        ["leds", owner] => give_leds(machine, owner),
        [
            "quit" | "help" | "show" | "pin" | "turn" | "leds" | "stall" | "wheel" | "estop"
            | "reset" | "loss" | "late" | "dup",
            ..,
        ] => Err(wrong(words[0])),
        [command, slot, ref rest @ ..] => slot
            .parse()
            .and_then(|slot| remotes::command(machine, command, slot, rest))
            .map(nothing),
        [word, ..] => Err(format!(
            "`{word}` is no command, or it takes something else: try help"
        )),
    }
}

fn reset(machine: &mut Machine, time: &str) -> Result<(), String> {
    let nanos = parse_time(time)?.as_nanos();
    let nanos = u64::try_from(nanos).map_err(|_| wrong("reset"))?;
    machine.board.reset_for(nanos);
    Ok(())
}

fn set_mishap(face: &mut Face, what: &str, chance: &str) -> Result<(), String> {
    let chance = probability(chance)?;
    let Face::Ethernet(face) = face else {
        return Err("this board is on the PCI bus, which loses nothing".to_owned());
    };
    let mut mishaps = face.mishaps();
    match what {
        "loss" => mishaps.loss = chance,
        "late" => mishaps.late = chance,
        _ => mishaps.dup = chance,
    }
    face.set_mishaps(mishaps);
    Ok(())
}

/// Text printed at the end.
pub fn summary(machine: &mut Machine, face: &Face) -> String {
    format!("summary\n{}ok\n", show_all(machine, face))
}

fn nothing((): ()) -> String {
    String::new()
}

fn set_board_input(machine: &mut Machine, input: &str, state: &str) -> Result<String, String> {
    let (input, on) = (number(input)?, on_off(state)?);
    let count = machine
        .fpga()
        .inputs()
        .map_or(0, mesa_hal_sim::Inputs::count);
    if input >= count {
        return Err(format!("input {input}: this board has {count}"));
    }
    machine.fpga().set_input(input, on);
    Ok(String::new())
}

fn drive_pin(machine: &mut Machine, pin: &str, level: &str) -> Result<String, String> {
    let level = match level {
        "high" | "1" => Some(true),
        "low" | "0" => Some(false),
        "free" => None,
        _ => return Err(format!("`{level}`: expected high, low or free")),
    };
    let pin: usize = number(pin)?;
    let count = machine.fpga().firmware().pins.len();
    if pin >= count {
        return Err(format!("pin {pin}: this board has {count}"));
    }
    machine.fpga().drive_pin(pin, level);
    Ok(String::new())
}

fn give_leds(machine: &mut Machine, owner: &str) -> Result<String, String> {
    let debug = match owner {
        "fpga" => false,
        "packets" => true,
        _ => return Err(format!("`{owner}`: expected fpga or packets")),
    };
    machine.board.give_leds(debug);
    Ok(String::new())
}

fn show(machine: &mut Machine, face: &Face, what: &str) -> Result<String, String> {
    let mut text = String::new();
    match what {
        "network" => show_network(&mut text, machine, face),
        "board" => show_board(&mut text, machine),
        "motors" => mechanics::show(&mut text, machine),
        "time" => show_time(&mut text, machine),
        _ => {
            let Ok(slot) = what.parse() else {
                if what.contains(['*', '.']) {
                    return show_pattern(machine, face, what);
                }
                return Err(format!(
                    "`{what}`: expected all, network, board, motors, time, a channel, or a pattern such \
                     as motor.*.position"
                ));
            };
            machine.cable(slot)?;
            remotes::show(&mut text, machine, slot);
        }
    }
    Ok(text)
}

/// The lines whose names match a pattern.
fn show_pattern(machine: &mut Machine, face: &Face, pattern: &str) -> Result<String, String> {
    let all = show_all(machine, face);
    let names = |line: &&str| {
        let name = line.split(' ').next().unwrap_or_default();
        is_match(pattern.as_bytes(), name.as_bytes())
    };
    let found: String = all.split_inclusive('\n').filter(names).collect();
    if found.is_empty() {
        return Err(format!("nothing is like `{pattern}`; `show` has all names"));
    }
    Ok(found)
}

/// Value of a name that `show` prints.
pub fn value(machine: &mut Machine, face: &Face, name: &str) -> Result<String, String> {
    let mut text = String::new();
    match name.split('.').next().unwrap_or_default() {
        "network" => show_network(&mut text, machine, face),
        "board" => {
            show_network(&mut text, machine, face);
            show_board(&mut text, machine);
        }
        "time" => show_time(&mut text, machine),
        "remote" => {
            let slot = Slot::in_name(name);
            let slot = slot.ok_or_else(|| format!("`{name}` names no channel"))?;
            remotes::show(&mut text, machine, slot);
        }
        _ => mechanics::show(&mut text, machine),
    }
    let mut pairs = text.lines().filter_map(|line| line.split_once(' '));
    let found = pairs.find(|(found, _)| *found == name);
    let value = found.map(|(_, value)| value.to_owned());
    value.ok_or_else(|| format!("there is no value `{name}`; `show` has all names"))
}

fn show_time(text: &mut String, machine: &Machine) {
    let seconds = machine.board.time() as f64 / 1e9;
    line(text, "time", format_args!("{seconds:.6}"));
}

fn show_all(machine: &mut Machine, face: &Face) -> String {
    let mut text = String::new();
    show_time(&mut text, machine);
    show_network(&mut text, machine, face);
    show_board(&mut text, machine);
    mechanics::show(&mut text, machine);
    let remotes = machine.description.remotes.iter();
    let slots: Vec<_> = remotes.map(|remote| remote.slot).collect();
    for slot in slots {
        remotes::show(&mut text, machine, slot);
    }
    text
}

fn show_network(text: &mut String, machine: &Machine, face: &Face) {
    match face {
        Face::Ethernet(face) => show_packets(text, machine, face),
        Face::Pci(face) => line(text, "network.pci.accesses", face.accesses),
    }
}

fn show_packets(text: &mut String, machine: &Machine, face: &UdpFace) {
    let directions = [("received", face.received()), ("sent", face.sent())];
    for (direction, counters) in directions {
        let UdpCounters {
            packets,
            bytes,
            lost,
            late,
            duplicate,
        } = counters;
        let all = [
            ("packets", packets),
            ("bytes", bytes),
            ("lost", lost),
            ("late", late),
            ("duplicate", duplicate),
        ];
        for (name, count) in all {
            line(text, &format!("network.{direction}.{name}"), count);
        }
    }
    let errors = [("parse", 0x02), ("memory", 0x04), ("write", 0x06)];
    for (name, address) in errors {
        line(
            text,
            &format!("board.errors.{name}"),
            machine.board.status(address),
        );
    }
    let (reloads, resets) = machine.board.restarts();
    line(text, "board.reloads", reloads);
    line(text, "board.resets", resets);
    for (number, client) in face.clients().iter().enumerate() {
        let name = |what: &str| format!("network.client.{number}.{what}");
        let silent = face.now().saturating_sub(client.heard) as f64 / 1e9;
        line(text, &name("address"), client.address);
        line(text, &name("packets"), client.packets);
        line(text, &name("writes"), client.writes);
        line(text, &name("silent"), format_args!("{silent:.3}"));
    }
}

fn show_board(text: &mut String, machine: &mut Machine) {
    line(text, "board.name", machine.name());
    let leds = machine.board.lit_leds();
    let fpga = machine.fpga();
    let watchdog = fpga.watchdog();
    let states = [
        ("board.watchdog-running", watchdog.is_running()),
        ("board.watchdog-bitten", watchdog.has_bitten()),
    ];
    for (name, state) in states {
        line(text, name, u8::from(state));
    }
    let inputs = fpga.inputs().map_or(0, mesa_hal_sim::Inputs::count);
    for input in 0..inputs {
        let on = fpga.inputs().is_some_and(|inputs| inputs.terminal(input));
        line(text, &format!("board.input-{input:02}"), u8::from(on));
    }
    for (led, is_lit) in leds.into_iter().enumerate() {
        line(text, &format!("board.led-{led}"), u8::from(is_lit));
    }
    let outputs = fpga.pwm().map_or(0, mesa_hal_sim::SimPwm::count);
    for output in 0..outputs {
        let signal = fpga.analog_output(output);
        line(
            text,
            &format!("board.analogout{output}"),
            format_args!("{:.4}", signal.volts),
        );
        line(
            text,
            &format!("board.enable{output}"),
            u8::from(signal.enabled),
        );
    }
    if fpga.ssr().or(fpga.out_m()).is_some() {
        for output in 0..6 {
            let on = fpga.isolated_output(output);
            line(text, &format!("board.output-{output:02}"), u8::from(on));
        }
    }
    for pin in 0..fpga.firmware().pins.len() {
        line(
            text,
            &format!("board.pin-{pin:03}"),
            u8::from(fpga.pin_level(pin)),
        );
    }
}
