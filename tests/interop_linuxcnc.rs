//! LinuxCNC (Debian package `linuxcnc-uspace`, driver hm2_eth) takes the simulated board for a real
//! one, at 1 kHz.
//!
//! Needs root, for a private network: the driver wants a board with a MAC address of its own. See
//! `interop/sandbox.sh`. What LinuxCNC created is kept under `target/interop/` (`NAME.pins`:
//! type, direction and name of each pin; `NAME.params`), to compare other lists with.

mod interop;

use std::{
    collections::BTreeMap,
    fs::{self, File, OpenOptions},
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, Command, Stdio},
    sync::{
        Mutex,
        mpsc::{Receiver, channel},
    },
    time::{Duration, Instant},
};

use interop::{
    console::{Console, Values, values},
    has_program, sim_board, skip,
};

/// How long a command of LinuxCNC may take.
const PATIENCE: Duration = Duration::from_secs(60);

/// Its init never retries, and one late reply fails it: so often it is tried again (FACTS 10.3).
const LOADS: usize = 12;

/// How long something set on one side may take to arrive at the other on a busy machine.
const SETTLE: Duration = Duration::from_secs(5);

/// One LinuxCNC at a time: the machine has few cores, and each is meant to run at 1 kHz.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// LinuxCNC and a simulated board in a private network.
struct Machine {
    sandbox: Child,
    commands: Option<ChildStdin>,
    lines: Receiver<String>,
    board: Console,
    /// `hm2_7i97.0`
    prefix: &'static str,
    pipes: [PathBuf; 2],
}

