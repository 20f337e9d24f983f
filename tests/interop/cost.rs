//! What a cycle costs LinuxCNC and this crate on the same kind of board, at the same time.

use std::{
    fs,
    path::PathBuf,
    process::{Child, Command, Stdio},
    time::Duration,
};

use crate::interop::{console::Console, example_in, sim_board};

/// What LinuxCNC's realtime process has had of the CPUs so far.
pub fn linuxcnc_cpu() -> Duration {
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    let is_realtime = |directory: &fs::DirEntry| {
        let name = fs::read_to_string(directory.path().join("comm"));
        name.is_ok_and(|name| name.starts_with("rtapi_app"))
    };
    processes
        .filter(is_realtime)
        .flat_map(|process| fs::read_dir(process.path().join("task")))
        .flatten()
        .flatten()
        .map(|thread| cpu(&thread.path().join("schedstat").to_string_lossy()))
        .sum()
}

/// The example `cycle_cost` twice, at the host's pace and at the board's, each on a board of its own
/// while LinuxCNC is in its cycle. It is built for speed, as LinuxCNC is.
pub struct Beside {
    runs: Vec<Run>,
}

struct Run {
    pace: &'static str,
    board: Child,
    cost: Child,
}

impl Beside {
    /// Starts them.
    pub fn start(board: &str) -> Self {
        let program = example_in("release", "cycle_cost");
        let runs = [("board", 2), ("host", 3)];
        let runs = runs.map(|(pace, host)| Run::start(board, host, pace, &program));
        Self { runs: runs.into() }
    }

    /// Waits for their end.
    pub fn finish(self) -> Vec<(&'static str, String)> {
        let runs = self.runs.into_iter();
        runs.map(|run| (run.pace, run.finish())).collect()
    }
}

impl Run {
    fn start(board: &str, host: u8, pace: &'static str, program: &PathBuf) -> Self {
        let address = format!("127.97.0.{host}");
        let mut board = Command::new(sim_board())
            .args(board.split(' '))
            .args(["--listen", &address])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("sim_board starts");
        let (input, output) = (board.stdin.take().unwrap(), board.stdout.take().unwrap());
        Console::new(input, output).wait_for("help");
        let cost = Command::new(program)
            .args(["--addr", &address, "--pace", pace, "--seconds", "6"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("cycle_cost starts");
        Self { pace, board, cost }
    }

    fn finish(mut self) -> String {
        let output = self.cost.wait_with_output().expect("cycle_cost ends");
        let _ = self.board.kill();
        let _ = self.board.wait();
        assert!(output.status.success(), "cycle_cost: {}", output.status);
        String::from_utf8_lossy(&output.stdout).into_owned()
    }
}

/// Prints what they have printed, and the ratios of the CPU times.
pub fn print(linuxcnc_per_cycle: Duration, ours: &[(&'static str, String)]) {
    let linuxcnc = linuxcnc_per_cycle.as_secs_f64() * 1e6;
    println!("a cycle of LinuxCNC's: {linuxcnc:.1} us CPU; of ours, at the same time:");
    for (pace, printed) in ours {
        let value = |what: &str| {
            let line = printed.lines().find_map(|line| line.strip_prefix(what));
            line.expect("it prints that").trim().to_owned()
        };
        let cpu = value("CPU per cycle:");
        let us: f64 = cpu.trim_end_matches(" us").parse().expect("a number");
        println!(
            "paced by the {pace}: {cpu} CPU, {} packets out, bytes {}; {:.2} of LinuxCNC's",
            value("packets out per cycle:"),
            value("bytes per cycle:"),
            us / linuxcnc
        );
    }
}

/// The time a thread has run, from its `schedstat`.
fn cpu(path: &str) -> Duration {
    let text = fs::read_to_string(path).unwrap_or_default();
    let nanos = text.split(' ').next().and_then(|field| field.parse().ok());
    Duration::from_nanos(nanos.unwrap_or(0))
}
