//! Files for LinuxCNC: the board's signals, motion on them, and the settings of both.

mod estop;
mod ini;
mod motion;
mod parts;
mod prepared;

use std::fmt::Write;

use super::Component;
use super::machine::{Joint, Machine, Servo, Stepper, is_enable, remark};
use mesa_hal::hal::Role;

pub use ini::{ini, tools};
pub use motion::motion;

/// Settings of a servo loop: name in the INI file, parameter of `pid`, and default.
const LOOP: [(&str, &str, &str); 9] = [
    ("P", "Pgain", "0"),
    ("I", "Igain", "0"),
    ("D", "Dgain", "0"),
    ("BIAS", "bias", "0"),
    ("FF0", "FF0", "0"),
    ("FF1", "FF1", "0"),
    ("FF2", "FF2", "0"),
    ("DEADBAND", "deadband", "0"),
    ("MAX_OUTPUT", "maxoutput", "10"),
];

/// Settings of a step generator: name in the INI file, parameter, and default.
const STEPS: [(&str, &str, &str); 7] = [
    ("STEP_SCALE", "position-scale", "1000"),
    ("STEPGEN_MAXVEL", "maxvel", "1.25"),
    ("STEPGEN_MAXACCEL", "maxaccel", "1.25"),
    ("STEPLEN", "steplen", "5000"),
    ("STEPSPACE", "stepspace", "5000"),
    ("DIRSETUP", "dirsetup", "10000"),
    ("DIRHOLD", "dirhold", "10000"),
];

/// `board.hal`: the board's driver, and a signal for each pin.
pub fn board(machine: &Machine, component: Component) -> String {
    let board = &machine.board;
    let mut text = heading(machine) + &driver(machine, component);
    // On the PCI bus no packet can be lost, and LinuxCNC has no pin for it.
    let lost = if machine.host.is_pci() {
        String::new()
    } else {
        format!("net board-lost <= {board}.packet-error-exceeded\n")
    };
    let _ = write!(
        text,
        "\n# Parts of the emergency stop. {}\
         net board-watchdog <=> {board}.watchdog.has_bit\n{lost}",
        after_a_fault(machine, component)
    );
    if !machine.settings.is_empty() {
        text.push_str("\n# Settings of this board's outputs. Do not change them.\n");
    }
    for (name, value) in &machine.settings {
        let _ = writeln!(text, "setp {name} {value}");
    }
    text.push_str(&signals(machine));
    text
}

/// Comments on how the board's outputs follow again after a fault.
fn after_a_fault(machine: &Machine, component: Component) -> String {
    let board = &machine.board;
    let io_error = if machine.host.is_pci() {
        String::new()
    } else {
        format!("`setp {board}.io_error false`, ")
    };
    if component.is_ours() {
        return format!(
            "F1 on the screen clears them (motion.hal); on the bench\n\
             # `setp {board}.rearm true` does, and `setp {board}.rearm false` before the next time.\n"
        );
    }
    let runs = machine.used_ports();
    let runs = runs.map(|port| {
        let run = format!("{board}.sserial.port-{port}.run");
        format!(", `setp {run} false`, `setp {run} true`")
    });
    format!(
        "They stay until they are cleared, with halcmd in this order:\n\
         # {io_error}`sets board-watchdog false`{}.\n",
        runs.collect::<String>()
    )
}

/// Comments on the signals, the remotes, and modules without signals.
fn heading(machine: &Machine) -> String {
    let mut text = format!(
        "# {}: its driver, and a signal for each pin. Written by `mesa hal`.\n\
         #\n\
         # motion.hal, which is read after this file, connects LinuxCNC to the signals; lines for switches, spindle\n\
         # and more are prepared there.\n\
         # An output whose signal nothing writes is off; `halcmd sets SIGNAL true` switches it by hand.\n",
        machine.board
    );
    if !machine.remotes.is_empty() {
        text.push_str("#\n");
    }
    for remote in &machine.remotes {
        let _ = writeln!(text, "# {remote}");
    }
    if !machine.undriven.is_empty() {
        text.push_str("#\n# No signals for modules that mesa-hal does not drive:\n");
    }
    for module in &machine.undriven {
        let _ = writeln!(text, "# {module}");
    }
    text
}

