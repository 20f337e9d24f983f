//! The table "What differs" of `docs/linuxcnc.md`, row by row, with both drivers.

use std::time::{Duration, Instant};

use crate::halcmd::{alone, skipped};
use crate::session::{self, Session};

const PAGE: &str = include_str!("../../../../docs/linuxcnc.md");

/// A row of the page, word by word, and what a driver has to show of it.
struct Row {
    fault: &'static str,
    hostmot2: &'static str,
    mesa_eth: &'static str,
    shows: fn(&mut Faults),
}

/// In an order in which each row begins where the one before has ended: all outputs are on.
const ROWS: &[Row] = &[
    Row {
        fault: "a card is pulled",
        hostmot2: "its whole port stops, outputs of all its cards go off",
        mesa_eth: "that card alone goes offline within 40 cycles; the others transfer and follow",
        shows: Faults::a_card_is_pulled,
    },
    Row {
        fault: "it is put back",
        hostmot2: "nothing, until `sserial.port-N.run` is FALSE and TRUE again",
        mesa_eth: "it comes back by itself within 6 s, with a message; its outputs are safe until `run` is FALSE and TRUE again, or until its pin `rearm` rises",
        shows: Faults::it_is_put_back,
    },
    Row {
        fault: "parameters that cards keep (`nvwatchdogtimeout`)",
        hostmot2: "written when the port starts",
        mesa_eth: "the same: written, read back, and reported if the card does not keep it; a value that it cannot have comes back at once with a message",
        shows: Faults::a_parameter_is_set,
    },
    Row {
        fault: "the thread stops for longer than the watchdog's time",
        hostmot2: "`watchdog.has_bit`, and the port stops",
        mesa_eth: "`watchdog.has_bit`, everything is safe",
        shows: Faults::the_thread_stops,
    },
    Row {
        fault: "`watchdog.has_bit` is set to FALSE",
        hostmot2: "the board's own outputs follow; cards not before `run`",
        mesa_eth: "everything follows, cards included, unless another fault comes first",
        shows: Faults::has_bit_is_cleared,
    },
    Row {
        fault: "packets are lost",
        hostmot2: "`io_error`, then `has_bit`, then `run`: three acts",
        mesa_eth: "`io_error`; safe values are sent once more, and nothing is written until it is set to FALSE; then everything follows. Meanwhile the board is read as soon as it answers, so that positions stay exact",
        shows: Faults::packets_are_lost,
    },
    Row {
        fault: "an input whose transfer fails",
        hostmot2: "keeps its last value",
        mesa_eth: "keeps its last value, and the pin `valid` of its card or board is FALSE",
        shows: Faults::an_input_fails,
    },
    Row {
        fault: "a card that is offline when `has_bit` or `io_error` is cleared",
        hostmot2: "",
        mesa_eth: "its outputs follow as soon as it is back: that was the command. One that was pulled while nothing was exchanged is a new fault",
        shows: Faults::io_error_is_cleared_without_a_card,
    },
    Row {
        fault: "a scale of 0, or another value that cannot be",
        hostmot2: "1 is used",
        mesa_eth: "the parameter gets its old value back, with a message",
        shows: Faults::a_scale_is_0,
    },
];

/// Rows of other tests, or of none.
const ELSEWHERE: &[(&str, &str)] = &[
    (
        "counters of 64 bits",
        "no test runs for long enough; src/table.rs",
    ),
    (
        "the firewall and the ARP entry",
        "mesa_eth does nothing there",
    ),
    ("loopback addresses, other ports", "tests/fake_hal"),
    ("processor time of a 7I97", "cost.rs prints it"),
    ("a panic, which would be an error", "tests/fake_hal"),
    (
        "a period of the thread that cannot be",
        "messages.rs; src/cycle/tests/period.rs",
    ),
    (
        "a period that the DPLL cannot follow",
        "src/cycle/tests/period.rs",
    ),
    (
        "a rate, filter, time or type out of range",
        "messages.rs; tests/driver/setup/corrected.rs",
    ),
    ("a pin out of range", "tests/driver/setup/corrected.rs"),
    ("`board_rtnet=evl`", "src/parameters.rs"),
    (
        "components that call functions of hostmot2",
        "they are not driven",
    ),
    ("`0.debug` of a serial port", "names.rs has its name"),
    ("positions after a time without replies", "tests/driver"),
    ("positions after a bite", "tests/driver"),
    (
        "a board that was away for its packets has lost its configuration",
        "src/cycle/tests.rs",
    ),
    (
        "in newer versions of LinuxCNC",
        "names.rs of mesa-linuxcnc, tests/field_pins",
    ),
    ("a card's name in pins", "tests/driver/remotes/devices.rs"),
    ("the user sets `io_error`", "src/cycle/tests.rs"),
    (
        "a card has no field power when LinuxCNC loads the driver",
        "messages.rs; src/cycle/tests.rs",
    ),
];

