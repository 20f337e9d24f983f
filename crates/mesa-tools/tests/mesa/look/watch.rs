//! `mesa watch`, on the screen of a terminal.

use std::net::Ipv4Addr;

use crate::interop::board::Board;
use crate::run::run;
use crate::terminal::Terminal;

/// Value of a pin on the screen.
fn value(text: &str, pin: &str) -> Option<String> {
    let mut lines = text.lines().map(|line| line.trim_start_matches(['│', ' ']));
    let line = lines.find_map(|line| line.strip_prefix(pin)?.strip_prefix(' '))?;
    line.split_whitespace().next().map(str::to_owned)
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn screen_follows_the_board_and_ends_with_the_terminal_restored() {
    let arguments = ["--board", "7i92-7i77", "--port", "0"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &arguments);
    let arguments = format!("watch --addr {}", board.address);
    let Some(terminal) = Terminal::start("follows", &arguments) else {
        return;
    };
    let text = terminal.wait_for_text("7i77.0.0  running");
    for wanted in [
        " hm2_7i92.0 ",
        "board     running",
        "exchanges",
        "watchdog",
        "of 5000 us",
    ] {
        assert!(text.contains(wanted), "{wanted}:\n{text}");
    }
    // Typed characters filter at once; q is a letter there.
    terminal.type_keys(&["/"]);
    terminal.type_keys(&["-l", "7i77.0.0.input-0"]);
    let text = terminal.wait_for_text("filter: 7i77.0.0.input-0_");
    assert!(text.contains("TB8 of 7i77.0.0"), "{text}");
    assert!(text.contains("TB8 pin 8 INPUT7"), "{text}");
    assert!(!text.contains("analogout0"), "{text}");
    terminal.type_keys(&["Enter"]);
    let (pin, other) = ("7i77.0.0.input-07", "7i77.0.0.input-06");
    for (level, shown) in [("on", "ON"), ("off", "off"), ("on", "ON")] {
        board.console.run(&format!("input 0 7 {level}"));
        let text = terminal.wait_for(shown, |text| value(text, pin).as_deref() == Some(shown));
        assert_eq!(value(&text, other).as_deref(), Some("off"), "{text}");
    }
    board.console.run("unplug 0");
    let text = terminal.wait_for_text("7i77.0.0  OFFLINE");
    assert!(text.contains("7i77.0.1  running"), "{text}");
    board.console.run("plug 0");
    terminal.wait_for_text("7i77.0.0  running");

    terminal.type_keys(&["q"]);
    let text = terminal.wait_for_text("exit code 0");
    assert!(
        text.contains("outputs were never on; the ports are stopped"),
        "{text}"
    );
    assert!(
        !text.contains("board     running"),
        "the screen is as before:\n{text}"
    );
    let truth = board.console.show("0");
    let outputs = (0..16).map(|n| &truth[&format!("remote.0.output-{n:02}")]);
    assert!(outputs.clone().all(|output| output == "0"), "{truth:?}");
}

/// Words of the screen, without frames: a terminal may be broken at a space.
fn words(text: &str) -> String {
    let lines = text.lines().map(|line| line.trim_matches(['│', ' ']));
    let words: Vec<_> = lines.flat_map(str::split_whitespace).collect();
    words.join(" ")
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn terminals_come_first_and_are_whole_on_narrow_screens() {
    for columns in [40, 80, 120] {
        let name = format!("narrow-{columns}");
        let arguments = "watch --sim 7i92-7i77,2=7i72";
        let Some(terminal) = Terminal::start_with(&name, arguments, [columns, 60]) else {
            return;
        };
        let text = terminal.wait_for("the first terminal", |text| text.contains(" more ─"));
        let pins = text
            .split(" more ")
            .nth(1)
            .unwrap_or_else(|| panic!("{text}"));
        let first = words(pins);
        let first = first.trim_start_matches(['─', '┐', ' ']);
        assert!(first.starts_with("TB"), "{columns}:\n{text}");
        // The longest places are those of encoders.
        for (filter, place) in [
            ("encoder.05", "TB4 pin 17, 18, 20, 21 QA5, /QA5, QB5, /QB5"),
            ("input-17", "TB7 pin 2 INPUT17"),
            ("7i72.0.2.output-00", "TB3 pin 1 OUTPUT0"),
        ] {
            terminal.type_keys(&["/"]);
            terminal.type_keys(&["-l", filter]);
            terminal.type_keys(&["Enter"]);
            let filtered = format!("filter: {filter}");
            terminal.wait_for(place, |text| {
                let words = words(text);
                words.contains(&filtered) && words.contains(place)
            });
            terminal.type_keys(&["/"]);
            let erase = vec!["BSpace"; filter.len()];
            terminal.type_keys(&erase);
            terminal.type_keys(&["Enter"]);
        }
        // Parameters come with the key that the screen and the help name.
        terminal.wait_for_text("a: all");
        terminal.type_keys(&["/"]);
        terminal.type_keys(&["-l", "watchdog.timeout_ns"]);
        terminal.wait_for_text(" pins: 0; a: 1 more ");
        terminal.type_keys(&["Enter", "a"]);
        terminal.wait_for_text(" pins and parameters: 1; a: less ");
        terminal.type_keys(&["q"]);
        terminal.wait_for_text("exit code 0");
    }
    let help = run(&["watch", "--help"]).out;
    assert!(
        help.contains("Keys: a lists parameters and inverted pins"),
        "{help}"
    );
}

/// The truth is the board: it is one that lost its power once, or none.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn power_cycle_counts_one_reset_and_state_is_unknown_meanwhile() {
    let arguments = ["--board", "7i92-7i77", "--port", "0"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &arguments);
    let address = board.address;
    let Some(terminal) = Terminal::start("power", &format!("watch --addr {address}")) else {
        return;
    };
    terminal.wait_for_text("7i77.0.0  running");
    for cuts in 1..3 {
        board.kill();
        let text = terminal.wait_for_text("board     NOT REACHED");
        let is_known = ["running", "OFFLINE"]
            .iter()
            .any(|state| text.contains(&format!("7i77.0.0  {state}")));
        assert!(!is_known, "{text}");
        for channel in [0, 1] {
            assert!(
                text.contains(&format!("7i77.0.{channel}  UNKNOWN")),
                "{text}"
            );
        }
        let port = address.port().to_string();
        board = Board::start(*address.ip(), &["--board", "7i92-7i77", "--port", &port]);
        let text = terminal.wait_for("it runs again", |text| {
            text.contains("board     running") && text.contains("7i77.0.0  running")
        });
        let times = if cuts == 1 { "1 time," } else { "2 times," };
        assert!(text.contains(&format!("board reset {times}")), "{text}");
    }
    // A remote that is pulled out now is not offline for a reason from before.
    board.console.run("unplug 0");
    let text = terminal.wait_for_text("7i77.0.0  OFFLINE");
    let line = text.lines().find(|line| line.contains("7i77.0.0  OFFLINE"));
    let line = line.expect("the line of the remote");
    assert!(line.contains("too many failed transfers"), "{text}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn control_c_and_a_signal_end_it_too() {
    for (name, keys, said) in [
        ("key", Some("C-c"), "exit code 0"),
        ("term", None, "exit code 143"),
    ] {
        let Some(terminal) = Terminal::start(name, "watch --sim 7i97 inmux") else {
            return;
        };
        terminal.wait_for_text("TB4");
        if let Some(keys) = keys {
            terminal.type_keys(&[keys]);
        } else {
            terminal.signal("TERM");
        }
        let text = terminal.wait_for_text(said);
        assert!(text.contains("outputs were never on"), "{text}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn watch_ends_when_its_terminal_is_closed() {
    let Some(terminal) = Terminal::start("closed", "watch --sim 7i97 inmux") else {
        return;
    };
    terminal.wait_for_text("TB4");
    terminal.close();
}

#[test]
fn missing_terminal_is_reported_with_the_alternative() {
    let shown = run(&["watch", "--sim", "7i97"]);
    assert_eq!(shown.code, Some(2), "{shown:?}");
    assert!(
        shown.err.contains("this needs a terminal; `mesa pins`"),
        "{shown:?}"
    );
    let json = run(&["watch", "--sim", "7i97", "--json"]);
    assert_eq!(json.code, Some(2), "{json:?}");
    let period = run(&["watch", "--sim", "7i97", "--period", "0"]);
    assert_eq!(period.code, Some(2), "{period:?}");
}
