//! Parts of a board that a controller connects to.

use std::collections::BTreeMap;
use std::net::SocketAddrV4;
use std::str::FromStr;

use mesa_hal::Configured;
use mesa_hal::MesaError;
use mesa_hal::driver::RemarkKind;
use mesa_hal::hal::{AnyValue, HalType, PinInfo, Role};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::sslbp::{MAX_CHANNELS, PortLayout};
use mesa_tools::advice::with_advice;

use crate::board::address::BoardAddress;
use crate::board::bus::Bus;
use crate::board::hazard::{Hazard, hazard};
use crate::board::named;
use crate::board::pattern::Pattern;
use crate::board::place;
use crate::ui::context::Failure;
use mesa_pci::PciAddress;

/// Pins of the board's own modules that a controller connects to, without the board's name.
const OF_MODULES: [&str; 15] = [
    "encoder.??.position",
    "encoder.??.velocity",
    "encoder.??.index-enable",
    "pwmgen.??.value",
    "pwmgen.??.enable",
    "stepgen.??.position-cmd",
    "stepgen.??.position-fb",
    "stepgen.??.velocity-fb",
    "stepgen.??.enable",
    "stepgen.??.index-enable",
    "in*.??.input-??",
    "in*.??.enc?-count",
    "ssr.??.out-??",
    "outm.??.out-??",
    "gpio.???.in",
];

/// Pins of remotes that duplicate others, or that controllers do not connect to.
const NOT_OF_REMOTES: [&str; 3] = ["*-not", "*.rawcounts", "*.reset"];

/// Settings of outputs that must be the same in LinuxCNC as in `mesa-hal`, because another scale or
/// mode means another voltage.
const SETTINGS: [&str; 7] = [
    "pwmgen.pwm_frequency",
    "pwmgen.??.scale",
    "pwmgen.??.offset-mode",
    "pwmgen.??.output-type",
    "*analogout*-scalemax",
    "*analogout*-maxlim",
    "*analogout*-minlim",
];

/// LinuxCNC's axis letters, which limit the number of joints.
const LETTERS: &str = "XYZABCUVW";

/// Parts of a board that a controller connects to.
#[derive(Debug)]
pub struct Machine {
    /// For example `hm2_7i97.0`.
    pub board: String,
    /// Address of the board; `None` if it is simulated.
    pub host: Host,
    /// Pins that LinuxCNC has under the same names.
    pub pins: Vec<PinInfo>,
    /// Settings with their values in LinuxCNC's format.
    pub settings: Vec<(String, String)>,
    /// Encoders, each with an analog output, and then step generators; at most as many as there are
    /// axes.
    pub joints: Vec<Joint>,
    /// The axis of each joint. A letter stands twice for an axis with two motors.
    pub letters: String,
    /// Axis outputs of the board that are no joint's.
    pub spare: Vec<Joint>,
    /// Prefixes of the names of the cards' pins.
    pub cards: Vec<String>,
    /// All pins and parameters of the board, also those without a signal.
    all: Vec<PinInfo>,
    /// Configuration of each serial port for LinuxCNC: the software mode of each channel, or `x`.
    pub ports: BTreeMap<u8, String>,
    /// Remotes, one line each.
    pub remotes: Vec<String>,
    /// Modules that are not driven, one line each.
    pub undriven: Vec<String>,
}

/// An axis: the names of its pins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Joint {
    /// An encoder and an analog output.
    Servo(Servo),
    /// A step generator.
    Stepper(Stepper),
}

/// The pins of a servo axis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Servo {
    /// Prefix of the names of the encoder's pins.
    pub encoder: String,
    /// Pin of the analog output.
    pub volts: String,
    /// Pin that enables the drive; `None` for an unknown card.
    pub enable: Option<String>,
}

/// Where the files find the board; `None` if they were made from a simulated one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Host {
    Ethernet(Option<SocketAddrV4>),
    Pci(Option<PciAddress>),
}

impl Host {
    fn at(address: BoardAddress) -> Self {
        match address {
            BoardAddress::Ethernet(address) => {
                Self::Ethernet(Some(address).filter(|address| !address.ip().is_loopback()))
            }
            BoardAddress::Pci(address) => Self::Pci(Some(address)),
            BoardAddress::Embedded => Self::Pci(None),
        }
    }

