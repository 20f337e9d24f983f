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

#[test]
fn the_screen_follows_the_board_and_ends_with_the_terminal_restored() {
    let arguments = ["--board", "7i92-7i77", "--port", "0"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &arguments);
    let arguments = format!("watch --addr {}", board.address);
    let Some(terminal) = Terminal::start("follows", &arguments) else {
        return;
    };
    let text = terminal.wait_for_text("0.0 7I77  running");
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
    let text = terminal.wait_for_text("0.0 7I77  OFFLINE");
    assert!(text.contains("0.1 7I77  running"), "{text}");
    board.console.run("plug 0");
    terminal.wait_for_text("0.0 7I77  running");

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

#[test]
fn it_ends_when_its_terminal_is_closed() {
    let Some(terminal) = Terminal::start("closed", "watch --sim 7i97 inmux") else {
        return;
    };
    terminal.wait_for_text("TB4");
    terminal.close();
}

#[test]
fn without_a_terminal_it_says_what_to_use_instead() {
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