impl Machine {
    /// Loads LinuxCNC's driver for a board, or tries again. A packet that comes late during
    /// discovery makes it fail, or go on without a parameter, or without a remote.
    fn load(prefix: &'static str, name: &str, board: &str, expected: &Expected) -> Self {
        let mut missing = Vec::new();
        for attempt in 1..=LOADS {
            let mut machine = Self::start(prefix, board);
            let driver = "loadrt hm2_eth board_ip=10.97.0.2 config=sserial_port_0=000xxxxx";
            let mut load = || {
                machine
                    .try_hal("loadrt hostmot2")
                    .and(machine.try_hal(driver))
            };
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
                missing.first()
            );
            machine.stop();
        }
        panic!("LinuxCNC did not load in {LOADS} attempts: {missing:#?}");
    }

    fn start(prefix: &'static str, board: &str) -> Self {
        let pipes = ["to-board", "from-board"].map(|name| {
            let directory = Path::new(env!("CARGO_TARGET_TMPDIR"));
            let path = directory.join(format!("{}-{name}", std::process::id()));
            let _ = fs::remove_file(&path);
            let made = Command::new("mkfifo").arg(&path).status().unwrap();
            assert!(made.success());
            path
        });
        // Open for both, so that neither end waits for the other.
        let [to_board, from_board] = [&pipes[0], &pipes[1]].map(|path| both_ends(path));
        let board_command = format!("{} {board} --listen 10.97.0.2", sim_board().display());
        let mut sandbox = Command::new(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/tests/interop/sandbox.sh"
        ))
        .args(&pipes)
        .arg(board_command)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("the sandbox starts");
        let output = sandbox.stdout.take().unwrap();
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        let board = Console::new(to_board, from_board);
        board.wait_for("help");
        Self {
            commands: sandbox.stdin.take(),
            sandbox,
            lines,
            board,
            prefix,
            pipes,
        }
    }

    /// A command of halcmd; names that begin with `.` get the board's prefix.
    fn try_hal(&mut self, command: &str) -> Result<Vec<String>, Vec<String>> {
        let command = command.replace(" .", &format!(" {}.", self.prefix));
        let commands = self.commands.as_mut().expect("not stopped");
        if writeln!(commands, "{command}").is_err() {
            return Err(vec!["LinuxCNC is gone".to_owned()]);
        }
        let mut answer = Vec::new();
        let end = Instant::now() + PATIENCE;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let Ok(line) = self.lines.recv_timeout(left) else {
                answer.push("no answer".to_owned());
                return Err(answer);
            };
            match line.strip_prefix("= ") {
                Some("0") => return Ok(answer),
                Some(_) => return Err(answer),
                None => answer.push(line),
            }
        }
    }

    fn hal(&mut self, command: &str) -> Vec<String> {
        match self.try_hal(command) {
            Ok(answer) => answer,
            Err(answer) => panic!("halcmd {command}: {answer:?}"),
        }
    }

    fn set(&mut self, name: &str, value: &str) {
        self.hal(&format!("setp .{name} {value}"));
    }

    fn get(&mut self, name: &str) -> String {
        let answer = self.hal(&format!("getp .{name}"));
        let values: Vec<_> = answer
            .iter()
            .filter(|line| !line.starts_with('!'))
            .collect();
        assert_eq!(values.len(), 1, "{name}: {answer:?}");
        values[0].trim().to_owned()
    }

    fn number(&mut self, name: &str) -> f64 {
        let value = self.get(name);
        value.parse().unwrap_or_else(|_| panic!("{name} = {value}"))
    }

    /// Waits until a pin or parameter has a value.
    fn expect(&mut self, name: &str, expected: &str) {
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

    /// Waits until the board shows a value.
    fn expect_board(&mut self, what: &str, name: &str, fits: impl Fn(f64) -> bool) {
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

    /// Puts read and write into a thread of 1 kHz and starts it.
    fn run(&mut self) {
        self.hal("loadrt threads name1=servo period1=1000000");
        // This machine is not a realtime one: late packets are counted, not forbidden.
        self.set("packet-error-limit", "100000");
        self.set("watchdog.timeout_ns", "100000000");
        // Two cycles at once, after a pause, find the transfer still running: also only counted.
        self.set("sserial.port-0.fault-lim", "1000000");
        self.hal("addf .read servo");
        self.hal("addf .write servo");
        self.hal("start");
        self.start_port();
    }

    /// Starts the serial port until all remotes run: a late packet can spoil a start.
    fn start_port(&mut self) {
        for _ in 0..5 {
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

    /// What says why something does not arrive.
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

    /// Pins or parameters: type and direction by name without the board's prefix.
    fn list(&mut self, what: &str) -> List {
        let lines = self.hal(&format!("show {what}"));
        let prefix = format!("{}.", self.prefix);
        let parsed = lines.iter().filter_map(|line| {
            let words: Vec<_> = line.split_whitespace().collect();
            let [_, kind, direction, .., _] = words[..] else {
                return None;
            };
            let name = words.iter().find_map(|word| word.strip_prefix(&prefix))?;
            Some((name.to_owned(), (kind.to_owned(), direction.to_owned())))
        });
        parsed.collect()
    }

    /// Ends LinuxCNC and the board, and returns the board's summary.
    fn stop(mut self) -> Values {
        self.commands = None;
        let end = Instant::now() + PATIENCE;
        while self.sandbox.try_wait().unwrap().is_none() {
            assert!(Instant::now() < end, "the sandbox ends");
            std::thread::sleep(Duration::from_millis(20));
        }
        self.board.wait_for("summary");
        values(self.board.answer().unwrap())
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        self.commands = None;
        let end = Instant::now() + Duration::from_secs(10);
        while Instant::now() < end && matches!(self.sandbox.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.sandbox.kill();
        let _ = self.sandbox.wait();
        for pipe in &self.pipes {
            let _ = fs::remove_file(pipe);
        }
    }
}

fn both_ends(pipe: &Path) -> File {
    let file = OpenOptions::new().read(true).write(true).open(pipe);
    file.expect("the pipe opens")
}

/// `true` if the test can not run here.
fn skipped() -> bool {
    for program in ["halrun", "unshare", "nsenter", "ip", "iptables", "mkfifo"] {
        if !has_program(program) {
            skip(&format!("`{program}` is not installed"));
            return true;
        }
    }
    let allowed = Command::new("unshare")
        .args(["--net", "--ipc", "--mount", "--pid", "--fork", "true"])
        .stderr(Stdio::null())
        .status();
    if !allowed.is_ok_and(|status| status.success()) {
        skip("no right to make a private network (root or CAP_SYS_ADMIN)");
        return true;
    }
    false
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

/// Type and direction by name.
type List = BTreeMap<String, (String, String)>;

/// Pins and parameters that LinuxCNC must create.
#[derive(Default)]
struct Expected {
    pins: List,
    params: List,
}

impl Expected {
    fn pins(&mut self, kind: &str, direction: &str, names: impl IntoIterator<Item = String>) {
        let entry = (kind.to_owned(), direction.to_owned());
        self.pins
            .extend(names.into_iter().map(|name| (name, entry.clone())));
    }

    fn params(&mut self, kind: &str, direction: &str, names: impl IntoIterator<Item = String>) {
        let entry = (kind.to_owned(), direction.to_owned());
        self.params
            .extend(names.into_iter().map(|name| (name, entry.clone())));
    }

    /// What is not there, or not as expected.
    fn missing(&self, pins: &List, params: &List) -> Vec<String> {
        let missing = |expected: &List, found: &List| -> Vec<String> {
            let differs =
                |(name, entry): &(&String, &(String, String))| found.get(*name) != Some(*entry);
            let told = |(name, entry): (&String, &(String, String))| {
                format!("{name}: {entry:?}, found {:?}", found.get(name))
            };
            expected.iter().filter(differs).map(told).collect()
        };
        [missing(&self.pins, pins), missing(&self.params, params)].concat()
    }
}

fn numbered(count: usize, name: impl Fn(usize) -> String) -> impl Iterator<Item = String> {
    (0..count).map(name)
}

/// Pins and parameters of a 7I77 on channels 0 and 1. FACTS 8.6.
fn expect_7i77(expected: &mut Expected) {
    let io = |name: &str| format!("7i77.0.0.{name}");
    let analog = |name: &str| format!("7i77.0.1.{name}");
    expected.pins("bit", "OUT", numbered(32, |n| io(&format!("input-{n:02}"))));
    expected.pins(
        "bit",
        "OUT",
        numbered(32, |n| io(&format!("input-{n:02}-not"))),
    );
    expected.pins("bit", "IN", numbered(16, |n| io(&format!("output-{n:02}"))));
    expected.params(
        "bit",
        "RW",
        numbered(16, |n| io(&format!("output-{n:02}-invert"))),
    );
    expected.pins(
        "float",
        "IN",
        numbered(6, |n| analog(&format!("analogout{n}"))),
    );
    for limit in ["scalemax", "maxlim", "minlim"] {
        let names = numbered(6, |n| analog(&format!("analogout{n}-{limit}")));
        expected.params("float", "RW", names);
    }
    expected.pins("bit", "IN", ["analogena", "spinena"].map(analog));
    let inverts = ["analogena-invert", "spinena-invert"].map(analog);
    expected.params("bit", "RW", inverts);
    let parameters = [
        "nvencmode0",
        "nvencmode1",
        "nvunitnumber",
        "nvwatchdogtimeout",
        "nvbaudrate",
    ];
    expected.params("u32", "RW", parameters.map(io));
    expected.params("u32", "RO", ["swrevision", "hwrevision"].map(io));
}

/// Pins and parameters of the board and its serial port. FACTS 8.6.
fn expect_board(expected: &mut Expected) {
    let encoder = |n: usize, name: &str| format!("encoder.{n:02}.{name}");
    expected.pins("s32", "OUT", numbered(6, |n| encoder(n, "count")));
    expected.pins("s32", "OUT", numbered(6, |n| encoder(n, "rawcounts")));
    expected.pins("float", "OUT", numbered(6, |n| encoder(n, "position")));
    expected.pins("float", "OUT", numbered(6, |n| encoder(n, "velocity")));
    expected.pins("bit", "I/O", numbered(6, |n| encoder(n, "index-enable")));
    expected.params("float", "RW", numbered(6, |n| encoder(n, "scale")));
    let port = |name: &str| format!("sserial.port-0.{name}");
    expected.pins("bit", "IN", [port("run")]);
    expected.pins("u32", "OUT", ["fault-count", "port_state"].map(port));
    expected.params(
        "u32",
        "RW",
        ["fault-inc", "fault-dec", "fault-lim"].map(port),
    );
    expected.pins("bit", "I/O", ["watchdog.has_bit".to_owned()]);
    expected.params("u32", "RW", ["watchdog.timeout_ns".to_owned()]);
    expected.params("bit", "RW", ["io_error".to_owned()]);
    expected.pins("bit", "OUT", ["packet-error".to_owned()]);
}

/// Digital outputs, analog volts and booleans from HAL to the 7I77 and back.
fn check_7i77(machine: &mut Machine) {
    machine.set("7i77.0.0.output-03", "true");
    machine.set("7i77.0.0.output-15", "true");
    machine.set("7i77.0.0.output-07-invert", "true");
    for n in 0..16 {
        let on = [3, 7, 15].contains(&n);
        let name = format!("remote.0.output-{n:02}");
        machine.expect_board("0", &name, |value| value == f64::from(u8::from(on)));
    }
    machine.set("7i77.0.1.analogena", "true");
    for (n, volts) in ["5", "-10", "10", "-2.5", "0.01", "7"]
        .into_iter()
        .enumerate()
    {
        machine.set(&format!("7i77.0.1.analogout{n}-scalemax"), "10");
        machine.set(&format!("7i77.0.1.analogout{n}"), volts);
    }
    // 13 bits over 20 V; output 5 stays at 0 V until it has its own enable.
    for (n, volts) in [5.0, -10.0, 10.0, -2.5, 0.01, 0.0].into_iter().enumerate() {
        let near = move |value: f64| (value - volts).abs() < 0.005;
        machine.expect_board("1", &format!("remote.1.analogout{n}"), near);
    }
    machine.set("7i77.0.1.spinena", "true");
    machine.expect_board("1", "remote.1.analogout5", |volts| {
        (volts - 7.0).abs() < 0.005
    });
    machine.expect_board("1", "remote.1.spinena", |on| on == 1.0);

    for input in [0, 7, 31] {
        let name = format!("7i77.0.0.input-{input:02}");
        machine.expect(&name, "FALSE");
        machine.board.run(&format!("input 0 {input} on"));
        machine.expect(&name, "TRUE");
        machine.expect(&format!("{name}-not"), "FALSE");
        machine.board.run(&format!("input 0 {input} off"));
        machine.expect(&name, "FALSE");
    }
}

/// Turns a motor by hand and stops it: LinuxCNC must count what the encoder made.
fn check_encoders(machine: &mut Machine) {
    for axis in 0..6 {
        machine.set(&format!("encoder.{axis:02}.scale"), "1000");
        let speed = if axis % 2 == 0 { 20 } else { -20 };
        machine.board.run(&format!("turn {axis} {speed}"));
    }
    std::thread::sleep(Duration::from_millis(500));
    for axis in 0..6 {
        let velocity = machine.number(&format!("encoder.{axis:02}.velocity"));
        let speed = if axis % 2 == 0 { 20.0 } else { -20.0 };
        assert!(
            (velocity - speed).abs() < 2.0,
            "axis {axis}: {velocity} for {speed}"
        );
        machine.board.run(&format!("turn {axis} 0"));
    }
    std::thread::sleep(Duration::from_millis(100));
    let motors = machine.board.show("motors");
    for axis in 0..6 {
        let counts: f64 = motors[&format!("motor.{axis}.counts")].parse().unwrap();
        let count = machine.number(&format!("encoder.{axis:02}.count"));
        assert!(counts.abs() > 5_000.0, "axis {axis} moved by {counts}");
        assert!(
            (count - counts).abs() <= 1.0,
            "axis {axis}: {count} of {counts}"
        );
        machine.board.run(&format!("turn {axis} free"));
    }
}

/// Stops the serial port, which makes the remotes safe, and starts it again.
fn check_run_and_stop(machine: &mut Machine) {
    machine.expect_board("0", "remote.0.output-03", |on| on == 1.0);
    machine.set("sserial.port-0.run", "false");
    machine.expect_board("0", "remote.0.output-03", |on| on == 0.0);
    machine.expect_board("1", "remote.1.analogout0", |volts| volts == 0.0);
    machine.start_port();
    machine.expect_board("0", "remote.0.output-03", |on| on == 1.0);
    machine.expect_board("1", "remote.1.analogout0", |volts| {
        (volts - 5.0).abs() < 0.005
    });
}

/// Pulls a remote: LinuxCNC counts faults, in every cycle, and stops the port at the limit. Puts it
/// back and starts again.
fn check_unplugging(machine: &mut Machine, channel: usize) {
    machine.set("sserial.port-0.fault-lim", "5000");
    let before = machine.number("sserial.port-0.fault-count");
    assert!(before < 1000.0, "{before} before anything is unplugged");
    machine.board.run(&format!("unplug {channel}"));
    let start = Instant::now();
    while machine.number("sserial.port-0.fault-count") < 4000.0 {
        assert!(start.elapsed() < SETTLE, "no faults are counted");
    }
    // The stopped port makes all its remotes safe.
    machine.expect_board("0", "remote.0.output-03", |on| on == 0.0);
    machine.board.run(&format!("plug {channel}"));
    machine.set("sserial.port-0.fault-lim", "1000000");
    machine.set("sserial.port-0.run", "false");
    std::thread::sleep(Duration::from_millis(200));
    machine.start_port();
    machine.expect_board("0", "remote.0.output-03", |on| on == 1.0);
    let after = machine.number("sserial.port-0.fault-count");
    assert!(
        after < 1000.0,
        "{after} after everything is plugged in again"
    );
}

/// What cycled in `time`, from the board's counters.
fn assert_cycled(before: &Values, after: &Values, time: Duration) {
    let packets = |values: &Values| -> f64 { values["network.received.packets"].parse().unwrap() };
    let rate = (packets(after) - packets(before)) / 2.0 / time.as_secs_f64();
    println!("{rate:.0} cycles a second");
    // Not realtime: cycles whose reply was late are left out by LinuxCNC.
    assert!((800.0..1100.0).contains(&rate), "{rate} cycles a second");
    for error in ["parse", "memory", "write"] {
        assert_eq!(after[&format!("board.errors.{error}")], "0");
    }
}

#[test]
fn a_7i97_with_three_remotes_runs_at_1_khz() {
    if skipped() {
        return;
    }
    let _alone = ONE_AT_A_TIME
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    let remotes = "--remote 0=7i77-io --remote 1=7i77-analog --remote 2=7i72";
    let mut expected = Expected::default();
    expect_7i77(&mut expected);
    expect_board(&mut expected);
    expect_7i97(&mut expected);
    let board = format!("--board 7i97 {remotes}");
    let mut machine = Machine::load("hm2_7i97.0", "7i97", &board, &expected);

    // LinuxCNC writes parameters to the remotes' non-volatile memory when it starts the port.
    machine.expect_board("0", "remote.0.parameter.nvencmode0", |mode| mode == 0.0);
    machine.set("7i77.0.0.nvencmode0", "1");
    machine.run();
    let (start, before) = (Instant::now(), machine.board.show("network"));
    machine.expect_board("0", "remote.0.parameter.nvencmode0", |mode| mode == 1.0);
    check_7i77(&mut machine);
    check_7i72(&mut machine);
    check_isolated_io(&mut machine);
    check_encoders(&mut machine);
    check_analog_outputs(&mut machine);
    check_run_and_stop(&mut machine);
    check_unplugging(&mut machine, 2);
    std::thread::sleep(Duration::from_secs(20).saturating_sub(start.elapsed()));
    let after = machine.board.show("network");
    assert_cycled(&before, &after, start.elapsed());
    assert_eq!(machine.get("io_error"), "FALSE");
    assert_eq!(machine.get("watchdog.has_bit"), "FALSE");
    println!("packet errors: {}", machine.get("packet-error-total"));
    let summary = machine.stop();
    // LinuxCNC lets the watchdog bite when it goes.
    assert_eq!(summary["remote.0.output-03"], "0");
    assert_eq!(summary["board.output-02"], "0");
}

fn expect_7i97(expected: &mut Expected) {
    expected.pins(
        "bit",
        "IN",
        numbered(48, |n| format!("7i72.0.2.output-{n:02}")),
    );
    expected.params(
        "bit",
        "RW",
        numbered(48, |n| format!("7i72.0.2.output-{n:02}-invert")),
    );
    expected.pins(
        "bit",
        "OUT",
        numbered(16, |n| format!("inmux.00.input-{n:02}")),
    );
    expected.pins(
        "bit",
        "OUT",
        numbered(16, |n| format!("inmux.00.input-{n:02}-not")),
    );
    expected.pins(
        "s32",
        "OUT",
        numbered(4, |n| format!("inmux.00.enc{n}-count")),
    );
    expected.pins("bit", "IN", numbered(6, |n| format!("ssr.00.out-{n:02}")));
    expected.pins(
        "float",
        "IN",
        numbered(6, |n| format!("pwmgen.{n:02}.value")),
    );
    expected.pins(
        "bit",
        "IN",
        numbered(6, |n| format!("pwmgen.{n:02}.enable")),
    );
    expected.pins("bit", "IN", numbered(4, |n| format!("led.CR{:02}", n + 1)));
    expected.pins("bit", "OUT", numbered(51, |n| format!("gpio.{n:03}.in")));
    expected.pins("float", "OUT", ["dpll.phase-error-us".to_owned()]);
}

fn check_7i72(machine: &mut Machine) {
    for n in [0, 17, 47] {
        machine.set(&format!("7i72.0.2.output-{n:02}"), "true");
    }
    for n in 0..48 {
        let on = [0, 17, 47].contains(&n);
        let name = format!("remote.2.output-{n:02}");
        machine.expect_board("2", &name, |value| value == f64::from(u8::from(on)));
    }
}

/// Isolated inputs through InMux, isolated outputs through SSR, an MPG on inputs 2 and 3, LEDs, and
/// a pin of P1 both ways.
fn check_isolated_io(machine: &mut Machine) {
    machine.set("ssr.00.out-02", "true");
    for n in 0..6 {
        let name = format!("board.output-{n:02}");
        machine.expect_board("board", &name, |on| on == f64::from(u8::from(n == 2)));
    }
    for n in [0, 9, 15] {
        let name = format!("inmux.00.input-{n:02}");
        machine.expect(&name, "FALSE");
        machine.board.run(&format!("input board {n} on"));
        machine.expect(&name, "TRUE");
        machine.expect(&format!("{name}-not"), "FALSE");
        machine.board.run(&format!("input board {n} off"));
    }
    machine.set("inmux.00.enc1_4xmode", "true");
    machine.set("inmux.00.enc1-reset", "true");
    machine.expect("inmux.00.enc1-count", "0");
    machine.set("inmux.00.enc1-reset", "false");
    // Two detents forwards, slowly enough for the input filter.
    for step in [
        "2 on", "3 on", "2 off", "3 off", "2 on", "3 on", "2 off", "3 off",
    ] {
        machine.board.run(&format!("input board {step}"));
        std::thread::sleep(Duration::from_millis(10));
    }
    machine.expect("inmux.00.enc1-count", "8");
    machine.set("led.CR02", "true");
    machine.expect_board("board", "board.led-1", |lit| lit == 1.0);
    machine.board.run("pin 50 low");
    machine.expect("gpio.050.in", "FALSE");
    machine.board.run("pin 50 free");
    machine.expect("gpio.050.in", "TRUE");
    machine.set("gpio.049.is_output", "true");
    machine.set("gpio.049.out", "false");
    machine.expect_board("board", "board.pin-049", |level| level == 0.0);
    machine.set("gpio.049.out", "true");
    machine.expect_board("board", "board.pin-049", |level| level == 1.0);
}

/// PWM in offset mode is volts on the 7I97's analog outputs, which turn motors.
fn check_analog_outputs(machine: &mut Machine) {
    for (n, volts) in ["2.5", "-2.5", "1", "-1", "9", "-9"]
        .into_iter()
        .enumerate()
    {
        machine.set(&format!("pwmgen.{n:02}.offset-mode"), "true");
        machine.set(&format!("pwmgen.{n:02}.scale"), "10");
        machine.set(&format!("pwmgen.{n:02}.value"), volts);
        machine.set(&format!("pwmgen.{n:02}.enable"), "true");
    }
    for (n, volts) in [2.5, -2.5, 1.0, -1.0, 9.0, -9.0].into_iter().enumerate() {
        let near = move |value: f64| (value - volts).abs() < 0.03;
        machine.expect_board("board", &format!("board.analogout{n}"), near);
        machine.expect_board("board", &format!("board.enable{n}"), |on| on == 1.0);
        // 100 units a second at 10 V.
        let name = format!("motor.{n}.velocity");
        let follows = move |velocity: f64| (velocity - 10.0 * volts).abs() < 0.5;
        machine.expect_board("motors", &name, follows);
    }
    let velocity = machine.number("encoder.00.velocity");
    assert!((velocity - 25.0).abs() < 2.0, "{velocity}");
    for n in 0..6 {
        machine.set(&format!("pwmgen.{n:02}.enable"), "false");
        machine.expect_board("board", &format!("board.enable{n}"), |on| on == 0.0);
        machine.expect_board("motors", &format!("motor.{n}.velocity"), |v| v.abs() < 0.01);
    }
}

#[test]
fn a_7i92_with_a_7i77_runs_at_1_khz() {
    if skipped() {
        return;
    }
    let _alone = ONE_AT_A_TIME
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    let mut expected = Expected::default();
    expect_7i77(&mut expected);
    expect_board(&mut expected);
    let board = "--board 7i92-7i77";
    let mut machine = Machine::load("hm2_7i92.0", "7i92-7i77", board, &expected);

    machine.run();
    let (start, before) = (Instant::now(), machine.board.show("network"));
    check_encoders(&mut machine);
    check_7i77(&mut machine);
    // Channel 0 of the analog outputs stands at 5 V: 50 units a second.
    machine.expect_board("motors", "motor.0.velocity", |v| (v - 50.0).abs() < 0.5);
    let velocity = machine.number("encoder.00.velocity");
    assert!((velocity - 50.0).abs() < 2.0, "{velocity}");
    check_run_and_stop(&mut machine);
    check_unplugging(&mut machine, 1);
    std::thread::sleep(Duration::from_secs(20).saturating_sub(start.elapsed()));
    let after = machine.board.show("network");
    assert_cycled(&before, &after, start.elapsed());
    assert_eq!(machine.get("io_error"), "FALSE");
    machine.stop();
}