/// The driver and its settings. Its functions are added to the thread in `motion.hal`, or in
/// `bench.hal`.
fn driver(machine: &Machine, component: Component) -> String {
    let Machine { board, ports, .. } = machine;
    let config = if ports.is_empty() {
        ""
    } else {
        " config=[HOSTMOT2]CONFIG"
    };
    let load = match component {
        Component::Hm2Eth => "loadrt hostmot2\nloadrt hm2_eth board_ip=[HOSTMOT2]BOARD_IP",
        Component::MesaEth => "loadrt mesa_eth board_ip=[HOSTMOT2]BOARD_IP",
        Component::Hm2Pci => "loadrt hostmot2\nloadrt hm2_pci",
        Component::MesaPci => "loadrt mesa_pci",
    };
    let limit = if machine.host.is_pci() {
        String::new()
    } else {
        format!("setp {board}.packet-error-limit [HOSTMOT2]PACKET_ERROR_LIMIT\n")
    };
    let mut text = format!(
        "\n{load}{config}\n\n\
         setp {board}.watchdog.timeout_ns [HOSTMOT2]WATCHDOG_NS\n{limit}"
    );
    for port in machine.used_ports() {
        let _ = writeln!(
            text,
            "setp {board}.sserial.port-{port}.fault-lim [HOSTMOT2]SSERIAL_FAULT_LIMIT"
        );
    }
    text + &sampling(machine)
}

/// The timer that samples positions at the same moment of each period.
fn sampling(machine: &Machine) -> String {
    let board = &machine.board;
    let timer = format!("{board}.dpll.01.timer-us");
    let modules = ["encoder", "stepgen"].map(|module| format!("{board}.{module}.timer-number"));
    let used: Vec<_> = modules.iter().filter(|name| machine.has(name)).collect();
    if used.is_empty() || !machine.has(&timer) {
        return String::new();
    }
    let mut text = format!(
        "\n# Positions are sampled 50 us before the read: its jitter then is no jitter of the position.\n\
         setp {timer} -50\n"
    );
    for name in used {
        let _ = writeln!(text, "setp {name} 1");
    }
    text
}

/// Signals by module and remote, then the drive enables, which are commented out.
fn signals(machine: &Machine) -> String {
    let (mut text, mut last, mut enables) = (String::new(), "", String::new());
    for pin in &machine.pins {
        let remark = match &*remark(pin) {
            "" => String::new(),
            remark => format!("  # {remark}"),
        };
        if is_enable(pin) {
            // An axis beyond LinuxCNC's joints, or a spindle, has a signal of its own.
            let signal = machine.enabled_by(pin).map_or_else(
                || signal(machine, &pin.name),
                |joint| format!("joint-{joint}-enable"),
            );
            let _ = writeln!(enables, "# net {signal} => {}{remark}", pin.name);
            continue;
        }
        let own = machine.own(&pin.name);
        let module = own.rsplit_once('.').map_or(own, |(module, _)| module);
        if module != last {
            text.push('\n');
            let module = format!("{}.{module}", machine.board);
            let mut joints = machine.joints.iter();
            if let Some(joint) = joints.position(|joint| joint.module() == module) {
                text.push_str(&scales(&machine.joints[joint], joint));
            }
        }
        last = module;
        let arrow = match pin.role {
            Role::Input => "<=",
            Role::InOut => "<=>",
            _ => "=>",
        };
        let signal = signal(machine, &pin.name);
        let _ = writeln!(text, "net {signal} {arrow} {}{remark}", pin.name);
    }
    if !enables.is_empty() {
        text.push_str(
            "\n# Drive enables. TODO: remove the # once the emergency stop has been tested and every axis\n\
             # counts in the direction in which it is driven.\n",
        );
    }
    text + &enables
}

/// Settings of the encoder or step generator of a joint.
fn scales(joint: &Joint, number: usize) -> String {
    match joint {
        Joint::Servo(Servo { encoder, .. }) => {
            format!("setp {encoder}.scale [JOINT_{number}]ENCODER_SCALE\n")
        }
        Joint::Stepper(Stepper { stepgen, .. }) => {
            let line = |(name, parameter, _)| {
                format!("setp {stepgen}.{parameter} [JOINT_{number}]{name}\n")
            };
            STEPS.into_iter().map(line).collect()
        }
    }
}

fn signal(machine: &Machine, name: &str) -> String {
    machine.own(name).replace('.', "-")
}

/// `bench.hal`: the board with a thread, without motion.
pub fn bench(machine: &Machine) -> String {
    format!(
        "# {0} without LinuxCNC's motion, to try its inputs and outputs. Written by `mesa hal`.\n\
         #\n\
         #   halrun -I -i machine.ini -f bench.hal\n\
         #   show sig                                  every signal, and what it is connected to\n\
         #   sets SIGNAL true                          an output, by hand\n\
         #   exit\n\n\
         source board.hal\n\
         loadrt threads name1=servo-thread period1=[EMCMOT]SERVO_PERIOD\n\
         addf {0}.read servo-thread\n\
         addf {0}.write servo-thread\n\
         start\n",
        machine.board
    )
}
