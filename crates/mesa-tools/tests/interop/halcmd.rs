//! LinuxCNC's `halcmd` with a simulated board in a private network: `examples/linuxcnc.sh` with the
//! client `session.sh`. Tests of other packages include this file, with `tools.rs` beside it.

use std::{
    fs::{self, File, OpenOptions},
    io::{BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, Command, Stdio},
    sync::{
        Mutex, MutexGuard, PoisonError,
        mpsc::{Receiver, channel},
    },
    time::{Duration, Instant},
};

use super::tools::{LINUXCNC_NICE, has_program, skip};

/// Time limit of a command of LinuxCNC, and of its end.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Number of attempts to load hm2_eth: its initialisation never retries, and a single late reply
/// makes it fail (FACTS 10.3).
pub const LOADS: usize = 12;

/// Ensures that only one LinuxCNC runs at a time: the computer has few cores, and each LinuxCNC
/// needs its 1 kHz.
pub fn alone() -> MutexGuard<'static, ()> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// True, with the reason printed, if a test with LinuxCNC cannot run here.
pub fn skipped() -> bool {
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

/// The pipes of the board's console.
struct BoardPipes([PathBuf; 2]);

impl BoardPipes {
    fn new(folder: &Path) -> Self {
        Self(["to-board", "from-board"].map(|name| {
            let path = folder.join(format!("{}-{name}", std::process::id()));
            let _ = fs::remove_file(&path);
            let made = Command::new("mkfifo").arg(&path).status();
            assert!(made.expect("mkfifo runs").success());
            path
        }))
    }

    /// Both ends of each, so that neither side waits for the other.
    fn open(&self) -> [File; 2] {
        [&self.0[0], &self.0[1]].map(|path| {
            let file = OpenOptions::new().read(true).write(true).open(path);
            file.expect("the pipe opens")
        })
    }
}

impl Drop for BoardPipes {
    fn drop(&mut self) {
        for pipe in &self.0 {
            let _ = fs::remove_file(pipe);
        }
    }
}

/// The lines of an output, which can be waited for with a time limit.
pub fn lines_of(output: impl Read + Send + 'static) -> Receiver<String> {
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

/// A running LinuxCNC.
pub struct Halcmd {
    sandbox: Child,
    commands: Option<ChildStdin>,
    lines: Receiver<String>,
    /// `hm2_7i97.0`
    pub prefix: &'static str,
    /// All messages of LinuxCNC so far.
    pub messages: Vec<String>,
    _pipes: BoardPipes,
}

/// A running LinuxCNC, and the console of its board.
pub struct Started {
    pub halcmd: Halcmd,
    pub to_board: File,
    pub from_board: File,
}

impl Halcmd {
    /// Starts `sandbox`, which is `examples/linuxcnc.sh` with its arguments. `folder` is for pipes.
    pub fn start(prefix: &'static str, mut sandbox: Command, folder: &Path) -> Started {
        let pipes = BoardPipes::new(folder);
        let [to_board, from_board] = pipes.open();
        let mut sandbox = sandbox
            .env("BOARD_IN", &pipes.0[0])
            .env("BOARD_OUT", &pipes.0[1])
            .env(LINUXCNC_NICE.0, LINUXCNC_NICE.1)
            // What the watchdogs do, a test sees before it ends LinuxCNC.
            .env("BOARD_LINGER", "0")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the sandbox starts");
        let halcmd = Self {
            commands: sandbox.stdin.take(),
            lines: lines_of(sandbox.stdout.take().expect("a pipe")),
            sandbox,
            prefix,
            messages: Vec::new(),
            _pipes: pipes,
        };
        Started {
            halcmd,
            to_board,
            from_board,
        }
    }

    /// Executes a command; names that begin with `.` get the board's prefix. Messages of LinuxCNC
    /// begin with `! `.
    pub fn try_hal(&mut self, command: &str) -> Result<Vec<String>, Vec<String>> {
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
            self.messages
                .extend(line.strip_prefix("! ").map(str::to_owned));
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
        self.value(&format!("getp .{name}"))
    }

    pub fn number(&mut self, name: &str) -> f64 {
        let value = self.get(name);
        value.parse().unwrap_or_else(|_| panic!("{name} = {value}"))
    }

    /// The only value that a command prints.
    pub fn value(&mut self, command: &str) -> String {
        let answer = self.hal(command);
        let values: Vec<_> = answer
            .iter()
            .filter(|line| !line.starts_with('!'))
            .collect();
        assert_eq!(values.len(), 1, "{command}: {answer:?}");
        values[0].trim().to_owned()
    }

    /// The words of each pin or parameter of the board (`pin` or `param`), by its name without the
    /// prefix: owner, type, direction, value.
    pub fn show(&mut self, what: &str) -> Vec<(String, [String; 4])> {
        let prefix = format!("{}.", self.prefix);
        let lines = self.hal(&format!("show {what}"));
        let parsed = lines.iter().filter_map(|line| {
            let words: Vec<_> = line.split_whitespace().collect();
            let [owner, kind, direction, value, ..] = words[..] else {
                return None;
            };
            let name = words.iter().find_map(|word| word.strip_prefix(&prefix))?;
            let words = [owner, kind, direction, value].map(str::to_owned);
            Some((name.to_owned(), words))
        });
        parsed.collect()
    }

    /// A command that runs a program in the network of LinuxCNC, as another program on that PC.
    pub fn beside(&self, program: &Path) -> Command {
        let mut command = Command::new("nsenter");
        let target = self.sandbox.id().to_string();
        command.args(["--target", &target, "--net"]).arg(program);
        command
    }

    /// Ends LinuxCNC and its board.
    pub fn end(&mut self) {
        self.commands = None;
        let end = Instant::now() + PATIENCE;
        while matches!(self.sandbox.try_wait(), Ok(None)) {
            assert!(Instant::now() < end, "the sandbox ends");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Halcmd {
    fn drop(&mut self) {
        self.commands = None;
        let end = Instant::now() + Duration::from_secs(10);
        while Instant::now() < end && matches!(self.sandbox.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.sandbox.kill();
        let _ = self.sandbox.wait();
    }
}