#[test]
fn faults_end_as_documented() {
    check_page();
    if skipped() {
        return;
    }
    let _alone = alone();
    for driver in ["hm2_eth", "mesa_eth"] {
        let mut faults = Faults::load(driver);
        for row in ROWS {
            let begin = Instant::now();
            (row.shows)(&mut faults);
            println!("{driver}: {}: {:.1?}", row.fault, begin.elapsed());
        }
        if faults.is_ours {
            faults.ends_and_begins_again();
        }
        faults.session.hal("stop");
        faults.session.stop();
    }
}

/// Compares the rows with the page's.
fn check_page() {
    let (_, table) = PAGE.split_once("## What differs").expect("a heading");
    let lines = table.lines().skip_while(|line| !line.starts_with("|---"));
    let lines = lines.skip(1).take_while(|line| line.starts_with('|'));
    let rows: Vec<_> = ROWS
        .iter()
        .map(|row| {
            let cells = [row.fault, row.hostmot2, row.mesa_eth];
            cells
                .map(|cell| format!("| {cell} "))
                .concat()
                .replace("|  |", "| |")
                + "|"
        })
        .collect();
    let (mut found, mut untried) = (0, Vec::new());
    for line in lines {
        let is_elsewhere = |(fault, _): &(&str, &str)| line.contains(fault);
        if rows.iter().any(|row| row == line) {
            found += 1;
        } else if !ELSEWHERE.iter().any(is_elsewhere) {
            untried.push(line);
        }
    }
    assert!(untried.is_empty(), "rows that are not tried: {untried:#?}");
    assert_eq!(found, rows.len(), "rows that the page does not have");
}

/// A driver in LinuxCNC, with a board that has a 7I77 and a 7I72.
struct Faults {
    session: Session,
    is_ours: bool,
}

impl Faults {
    fn load(driver: &str) -> Self {
        let mut session = Session::load(driver);
        session.run();
        let mut faults = Self {
            session,
            is_ours: driver == "mesa_eth",
        };
        faults.be_patient(true);
        for output in ["7i77.0.0.output-03", "7i72.0.2.output-17", "ssr.00.out-02"] {
            faults.session.set(output, "TRUE");
        }
        faults.start_port();
        faults
    }

    /// The cycles that may fail on a busy computer before hostmot2 stops a port.
    fn be_patient(&mut self, is_patient: bool) {
        let limit = if is_patient { "1000000" } else { "200" };
        self.session.set("sserial.port-0.fault-lim", limit);
    }

    /// Switches the port off and on until it runs with all outputs on: a late packet can spoil a
    /// start of hostmot2's.
    fn start_port(&mut self) {
        let runs = (0..30)
            .any(|_| self.start_port_once(|session| session.outputs() == "[true, true, true]"));
        assert!(runs, "the port does not start");
    }

