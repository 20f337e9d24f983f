//! Files for LinuxCNC: the board's signals, motion on them, and the settings of both.

use std::fmt::Write;

use super::Component;
use super::machine::{Host, Joint, LETTERS, Machine, Servo, Stepper, is_enable, remark};
use mesa_hal::hal::Role;

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
        "\n# Both are part of the emergency stop. The first one stays on until it is reset:\n\
         # `halcmd sets board-watchdog false`.\n\
         net board-watchdog <=> {board}.watchdog.has_bit\n{lost}"
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

/// Comments on the signals, the remotes, and modules without signals.
fn heading(machine: &Machine) -> String {
    let mut text = format!(
        "# {}: its driver, and a signal for each pin. Written by `mesa hal`.\n\
         #\n\
         # Connect LinuxCNC to the signals, in motion.hal or in a file of your own:\n\
         #   net SIGNAL => joint.0.home-sw-in       an input\n\
         #   net SIGNAL <= spindle.0.on             an output\n\
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

/// The driver, in its thread, and its settings.
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
         # Read before everything else in the thread, write after it.\n\
         addf {board}.read servo-thread 1\n\
         addf {board}.write servo-thread -1\n\n\
         setp {board}.watchdog.timeout_ns [HOSTMOT2]WATCHDOG_NS\n{limit}"
    );
    // LinuxCNC has no pins and parameters of a port without remotes.
    let used = ports
        .iter()
        .filter(|(_, modes)| modes.contains(|mode| mode != 'x'));
    for (port, _) in used {
        let _ = writeln!(
            text,
            "setp {board}.sserial.port-{port}.fault-lim [HOSTMOT2]SSERIAL_FAULT_LIMIT"
        );
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

/// `motion.hal`: LinuxCNC's motion, servo loops and emergency stop.
pub fn motion(machine: &Machine) -> String {
    let Machine { board, joints, .. } = machine;
    let mut text = format!(
        "# LinuxCNC's motion, servo loops and emergency stop, on the signals of board.hal ({board}).\n\
         # Written by `mesa hal`.\n\n\
         loadrt [KINS]KINEMATICS\n\
         loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS\n\
         loadrt estop_latch count=3\n"
    );
    let servos = joints.iter().filter_map(Joint::servo).count();
    if servos > 0 {
        text.push_str("loadrt pid num_chan=[KINS]JOINTS\n");
    }
    text.push_str(
        "\naddf motion-command-handler servo-thread\n\
         addf motion-controller servo-thread\n",
    );
    for number in 0..servos {
        let _ = writeln!(text, "addf pid.{number}.do-pid-calcs servo-thread");
    }
    for latch in 0..3 {
        let _ = writeln!(text, "addf estop-latch.{latch} servo-thread");
    }
    text.push_str(&emergency_stop(machine));
    text.push_str(
        "\n# Tools are changed by hand.\n\
         net tool-prepare <= iocontrol.0.tool-prepare => iocontrol.0.tool-prepared\n\
         net tool-change <= iocontrol.0.tool-change => iocontrol.0.tool-changed\n",
    );
    for (number, joint) in joints.iter().enumerate() {
        text.push_str(&match joint {
            Joint::Servo(joint) => servo(machine, number, joint),
            Joint::Stepper(joint) => stepper(machine, number, joint),
        });
    }
    if joints.is_empty() {
        text.push_str(
            "\n# TODO: no encoder with an analog output and no step generator was found. This joint's feedback is its command.\n\
             net joint-0-enable <= joint.0.amp-enable-out\n\
             net joint-0-command <= joint.0.motor-pos-cmd => joint.0.motor-pos-fb\n",
        );
    }
    text
}

/// The chain of the emergency stop.
fn emergency_stop(machine: &Machine) -> String {
    let mut inputs = machine.pins.iter();
    let example = inputs.find(|pin| pin.name.contains(".input-"));
    let example = example.map_or_else(
        || format!("{}.INPUT", machine.board),
        |pin| pin.name.clone(),
    );
    format!(
        "\n# Emergency stop: a chain that the board's watchdog, lost packets and the button break.\n\
         # Software is no safe way to turn a motor off: the button has to remove its power as well.\n\
         net estop-released <= iocontrol.0.user-enable-out => estop-latch.0.ok-in\n\
         net estop-reset <= iocontrol.0.user-request-enable => estop-latch.0.reset estop-latch.1.reset estop-latch.2.reset\n\
         net board-watchdog => estop-latch.0.fault-in\n\
         net estop-watchdog-ok <= estop-latch.0.ok-out => estop-latch.1.ok-in\n\
         net board-lost => estop-latch.1.fault-in\n\
         net estop-board-ok <= estop-latch.1.ok-out => estop-latch.2.ok-in\n\
         net estop-pressed => estop-latch.2.fault-in\n\
         net estop-ok <= estop-latch.2.ok-out => iocontrol.0.emc-enable-in\n\
         # TODO: the input of the button; until then it counts as pressed. For a normally closed contact:\n\
         #   net estop-pressed <= {example}-not\n\
         sets estop-pressed true\n"
    )
}

/// The servo loop of a joint.
fn servo(machine: &Machine, number: usize, joint: &Servo) -> String {
    let encoder = signal(machine, &joint.encoder);
    let volts = signal(machine, &joint.volts);
    let mut text = format!("\n# Joint {number}: {encoder}, {volts}\n");
    for (name, parameter, _) in LOOP {
        let _ = writeln!(text, "setp pid.{number}.{parameter} [JOINT_{number}]{name}");
    }
    let _ = write!(
        text,
        "net joint-{number}-enable <= joint.{number}.amp-enable-out => pid.{number}.enable\n\
         net joint-{number}-command <= joint.{number}.motor-pos-cmd => pid.{number}.command\n\
         net {encoder}-position => joint.{number}.motor-pos-fb pid.{number}.feedback\n\
         net {encoder}-velocity => pid.{number}.feedback-deriv\n\
         net {encoder}-index-enable <=> joint.{number}.index-enable pid.{number}.index-enable\n\
         net {volts} <= pid.{number}.output\n"
    );
    text
}

/// The step generator of a joint, which follows positions.
fn stepper(machine: &Machine, number: usize, joint: &Stepper) -> String {
    let stepgen = signal(machine, &joint.stepgen);
    let mut text = format!(
        "\n# Joint {number}: {stepgen}\n\
         net joint-{number}-enable <= joint.{number}.amp-enable-out\n\
         net {stepgen}-position-cmd <= joint.{number}.motor-pos-cmd\n\
         net {stepgen}-position-fb => joint.{number}.motor-pos-fb\n"
    );
    if joint.has_index {
        let _ = writeln!(
            text,
            "net {stepgen}-index-enable <=> joint.{number}.index-enable"
        );
    }
    text
}

/// `bench.hal`: the board with a thread, without motion.
pub fn bench(machine: &Machine) -> String {
    format!(
        "# {} without LinuxCNC's motion, to try its inputs and outputs. Written by `mesa hal`.\n\
         #\n\
         #   halrun -I -i machine.ini -f bench.hal\n\
         #   show sig                                  every signal, and what it is connected to\n\
         #   sets SIGNAL true                          an output, by hand\n\
         #   exit\n\n\
         loadrt threads name1=servo-thread period1=[EMCMOT]SERVO_PERIOD\n\
         source board.hal\n\
         start\n",
        machine.board
    )
}

/// `machine.ini`: the settings of all files.
pub fn ini(machine: &Machine) -> String {
    let Machine { board, ports, .. } = machine;
    let axes = machine.joints.len().max(1);
    let letters: String = LETTERS.chars().take(axes).collect();
    let simulated = "# TODO: these files were made from a simulated board\n";
    let address = match machine.host {
        Host::Ethernet(Some(address)) => format!("BOARD_IP = {}\n", address.ip()),
        Host::Ethernet(None) => format!("{simulated}BOARD_IP = 10.10.10.10\n"),
        Host::Pci(Some(address)) => format!("# The board is at {address} on the PCI bus.\n"),
        Host::Pci(None) => simulated.to_owned(),
    };
    let limit = if machine.host.is_pci() {
        ""
    } else {
        "PACKET_ERROR_LIMIT = 10\n"
    };
    let config = ports
        .iter()
        .map(|(port, modes)| format!("sserial_port_{port}={modes}"));
    let config: Vec<_> = config.collect();
    let config = match &*config.join(" ") {
        "" => String::new(),
        config => format!(
            "# The software mode of each channel, or x where there is no remote.\nCONFIG = \"{config}\"\n"
        ),
    };
    let mut text = format!(
        "# {board}. Written by `mesa hal`. Set the values marked TODO, which the board does not know.\n\n\
         [EMC]\nVERSION = 1.1\nMACHINE = {board}\n\n\
         [DISPLAY]\nDISPLAY = axis\n\n\
         [TASK]\nTASK = milltask\nCYCLE_TIME = 0.010\n\n\
         [RS274NGC]\nPARAMETER_FILE = machine.var\n\n\
         [EMCMOT]\nEMCMOT = motmod\nCOMM_TIMEOUT = 1.0\n# Nanoseconds\nSERVO_PERIOD = 1000000\n\n\
         [EMCIO]\nEMCIO = io\nCYCLE_TIME = 0.100\n\n\
         [HOSTMOT2]\n{address}{config}\
         # Time without a write after which the board turns its outputs off: five periods\n\
         WATCHDOG_NS = 5000000\n{limit}SSERIAL_FAULT_LIMIT = 200\n\n\
         [HAL]\nHALUI = halui\nHALFILE = motion.hal\nHALFILE = board.hal\n\n\
         [KINS]\n# TODO: fewer, if an output is a spindle's or has no drive\nJOINTS = {axes}\nKINEMATICS = trivkins coordinates={letters}\n\n\
         [TRAJ]\nCOORDINATES = {letters}\nLINEAR_UNITS = mm\nANGULAR_UNITS = degree\n\
         # TODO\nMAX_LINEAR_VELOCITY = 1\n"
    );
    for (number, letter) in letters.chars().enumerate() {
        text.push_str(&axis(number, letter, machine.joints.get(number)));
    }
    text
}

/// The sections of an axis and its joint.
fn axis(number: usize, letter: char, joint: Option<&Joint>) -> String {
    let limits = "MIN_LIMIT = -1\nMAX_LIMIT = 1\nMAX_VELOCITY = 1\nMAX_ACCELERATION = 1\n";
    let kind = if "ABC".contains(letter) {
        "ANGULAR"
    } else {
        "LINEAR"
    };
    let (remark, settings) = match joint {
        Some(Joint::Stepper(_)) => (
            "# TODO: steps for one unit; what the generator may do, a quarter more than the joint; and\n\
             # times of the drive in ns\n",
            &STEPS[..],
        ),
        _ => (
            "# TODO: counts of the encoder for one unit\nENCODER_SCALE = 1000\n\
             # TODO: the servo loop, in volts\n",
            &LOOP[..],
        ),
    };
    let mut text = format!(
        "\n[AXIS_{letter}]\n# TODO: units, and units a second\n{limits}\n\
         [JOINT_{number}]\nTYPE = {kind}\n# TODO: units, and units a second\n{limits}\
         FERROR = 0.1\nMIN_FERROR = 0.01\n{remark}"
    );
    for (name, _, value) in settings {
        let _ = writeln!(text, "{name} = {value}");
    }
    text
}
