//! LinuxCNC's HAL with a simulated board in a private network: `examples/linuxcnc.sh`.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time limit of a command.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time limit for a change on one side to arrive at the other on a busy computer.
pub const SETTLE: Duration = Duration::from_secs(20);
/// Attempts to load hm2_eth, whose load fails if one reply is late.
const LOADS: usize = 12;

/// The words of an existing line.
pub const WORDS: &str = "board_ip=10.97.0.2 config=\"num_encoders=6 num_pwmgens=6 num_stepgens=0 sserial_port_0=000xxxxx\"";
pub const PREFIX: &str = "hm2_7i97.0";

/// Type, direction and value of each name.
pub type List = BTreeMap<String, [String; 3]>;

/// LinuxCNC, with a board.
pub struct Session {
    sandbox: Child,
    commands: Option<ChildStdin>,
    lines: Receiver<String>,
    to_board: File,
    of_board: Receiver<String>,
    pipes: [PathBuf; 2],
}

/// One LinuxCNC at a time.
pub fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// True, with the reason printed, if the test cannot run here. In CI nothing may be missing.
pub fn is_skipped() -> bool {
    let Some(why) = missing() else {
        return false;
    };
    let why = format!(
        "{why}; needed: root, and apt-get install linuxcnc-uspace iproute2 iptables util-linux"
    );
    assert!(
        std::env::var_os("CI").is_none_or(|ci| ci != "true"),
        "missing in CI: {why}"
    );
    println!("SKIPPED: {why}");
    true
}

fn missing() -> Option<String> {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<_> = std::env::split_paths(&paths)
        .chain(["/usr/sbin", "/sbin"].map(PathBuf::from))
        .collect();
    for program in ["halrun", "unshare", "nsenter", "ip", "iptables", "mkfifo"] {
        if !folders.iter().any(|folder| folder.join(program).is_file()) {
            return Some(format!("`{program}` is not installed"));
        }
    }
    let allowed = Command::new("unshare")
        .args(["--net", "--ipc", "--mount", "--pid", "--fork", "true"])
        .stderr(Stdio::null())
        .status();
    let is_allowed = allowed.is_ok_and(|status| status.success());
    (!is_allowed).then(|| "no right to make a private network".to_owned())
}

/// A program of this package that `cargo test` builds beside the test.
fn built(name: &str) -> PathBuf {
    let program = std::env::current_exe().expect("a program");
    let path = program.parent().expect("a folder").join(name);
    assert!(
        path.exists(),
        "{} is not built: cargo test -p mesa-linuxcnc builds it",
        path.display()
    );
    path
}

fn both_ends(pipe: &Path) -> File {
    let file = OpenOptions::new().read(true).write(true).open(pipe);
    file.expect("the pipe opens")
}

