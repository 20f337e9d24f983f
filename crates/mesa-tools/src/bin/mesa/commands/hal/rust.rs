//! The program for `mesa-hal`.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::machine::{Host, Joint, Machine, Servo, remark};
use mesa_hal::hal::{HalType, PinInfo, Role};

/// A program that runs the cycle with a handle for each pin, and enables no drive.
pub fn program(machine: &Machine) -> String {
    let Machine { board, host, .. } = machine;
    let todo = " TODO: made from a simulated board.";
    let (address, simulated) = match host {
        Host::Ethernet(Some(address)) => (address.to_string(), ""),
        Host::Ethernet(None) => ("10.10.10.10:27181".to_owned(), todo),
        Host::Pci(Some(address)) => (address.to_string(), ""),
        Host::Pci(None) => ("0000:03:00.0".to_owned(), todo),
    };
    let joints: Vec<_> = machine
        .joints
        .iter()
        .filter_map(Joint::servo)
        .filter(|it| it.enable.is_some())
        .collect();
    let others: Vec<_> = machine
        .pins
        .iter()
        .filter(|pin| !is_of(&joints, pin))
        .collect();
    let mut used: BTreeSet<&str> = others.iter().map(|pin| kind(pin)).collect();
    used.extend(["Driver", "Pins", "Settings", "MesaError"]);
    let (package, import) = if host.is_pci() {
        (
            "`mesa-pci = \"0.1\"` and ",
            "use mesa_pci::{PciDevice, SYSFS};\n",
        )
    } else {
        used.extend(["UdpBus", "UdpConfig"]);
        ("", "")
    };
    if !joints.is_empty() {
        used.extend(["Counter", "Output"]);
    }
    let used: Vec<_> = used.into_iter().collect();
    let used = used.join(", ");
    let mut text = format!(
        "//! Skeleton of a controller on {board}, written by `mesa hal`. Enables no drive.\n//!\n\
         //! In Cargo.toml: {package}`mesa-hal = {{ version = \"0.1\", features = [\"realtime\"] }}`.\n\n\
         use std::error::Error;\nuse std::ops::ControlFlow::Continue;\nuse std::process::ExitCode;\n\n\
         use mesa_hal::hal::PinError;\nuse mesa_hal::runner::{{Runner, Stop}};\n\
         use mesa_hal::{{{used}}};\n{import}\n\
         /// The board, unless an argument names another.{simulated}\n\
         const BOARD: &str = \"{address}\";\n\n"
    );
    text.push_str(&types(machine, &joints, &others));
    text.push_str(&find(machine, &joints, &others));
    text.push_str(&control(&joints));
    text.push_str(&main(machine));
    text
}

fn is_of(joints: &[&Servo], pin: &PinInfo) -> bool {
    joints.iter().any(|joint| {
        let module = pin.name.rsplit_once('.').map(|(module, _)| module);
        let is_encoder = module == Some(&*joint.encoder) && !pin.name.ends_with(".velocity");
        is_encoder || joint.volts == pin.name || joint.enable.as_ref() == Some(&pin.name)
    })
}

/// Types of the program.
fn types(machine: &Machine, joints: &[&Servo], others: &[&PinInfo]) -> String {
    let mut text = String::new();
    if !joints.is_empty() {
        text.push_str(
            "/// A servo axis.\n#[derive(Clone, Copy, Debug)]\nstruct Joint {\n    \
             encoder: Counter,\n    /// In volts; 0 V while the drive is not enabled.\n    \
             volts: Output<f64>,\n    /// Enables the drive, and every other drive with the same enable.\n    \
             #[allow(dead_code, reason = \"nothing enables a drive yet\")]\n    \
             enable: Output<bool>,\n}\n\n",
        );
    }
    text.push_str(
        "/// Handles of the machine's pins.\n#[derive(Debug)]\n\
         #[allow(dead_code, reason = \"remove unused fields\")]\nstruct Machine {\n",
    );
    if !joints.is_empty() {
        let _ = writeln!(text, "    joints: [Joint; {}],", joints.len());
    }
    for pin in others {
        let remark = match &*remark(pin) {
            "" => machine.own(&pin.name).to_owned(),
            remark => remark.to_owned(),
        };
        let field = field(machine, pin);
        let _ = writeln!(text, "    /// {remark}.\n    {field}: {},", handle(pin));
    }
    text + "}\n\n"
}

