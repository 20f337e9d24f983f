//! A session of LinuxCNC with a simulated board, in a private network.

use std::{
    collections::BTreeMap,
    fs,
    ops::{Deref, DerefMut},
    path::Path,
    time::{Duration, Instant},
};

use super::expected::{Expected, List};
use crate::interop::{
    console::{Console, Values, values},
    halcmd::{Halcmd, LOADS, Started},
    mesa, realtime,
};

pub use crate::interop::halcmd::{alone, skipped};

/// The usual configuration of the board.
pub const CONFIG: &str = "sserial_port_0=000xxxxx";

/// Time limit for a change on one side to arrive at the other on a busy machine.
pub const SETTLE: Duration = Duration::from_secs(5);

/// Watchdog time of a remote, ms, that a busy machine leaves alone. Each attempt to set it adds
/// one.
const PATIENCE: u32 = 1000;

/// Starts of a serial port: a single late packet spoils one, and on a busy computer many are late.
const ATTEMPTS: u32 = 20;

/// LinuxCNC and a simulated board in a private network.
pub struct Machine {
    halcmd: Halcmd,
    pub board: Console,
}

impl Deref for Machine {
    type Target = Halcmd;

    fn deref(&self) -> &Halcmd {
        &self.halcmd
    }
}

impl DerefMut for Machine {
    fn deref_mut(&mut self) -> &mut Halcmd {
        &mut self.halcmd
    }
}

impl Machine {
    /// Loads LinuxCNC's driver for a board, with retries. A packet that comes late during discovery
    /// makes the driver fail, or continue without a parameter or a remote.
    pub fn load(prefix: &'static str, name: &str, board: &str, expected: &Expected) -> Self {
        Self::load_with(prefix, name, board, expected, "loadrt hostmot2")
    }

    /// Like [`load`](Self::load), with the given command for the part that all boards share.
    pub fn load_with(
        prefix: &'static str,
        name: &str,
        board: &str,
        expected: &Expected,
        hostmot2: &str,
    ) -> Self {
        Self::load_all(prefix, (name, board), expected, (hostmot2, CONFIG))
    }

    /// Like [`load_with`](Self::load_with), with the given configuration of the board.
    pub fn load_all(
        prefix: &'static str,
        (name, board): (&str, &str),
        expected: &Expected,
        (hostmot2, config): (&str, &str),
    ) -> Self {
        let driver = format!("loadrt hm2_eth board_ip=10.97.0.2 config=\"{config}\"");
        let mut missing = Vec::new();
        for attempt in 1..=LOADS {
            let mut machine = Self::start(prefix, board, &[]);
            let mut load = || machine.try_hal(hostmot2).and(machine.try_hal(&driver));
            missing = match load() {
                Ok(_) => {
                    let (pins, params) = (machine.list("pin"), machine.list("param"));
                    keep(&format!("{name}.pins"), &pins);
                    keep(&format!("{name}.params"), &params);
                    expected.missing(&pins, &params)
                }
                Err(messages) => messages,
            };
            if missing.is_empty() {
                println!("LinuxCNC loaded at attempt {attempt}");
                return machine;
            }
            println!(
                "attempt {attempt}: LinuxCNC did not load all: {:?}",
                missing.last()
            );
            machine.stop();
        }
        panic!("LinuxCNC did not load in {LOADS} attempts: {missing:#?}");
    }

    /// Loads, with retries, the files that `mesa hal` has written to `directory`: with a thread
    /// alone (`bench`), or all of it (`linuxcnc`, or `prepared`), with options of `mesa hal` behind
    /// that. The remotes get the watchdog times of [`run`](Self::run).
    pub fn load_written(
        prefix: &'static str,
        (board, remotes): (&str, &[&str]),
        (how, directory): (&str, &Path),
    ) -> Self {
        let directory = directory.to_str().expect("UTF-8");
        let mut said = Vec::new();
        for attempt in 1..=LOADS {
            let (how, options) = how.split_once(' ').unwrap_or((how, ""));
            let mut session = vec![how, directory];
            session.extend(options.split_whitespace());
            let mut machine = Self::start(prefix, board, &session);
            let mut load = || {
                machine.try_hal("getp .io_error")?;
                let mut remotes = remotes.iter();
                remotes.try_for_each(|remote| {
                    let found = machine.try_hal(&format!("getp .{remote}.nvwatchdogtimeout"));
                    found.map(drop)
                })
            };
            match load() {
                Ok(()) => {
                    println!("LinuxCNC loaded at attempt {attempt}");
                    machine.be_patient(remotes);
                    return machine;
                }
                Err(messages) => said = messages,
            }
            let last = said.len().saturating_sub(3);
            println!("attempt {attempt}: {:?}", &said[last..]);
            machine.stop();
        }
        panic!("LinuxCNC did not load in {LOADS} attempts: {said:#?}");
    }