    pub const fn is_pci(self) -> bool {
        matches!(self, Self::Pci(_))
    }
}

/// The pins of a stepper axis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stepper {
    /// Prefix of the names of the step generator's pins.
    pub stepgen: String,
    /// Pin that enables the generator.
    pub enable: String,
    /// True if the generator has an index input.
    pub has_index: bool,
}

impl Joint {
    /// Prefix of the pins of its encoder or step generator.
    pub fn module(&self) -> &str {
        match self {
            Self::Servo(servo) => &servo.encoder,
            Self::Stepper(stepper) => &stepper.stepgen,
        }
    }

    /// Pin that enables it.
    pub fn enable(&self) -> Option<&String> {
        match self {
            Self::Servo(servo) => servo.enable.as_ref(),
            Self::Stepper(stepper) => Some(&stepper.enable),
        }
    }

    /// The pin that is on while its position may be wrong; only this project's driver has it.
    pub fn unsure(&self) -> String {
        match self {
            Self::Servo(servo) => format!("{}.count-unsure", servo.encoder),
            Self::Stepper(stepper) => format!("{}.position-unsure", stepper.stepgen),
        }
    }

    /// The servo axis.
    pub const fn servo(&self) -> Option<&Servo> {
        match self {
            Self::Servo(servo) => Some(servo),
            Self::Stepper(_) => None,
        }
    }
}

impl Machine {
    /// Takes the parts of a board that is discovered and not started: the driver's own pins, which
    /// LinuxCNC does not have, do not exist yet.
    /// `letters` are the axes of the machine; without them every output for an axis is one.
    ///
    /// # Errors
    /// More axes than outputs, and a remote in a mode that LinuxCNC has no number for.
    pub fn of(
        board: &Configured<Bus>,
        address: BoardAddress,
        letters: Option<&Axes>,
    ) -> Result<Self, Failure> {
        let all = board.pins();
        let groups: Vec<_> = board.remotes().map(|(_, it)| it.pins.group).collect();
        let prefix = format!("{}.", board.name());
        let own = |info: &PinInfo| info.name.strip_prefix(&prefix).map(str::to_owned);
        let is_one = |patterns: &[&str], name: &str| {
            patterns.iter().any(|it| Pattern::from(*it).fits_text(name))
        };
        let is_encoder = |info: &PinInfo| own(info).is_some_and(|it| it.starts_with("encoder."));
        let reaches_a_terminal = |info: &PinInfo| {
            let mut same = all.infos().iter().filter(|other| is_of_one(info, other));
            same.any(|pin| !pin.place.terminal.is_empty())
        };
        let mut encoders = all.infos().iter().filter(|info| is_encoder(info));
        let has_terminals = encoders.any(|pin| !pin.place.terminal.is_empty());
        let is_connected = |info: &&PinInfo| {
            let name = own(info).unwrap_or_default();
            // I/O pins at connectors for daughter cards only, as on the 7I92, have one terminal and
            // are left out; those of a 7I97 are on a header too.
            let is_free = name.starts_with("gpio.") && !info.place.terminal.contains(", ");
            // An encoder at no terminal, where others are at one.
            let is_nowhere = is_encoder(info) && has_terminals && !reaches_a_terminal(info);
            let is_taken = if is_nowhere {
                false
            } else if groups.contains(&info.group) {
                !is_one(&NOT_OF_REMOTES, &name)
            } else {
                is_one(&OF_MODULES, &name) && !is_free
            };
            !info.role.is_param() && is_taken
        };
        let pins: Vec<_> = all.infos().iter().filter(is_connected).cloned().collect();
        let undriven = board
            .remarks()
            .iter()
            .filter_map(|remark| match &remark.kind {
                RemarkKind::Undriven(module) => Some(with_advice(module, module.reason.advice())),
                _ => None,
            });
        let undriven = undriven.collect();
        let settings = all.infos().iter().zip(all.values());
        let settings = settings.filter_map(|(info, value)| {
            let is_it = info.role == Role::Setting && is_one(&SETTINGS, &own(info)?);
            is_it.then(|| (info.name.clone(), number(value)))
        });
        let mut settings: Vec<_> = settings.collect();
        settings.extend(dither(board, &prefix));
        let (ports, remotes) = ports(board)?;
        let mut joints = joints(board, &pins);
        let letters = axes(letters, joints.len())?;
        let spare = joints.split_off(letters.len().min(joints.len()));
        Ok(Self {
            joints,
            letters,
            spare,
            cards: board
                .remotes()
                .map(|(_, it)| it.pins.prefix.clone())
                .collect(),
            all: all.infos().to_vec(),
            settings,
            pins,
            board: board.name().to_owned(),
            host: Host::at(address),
            ports,
            remotes,
            undriven,
        })
    }