    /// Switches the port off and on; true if it runs within 3 s, and something is so.
    fn start_port_once(&mut self, is_so: impl Fn(&mut Session) -> bool) -> bool {
        let state = |session: &mut Session| session.get("sserial.port-0.port_state");
        self.session.set("sserial.port-0.run", "FALSE");
        self.session
            .until("the port stops", |session| state(session) == "0");
        self.session.set("sserial.port-0.run", "TRUE");
        let begin = Instant::now();
        while begin.elapsed() < Duration::from_secs(3) {
            if state(&mut self.session) == "3" && is_so(&mut self.session) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        false
    }

    /// Asserts that the outputs stay as they are.
    fn stay(&mut self, outputs: [bool; 3]) {
        for _ in 0..10 {
            std::thread::sleep(Duration::from_millis(30));
            assert_eq!(self.session.outputs(), format!("{outputs:?}"));
        }
    }

    /// hostmot2's state of a port that has stopped after a fault.
    fn port_is_stopped(&mut self) {
        self.session.until("the port has stopped", |session| {
            session.get("sserial.port-0.port_state") == "10"
        });
    }

    fn a_card_is_pulled(&mut self) {
        self.be_patient(false);
        self.session.board("unplug 2");
        if !self.is_ours {
            self.port_is_stopped();
            self.session.expect_outputs([false, false, true]);
            return;
        }
        self.session.expect("7i72.0.2.valid", "FALSE");
        for value in ["FALSE", "TRUE"] {
            self.session.set("7i77.0.0.output-03", value);
            let is_on = value == "TRUE";
            self.session.until("the 7I77 follows", |session| {
                session.outputs().starts_with(&format!("[{is_on}"))
            });
        }
        // Its own watchdog does that: nothing reaches it.
        self.session.expect_outputs([true, false, true]);
        assert_eq!(self.session.get("7i77.0.0.valid"), "TRUE");
    }

    fn it_is_put_back(&mut self) {
        self.session.board("plug 2");
        if self.is_ours {
            self.session.expect("7i72.0.2.valid", "TRUE");
            self.stay([true, false, true]);
            assert_eq!(self.session.get("7i72.0.2.armed"), "FALSE");
            self.session.set("7i72.0.2.rearm", "TRUE");
            self.session.expect_outputs([true; 3]);
            self.session.set("7i72.0.2.rearm", "FALSE");
            self.session.board("unplug 2");
            self.session.expect("7i72.0.2.valid", "FALSE");
            self.session.board("plug 2");
            self.session.expect("7i72.0.2.valid", "TRUE");
        } else {
            self.stay([false, false, true]);
            assert_eq!(self.session.get("sserial.port-0.port_state"), "10");
            self.be_patient(true);
        }
        self.start_port();
    }

    fn a_parameter_is_set(&mut self) {
        // hostmot2 does not notice that a late packet has cost a write, and does not write a value
        // again that it takes for written.
        let attempts = if self.is_ours { 1 } else { 30 };
        let written = (1900..1900 + attempts).find(|value| {
            let value = value.to_string();
            self.session.set("7i72.0.2.nvwatchdogtimeout", &value);
            let kept = format!("{value} ms");
            self.start_port_once(|session| session.board("watchdog 2") == kept)
        });
        let value = written.expect("the parameter is written").to_string();
        self.session.expect_outputs([true; 3]);
        assert_eq!(self.session.get("7i72.0.2.nvwatchdogtimeout"), value);
        if self.is_ours {
            self.comes_back(
                "7i72.0.2.nvwatchdogtimeout",
                ["70000", &value],
                "NVWatchDogTimeout: 70000",
            );
        }
    }

    /// A value that cannot be is replaced by the old one, and a message has the `words`.
    fn comes_back(&mut self, name: &str, [value, old]: [&str; 2], words: &str) {
        let mut said = self.session.hal(&format!("setp .{name} {value}"));
        let begin = Instant::now();
        // What the realtime part says comes late, with the answer to any command.
        while !said.iter().any(|line| line == old) || !said.iter().any(|line| line.contains(words))
        {
            let in_time = begin.elapsed() < session::SETTLE;
            assert!(in_time, "{name} = {value}: {:?}", said.last());
            std::thread::sleep(Duration::from_millis(20));
            said.extend(self.session.hal(&format!("getp .{name}")));
        }
        assert_eq!(self.session.get(name), old);
    }

    /// True if `watchdog.has_bit` is set within 3 s.
    fn has_bitten(&mut self) -> bool {
        let begin = Instant::now();
        while begin.elapsed() < Duration::from_secs(3) {
            if self.session.get("watchdog.has_bit") == "TRUE" {
                return true;
            }
        }
        false
    }

    fn the_thread_stops(&mut self) {
        // On a busy computer hostmot2 now and then goes on with the board's own outputs as if
        // nothing had been.
        let attempts = if self.is_ours { 1 } else { 10 };
        let is_noticed = (0..attempts).any(|attempt| {
            if attempt > 0 {
                self.be_patient(true);
                self.start_port();
            }
            self.be_patient(false);
            self.session.hal("stop");
            // The watchdogs of board and cards: nothing reaches them.
            self.session.expect_outputs([false; 3]);
            self.session.hal("start");
            self.has_bitten()
        });
        assert!(is_noticed, "the watchdog has bitten");
        if self.is_ours {
            self.session.expect("valid", "FALSE");
        } else {
            self.port_is_stopped();
        }
        self.stay([false; 3]);
    }

    fn has_bit_is_cleared(&mut self) {
        self.session.set("watchdog.has_bit", "FALSE");
        if self.is_ours {
            self.session.expect_outputs([true; 3]);
            self.session.expect("valid", "TRUE");
            return;
        }
        self.session.expect_outputs([false, false, true]);
        self.stay([false, false, true]);
        self.be_patient(true);
        self.start_port();
    }

    /// All packets are lost until `io_error`.
    fn lose_packets(&mut self) {
        self.session.set("packet-error-limit", "10");
        self.session.board("lose 1");
        self.session.expect("io_error", "TRUE");
    }

    fn find_packets(&mut self) {
        self.session.board("lose 0");
        self.session.set("packet-error-limit", "100000");
    }

    fn packets_are_lost(&mut self) {
        self.be_patient(false);
        self.lose_packets();
        // The board's watchdog.
        self.session.until("its outputs are off", |session| {
            session.outputs().ends_with("false]")
        });
        self.find_packets();
        // Nothing is written until it is cleared, and failures are not counted on.
        let errors = self.session.get("packet-error-total");
        std::thread::sleep(Duration::from_millis(300));
        assert!(self.session.outputs().ends_with("false]"));
        self.session.set("io_error", "FALSE");
        if self.is_ours {
            assert_eq!(self.session.get("packet-error-total"), errors);
            self.session.expect_outputs([true; 3]);
            self.session.expect("valid", "TRUE");
            return;
        }
        self.session.expect("watchdog.has_bit", "TRUE");
        self.port_is_stopped();
        self.session.expect_outputs([false; 3]);
        self.session.set("watchdog.has_bit", "FALSE");
        self.session.expect_outputs([false, false, true]);
        self.stay([false, false, true]);
        self.be_patient(true);
        self.start_port();
    }

    fn an_input_fails(&mut self) {
        self.session.board("input 7 on");
        self.session.expect("7i77.0.0.input-07", "TRUE");
        if self.is_ours {
            self.make_inputs_stop_a_machine();
        } else {
            self.be_patient(false);
        }
        self.session.board("unplug 0");
        if self.is_ours {
            self.session.expect("7i77.0.0.valid", "FALSE");
            self.session.until("an input is not valid", |session| {
                session.value("getp inputs-valid.out") == "FALSE"
            });
            assert_eq!(self.session.get("valid"), "TRUE");
        } else {
            self.port_is_stopped();
        }
        self.session.board("input 7 off");
        std::thread::sleep(Duration::from_millis(300));
        assert_eq!(self.session.get("7i77.0.0.input-07"), "TRUE");
        if !self.is_ours {
            self.session.board("plug 0");
            self.be_patient(true);
            self.start_port();
        }
    }

    /// The lines of the page, and of the manual page, for an emergency stop.
    fn make_inputs_stop_a_machine(&mut self) {
        let manual = include_str!("../../packaging/mesa_eth.9");
        let lines = PAGE.lines().filter(|line| line.contains("inputs-valid"));
        let lines: Vec<_> = lines.filter(|line| !line.contains('`')).collect();
        assert_eq!(lines.len(), 4, "{lines:?}");
        for line in lines {
            assert!(manual.lines().any(|other| other == line), "{line}");
            // The arrow is for readers; the shell of this session would take it for a file.
            let line = line.replace("servo-thread", "servo").replace("=> ", "");
            self.session.hal(&line);
        }
        self.session.until("inputs are valid", |session| {
            session.value("getp inputs-valid.out") == "TRUE"
        });
    }

    /// The 7I77 is still out.
    fn io_error_is_cleared_without_a_card(&mut self) {
        if !self.is_ours {
            return;
        }
        self.lose_packets();
        self.find_packets();
        self.session.set("io_error", "FALSE");
        self.session.expect("7i72.0.2.valid", "TRUE");
        self.session.expect_outputs([false, true, true]);
        self.session.board("plug 0");
        self.session.expect_outputs([true; 3]);
        self.session.expect("7i77.0.0.input-07", "FALSE");
        self.session.until("inputs are valid", |session| {
            session.value("getp inputs-valid.out") == "TRUE"
        });
    }

    fn a_scale_is_0(&mut self) {
        let scale = "encoder.00.scale";
        self.session.set(scale, "5");
        if self.is_ours {
            self.session.cycles();
            self.comes_back(scale, ["0", "5"], "hm2_7i97.0.encoder.00.scale");
        } else {
            self.session.set(scale, "0");
            self.session.expect(scale, "1");
        }
    }

    /// Loads the component again, in one LinuxCNC.
    fn ends_and_begins_again(&mut self) {
        for _ in 0..3 {
            self.session.hal("stop");
            self.session.hal("unloadrt mesa_eth");
            self.session.expect_outputs([false; 3]);
            self.session
                .hal(&format!("loadrt mesa_eth {}", session::WORDS));
            self.session.set("packet-error-limit", "100000");
            self.session.set("watchdog.timeout_ns", "1000000000");
            self.session.hal("addf .read servo");
            self.session.hal("addf .write servo");
            self.session.hal("start");
            self.session.switch_on();
        }
    }
}
