//! The emergency-stop chain of `motion.hal`.

use std::fmt::Write;

use super::super::Component;
use super::super::machine::{Joint, Machine};
use super::parts::Parts;
use super::prepared::Terminals;

/// Most inputs of one part `logic`.
const MAX_INPUTS: usize = 16;

/// A part that breaks the chain while its fault is on, and until it is reset.
struct Link {
    /// Name of the part.
    name: &'static str,
    /// Signal of the fault.
    fault: &'static str,
    /// Signal behind the part.
    ok: &'static str,
}

const WATCHDOG: Link = Link {
    name: "estop-watchdog",
    fault: "board-watchdog",
    ok: "estop-watchdog-ok",
};
const NETWORK: Link = Link {
    name: "estop-network",
    fault: "board-lost",
    ok: "estop-network-ok",
};
const PORTS: Link = Link {
    name: "estop-ports",
    fault: "ports-stopped",
    ok: "estop-ports-ok",
};
const INPUTS: Link = Link {
    name: "estop-inputs",
    fault: "inputs-invalid",
    ok: "estop-inputs-ok",
};
const POSITION: Link = Link {
    name: "estop-position",
    fault: "position-lost",
    ok: "estop-position-ok",
};
const BUTTON: Link = Link {
    name: "estop-button",
    fault: "estop-pressed",
    ok: "estop-ok",
};

/// Adds the chain to the parts, and returns its lines.
pub fn chain(
    machine: &Machine,
    component: Component,
    parts: &mut Parts,
    terminals: &mut Terminals<'_>,
) -> String {
    let is_ours = component.is_ours();
    let mut links = vec![WATCHDOG];
    if !machine.host.is_pci() {
        links.push(NETWORK);
    }
    let mut text = String::new();
    if is_ours {
        text += &inputs_valid(machine, parts);
        links.push(INPUTS);
        if !machine.joints.is_empty() {
            text += &positions_known(machine, parts);
            links.push(POSITION);
        }
    } else if machine.used_ports().next().is_some() {
        text += &ports_run(machine, parts);
        links.push(PORTS);
    }
    links.push(BUTTON);
    let reset = if is_ours {
        resets(machine, parts)
    } else {
        "\n# The button of LinuxCNC's screen (F1) resets the chain.\n\
         net estop-reset <= iocontrol.0.user-request-enable\n"
            .to_owned()
    };
    text + &reset + &links_of(&links, is_ours, parts) + &button(terminals)
}

/// The links of the chain, each behind the one before it.
fn links_of(links: &[Link], is_ours: bool, parts: &mut Parts) -> String {
    let mut text = String::from(
        "\n# Emergency stop: a chain that each of these faults breaks, until it is reset (F1).\n\
         # Software is no safe way to turn a motor off: the button has to remove its power as well.\n\
         net estop-released <= iocontrol.0.user-enable-out",
    );
    for Link { name, fault, ok } in links {
        parts.add("estop_latch", name);
        let _ = write!(
            text,
            " => {name}.ok-in\n\
             net {fault} => {name}.fault-in\n\
             net {ok} <= {name}.ok-out"
        );
    }
    text += " => iocontrol.0.emc-enable-in motion.enable\n";
    let reset = if is_ours {
        "estop-reset-late"
    } else {
        "estop-reset"
    };
    let _ = write!(text, "net {reset} =>");
    for Link { name, .. } in links {
        let _ = write!(text, " {name}.reset");
    }
    text.push('\n');
    text
}

/// The line of the button, whose signal counts as pressed until it has an input.
fn button(terminals: &mut Terminals<'_>) -> String {
    let line = match terminals.closed_input() {
        Some(input) => format!("# net estop-pressed <= {input}\n"),
        None => "#   net estop-pressed <= PIN-not\n".to_owned(),
    };
    format!(
        "sets estop-pressed true\n\
         # TODO: the input of the button; until then it counts as pressed. For a normally closed contact:\n\
         {line}"
    )
}

/// Each serial port with cards has to run: hostmot2 has no pin for a single card, and stops the
/// whole port when one of its cards fails.
fn ports_run(machine: &Machine, parts: &mut Parts) -> String {
    let mut text = String::from(
        "\n# Each serial port runs, which is state 3. hostmot2 stops a port when one of its cards fails; its\n\
         # outputs are off then, and its inputs, such as switches, keep their last values.\n",
    );
    let board = &machine.board;
    let ports: Vec<u8> = machine.used_ports().collect();
    for port in &ports {
        let (state, runs) = (format!("port-{port}-state"), format!("port-{port}-runs"));
        parts.add("conv_u32_float", &state);
        parts.add("wcomp", &runs);
        let _ = write!(
            text,
            "net {state}-number <= {board}.sserial.port-{port}.port_state => {state}.in\n\
             net {state} <= {state}.out => {runs}.in\n\
             setp {runs}.min 2.5\n\
             setp {runs}.max 3.5\n"
        );
    }
    parts.add_logic("0x1", ports.len(), "ports-run");
    parts.add("not", "ports-stopped");
    for (input, port) in ports.iter().enumerate() {
        let _ = writeln!(
            text,
            "net port-{port}-runs <= port-{port}-runs.out => ports-run.in-{input:02}"
        );
    }
    text + "net ports-run <= ports-run.and => ports-stopped.in\n\
            net ports-stopped <= ports-stopped.out\n"
}

