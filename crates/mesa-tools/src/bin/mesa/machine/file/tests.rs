use super::*;

use mesa_hal_sim::{MotorConfig, StepperConfig};

use crate::machine::boards::OF_FIRMWARE;
use crate::machine::description::Mover;

const MILL: &str = include_str!("../../../../../../../examples/mill.toml");
const ROUTER: &str = include_str!("../../../../../../../examples/router.toml");

fn parsed(text: &str) -> Result<Description, String> {
    parse(text, Path::new("."))
}

#[test]
fn example_is_read_as_its_comments_describe() {
    let mill = parsed(MILL).unwrap();
    assert_eq!(mill.board.name, "7i97");
    assert_eq!(mill.mac, Some(Mac([0x00, 0x60, 0x1B, 0x1B, 0x00, 0x97])));
    assert_eq!((mill.remotes.len(), mill.axes.len()), (1, 3));
    let Mover::Servo {
        output: 0,
        encoder: 0,
        motor,
    } = mill.axes[0].mover
    else {
        panic!("a motor on output 0: {:?}", mill.axes[0]);
    };
    assert_eq!(motor.config().stops, [-8.0, 508.0]);
    assert_eq!((motor.config().inertia, motor.config().drag), (0.08, 30.0));
    let limit = &mill.switches[1];
    assert_eq!((limit.from, limit.to), (502.0, f64::INFINITY));
    assert!(limit.normally_closed);
    let estop = mill.estop.unwrap();
    assert_eq!(estop.inputs[0].terminal, SimTerminal::Board { input: 15 });
}

#[test]
fn stepper_example_is_read_as_its_comments_describe() {
    let router = parsed(ROUTER).unwrap();
    assert_eq!(router.board.name, "7i92-7i76");
    let Mover::Stepper {
        generator: 0,
        encoder: None,
        motor,
    } = router.axes[0].mover
    else {
        panic!("a stepper motor: {:?}", router.axes[0]);
    };
    let config = motor.config();
    assert_eq!((config.steps_per_unit, config.max_speed), (200.0, 250.0));
    assert_eq!((config.min_pulse, config.dir_hold), (2_500, 5_000));
    // Without an encoder a count is a step.
    assert_eq!(config.counts_per_unit, 200.0);
    let spindle = &router.axes[3].mover;
    assert!(matches!(spindle, Mover::Servo { output: 0, .. }));
}

#[test]
fn documented_defaults_of_the_examples_are_the_defaults() {
    let motor = MotorConfig::default();
    are_the_defaults(
        MILL,
        &[
            ("counts_per_unit", motor.counts_per_unit),
            ("counts_per_index", motor.counts_per_revolution.into()),
            ("max_speed", motor.max_speed),
            ("full_scale", motor.full_scale),
            ("time_constant", motor.time_constant),
            ("dead_band", motor.friction),
            ("inertia", motor.inertia),
            ("max_force", motor.max_force),
            ("friction", motor.drag),
            ("position", motor.position),
        ],
    );
    let stepper = StepperConfig::default();
    are_the_defaults(
        ROUTER,
        &[
            ("steps_per_unit", stepper.steps_per_unit),
            ("max_acceleration", stepper.max_acceleration),
            ("start_speed", stepper.start_speed),
            ("max_speed", stepper.max_speed),
            ("min_pulse", stepper.min_pulse as f64),
            ("min_space", stepper.min_space as f64),
            ("dir_setup", stepper.dir_setup as f64),
            ("dir_hold", stepper.dir_hold as f64),
            ("position", stepper.position),
        ],
    );
}

fn are_the_defaults(example: &str, known: &[(&str, f64)]) {
    let line = |line: &&str| line.contains("# ") && line.contains("Default: ");
    for &(key, value) in known {
        let mut lines = example.lines().filter(line);
        let found = lines.find(|line| line.starts_with(&format!("{key} ")));
        let found = found.unwrap_or_else(|| panic!("{key} has no default in the example"));
        let (_, said) = found.rsplit_once("Default: ").unwrap();
        assert_eq!(said.parse::<f64>().unwrap(), value, "{key}");
    }
}

/// An example with one line replaced.
fn changed(example: &str, from: &str, to: &str) -> (usize, String) {
    let line = example.lines().position(|line| line.starts_with(from));
    let line = line.unwrap_or_else(|| panic!("no line `{from}`"));
    let lines = example.lines().enumerate();
    let text: Vec<_> = lines
        .map(|(number, old)| if number == line { to } else { old })
        .collect();
    (line + 1, text.join("\n"))
}

