//! `machine.ini`: the first steps, and the settings of all files.

use std::fmt::Write;

use super::super::Component;
use super::super::machine::{Host, Joint, Machine};
use super::{LOOP, STEPS};

/// `machine.ini`.
pub fn ini(machine: &Machine, component: Component) -> String {
    let letters = &machine.letters;
    let mut text = steps(machine);
    let _ = write!(
        text,
        "[EMC]\nVERSION = 1.1\nMACHINE = {board}\n\n\
         [DISPLAY]\nDISPLAY = axis\nPOSITION_OFFSET = RELATIVE\nPOSITION_FEEDBACK = ACTUAL\n\
         PROGRAM_PREFIX = ~/linuxcnc/nc_files\nINCREMENTS = 10 mm, 1 mm, 0.1 mm, 0.01 mm, 0.001 mm\n\
         # Units a second, at the first start\nDEFAULT_LINEAR_VELOCITY = 0.5\nMAX_LINEAR_VELOCITY = 1\n\n\
         [TASK]\nTASK = milltask\nCYCLE_TIME = 0.010\n\n\
         [RS274NGC]\nPARAMETER_FILE = machine.var\nRS274NGC_STARTUP_CODE = G17 G21 G40 G49 G54 G80 G90 G94\n\n\
         [EMCMOT]\nEMCMOT = motmod\nCOMM_TIMEOUT = 1.0\n# Nanoseconds\nSERVO_PERIOD = 1000000\n\n\
         [EMCIO]\nEMCIO = io\nCYCLE_TIME = 0.100\nTOOL_TABLE = tool.tbl\n\n\
         {hostmot2}\
         [HAL]\nHALUI = halui\n\
         # In this order: motion.hal connects LinuxCNC to the signals that board.hal makes.\n\
         HALFILE = board.hal\nHALFILE = motion.hal\n\n\
         [KINS]\n{remark}JOINTS = {count}\nKINEMATICS = trivkins coordinates={letters}{both}\n\n\
         [TRAJ]\nCOORDINATES = {letters}\nLINEAR_UNITS = mm\nANGULAR_UNITS = degree\n\
         # TODO\nMAX_LINEAR_VELOCITY = 1\n\n\
         [SPINDLE_0]\n\
         # For the prepared lines of motion.hal. TODO: counts of the encoder for one turn, and the speed\n\
         ENCODER_COUNTS = 4000\nSPEED_AT_10_V = 3000\nVOLTS_PER_RPM = 0.00333\n",
        board = machine.board,
        hostmot2 = hostmot2(machine, component),
        remark = if machine.joints.len() > 3 {
            "# Fewer axes: `mesa hal --axes XYZ`\n"
        } else {
            ""
        },
        count = letters.len(),
        both = if is_gantry(letters) {
            " kinstype=BOTH"
        } else {
            ""
        },
    );
    let mut named = String::new();
    for (number, letter) in letters.chars().enumerate() {
        if !named.contains(letter) {
            named.push(letter);
            let _ = write!(
                text,
                "\n[AXIS_{letter}]\n# TODO: units, and units a second\n{LIMITS}"
            );
        }
        text += &joint(number, letter, machine.joints.get(number));
    }
    text
}

/// `tool.tbl`: one tool, so that LinuxCNC finds a table.
pub fn tools() -> String {
    "T1 P1 Z0 D6 ; TODO: the tools\n".to_owned()
}

const LIMITS: &str = "MIN_LIMIT = -1\nMAX_LIMIT = 1\nMAX_VELOCITY = 1\nMAX_ACCELERATION = 1\n";

/// True if an axis has two motors.
fn is_gantry(letters: &str) -> bool {
    let mut all: Vec<char> = letters.chars().collect();
    all.sort_unstable();
    all.windows(2).any(|pair| pair[0] == pair[1])
}