    fn start(prefix: &'static str, board: &str, session: &[&str]) -> Self {
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut sandbox = realtime(package.join("../../examples/linuxcnc.sh"));
        sandbox
            .args(board.split(' '))
            .arg("--")
            .arg(package.join("tests/mesa/interop_linuxcnc/session.sh"))
            .args(session)
            .env("MESA", mesa());
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let Started {
            halcmd,
            to_board,
            from_board,
        } = Halcmd::start(prefix, sandbox, folder);
        let board = Console::new(to_board, from_board);
        board.wait_for("help");
        Self { halcmd, board }
    }

    /// Complete output of a command, whether it succeeds or not.
    pub fn said(&mut self, command: &str) -> String {
        let (Ok(answer) | Err(answer)) = self.try_hal(command);
        answer.join("\n")
    }

    /// The value of a signal.
    pub fn signal(&mut self, name: &str) -> String {
        self.value(&format!("gets {name}"))
    }

    /// Waits until a pin or parameter has a value.
    pub fn expect(&mut self, name: &str, expected: &str) {
        let start = Instant::now();
        loop {
            let value = self.get(name);
            if value == expected {
                return;
            }
            let in_time = start.elapsed() < SETTLE;
            assert!(
                in_time,
                "{name} is {value}, not {expected}: {}",
                self.diagnosis()
            );
        }
    }

    /// Waits until a signal has a value.
    pub fn expect_signal(&mut self, name: &str, fits: impl Fn(&str) -> bool) {
        let start = Instant::now();
        loop {
            let value = self.signal(name);
            if fits(&value) {
                return;
            }
            let in_time = start.elapsed() < SETTLE;
            assert!(in_time, "{name} is {value}: {}", self.diagnosis());
        }
    }

    /// Waits until a value of the simulated board fits.
    pub fn expect_board(&mut self, what: &str, name: &str, fits: impl Fn(f64) -> bool) {
        let start = Instant::now();
        loop {
            let all = self.board.show(what);
            let value = all.get(name).unwrap_or_else(|| panic!("{name}: {all:?}"));
            if fits(value.parse().unwrap()) {
                return;
            }
            let in_time = start.elapsed() < SETTLE;
            assert!(in_time, "{name} is {value}: {}", self.diagnosis());
        }
    }

    /// Adds read and write to a thread of 1 kHz and starts it.
    ///
    /// The test machine is not a realtime one: late packets and pauses are counted, not forbidden,
    /// and the watchdogs of board and remotes get longer times, as far as their parameters permit.
    pub fn run(&mut self, remotes: &[&str]) {
        self.hal("loadrt threads name1=servo period1=1000000");
        self.set("packet-error-limit", "100000");
        self.set("watchdog.timeout_ns", "1000000000");
        // After a pause, two cycles in a row find the transfer still running.
        self.set("sserial.port-0.fault-lim", "1000000");
        self.hal("addf .read servo");
        self.hal("addf .write servo");
        self.hal("start");
        self.power_up(remotes);
    }

    /// Sets the same watchdog times for remotes whose thread runs already.
    fn be_patient(&mut self, remotes: &[&str]) {
        self.set("sserial.port-0.run", "false");
        std::thread::sleep(Duration::from_millis(200));
        self.power_up(remotes);
    }

