//! `mesa sim --watch` on the screen of a terminal: it shows the true state, and its console works.

use std::fs;
use std::net::{Ipv4Addr, UdpSocket};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use mesa_hal::transport::udp::UdpBus;
use mesa_hal::{Driver, I7i97, Settings};

use crate::interop::Scratch;
use crate::interop::console::Console;
use crate::run::{command, patient, run};
use crate::terminal::Terminal;

const MILL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/mill.toml");

const ROUTER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/router.toml");

/// Words of the line that begins with a text, without the frame around it.
fn words<'a>(text: &'a str, begin: &str) -> Vec<&'a str> {
    let lines = text.lines().map(|line| line.trim_matches(['│', ' ']));
    let mut lines = lines.filter(|line| line.starts_with(begin));
    lines
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .collect()
}

/// A number in the line of an axis.
fn number(text: &str, axis: &str, column: usize) -> Option<f64> {
    let lines = text.lines().map(|line| line.trim_matches(['│', ' ']));
    let mut words = lines.map(|line| line.split_whitespace().collect::<Vec<_>>());
    words.find_map(|words| match words[..] {
        [first, ..] if first == axis => words.get(column)?.parse().ok(),
        _ => None,
    })
}

/// Address of the board with that name.
fn address(text: &str, board: &str) -> String {
    let words = words(text, &format!("{board} "));
    let address = words.iter().find(|word| word.starts_with("127.0.0."));
    (*address.unwrap_or_else(|| panic!("{board} is nowhere:\n{text}"))).to_owned()
}

/// A controller that drives the first axis at a voltage until it is dropped. It then ends in the
/// middle of its cycle, like one that has crashed.
struct Controller {
    over: Arc<AtomicBool>,
    cycle: Option<JoinHandle<()>>,
}

impl Controller {
    fn start(board: &str, volts: f64) -> Self {
        let bus = UdpBus::connect(board.parse().unwrap(), patient()).unwrap();
        let settings = Settings {
            watchdog: Some(Duration::from_secs(1)),
            ..Settings::default()
        };
        let mut driver = Driver::start(bus, settings).unwrap();
        let board: I7i97 = driver.attach_board().unwrap();
        let over = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&over);
        let cycle = std::thread::spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                let _ = driver.read();
                // A busy host is late now and then, and a watchdog bites.
                let _ = driver.rearm();
                board.analog_out[0].enable(driver.pins_mut(), true);
                board.analog_out[0].set(driver.pins_mut(), volts);
                let _ = driver.write();
                std::thread::sleep(Duration::from_millis(2));
            }
            // Dropping the driver would switch everything off.
            std::mem::forget(driver);
        });
        Self {
            over,
            cycle: Some(cycle),
        }
    }
}