/// `Machine::find`, which makes the handles.
fn find(machine: &Machine, joints: &[&Servo], others: &[&PinInfo]) -> String {
    let mut text =
        "impl Machine {\n    #[allow(clippy::too_many_lines, reason = \"a line for each pin\")]\n    fn find(pins: &Pins) -> Result<Self, PinError> {\n".to_owned();
    if !joints.is_empty() {
        text.push_str(
            "        let joint = |encoder: &str, volts: &str, enable: &str| {\n            \
             Ok(Joint {\n                encoder: Counter::find(pins, encoder)?,\n                \
             volts: pins.output(volts)?,\n                enable: pins.output(enable)?,\n            \
             })\n        };\n",
        );
    }
    text.push_str("        Ok(Self {\n");
    if !joints.is_empty() {
        text.push_str("            joints: [\n");
        for Servo {
            encoder,
            volts,
            enable,
        } in joints
        {
            let indent = " ".repeat(20);
            let _ = writeln!(
                text,
                "                joint(\n{indent}\"{encoder}\",\n{indent}\"{volts}\",\n\
                 {indent}\"{}\",\n                )?,",
                enable.as_deref().unwrap_or_default()
            );
        }
        text.push_str("            ],\n");
    }
    for pin in others {
        let how = kind(pin).to_lowercase();
        let (field, name) = (field(machine, pin), &pin.name);
        let _ = writeln!(text, "            {field}: pins.{how}(\"{name}\")?,");
    }
    text + "        })\n    }\n\n"
}

/// `Machine::control`, which runs in each cycle, and the functions it calls.
fn control(joints: &[&Servo]) -> String {
    let (servo, loops) = if joints.is_empty() {
        ("", "        // TODO\n        let _ = may_move;\n")
    } else {
        (
            "/// Servo loop of an axis: volts for a position, in counts while `encoder.scale` is 1. TODO\n\
             fn servo(_position: f64) -> f64 {\n    0.0\n}\n\n",
            "        for joint in self.joints {\n            \
             let position = joint.encoder.read(pins).ok().filter(|_| may_move);\n            \
             pins.set(joint.volts, position.map_or(0.0, servo));\n            \
             // TODO: once the emergency stop and each axis's direction of counting are tested:\n            \
             // pins.set(joint.enable, may_move);\n        }\n",
        )
    };
    format!(
        "    /// One cycle: inputs have been read, outputs are written after it.\n    \
         fn control(&self, pins: &mut Pins) {{\n        \
         let may_move = may_move(self, pins);\n{loops}    }}\n}}\n\n\
         /// True if motion is allowed. TODO: the input of the emergency stop. An input that is not valid\n\
         /// counts as pressed: `pins.read(machine.INPUT).ok() == Some(true)`.\n\
         fn may_move(_machine: &Machine, _pins: &Pins) -> bool {{\n    false\n}}\n\n{servo}"
    )
}

fn main(machine: &Machine) -> String {
    let ports = machine.ports.iter();
    let ports = ports.map(|(port, modes)| format!("({port}, \"{modes}\".parse()?)"));
    let ports: Vec<_> = ports.collect();
    let ports = if ports.is_empty() {
        "        ..Settings::default()\n".to_owned()
    } else {
        let ports = ports.join(", ");
        format!("        serial_ports: [{ports}].into(),\n        ..Settings::default()\n")
    };
    let open = if machine.host.is_pci() {
        "let device = PciDevice::at(SYSFS.as_ref(), address)?;\n    \
         let bus = device\n        .open()\n        \
         .map_err(|error| error.with_advice().to_string())?;\n    "
    } else {
        "let bus = UdpBus::connect(address, UdpConfig::default())?;\n    "
    };
    format!(
        "fn main() -> Result<ExitCode, Box<dyn Error>> {{\n    \
         let address = std::env::args().nth(1);\n    \
         let address = address.as_deref().unwrap_or(BOARD).parse()?;\n    \
         let settings = Settings {{\n{ports}    }};\n    \
         {open}let driver = Driver::start(bus, settings)?;\n    \
         for missing in driver.missing() {{\n        let missing = missing.with_advice();\n        eprintln!(\"MISSING: {{missing}}\");\n    }}\n    \
         let machine = Machine::find(driver.pins())?;\n    \
         let events = driver.events();\n    \
         eprintln!(\"{{}} runs; Ctrl-C ends it\", driver.name());\n    \
         let runner = Runner::new(driver).stop_on(Stop::on_signals()?);\n    \
         let ended = runner.run(|cycle| {{\n        \
         machine.control(cycle.pins_mut());\n        Continue(())\n    }});\n    \
         for event in events {{\n        eprintln!(\"{{}}\", event.with_advice());\n    }}\n    \
         ended.stopped?;\n    \
         Ok(match ended.signal {{\n        Some(signal) => signal.exit_code(),\n        \
         None => ExitCode::SUCCESS,\n    }})\n}}\n"
    )
}

/// An identifier for a pin.
fn field(machine: &Machine, pin: &PinInfo) -> String {
    let name = machine.own(&pin.name).to_lowercase();
    let name = name.replace(|c: char| !c.is_ascii_alphanumeric(), "_");
    if name.starts_with(|c: char| c.is_ascii_digit()) {
        format!("i{name}")
    } else {
        name
    }
}

fn kind(pin: &PinInfo) -> &'static str {
    match pin.role {
        Role::Input => "Input",
        Role::InOut => "InOut",
        _ => "Output",
    }
}

fn handle(pin: &PinInfo) -> String {
    let value = match pin.hal_type {
        HalType::Bit => "bool",
        HalType::S32 => "i32",
        HalType::U32 => "u32",
        HalType::S64 => "i64",
        HalType::U64 => "u64",
        HalType::Float => "f64",
    };
    format!("{}<{value}>", kind(pin))
}