    /// The name of a pin without the name of the board.
    pub fn own<'a>(&self, name: &'a str) -> &'a str {
        let own = name.strip_prefix(&self.board).unwrap_or(name);
        own.trim_start_matches('.')
    }

    /// Serial ports with remotes: LinuxCNC has no pins and parameters of the others.
    pub fn used_ports(&self) -> impl Iterator<Item = u8> {
        let used = self.ports.iter();
        let used = used.filter(|(_, modes)| modes.contains(|mode| mode != 'x'));
        used.map(|(port, _)| *port)
    }

    /// True if the board has this pin or parameter.
    pub fn has(&self, name: &str) -> bool {
        self.all.iter().any(|pin| pin.name == name)
    }

    /// Names of the board's pins and parameters, with or without a signal, that fit a pattern.
    pub fn of_all(&self, pattern: &str) -> impl Iterator<Item = &str> {
        let pattern = Pattern::from(pattern);
        let names = self.all.iter().map(|pin| &*pin.name);
        names.filter(move |name| pattern.fits_text(self.own(name)))
    }

    /// True for an enable that a joint has too.
    pub fn is_shared(&self, enable: &str) -> bool {
        let mut joints = self.joints.iter();
        joints.any(|joint| joint.enable().is_some_and(|it| it == enable))
    }

    /// The number of the joint whose drive a pin enables.
    pub fn enabled_by(&self, pin: &PinInfo) -> Option<usize> {
        let mut joints = self.joints.iter();
        joints.position(|joint| joint.enable() == Some(&pin.name))
    }
}

/// True if two pins belong to the same instance of a module.
fn is_of_one(one: &PinInfo, other: &PinInfo) -> bool {
    let instance = |info: &PinInfo| {
        info.name
            .rsplit_once('.')
            .map(|(instance, _)| instance.to_owned())
    };
    instance(one) == instance(other)
}

/// Dither settings of PWM modules of version 1, which `mesa-hal` always dithers. In LinuxCNC dither
/// is a parameter that is off at first. Every LinuxCNC that supports such a module has the
/// parameter (2.9.2 and later; FIELD 3.3).
fn dither(board: &Configured<Bus>, prefix: &str) -> Vec<(String, String)> {
    let modules = board.firmware().modules_of(Gtag::PWM);
    let versions = modules.flat_map(|(_, it)| (0..it.instances).map(|_| it.version));
    (0..)
        .zip(versions)
        .filter(|(_, version)| *version >= 1)
        .map(|(n, _): (u8, _)| (format!("{prefix}pwmgen.{n:02}.dither"), "1".to_owned()))
        .collect()
}

/// Modes of all channels in LinuxCNC's format, and one line for each remote.
fn ports(board: &Configured<Bus>) -> Result<(BTreeMap<u8, String>, Vec<String>), Failure> {
    let instances = PortLayout::ports(board.firmware()).len() as u8;
    let none = ['x'; MAX_CHANNELS as usize];
    let mut ports: BTreeMap<_, _> = (0..instances).map(|port| (port, none)).collect();
    let mut remotes = Vec::new();
    for (id, remote) in board.remotes() {
        let started = &remote.started;
        let mode = started.software_mode;
        let place = format!("{}: mode {mode}", remote.label());
        let digit = char::from_digit(mode.into(), 10).ok_or_else(|| {
            Failure::usage(format_args!("{place}: LinuxCNC takes modes 0 to 9 only"))
        })?;
        let modes = ports.entry(id.port).or_insert(none);
        if let Some(character) = modes.get_mut(usize::from(id.channel)) {
            *character = digit;
        }
        remotes.push(place);
    }
    let ports = ports.into_iter();
    let ports = ports.map(|(port, modes)| (port, modes.iter().collect()));
    Ok((ports.collect(), remotes))
}