/// Start of a line, its replacement, and the key and the allowed values that the error contains.
const MISTAKES: &[(&str, &str, &str, &str)] = &[
    ("board", "board = \"7i43\"", "board", "7i92-7i77"),
    (
        "board",
        "bord = \"7i97\"",
        "bord",
        "expected one of `board`, `firmware`",
    ),
    ("mac", "mac = \"7\"", "mac", "00:60:1b:1b:00:97"),
    ("channel", "channel = 8", "remote.channel", "0 to 7"),
    ("name = \"y\"", "name = \"x\"", "axis.name", "another one"),
    ("name = \"y\"", "name = \"a b\"", "axis.name", "letters"),
    ("output", "output = 6", "axis.output", "0 to 5"),
    ("output", "output = 1", "axis.name", "belongs to"),
    (
        "max_speed",
        "max_speed = 0",
        "axis.max_speed",
        "more than 0",
    ),
    (
        "max_speed",
        "max_speed = \"1\"",
        "max_speed",
        "expected f64",
    ),
    ("max_speed", "top_speed = 1.0", "top_speed", "`max_speed`"),
    (
        "max_speed",
        "max_speed = nan",
        "axis.max_speed",
        "more than 0",
    ),
    (
        "counts_per_unit",
        "counts_per_unit = 0",
        "counts_per_unit",
        "not 0",
    ),
    ("inertia", "inertia = -1", "axis.inertia", "1e-9 to 1e9"),
    ("friction", "friction = -1", "axis.friction", "0 to 1e9"),
    ("dead_band", "dead_band = 11", "axis.dead_band", "0 to 10"),
    (
        "stops",
        "stops = [1.0, -1.0]",
        "axis.stops",
        "lower one first",
    ),
    (
        "position",
        "position = 600.0",
        "axis.position",
        "between the stops",
    ),
    ("axis = \"x\"", "axis = \"w\"", "switch.axis", "x, y, z"),
    ("to = 0.0", "", "switch.name", "`from`, `to`"),
    (
        "bounce_ms",
        "bounce_ms = -1",
        "switch.bounce_ms",
        "0 to 1000 ms",
    ),
    (
        "wire",
        "wire = { channel = 0 }",
        "switch.wire",
        "{ pin = N }",
    ),
    ("device", "device = \"nowhere\"", "remote.device", "7i77-io"),
    ("mode", "mode = 9", "remote.mode", "no mode 9"),
    (
        "wire = { input = 4 }",
        "wire = { input = 15 }",
        "input 15",
        "already, in line",
    ),
    (
        "wire = { input = 4 }",
        "wire = { pin = 4 }",
        "pin 4",
        "output of a module",
    ),
    (
        "wire = { input = 4 }",
        "wire = { input = 40 }",
        "input 40",
        "this board has",
    ),
    ("cuts_field", "cuts_field = [5]", "cuts_field", "channel 5"),
    ("speed", "speed = 1e6", "wheel.speed", "1000 clicks"),
    ("cuts_drives", "cuts_drives = 1", "cuts_drives", "boolean"),
];

/// The same for the stepper example.
const STEPPER_MISTAKES: &[(&str, &str, &str, &str)] = &[
    ("stepgen = 0", "stepgen = 5", "axis.stepgen", "0 to 4"),
    (
        "stepgen = 1",
        "stepgen = 0",
        "axis.name",
        "belongs to axis x",
    ),
    ("output", "stepgen = 2", "axis.name", "belongs to axis z"),
    ("output", "output = 1", "axis.output", "0 to 0"),
    ("output", "start_speed = 1", "axis.start_speed", "`stepgen`"),
    ("output", "dir_hold = 1", "axis.dir_hold", "`stepgen`"),
    ("min_pulse", "min_pulse = -1", "min_pulse", "u32"),
    ("min_space", "stops = [0, 1]", "axis.stops", "does not have"),
    ("min_space", "output = 0", "axis.output", "does not have"),
    ("min_space", "encoder = 1", "axis.encoder", "0 to 0"),
    ("min_space", "inertia = 1", "axis.inertia", "does not have"),
    (
        "steps_per_unit",
        "steps_per_unit = 0",
        "axis.steps_per_unit",
        "not 0",
    ),
    (
        "max_acceleration",
        "max_acceleration = 0",
        "axis.max_acceleration",
        "more than 0",
    ),
    (
        "start_speed",
        "start_speed = nan",
        "axis.start_speed",
        "more than 0",
    ),
    ("board", "board = \"7i97\"", "axis.stepgen", "has none"),
];

