//! `mesa sim --machine`: a machine described in a file.

use std::fs;
use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

use mesa_hal::transport::udp::UdpBus;
use mesa_hal::{Driver, I7i77Field, I7i97, Settings};

use crate::interop::board::Board;
use crate::interop::{PATIENCE, Scratch};
use crate::run::{done, json, patient, run};

const MILL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/mill.toml");
const ROUTER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/router.toml");
const PERIOD: Duration = Duration::from_millis(1);

fn mill() -> Board {
    let arguments = ["--machine", MILL, "--port", "0"];
    Board::start(Ipv4Addr::LOCALHOST, &arguments)
}

/// Observations of a driver that moves the x axis down at 46 mm/s, until it stands.
struct Travel {
    /// Position and home switch, in each cycle with both.
    seen: Vec<(f64, bool)>,
}

fn drive_down(board: &Board) -> Travel {
    // A busy host must not cause a new set-up of the board, which loses counts: after failed reads,
    // or after a bite of the watchdog.
    let bus = UdpBus::connect(board.address, patient()).unwrap();
    let settings = Settings {
        watchdog: Some(Duration::from_secs(4)),
        ..Settings::default()
    };
    let mut driver = Driver::start(bus, settings).unwrap();
    let field: I7i77Field = driver.attach((0, 0)).unwrap();
    let own: I7i97 = driver.attach_board().unwrap();
    let mut seen: Vec<(f64, bool)> = Vec::new();
    let start = Instant::now();
    let stands = |seen: &[(f64, bool)]| {
        let last = seen.iter().rev().take(200);
        seen.len() > 400
            && last
                .clone()
                .all(|now| now.0 == seen[seen.len() - 1].0 && now.1)
    };
    while !stands(&seen) {
        assert!(start.elapsed() < PATIENCE, "{:?}", seen.last());
        let good = driver.read().is_ok();
        let switch = field.inputs[0].read(driver.pins());
        let counts = driver.pins().read(own.encoders[0].count);
        if good && switch.valid && counts.valid {
            seen.push((f64::from(counts.value) / 1000.0, switch.value));
        }
        // A busy host is late now and then, and a remote's watchdog bites.
        let _ = driver.rearm();
        // The driver begins to count at its first reading.
        own.analog_out[0].enable(driver.pins_mut(), !seen.is_empty());
        own.analog_out[0].set(driver.pins_mut(), -4.0);
        let _ = driver.write();
        std::thread::sleep(PERIOD);
    }
    let _ = driver.shutdown();
    Travel { seen }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn driver_meets_home_switch_and_hard_stop_at_their_positions() {
    let mut board = mill();
    let Travel { seen } = drive_down(&board);
    // At power-up the axis stands at 25, where the driver's count is 0.
    let at = |count: f64| 25.0 + count;
    for pair in seen.windows(2) {
        let [before, now] = [pair[0], pair[1]];
        // An input is sampled between two readings of the encoder, on the way down.
        if now.1 {
            assert!(at(now.0) <= 0.001, "on before its position: {now:?}");
        } else {
            assert!(
                at(before.0) >= -0.001,
                "off behind its position: {before:?}"
            );
        }
    }
    let changes = seen.windows(2).filter(|pair| pair[0].1 != pair[1].1);
    assert_eq!(changes.count(), 1, "nothing bounces");
    let last = seen.last().unwrap().0;
    assert!((at(last) + 8.0).abs() <= 0.002, "the hard stop: {last}");
    let truth = board.console.show("motors");
    assert_eq!(truth["motor.0.position"], "-8.0000");
    assert_eq!(truth["motor.0.at-stop"], "1");
    assert_eq!(truth["switch.x-home"], "1");
    let inputs = board.console.show("0");
    assert_eq!(inputs["remote.0.input-00"], "1");
    board.stop("TERM");
}

/// Waits until a value that `show` prints is as given.
fn wait_for(board: &mut Board, what: &str, name: &str, value: &str) {
    let start = Instant::now();
    while board.console.show(what)[name] != value {
        assert!(start.elapsed() < PATIENCE, "{name} does not become {value}");
        std::thread::sleep(PERIOD);
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn console_turns_the_wheel_presses_the_estop_and_jams_an_axis() {
    let mut board = mill();
    board.console.run("wheel 12");
    wait_for(&mut board, "motors", "wheel.mpg.turning", "0");
    assert_eq!(board.console.show("0")["remote.0.enc0"], "12");
    board.console.run("wheel -2 mpg");
    wait_for(&mut board, "motors", "wheel.mpg.turning", "0");
    assert_eq!(board.console.show("0")["remote.0.enc0"], "10");
    assert_eq!(board.console.show("motors")["wheel.mpg.clicks"], "10");

    assert_eq!(board.console.show("0")["remote.0.input-31"], "1");
    board.console.run("estop on");
    assert_eq!(board.console.show("0")["remote.0.input-31"], "0");
    let motors = board.console.show("motors");
    assert_eq!((&*motors["estop"], &*motors["motor.2.powered"]), ("1", "0"));
    board.console.run("estop off");
    assert_eq!(board.console.show("motors")["motor.2.powered"], "1");

    board.console.run("turn z 50");
    wait_for(&mut board, "motors", "motor.2.at-stop", "1");
    assert_eq!(board.console.show("motors")["motor.2.position"], "12.0000");
    assert_eq!(board.console.show("motors")["switch.z-home"], "1");
    board.console.run("turn z -1");
    board.console.run("stall z");
    let jammed = board.console.show("motors")["motor.2.position"].clone();
    std::thread::sleep(20 * PERIOD);
    assert_eq!(board.console.show("motors")["motor.2.position"], jammed);
    board.console.run("stall z off");
    board.console.run("turn z -100");
    wait_for(&mut board, "motors", "switch.z-home", "0");

    for (bad, said) in [
        ("stall w", "x, y, z"),
        ("turn 3 1", "x, y, z"),
        ("wheel 1 other", "mpg"),
        ("wheel 99999999", "million"),
        ("wheel x", "no number"),
        ("estop maybe", "on or off"),
    ] {
        let refused = board.console.command(bad).unwrap_err();
        assert!(refused.contains(said), "{bad}: {refused}");
    }
    board.stop("TERM");
}

/// A driver of the router whose first generator has pulses, spaces and times of this length in ns.
fn stepper_driver(board: &Board, ns: u32) -> Driver<UdpBus> {
    let bus = UdpBus::connect(board.address, patient()).unwrap();
    let settings = Settings {
        watchdog: Some(Duration::from_secs(4)),
        ..Settings::default()
    };
    let mut driver = Driver::start(bus, settings).unwrap();
    let pins = driver.pins_mut();
    let name = |name: &str| format!("hm2_7i92.0.stepgen.00.{name}");
    for (parameter, value) in [
        ("position-scale", 200.0),
        ("maxvel", 20.0),
        ("maxaccel", 100.0),
    ] {
        let parameter = pins.parameter::<f64>(&name(parameter)).unwrap();
        pins.set_param(parameter, value).unwrap();
    }
    for parameter in ["steplen", "stepspace", "dirsetup", "dirhold"] {
        let parameter = pins.parameter::<u32>(&name(parameter)).unwrap();
        pins.set_param(parameter, ns).unwrap();
    }
    driver
}

/// Sends the first generator to a position and runs the spindle backwards, for 20 cycles.
fn run_router(driver: &mut Driver<UdpBus>, position: f64) {
    let pins = driver.pins();
    let enable = pins.output::<bool>("hm2_7i92.0.stepgen.00.enable");
    let command = pins.output::<f64>("hm2_7i92.0.stepgen.00.position-cmd");
    let speed = pins.output::<f64>("hm2_7i92.0.7i76.0.0.spinout");
    let of_spindle = ["spinena", "spindir"];
    let switch = |name| pins.output::<bool>(&format!("hm2_7i92.0.7i76.0.0.{name}"));
    let [enable_spindle, reverse] = of_spindle.map(|name| switch(name).unwrap());
    let (enable, command, speed) = (enable.unwrap(), command.unwrap(), speed.unwrap());
    for _ in 0..20 {
        let _ = driver.read();
        // A busy host is late now and then, and a watchdog bites.
        let _ = driver.rearm();
        let pins = driver.pins_mut();
        for switch in [enable, enable_spindle, reverse] {
            pins.set(switch, true);
        }
        pins.set(command, position);
        // Half of the voltage at its terminals.
        pins.set(speed, 50.0);
        let _ = driver.write();
        std::thread::sleep(PERIOD);
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn stepper_motor_loses_the_steps_that_its_drive_does_not_detect() {
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &["--machine", ROUTER, "--port", "0"]);
    // The drive needs 2500 ns.
    let mut driver = stepper_driver(&board, 1_000);
    let start = Instant::now();
    while board.console.show("motors")["motor.0.commanded-steps"] != "100" {
        assert!(start.elapsed() < PATIENCE);
        run_router(&mut driver, 0.5025);
    }
    // On a busy host it may have gone further, and back.
    let motors = board.console.show("motors");
    let lost: u64 = motors["motor.0.lost-steps"].parse().unwrap();
    assert!(lost >= 100, "{lost}");
    assert_eq!(motors["motor.0.position"], "10.0000");
    let _ = driver.shutdown();
    board.stop("TERM");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn stepper_machine_moves_and_console_shows_steps_and_spindle() {
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &["--machine", ROUTER, "--port", "0"]);
    let mut driver = stepper_driver(&board, 5_000);
    let start = Instant::now();
    let number = |text: &str| text.parse::<f64>().unwrap();
    loop {
        let motors = board.console.show("motors");
        let spindle = number(&motors["motor.3.velocity"]);
        // From 10 to the home switch. `spindir` is on, and a motor has 50 turns/s at 10 V.
        if motors["motor.0.steps"] == "-2000"
            && motors["motor.0.position"] == "0.0000"
            && motors["switch.x-home"] == "1"
            && (spindle + 25.0).abs() < 1.0
        {
            break;
        }
        assert!(start.elapsed() < PATIENCE, "{motors:?}");
        // Whole steps are rounded down: this is half a step above the end.
        run_router(&mut driver, -9.9975);
    }
    let motors = board.console.show("motors");
    assert_eq!(motors["motor.0.name"], "x");
    assert_eq!(motors["motor.0.lost-steps"], "0");
    assert_eq!(motors["motor.1.steps"], "0");
    let volts = number(&motors["motor.3.volts"]);
    assert!((volts + 5.0).abs() < 0.01, "{volts}");
    for command in ["turn x 5", "stall y"] {
        let refused = board.console.command(command).unwrap_err();
        assert!(refused.contains("stepper motor"), "{refused}");
    }
    let _ = driver.shutdown();
    board.stop("TERM");
}

#[test]
fn described_machine_is_the_board_of_every_other_command() {
    assert_eq!(json(&["led", "--sim", MILL])["now"], "debug");
    assert!(done(&["info", "--sim", MILL]).contains("Channel 0: 7I77"));
}

#[test]
fn invalid_description_is_refused_with_place_and_allowed_values() {
    let text = fs::read_to_string(MILL).unwrap();
    let cases = [
        (
            "max_speed = 120.0",
            "max_sped = 120.0",
            "line 30: ",
            "`max_speed`",
        ),
        (
            "channel = 0, input = 31",
            "channel = 0, input = 32",
            "line ",
            "no number 32",
        ),
        (
            "{ input = 15 }",
            "{ input = 16 }",
            "line ",
            "this board has 16",
        ),
        ("input = 17 }", "pin = 7 }", "wheel.b", "{ pin = N }"),
        (
            "cuts_field = []",
            "cuts_field = [3]",
            "cuts_field",
            "channel 3",
        ),
    ];
    for (from, to, place, allowed) in cases {
        let file = Scratch::new("machine.toml");
        fs::write(&file.0, text.replacen(from, to, 1)).unwrap();
        for arguments in [
            &["sim", "--machine", file.path(), "--port", "0"][..],
            &["info", "--sim", file.path()],
        ] {
            let run = run(arguments);
            assert!(matches!(run.code, Some(1 | 2)), "{to}: {run:?}");
            assert!(run.err.contains(place), "{to}: {run:?}");
            assert!(run.err.contains(allowed), "{to}: {run:?}");
        }
    }
    let missing = run(&["sim", "--machine", "/nowhere.toml"]);
    assert_eq!(missing.code, Some(2));
    assert!(
        missing.err.contains("/nowhere.toml: No such file"),
        "{missing:?}"
    );
    let both = run(&["sim", "--machine", MILL, "--board", "7i97"]);
    assert_eq!(both.code, Some(2), "{both:?}");
}