/// What to do first, in order.
fn steps(machine: &Machine) -> String {
    let board = &machine.board;
    let target = match machine.host {
        Host::Ethernet(Some(address)) => format!("--addr {}", address.ip()),
        Host::Ethernet(None) => "--addr 10.10.10.10".to_owned(),
        Host::Pci(Some(address)) => format!("--pci {address}"),
        Host::Pci(None) => "--pci".to_owned(),
    };
    let servos = machine.joints.iter().any(|joint| joint.servo().is_some());
    let scale = if servos {
        "ENCODER_SCALE: move the axis by hand along a ruler;"
    } else {
        "STEP_SCALE: steps of the drive for one unit;"
    };
    let tune = if servos {
        "[JOINT_n]P and FF1: the servo loop, with slow and short jogs."
    } else {
        "[JOINT_n]STEPLEN to DIRHOLD: the times of the drive, from its manual."
    };
    format!(
        "# {board}. Written by `mesa hal`. Values marked TODO are not known to the board. First steps, with the\n\
         # power of the drives off until step 6:\n\
         #\n\
         #  1. `mesa doctor {target}`: network, firmware, field power. `mesa wiring {target}`: the wires.\n\
         #  2. `halrun -I -i machine.ini -f bench.hal`: the board alone; `show sig` has inputs and outputs.\n\
         #  3. motion.hal: the input of the emergency stop (TODO). `linuxcnc machine.ini`: F1 works only while the\n\
         #     button is released, and the button ends it.\n\
         #  4. [JOINT_n]{scale}\n\
         #     a negative number turns the direction.\n\
         #  5. [TRAJ], [AXIS_x] and [JOINT_n]: limits, velocity, acceleration. Keep them small.\n\
         #  6. board.hal: remove the # of the drive enables (TODO). Power on, a hand on the emergency stop, F2; the\n\
         #     axis holds, or does not move. If it runs away: press the button, and turn a sign (step 4).\n\
         #  7. {tune}\n\
         #  8. motion.hal: home and limit switches. [JOINT_n]HOME_*: homing, first without an index.\n\
         #  9. motion.hal: spindle, coolant, probe, handwheel. Then the real velocities and limits.\n\n"
    )
}

/// The section of the driver.
fn hostmot2(machine: &Machine, component: Component) -> String {
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
    let config = machine.ports.iter();
    let config = config.map(|(port, modes)| format!("sserial_port_{port}={modes}"));
    let config: Vec<_> = config.collect();
    let config = match &*config.join(" ") {
        "" => String::new(),
        config => format!(
            "# The software mode of each channel, or x where there is no remote.\nCONFIG = \"{config}\"\n"
        ),
    };
    let ours = if component.is_ours() {
        "# Seconds: how long inputs may be invalid before the machine stops, and how long after F1 the faults\n\
         # have to be gone\nINVALID_TIME = 0.02\nRESET_TIME = 0.05\n"
    } else {
        ""
    };
    format!(
        "[HOSTMOT2]\n{address}{config}\
         # Time without a write after which the board turns its outputs off: five periods\n\
         WATCHDOG_NS = 5000000\n{limit}SSERIAL_FAULT_LIMIT = 200\n{ours}\n"
    )
}

/// The section of a joint.
fn joint(number: usize, letter: char, joint: Option<&Joint>) -> String {
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
             # TODO: the servo loop, in volts. For a drive that follows a speed: P = 1 first, doubled until the axis\n\
             # hums, then half of it; FF1 = 10 / (units a second at 10 V) removes most of the following error.\n\
             # I and D stay 0 until that works.\n",
            &LOOP[..],
        ),
    };
    let mut text = format!(
        "\n[JOINT_{number}]\nTYPE = {kind}\n# TODO: units, and units a second\n{LIMITS}\
         # Following error, in units, that stops the machine: at full velocity, and at standstill\n\
         FERROR = 1\nMIN_FERROR = 0.25\n{remark}"
    );
    for (name, _, value) in settings {
        let _ = writeln!(text, "{name} = {value}");
    }
    text + &homing(letter, joint)
}

/// Homing, as comments: without it a joint is at 0 where it stands.
fn homing(letter: char, joint: Option<&Joint>) -> String {
    let sequence = u8::from(letter != 'Z');
    let index = match joint {
        Some(Joint::Servo(_)) => "# HOME_USE_INDEX = YES\n",
        Some(Joint::Stepper(stepper)) if stepper.has_index => "# HOME_USE_INDEX = YES\n",
        _ => "",
    };
    format!(
        "# Homing, with the switch in motion.hal; without these lines a joint is at 0 where it stands. The sign of\n\
         # HOME_SEARCH_VEL is the direction to the switch.\n\
         # HOME = 0\n# HOME_OFFSET = 0\n# HOME_SEARCH_VEL = -0.5\n# HOME_LATCH_VEL = 0.1\n{index}\
         # HOME_SEQUENCE = {sequence}\n"
    )
}
