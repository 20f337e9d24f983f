//! `mesa watch`, on the screen of a terminal.

use std::net::Ipv4Addr;
use std::process::{Command, Output};
use std::time::Duration;

use crate::interop::board::Board;
use crate::interop::mesa;
use crate::interop::tools::{has_program, skip};
use crate::run::run;

/// How often the screen is looked at, ten times a second.
const LOOKS: u32 = 300;

/// A terminal of 120 by 40 that a command runs in. Ends with it.
struct Terminal {
    socket: String,
}

impl Terminal {
    /// `None`, said loudly, where there is no tmux.
    fn start(name: &str, arguments: &str) -> Option<Self> {
        if !has_program("tmux") {
            skip("tmux");
            return None;
        }
        let terminal = Self {
            socket: format!("mesa-{name}-{}", std::process::id()),
        };
        let command = format!(
            "{} {arguments}; echo exit code $?; sleep 60",
            mesa().display()
        );
        let size = ["-x", "120", "-y", "40"];
        let started = ["-f", "/dev/null", "new-session", "-d"];
        let output = terminal.tmux(&[&started[..], &size, &[&command]].concat());
        assert!(output.status.success(), "{output:?}");
        Some(terminal)
    }

    fn tmux(&self, arguments: &[&str]) -> Output {
        let mut tmux = Command::new("tmux");
        tmux.args(["-L", &self.socket]).args(arguments);
        tmux.env_remove("TMUX")
            .env("LC_ALL", "C.UTF-8")
            .env("TERM", "xterm");
        tmux.output().expect("tmux runs")
    }

    fn type_keys(&self, keys: &[&str]) {
        let output = self.tmux(&[&["send-keys"], keys].concat());
        assert!(output.status.success(), "{output:?}");
    }

    fn text(&self) -> String {
        let output = self.tmux(&["capture-pane", "-p"]);
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Waits until the screen is as it has to be, and returns it.
    fn wait_for(&self, what: &str, is: impl Fn(&str) -> bool) -> String {
        let mut text = String::new();
        for _ in 0..LOOKS {
            text = self.text();
            if is(&text) {
                return text;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        panic!("{what} is not on the screen:\n{text}");
    }

    fn wait_for_text(&self, wanted: &str) -> String {
        self.wait_for(wanted, |text| text.contains(wanted))
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.tmux(&["kill-server"]);
    }
}

/// The value of a pin on the screen.
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
    // What is typed filters at once; q is a letter there.
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
            let pid = terminal.tmux(&["display-message", "-p", "#{pane_pid}"]);
            let pid = String::from_utf8_lossy(&pid.stdout).trim().to_owned();
            let kill = format!("pkill -TERM -P {pid}");
            let killed = Command::new("sh").args(["-c", &kill]).status();
            assert!(killed.expect("a shell").success());
        }
        let text = terminal.wait_for_text(said);
        assert!(text.contains("outputs were never on"), "{text}");
    }
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
