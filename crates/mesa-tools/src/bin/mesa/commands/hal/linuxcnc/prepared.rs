//! Lines of `motion.hal` that are prepared as comments: switches, spindle, coolant, probe,
//! handwheel.
//!
//! Each is a whole line that works where it stands, once its `# ` is removed: it uses signals that
//! `board.hal` has made, or pins that have none yet, and each input and output once.

use std::fmt::Write;
use std::vec::IntoIter;

use mesa_hal::hal::{HalType, PinInfo, Role};

use super::super::machine::{Joint, Machine, is_enable, remark};
use super::signal;
use crate::board::pattern::Pattern;

const HEAD: &str = "
# Prepared lines. Each works where it stands without the `# ` in front of it. Inputs and outputs are examples:
# board.hal has the signals of all others, with their terminals. For the other sense of an input take its pin
# with `-not` at the end, as the limit switches do.
";

/// Digital inputs and outputs of the board and its cards, handed out once each.
#[derive(Debug)]
pub struct Terminals<'a> {
    machine: &'a Machine,
    inputs: IntoIter<&'a PinInfo>,
    outputs: IntoIter<&'a PinInfo>,
}

impl<'a> Terminals<'a> {
    /// All of them, in the order of the board's pins.
    pub fn of(machine: &'a Machine) -> Self {
        let is_bit = |pin: &&PinInfo, role| pin.hal_type == HalType::Bit && pin.role == role;
        let named = |pin: &&PinInfo, part: &str| {
            let last = machine.own(&pin.name).rsplit('.').next();
            last.is_some_and(|last| last.starts_with(part))
        };
        let pins = machine.pins.iter();
        let inputs = pins.filter(|pin| is_bit(pin, Role::Input) && named(pin, "input-"));
        let pins = machine.pins.iter();
        let outputs = pins.filter(|pin| {
            is_bit(pin, Role::Output) && (named(pin, "output-") || named(pin, "out-"))
        });
        let outputs = outputs.filter(|pin| !is_enable(pin));
        let (inputs, outputs): (Vec<_>, Vec<_>) = (inputs.collect(), outputs.collect());
        Self {
            machine,
            inputs: inputs.into_iter(),
            outputs: outputs.into_iter(),
        }
    }

    /// The next input as it is with a normally closed contact, with its terminal behind it.
    pub fn closed_input(&mut self) -> Option<String> {
        let (pin, place) = self.closed()?;
        Some(format!("{pin}{place}"))
    }

    fn closed(&mut self) -> Option<(String, String)> {
        let pin = self.inputs.next()?;
        let inverted = format!("{}-not", pin.name);
        self.machine
            .has(&inverted)
            .then(|| (inverted, comment(pin)))
    }

    /// A prepared line that connects the next input; empty if there is none.
    fn input(&mut self, to: &str) -> String {
        let Some(pin) = self.inputs.next() else {
            return String::new();
        };
        let (signal, comment) = (signal(self.machine, &pin.name), comment(pin));
        format!("# net {signal} => {to}{comment}\n")
    }

    /// A prepared line that connects the next output; empty if there is none.
    fn output(&mut self, from: &str) -> String {
        let Some(pin) = self.outputs.next() else {
            return String::new();
        };
        let (signal, comment) = (signal(self.machine, &pin.name), comment(pin));
        format!("# net {signal} <= {from}{comment}\n")
    }
}

/// The terminal of a pin, as a comment behind a line.
fn comment(pin: &PinInfo) -> String {
    match &*remark(pin) {
        "" => String::new(),
        place => format!("  # {place}"),
    }
}

/// All prepared lines.
pub fn lines(machine: &Machine, terminals: &mut Terminals<'_>) -> String {
    let mut encoders = spare_encoders(machine);
    let sections = [
        (
            "Home switches, with HOME_SEARCH_VEL and HOME_LATCH_VEL in machine.ini",
            homes(machine, terminals),
        ),
        (
            "Limit switches, normally closed, both of a joint in series",
            limits(machine, terminals),
        ),
        ("A probe", terminals.input("motion.probe-input")),
        ("Spindle", spindle(machine, terminals, encoders.next())),
        ("Coolant", coolant(terminals)),
        (
            "A charge pump, which toggles while the machine may run: 500 Hz with a thread of 1 kHz",
            charge_pump(terminals),
        ),
        (
            "A handwheel (MPG) with a switch for each axis",
            handwheel(machine, terminals, encoders.next()),
        ),
    ];
    let mut text = String::from(HEAD);
    for (title, lines) in sections.iter().filter(|(_, lines)| !lines.is_empty()) {
        let _ = write!(text, "\n# {title}.\n{lines}");
    }
    text
}

/// Encoders of the board at a terminal that are no joint's.
fn spare_encoders(machine: &Machine) -> IntoIter<String> {
    let is_used = |encoder: &str| machine.joints.iter().any(|joint| joint.module() == encoder);
    let of_board = Pattern::from("encoder.??.position");
    let names = machine.pins.iter().map(|pin| &*pin.name);
    let names = names.filter(|name| of_board.fits_text(machine.own(name)));
    let encoders = names.filter_map(|name| name.strip_suffix(".position").map(str::to_owned));
    let encoders: Vec<String> = encoders.filter(|encoder| !is_used(encoder)).collect();
    encoders.into_iter()
}