fn lines_of(output: impl std::io::Read + Send + 'static) -> Receiver<String> {
    let (sender, lines) = channel();
    std::thread::spawn(move || {
        for line in BufReader::new(output).lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    lines
}

impl Session {
    pub fn start() -> Self {
        let pipes = ["to-board", "from-board"].map(|name| {
            let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
            let path = folder.join(format!("{}-{name}", std::process::id()));
            let _ = fs::remove_file(&path);
            let made = Command::new("mkfifo").arg(&path).status();
            assert!(made.expect("mkfifo runs").success());
            path
        });
        let [to_board, from_board] = [&pipes[0], &pipes[1]].map(|path| both_ends(path));
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        let tools = package.join("../mesa-tools/tests/mesa/interop_linuxcnc");
        let mut sandbox = Command::new(package.join("../../examples/linuxcnc.sh"))
            .args(["--board", "7i97", "--"])
            .arg(package.join("tests/linuxcnc/with_component.sh"))
            .arg(built("libmesa_eth.so"))
            .arg(tools.join("session.sh"))
            .env("MESA", built("../examples/simulated_board"))
            .env("BOARD_IN", &pipes[0])
            .env("BOARD_OUT", &pipes[1])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .expect("the sandbox starts");
        let session = Self {
            commands: sandbox.stdin.take(),
            lines: lines_of(sandbox.stdout.take().expect("a pipe")),
            sandbox,
            to_board,
            of_board: lines_of(from_board),
            pipes,
        };
        assert_eq!(session.board_line(), "ready");
        session
    }

    fn board_line(&self) -> String {
        let line = self.of_board.recv_timeout(PATIENCE);
        line.expect("the board answers")
    }

    /// A command for the board.
    pub fn board(&mut self, command: &str) -> String {
        writeln!(self.to_board, "{command}").expect("the board runs");
        self.board_line()
    }

    pub fn outputs(&mut self) -> String {
        self.board("outputs")
    }

    /// A command of halcmd; its messages begin with `! `.
    pub fn try_hal(&mut self, command: &str) -> Result<Vec<String>, Vec<String>> {
        let command = command.replace(" .", &format!(" {PREFIX}."));
        let commands = self.commands.as_mut().expect("not stopped");
        if writeln!(commands, "{command}").is_err() {
            return Err(vec!["LinuxCNC is gone".into()]);
        }
        let mut answer = Vec::new();
        let end = Instant::now() + PATIENCE;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let Ok(line) = self.lines.recv_timeout(left) else {
                answer.push("no answer".into());
                return Err(answer);
            };
            match line.strip_prefix("= ") {
                Some("0") => return Ok(answer),
                Some(_) => return Err(answer),
                None => answer.push(line),
            }
        }
    }

    pub fn hal(&mut self, command: &str) -> Vec<String> {
        match self.try_hal(command) {
            Ok(answer) => answer,
            Err(answer) => panic!("halcmd {command}: {answer:?}"),
        }
    }

    pub fn set(&mut self, name: &str, value: &str) {
        self.hal(&format!("setp .{name} {value}"));
    }

    pub fn get(&mut self, name: &str) -> String {
        let answer = self.hal(&format!("getp .{name}"));
        let values: Vec<_> = answer
            .iter()
            .filter(|line| !line.starts_with('!'))
            .collect();
        assert_eq!(values.len(), 1, "{name}: {answer:?}");
        values[0].trim().to_owned()
    }

    pub fn expect(&mut self, name: &str, value: &str) {
        self.until(name, |session| session.get(name) == value);
    }

    pub fn expect_outputs(&mut self, outputs: [bool; 3]) {
        let outputs = format!("{outputs:?}");
        self.until(&outputs, |session| session.outputs() == outputs);
    }

    fn until(&mut self, what: &str, is_so: impl Fn(&mut Self) -> bool) {
        let start = Instant::now();
        while !is_so(self) {
            let in_time = start.elapsed() < SETTLE;
            assert!(in_time, "never: {what}; outputs: {}", self.outputs());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Type, direction and value of all pins and parameters of the board.
    pub fn list(&mut self) -> List {
        let mut list = List::new();
        for what in ["pin", "param"] {
            for line in self.hal(&format!("show {what} {PREFIX}")) {
                let words: Vec<_> = line.split_whitespace().collect();
                let [_, kind, direction, value, name, ..] = words[..] else {
                    continue;
                };
                let Some(name) = name.strip_prefix(&format!("{PREFIX}.")) else {
                    continue;
                };
                let entry = [kind, direction, value].map(str::to_owned);
                list.insert(name.to_owned(), entry);
            }
        }
        list
    }

    /// Loads a driver, with retries where it never retries itself.
    pub fn load(driver: &str) -> Self {
        let mut messages = Vec::new();
        let attempts = if driver == "hm2_eth" { LOADS } else { 1 };
        for attempt in 1..=attempts {
            let mut session = Self::start();
            session.hal("loadrt hostmot2");
            match session.try_hal(&format!("loadrt {driver} {WORDS}")) {
                // A packet that comes late can leave a remote out.
                Ok(_) if session.list().contains_key("7i72.0.2.output-47") => {
                    println!("{driver} loaded at attempt {attempt}");
                    return session;
                }
                Ok(answer) | Err(answer) => messages = answer,
            }
            println!("{driver}, attempt {attempt}: {messages:?}");
            session.stop();
        }
        panic!("{driver} does not load: {messages:?}");
    }

    /// Starts a thread of 1 kHz, with patience for a busy computer.
    pub fn run(&mut self) {
        self.hal("loadrt threads name1=servo period1=1000000");
        self.set("packet-error-limit", "100000");
        self.set("watchdog.timeout_ns", "1000000000");
        self.hal("addf .read servo");
        self.hal("addf .write servo");
        self.hal("start");
    }

    /// Outputs 3 of the 7I77, 17 of the 7I72, and 2 of the board are on.
    pub fn switch_on(&mut self) {
        self.set("7i77.0.0.output-03", "TRUE");
        self.set("7i72.0.2.output-17", "TRUE");
        self.set("ssr.00.out-02", "TRUE");
        self.expect_outputs([true; 3]);
    }

    pub fn stop(mut self) {
        self.end();
    }

    fn end(&mut self) {
        self.commands = None;
        let end = Instant::now() + PATIENCE;
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

impl Drop for Session {
    fn drop(&mut self) {
        self.end();
    }
}