/// Pairs of the first encoder and the first analog output, the second ones, and so on; then the
/// step generators.
fn joints(board: &Configured<Bus>, pins: &[PinInfo]) -> Vec<Joint> {
    let of_fpga = format!("{}.encoder.", board.name());
    let encoders = pins.iter().filter_map(|pin| {
        let encoder = pin.name.strip_suffix(".position")?;
        encoder.starts_with(&of_fpga).then(|| encoder.to_owned())
    });
    let volts = pins.iter().filter(|pin| is_analog_output(pin));
    let servo = |(encoder, volts): (String, &PinInfo)| {
        let id = board.pins().find(&volts.name);
        let enable = id.and_then(|id| board.pins().enables(id).next());
        let enable = enable.and_then(|enable| board.pins().info_of(enable));
        Joint::Servo(Servo {
            encoder,
            volts: volts.name.clone(),
            enable: enable.map(|enable| enable.name.clone()),
        })
    };
    let stepper = |pin: &PinInfo| {
        let stepgen = pin.name.strip_suffix(".position-cmd")?.to_owned();
        let index = format!("{stepgen}.index-enable");
        Some(Joint::Stepper(Stepper {
            enable: format!("{stepgen}.enable"),
            has_index: pins.iter().any(|pin| pin.name == index),
            stepgen,
        }))
    };
    let servos = encoders.zip(volts).map(servo);
    servos.chain(pins.iter().filter_map(stepper)).collect()
}

/// The letters of the axes: those that are asked for, else one for each output, and at least one.
fn axes(requested: Option<&Axes>, outputs: usize) -> Result<String, Failure> {
    let Some(Axes(letters)) = requested else {
        return Ok(LETTERS.chars().take(outputs.max(1)).collect());
    };
    if outputs > 0 && letters.len() > outputs {
        let what = format_args!(
            "--axes {letters}: {} axes, and the board has outputs for {outputs}",
            letters.len()
        );
        return Err(Failure::usage(what).advising("give fewer axes"));
    }
    Ok(letters.clone())
}

/// Axes as a person gives them: `XYZ`, and `XYYZ` for two motors on one axis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axes(String);

impl FromStr for Axes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let letters = text.to_uppercase();
        let unknown = letters.chars().find(|letter| !LETTERS.contains(*letter));
        match unknown {
            Some(unknown) => Err(format!("`{unknown}` is no axis; the axes are {LETTERS}")),
            None if letters.is_empty() => Err("no axis".to_owned()),
            None if letters.len() > LETTERS.len() => {
                Err(format!("LinuxCNC has {} joints at most", LETTERS.len()))
            }
            None => Ok(Self(letters)),
        }
    }
}

/// True for an analog output of an axis: that of a 7I76 is for a spindle.
fn is_analog_output(pin: &PinInfo) -> bool {
    let is_spindle = pin.name.ends_with(".spinout");
    let is_voltage = pin.unit.to_lowercase().starts_with('v');
    pin.role == Role::Output && pin.hal_type == HalType::Float && is_voltage && !is_spindle
}

/// True if a pin can turn a drive on.
pub fn is_enable(pin: &PinInfo) -> bool {
    pin.role == Role::Output && hazard(pin) == Hazard::DriveEnable
}

/// Terminals and unit of a pin, on one line.
pub fn remark(pin: &PinInfo) -> String {
    let unit = match &*pin.unit {
        "" => String::new(),
        unit => format!(" in {unit}"),
    };
    let text = place::short(&pin.place) + &unit;
    // The unit comes from the remote and may contain control characters.
    text.trim().replace(char::is_control, " ")
}

/// Formats a value for LinuxCNC, with all digits.
fn number(value: AnyValue) -> String {
    match value.hal_type {
        HalType::Float => f64::from_bits(value.bits).to_string(),
        _ => named::text(value),
    }
}