/// A board with three serial ports.
const PORTS: &str = r#"
firmware = "7I80HD-SSSV18_12_72-2016.txt"
[[remote]]
channel = 0
device = "7i77-io"
[[remote]]
port = 1
channel = 3
device = "7i84u"
[[remote]]
port = 2
channel = 0
device = "7i72"
mode = 1
[estop]
inputs = [{ port = 1, channel = 3, input = 31 }]
cuts_field = [0, "1.3"]
"#;

fn ports(text: &str) -> Result<Description, String> {
    let firmwares = "../../tests/transcripts/firmwares";
    parse(text, &Path::new(env!("CARGO_MANIFEST_DIR")).join(firmwares))
}

#[test]
fn remotes_are_on_any_serial_port_of_a_firmware() {
    let options = ports(PORTS).unwrap();
    assert_eq!(options.board, &OF_FIRMWARE);
    let mut machine = Machine::new(&options).unwrap();
    let slots = machine
        .description
        .remotes
        .iter()
        .map(|remote| remote.slot.to_string());
    assert_eq!(slots.collect::<Vec<_>>(), ["0", "1.3", "2.0"]);
    let inventory = machine.inventory();
    assert!(inventory.contains("channel 1.3: 7i84u"), "{inventory}");
    assert!(
        inventory.contains("emergency stop: channel 1.3 input 31"),
        "{inventory}"
    );
    let slot = Slot {
        port: 1,
        channel: 3,
    };
    let field = |machine: &mut Machine| {
        let inputs = machine.device(slot).unwrap().inputs();
        let field = inputs.into_iter().find(|(name, _)| name == "fieldvoltage");
        format!("{:?}", field.unwrap().1)
    };
    let before = field(&mut machine);
    machine.fpga().press_estop(true);
    assert_ne!(field(&mut machine), before, "the stop cuts its field power");
}

#[test]
fn place_that_a_firmware_does_not_have_is_refused() {
    for (from, to, said) in [
        ("port = 2", "port = 3", "this board has ports 0 to 2"),
        (
            "port = 2\nchannel = 0",
            "port = 1\nchannel = 3",
            "two remotes on channel 1.3",
        ),
        ("\"1.3\"", "\"1.4\"", "no remote belongs to channel 1.4"),
        ("\"1.3\"", "\"x\"", "`x` is no channel"),
        (
            "port = 1, channel = 3, input",
            "port = 2, channel = 1, input",
            "channel 2.1",
        ),
        (
            "firmware = ",
            "board = \"7i97\"\nfirmware = ",
            "allowed is one of",
        ),
        ("firmware = \"7I80HD", "firmware = \"none", "none-SSSV18"),
        (
            "firmware = ",
            "listen = \"127.0.0.1\" # ",
            "no board: allowed is one of",
        ),
    ] {
        assert!(PORTS.contains(from), "{from}");
        let error = ports(&PORTS.replace(from, to)).unwrap_err();
        assert!(error.contains(said), "{to}: {error}");
    }
    let both = "[[axis]]\nname = \"x\"\n";
    let error = ports(&format!("{PORTS}{both}")).unwrap_err();
    assert!(error.contains("0 outputs"), "{error}");
}

#[test]
fn error_names_its_line_its_key_and_what_is_allowed() {
    let all = MISTAKES.iter().map(|mistake| (MILL, mistake));
    let all = all.chain(STEPPER_MISTAKES.iter().map(|mistake| (ROUTER, mistake)));
    for (example, &(from, to, key, allowed)) in all {
        let (line, text) = changed(example, from, to);
        let error = parsed(&text).unwrap_err();
        // These conflicts with another line may be reported at that line.
        if !["axis.name", "axis.stepgen", "switch.name", "input 15"].contains(&key) {
            assert!(
                error.starts_with(&format!("line {line}: ")),
                "{to}: {error}"
            );
        }
        assert!(error.contains(key), "{to}: {error}");
        assert!(error.contains(allowed), "{to}: {error}");
    }
}
