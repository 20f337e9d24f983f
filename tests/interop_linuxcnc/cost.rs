//! What a cycle costs LinuxCNC and this crate on the same kind of board, at the same time.

use std::{fs, net::Ipv4Addr, path::PathBuf, process::Command, time::Duration};

use crate::interop::{board::Board, example_in};

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

/// The paces that are compared, and where their boards listen.
const PACES: [(&str, u8); 2] = [("board", 2), ("host", 3)];
/// Each is run so often: loops of the same rate meet in another phase each time.
const ROUNDS: usize = 3;

/// Runs the example `cycle_cost`, at the board's pace and at the host's, on boards of its own while
/// LinuxCNC is in its cycle: what it has printed, for each pace and round. It is built for speed,
/// as LinuxCNC is.
pub fn run_beside(board: &str) -> [Vec<String>; PACES.len()] {
    let program = example_in("release", "cycle_cost");
    let mut printed = [const { Vec::new() }; PACES.len()];
    for _ in 0..ROUNDS {
        for ((pace, host), all) in PACES.into_iter().zip(&mut printed) {
            all.push(run(board, host, pace, &program));
        }
    }
    printed
}

fn run(board: &str, host: u8, pace: &str, program: &PathBuf) -> String {
    let address = Ipv4Addr::new(127, 97, 0, host);
    let arguments: Vec<&str> = board.split(' ').collect();
    let board = Board::start(address, &arguments);
    let output = Command::new(program)
        .args([
            "--addr",
            &address.to_string(),
            "--pace",
            pace,
            "--seconds",
            "2",
        ])
        .output()
        .expect("cycle_cost starts");
    drop(board);
    assert!(output.status.success(), "cycle_cost: {}", output.status);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Prints what they have printed, and the ratios of the CPU times.
pub fn print(linuxcnc_per_cycle: Duration, ours: &[Vec<String>]) {
    let linuxcnc = linuxcnc_per_cycle.as_secs_f64() * 1e6;
    println!("a cycle of LinuxCNC's: {linuxcnc:.1} us CPU; of ours, at the same time:");
    for ((pace, _), printed) in PACES.into_iter().zip(ours) {
        let values = |what: &str| -> Vec<String> {
            let lines = printed.iter().flat_map(|text| text.lines());
            let values = lines.filter_map(|line| line.strip_prefix(what));
            values.map(|value| value.trim().to_owned()).collect()
        };
        let cpu = values("CPU per cycle:");
        let us = cpu.iter().map(|cpu| -> f64 {
            let number = cpu.trim_end_matches(" us");
            number.parse().expect("a number")
        });
        let mean = us.sum::<f64>() / cpu.len() as f64;
        println!(
            "paced by the {pace}: {mean:.1} us CPU ({}), {} packets out, bytes {}; {:.2} of LinuxCNC's",
            cpu.join(", "),
            values("packets out per cycle:").join(", "),
            values("bytes per cycle:")
                .first()
                .map_or("", String::as_str),
            mean / linuxcnc
        );
    }
}

/// The time a thread has run, from its `schedstat`.
fn cpu(path: &str) -> Duration {
    let text = fs::read_to_string(path).unwrap_or_default();
    let nanos = text.split(' ').next().and_then(|field| field.parse().ok());
    Duration::from_nanos(nanos.unwrap_or(0))
}