/// Inputs of the board and of each card have to be valid, apart from single lost transfers.
fn inputs_valid(machine: &Machine, parts: &mut Parts) -> String {
    let board = std::iter::once(&machine.board);
    let pins = board.chain(&machine.cards);
    let pins: Vec<String> = pins.map(|prefix| format!("{prefix}.valid")).collect();
    let mut text = String::from(
        "\n# Inputs of the board and of each card, such as switches, are valid. An invalid input keeps its last\n\
         # value: the machine stops if that lasts longer than INVALID_TIME.\n",
    );
    // A part takes the result of the one before it as its first input.
    let mut before: Option<String> = None;
    for (number, pins) in pins.chunks(MAX_INPUTS - 1).enumerate() {
        let name = format!("inputs-valid-{number}");
        let inputs = before.iter().chain(pins);
        for (input, pin) in inputs.enumerate() {
            let signal = if *pin == result(number.wrapping_sub(1)) {
                format!("inputs-valid-up-to-{}", number - 1)
            } else {
                valid_signal(machine, pin)
            };
            let _ = writeln!(text, "net {signal} <= {pin} => {name}.in-{input:02}");
        }
        let count = pins.len() + usize::from(before.is_some());
        parts.add_logic("0x1", count, &name);
        before = Some(result(number));
    }
    let last = before.unwrap_or_default();
    parts.add("timedelay", "inputs-valid-late");
    parts.add("not", "inputs-invalid");
    let _ = write!(
        text,
        "net inputs-valid <= {last} => inputs-valid-late.in\n\
         setp inputs-valid-late.on-delay 0\n\
         setp inputs-valid-late.off-delay [HOSTMOT2]INVALID_TIME\n\
         net inputs-valid-late <= inputs-valid-late.out => inputs-invalid.in\n\
         net inputs-invalid <= inputs-invalid.out\n"
    );
    text
}

/// `board-valid`, or `7i77-0-0-valid` of a card.
fn valid_signal(machine: &Machine, pin: &str) -> String {
    match machine.own(pin) {
        "valid" => "board-valid".to_owned(),
        own => own.replace('.', "-"),
    }
}

/// Output of a part of the chain of valid inputs.
fn result(number: usize) -> String {
    format!("inputs-valid-{number}.and")
}

/// A joint that LinuxCNC takes for homed, and whose position may be wrong, stops the machine and
/// has to be homed again.
fn positions_known(machine: &Machine, parts: &mut Parts) -> String {
    let mut text = String::from(
        "\n# A joint that is homed, and whose position may be wrong after a fault, stops the machine and is\n\
         # unhomed: home it again.\n\
         net machine-on <= motion.motion-enabled => machine-off.in\n\
         net machine-off <= machine-off.out\n",
    );
    parts.add("not", "machine-off");
    for (number, joint) in machine.joints.iter().enumerate() {
        text += &position_known(number, joint, parts);
    }
    let count = machine.joints.len();
    parts.add_logic("0x2", count, "position-lost");
    let _ = writeln!(text, "net position-lost <= position-lost.or");
    for number in 0..count {
        let name = format!("unhome-{number}");
        parts.add_logic("0x1", 2, &name);
        let _ = write!(
            text,
            "net joint-{number}-lost => {name}.in-00\n\
             net machine-off => {name}.in-01\n\
             net joint-{number}-unhome <= {name}.and => halui.joint.{number}.unhome\n"
        );
    }
    text
}

fn position_known(number: usize, joint: &Joint, parts: &mut Parts) -> String {
    let (late, lost) = (
        format!("joint-{number}-homed"),
        format!("joint-{number}-lost"),
    );
    parts.add("timedelay", &late);
    parts.add("and2", &lost);
    let (module, unsure) = (joint.module(), joint.unsure());
    format!(
        "net joint-{number}-homed <= joint.{number}.homed => {module}.homed {late}.in\n\
         setp {late}.on-delay 0.1\n\
         setp {late}.off-delay 0\n\
         net joint-{number}-is-homed <= {late}.out => {lost}.in0\n\
         net joint-{number}-unsure <= {unsure} => {lost}.in1\n\
         net joint-{number}-lost <= {lost}.out => position-lost.in-{number:02}\n"
    )
}

/// The button of the screen lets all outputs follow again, and then resets the chain: what it has
/// cleared has to be gone by then.
fn resets(machine: &Machine, parts: &mut Parts) -> String {
    parts.add("timedelay", "estop-reset-late");
    let mut text = String::from(
        "\n# The button of LinuxCNC's screen (F1) clears io_error and has_bit of the board, lets the outputs of the\n\
         # board and of each card follow again, and then resets the chain.\n\
         net estop-reset <= iocontrol.0.user-request-enable => estop-reset-late.in\n",
    );
    for prefix in std::iter::once(&machine.board).chain(&machine.cards) {
        let _ = writeln!(text, "net estop-reset => {prefix}.rearm");
    }
    text + "setp estop-reset-late.on-delay [HOSTMOT2]RESET_TIME\n\
            setp estop-reset-late.off-delay 0\n\
            net estop-reset-late <= estop-reset-late.out\n"
}