impl Drop for Controller {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(cycle) = self.cycle.take() {
            let _ = cycle.join();
        }
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn screen_shows_stepper_motors_with_their_steps() {
    let arguments = format!("sim --machine {ROUTER} --port 0 --watch");
    let Some(terminal) = Terminal::start("sim-steppers", &arguments) else {
        return;
    };
    let of_x = ["x", "10.0000", "0.0000", "0", "steps", "powered"];
    let text = terminal.wait_for("the axes", |text| {
        words(text, "x ").starts_with(&of_x) && text.contains("spindle ")
    });
    assert_eq!(number(&text, "z", 1), Some(-10.0), "{text}");
    let of_spindle = words(&text, "spindle ");
    assert!(of_spindle.contains(&"V"), "{of_spindle:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn screen_shows_the_client_and_the_true_state_of_the_machine() {
    let socket = Scratch::new("watch.sock");
    let arguments = format!(
        "sim --machine {MILL} --port 0 --watch --control {}",
        socket.path()
    );
    let Some(terminal) = Terminal::start("sim-truth", &arguments) else {
        return;
    };
    let all = [
        "watchdog off  no client",
        " simulated boards ",
        "mill       7I97 127.0.0.1:",
        "0 7i77-io      idle",
        "emergency stop released, its chain is closed",
        "x-home off  x-limit off  y-home off  z-home off",
        "handwheel      mpg 0 clicks",
        "channel 0      inputs on: 1 31  outputs on: none",
        "mill>",
    ];
    let text = terminal.wait_for(&all.join(", "), |text| {
        all.iter().all(|wanted| text.contains(wanted))
    });
    assert_eq!(number(&text, "x", 1), Some(25.0), "{text}");
    assert_eq!(
        words(&text, "x ")[3..=5],
        ["0.0000", "V", "disabled"],
        "{text}"
    );

    // Any client is named.
    let board = address(&text, "mill");
    let other = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let from = other.local_addr().unwrap();
    let text = terminal.wait_for("who talks", |text| {
        other.send_to(&[0x01, 0x42, 0x00, 0x01], &board).unwrap();
        text.contains(&format!("from {from}"))
    });
    assert!(
        words(&text, "mill ")[3].parse::<f64>().unwrap() > 0.0,
        "{text}"
    );

    // 3 V of 10 are 36 of 120 mm/s, less the effect of friction: 30 / 0.08 * 5 ms.
    let controller = Controller::start(&board, 3.0);
    let text = terminal.wait_for("the axis at its speed", |text| {
        number(text, "x", 2).is_some_and(|velocity| (velocity - 34.125).abs() < 0.5)
            && text.contains("0 7i77-io      running")
    });
    assert!(text.contains("watchdog alive  from "), "{text}");
    let axis = words(&text, "x ");
    assert_eq!(axis[4..=5], ["V", "enabled"], "{text}");
    let volts: f64 = axis[3].parse().unwrap();
    assert!((volts - 3.0).abs() < 0.05, "{text}");
    let packets = words(&text, "mill ");
    let packets: f64 = packets[3].parse().unwrap();
    assert!(packets > 10.0, "{text}");

    // A program on a socket gets the same values as the screen.
    let stream = UnixStream::connect(&socket.0).unwrap();
    let mut console = Console::new(stream.try_clone().unwrap(), stream);
    console.run("stall x");
    let position = console.show("motor.0.position")["motor.0.position"].clone();
    let text = terminal.wait_for("a jammed axis", |text| text.contains("JAMMED"));
    assert_eq!(words(&text, "x ")[1], position, "{text}");
    console.run("stall x off");
    terminal.wait_for("the limit switch and the stop", |text| {
        text.contains("x-limit ON") && text.contains("AT STOP")
    });

    // The controller crashes: nothing is driven any more, and the screen shows the reason.
    drop(controller);
    let text = terminal.wait_for_text("WATCHDOG HAS BITTEN");
    assert_eq!(words(&text, "x ")[5], "disabled", "{text}");
    terminal.wait_for("no client", |text| {
        text.contains("no client") && text.contains("0 7i77-io      idle")
    });
    console.run("unplug 0");
    terminal.wait_for_text("0 7i77-io      UNPLUGGED");
    console.run("quit");
    let text = terminal.wait_for_text("exit code 0");
    assert!(text.contains("the simulated boards have ended"), "{text}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn commands_are_answered_below_without_blocking_the_screen() {
    let arguments = format!("sim --machine {MILL} --port 0 --watch");
    let Some(terminal) = Terminal::start("sim-console", &arguments) else {
        return;
    };
    terminal.wait_for_text("mill>");
    let enter = |command: &str| {
        terminal.type_keys(&["-l", command]);
        terminal.wait_for_text(&format!("mill> {command}"));
        terminal.type_keys(&["Enter"]);
    };
    enter("estop on");
    let text = terminal.wait_for_text("emergency stop PRESSED");
    assert_eq!(words(&text, "x ")[5..=6], ["NO", "POWER"], "{text}");
    assert!(!text.contains("inputs on: 1 31"), "{text}");
    terminal.type_keys(&["Up"]);
    terminal.wait_for("the command before", |text| {
        text.trim_end().ends_with("mill> estop on")
    });
    terminal.type_keys(&["BSpace", "f", "f", "Enter"]);
    terminal.wait_for_text("emergency stop released");
    enter("turn w 5");
    terminal.wait_for_text("error: there is no axis `w`: there are x, y, z");
    enter("at +1ms turn w 5");
    let refused = "error: there is no axis `w`";
    terminal.wait_for("refused at once", |text| text.matches(refused).count() == 2);

    // A waiting command blocks neither the screen nor the input line.
    enter("wait until motor.0.position <20 within 60s");
    enter("turn x -10");
    let before = number(&terminal.text(), "y", 1);
    assert_eq!(before, Some(40.0));
    // The command waits for its turn.
    terminal.type_keys(&["-l", "input 0 5 on"]);
    terminal.wait_for_text("mill> input 0 5 on");
    terminal.type_keys(&["C-u"]);
    terminal.type_keys(&["C-c"]);
    terminal.wait_for_text("exit code 0");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn no_text_is_truncated_on_narrow_screens() {
    for columns in [40, 80, 120] {
        let arguments = format!("sim --machine {MILL} --port 0 --watch");
        let name = format!("sim-narrow-{columns}");
        let Some(terminal) = Terminal::start_with(&name, &arguments, [columns, 90]) else {
            return;
        };
        let all = |text: &str| {
            let lines = text.lines().map(|line| line.trim_matches(['│', ' ']));
            let words: Vec<_> = lines.flat_map(str::split_whitespace).collect();
            words.join(" ")
        };
        let refused = "error: there is no axis `w`: there are x, y, z";
        terminal.wait_for_text("mill>");
        terminal.type_keys(&["-l", "turn w 5"]);
        terminal.type_keys(&["Enter"]);
        terminal.type_keys(&["-l", "wheel 1"]);
        terminal.type_keys(&["Enter"]);
        for wanted in [
            "watchdog off no client",
            "errors: 0 parse, 0 memory, 0 write; 0 reloads, 0 resets",
            "0 7i77-io idle",
            "V disabled",
            "emergency stop released, its chain is closed",
            "x-home off x-limit off y-home off z-home off",
            "handwheel mpg 1 click",
            "channel 0 inputs on: 1 31 outputs on: none",
            refused,
        ] {
            let what = format!("{wanted}, {columns} columns");
            terminal.wait_for(&what, |text| all(text).contains(wanted));
        }
        terminal.type_keys(&["C-c"]);
        terminal.wait_for_text("exit code 0");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn long_answer_has_the_whole_screen_until_it_was_read() {
    let Some(terminal) = Terminal::start(
        "sim-help",
        "sim --board 7i92-7i77 --listen 127.0.0.1 --port 0 --watch",
    ) else {
        return;
    };
    terminal.wait_for_text("1 7i77-analog");
    terminal.type_keys(&["-l", "help"]);
    terminal.type_keys(&["Enter"]);
    let text = terminal.wait_for_text("help                       this text");
    assert!(text.contains("board> help"), "from its beginning:\n{text}");
    assert!(!text.contains("inputs and outputs"), "{text}");
    terminal.type_keys(&["NPage"]);
    terminal.wait_for_text("quit                       stop");
    // q closes the answer, and then ends the program.
    terminal.type_keys(&["q"]);
    terminal.wait_for_text("inputs and outputs");
    terminal.type_keys(&["q"]);
    let text = terminal.wait_for_text("exit code 0");
    assert!(
        text.contains("7I92 listening on 127.0.0.1:"),
        "as before:\n{text}"
    );
    assert!(!text.contains("summary"), "{text}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn one_of_several_boards_is_shown_and_gets_the_commands() {
    let lathe = Scratch::new("lathe.toml");
    fs::write(&lathe.0, "board = \"7i92-7i77\"\n").unwrap();
    let commands = Scratch::new("watch.cmd");
    fs::write(&commands.0, "turn 1 7\n").unwrap();
    let arguments = format!(
        "sim --machine {MILL} --machine {} --port 0 --listen 127.0.0.1 --listen 127.0.0.2 --watch",
        lathe.path()
    );
    let Some(terminal) = Terminal::start("sim-several", &arguments) else {
        return;
    };
    let name = lathe.0.file_stem().unwrap().to_str().unwrap();
    let text = terminal.wait_for_text("handwheel      mpg");
    assert!(address(&text, "mill").starts_with("127.0.0.1:"), "{text}");
    assert!(address(&text, name).starts_with("127.0.0.2:"), "{text}");
    terminal.type_keys(&["Tab"]);
    let text = terminal.wait_for_text(&format!("{name}>"));
    assert!(
        text.contains("1 7i77-analog") && !text.contains("handwheel"),
        "{text}"
    );
    terminal.type_keys(&["-l", &format!("source {}", commands.path())]);
    terminal.type_keys(&["Enter"]);
    terminal.wait_for("axis 1 of the second board", |text| {
        number(text, "1", 2) == Some(7.0)
    });
    terminal.type_keys(&["-l", "@mill turn y 3"]);
    terminal.type_keys(&["Enter", "BTab"]);
    let text = terminal.wait_for("axis y of the first", |text| {
        number(text, "y", 2) == Some(3.0)
    });
    assert_eq!(number(&text, "x", 2), Some(0.0), "{text}");
    terminal.signal("TERM");
    terminal.wait_for_text("exit code 0");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn screen_ends_when_its_terminal_is_closed() {
    let socket = Scratch::new("closed.sock");
    let arguments = format!(
        "sim --machine {MILL} --port 0 --watch --control {}",
        socket.path()
    );
    let Some(terminal) = Terminal::start("sim-closed", &arguments) else {
        return;
    };
    terminal.wait_for_text("mill>");
    assert!(socket.0.exists());
    terminal.close();
    assert!(!socket.0.exists(), "it has cleared away what it made");
}

#[test]
fn watch_without_a_terminal_is_refused_before_anything_starts() {
    let state = Scratch::new("watch.state");
    let arguments = [
        "sim",
        "--machine",
        MILL,
        "--port",
        "0",
        "--watch",
        "--state",
        state.path(),
    ];
    let shown = run(&arguments);
    assert_eq!(shown.code, Some(2), "{shown:?}");
    assert!(
        shown.err.contains("this needs a terminal; without --watch"),
        "{shown:?}"
    );
    assert_eq!(shown.out, "");
    assert!(!state.0.exists());
    let json = command(&[&arguments[..], &["--json"]].concat()).output();
    assert_eq!(json.unwrap().status.code(), Some(2));
}