    /// Starts the port until the remotes have longer watchdog times, because a late packet can
    /// prevent the write, then power-cycles the remotes, which makes the times effective.
    fn power_up(&mut self, remotes: &[&str]) {
        let channels = remotes
            .iter()
            .map(|remote| remote.rsplit('.').next().expect("a channel"));
        let channels: Vec<_> = channels.collect();
        let is_written_to = |all: &Values, channel: &str| {
            let time = &all[&format!("remote.{channel}.parameter.nvwatchdogtimeout")];
            time.parse::<u32>().is_ok_and(|time| time >= PATIENCE)
        };
        let is_written = |all: Values| channels.iter().all(|channel| is_written_to(&all, channel));
        for attempt in 0..ATTEMPTS {
            // LinuxCNC does not write a value again that it takes for written.
            let all = self.board.show("all");
            for (remote, channel) in remotes.iter().zip(&channels) {
                if !is_written_to(&all, channel) {
                    let time = (PATIENCE + attempt).to_string();
                    self.set(&format!("{remote}.nvwatchdogtimeout"), &time);
                }
            }
            self.start_port();
            let start = Instant::now();
            while !is_written(self.board.show("all")) && start.elapsed() < SETTLE / 2 {}
            self.set("sserial.port-0.run", "false");
            std::thread::sleep(Duration::from_millis(200));
            if is_written(self.board.show("all")) {
                break;
            }
        }
        for channel in &channels {
            self.board.run(&format!("power {channel} off"));
            self.board.run(&format!("power {channel} on"));
        }
        assert!(is_written(self.board.show("all")), "{}", self.diagnosis());
        std::thread::sleep(Duration::from_millis(200));
        self.start_port();
    }

    /// Starts the serial port until all remotes run: a late packet can spoil a start.
    pub fn start_port(&mut self) {
        for _ in 0..ATTEMPTS {
            self.set("sserial.port-0.run", "true");
            let start = Instant::now();
            while start.elapsed() < SETTLE {
                let all = self.board.show("all");
                let mut faults = all.iter().filter(|(name, _)| name.ends_with(".faults"));
                if faults.all(|(_, faults)| faults == "00") {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            println!("the serial port did not start: {}", self.diagnosis());
            self.set("sserial.port-0.run", "false");
            std::thread::sleep(Duration::from_millis(200));
        }
        panic!("the serial port does not start");
    }

    /// Values that show the reason for a failed expectation.
    fn diagnosis(&mut self) -> String {
        let names = [
            "sserial.port-0.run",
            "sserial.port-0.port_state",
            "sserial.port-0.fault-count",
            "packet-error-total",
            "watchdog.has_bit",
            "io_error",
        ];
        let all = names.map(|name| format!("{name} {}", self.get(name)));
        let board = self.board.show("all");
        let remotes = board.iter().filter(|(name, _)| {
            name.starts_with("remote.") && !name.contains("put-") && !name.contains("parameter")
        });
        format!("{}; {:?}", all.join(", "), remotes.collect::<Vec<_>>())
    }

    /// Pins or parameters: type and direction by name, without the board's prefix.
    pub fn list(&mut self, what: &str) -> List {
        let shown = self.show(what).into_iter();
        shown
            .map(|(name, [_, kind, direction, _])| (name, (kind, direction)))
            .collect()
    }

    /// Values of all pins and parameters by name, without the board's prefix.
    pub fn values(&mut self) -> BTreeMap<String, String> {
        let shown = [self.show("pin"), self.show("param")].into_iter().flatten();
        shown.map(|(name, [.., value])| (name, value)).collect()
    }

    /// Ends LinuxCNC and the board, and returns the board's summary.
    pub fn stop(mut self) -> Values {
        self.end();
        self.board.wait_for("summary");
        values(self.board.answer().unwrap())
    }
}

/// Keeps the list of pins or parameters for other tests.
fn keep(name: &str, list: &List) {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .parent()
        .unwrap()
        .join("interop");
    fs::create_dir_all(&directory).unwrap();
    let line = |(pin, (kind, direction)): (&String, &(String, String))| {
        format!("{kind} {direction} {pin}\n")
    };
    let text: String = list.iter().map(line).collect();
    fs::write(directory.join(name), text).unwrap();
}