fn homes(machine: &Machine, terminals: &mut Terminals<'_>) -> String {
    let joints = 0..machine.letters.len();
    joints
        .map(|number| terminals.input(&format!("joint.{number}.home-sw-in")))
        .collect()
}

fn limits(machine: &Machine, terminals: &mut Terminals<'_>) -> String {
    let mut text = String::new();
    for number in 0..machine.letters.len() {
        let Some((pin, place)) = terminals.closed() else {
            break;
        };
        let _ = writeln!(
            text,
            "# net joint-{number}-limit <= {pin} => joint.{number}.neg-lim-sw-in joint.{number}.pos-lim-sw-in{place}"
        );
    }
    text
}

fn coolant(terminals: &mut Terminals<'_>) -> String {
    let pins = ["iocontrol.0.coolant-flood", "iocontrol.0.coolant-mist"];
    pins.map(|pin| terminals.output(pin)).concat()
}

fn charge_pump(terminals: &mut Terminals<'_>) -> String {
    match terminals.output("charge-pump.out") {
        line if line.is_empty() => line,
        line => format!(
            "# loadrt charge_pump\n\
             # addf charge-pump servo-thread -2\n\
             # net estop-ok => charge-pump.enable\n{line}"
        ),
    }
}

/// Switch, direction and speed of a spindle, and its encoder for threading.
fn spindle(machine: &Machine, terminals: &mut Terminals<'_>, encoder: Option<String>) -> String {
    let mut text = analog_spindle(machine);
    if machine.of_all("*.spinena").next().is_none() {
        text += &terminals.output("spindle.0.forward");
        text += &terminals.output("spindle.0.reverse");
    }
    if let Some(encoder) = encoder {
        text += &spindle_encoder(machine, &encoder);
    }
    text
}

/// Speed of a spindle: the output of a card for one, else the first one that is no joint's.
fn analog_spindle(machine: &Machine) -> String {
    if let Some(volts) = machine.of_all("*.spinout").next() {
        let card = volts.trim_end_matches(".spinout");
        let of = |pin: &str| signal(machine, &format!("{card}.{pin}"));
        return format!(
            "# setp {volts}-scalemax [SPINDLE_0]SPEED_AT_10_V\n\
             # setp {volts}-maxlim [SPINDLE_0]SPEED_AT_10_V\n\
             # setp {volts}-minlim 0\n\
             # net {} <= spindle.0.speed-out-abs\n\
             # net {} <= spindle.0.on\n\
             # net {} <= spindle.0.reverse\n",
            of("spinout"),
            of("spinena"),
            of("spindir"),
        );
    }
    let Some(spare) = machine.spare.iter().find_map(Joint::servo) else {
        return String::new();
    };
    let mut text = format!(
        "# loadrt scale names=spindle-volts\n\
         # addf spindle-volts servo-thread -2\n\
         # setp spindle-volts.gain [SPINDLE_0]VOLTS_PER_RPM\n\
         # net spindle-speed <= spindle.0.speed-out-abs => spindle-volts.in\n\
         # net {} <= spindle-volts.out\n",
        signal(machine, &spare.volts)
    );
    if let Some(enable) = &spare.enable
        && !machine.is_shared(enable)
    {
        let _ = writeln!(text, "# net {} <= spindle.0.on", signal(machine, enable));
    }
    text
}

fn spindle_encoder(machine: &Machine, encoder: &str) -> String {
    let line =
        |pin: &str, arrow: &str, to: &str| source(machine, &format!("{encoder}.{pin}"), arrow, to);
    [
        format!("# setp {encoder}.scale [SPINDLE_0]ENCODER_COUNTS\n"),
        line("position", "=>", "spindle.0.revs"),
        line("velocity", "=>", "spindle.0.speed-in"),
        line("index-enable", "<=>", "spindle.0.index-enable"),
    ]
    .concat()
}

/// A prepared line from a pin: on its signal, or on a new one if it has none.
fn source(machine: &Machine, pin: &str, arrow: &str, to: &str) -> String {
    let signal = signal(machine, pin);
    if machine.pins.iter().any(|info| info.name == pin) {
        format!("# net {signal} {arrow} {to}\n")
    } else if arrow == "=>" {
        format!("# net {signal} <= {pin} => {to}\n")
    } else {
        format!("# net {signal} {pin} {to}\n")
    }
}

fn handwheel(machine: &Machine, terminals: &mut Terminals<'_>, encoder: Option<String>) -> String {
    let of_card = || {
        let mut counts = machine
            .of_all("*.enc?.count")
            .chain(machine.of_all("*.enc?-count"));
        counts.next().map(str::to_owned)
    };
    let of_board = encoder.map(|encoder| format!("{encoder}.count"));
    let Some(counts) = of_board.or_else(of_card) else {
        return String::new();
    };
    let mut axes: Vec<char> = machine.letters.to_lowercase().chars().collect();
    axes.dedup();
    let to: Vec<String> = axes
        .iter()
        .map(|axis| format!("axis.{axis}.jog-counts"))
        .collect();
    let mut text = source(machine, &counts, "=>", &to.join(" "));
    for axis in axes {
        let select = terminals.input(&format!("axis.{axis}.jog-enable"));
        if select.is_empty() {
            break;
        }
        let _ = write!(text, "# setp axis.{axis}.jog-scale 0.01\n{select}");
    }
    text
}
