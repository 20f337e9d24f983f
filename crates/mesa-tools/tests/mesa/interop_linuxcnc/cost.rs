//! CPU time of a cycle for LinuxCNC and for `mesa-hal`, on the same kind of board at the same time.

use std::{fs, net::Ipv4Addr, path::Path, process::Command, time::Duration};

use crate::interop::{board::Board, mesa};

/// CPU time used so far by LinuxCNC's realtime process.
fn linuxcnc_cpu() -> Duration {
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

/// The compared paces, and the last part of their boards' addresses.
const PACES: [(&str, u8); 2] = [("board", 2), ("host", 3)];
/// Number of runs for each pace: loops of the same rate meet in another phase each time.
const ROUNDS: usize = 5;
/// Duration of each run, without its start.
const SECONDS: &str = "0.4";

/// CPU time of a cycle at one pace, and of one of LinuxCNC's at the same time.
#[derive(Debug, Default)]
pub struct Beside {
    /// Microseconds of CPU, of `mesa-hal` and of LinuxCNC, in each round.
    pairs: Vec<[f64; 2]>,
    packets: String,
    bytes: String,
}

/// Runs `mesa latency` on boards of its own while LinuxCNC is in its cycle, alternately at the
/// board's pace and at the host's. With optimised tests it is optimised as LinuxCNC is.
///
/// `cycles` returns the number of cycles that LinuxCNC's board has seen so far.
pub fn run_beside(board: &str, mut cycles: impl FnMut() -> f64) -> [Beside; PACES.len()] {
    let program = mesa();
    let mut all = [const { Vec::new() }; PACES.len()].map(|pairs| Beside {
        pairs,
        ..Beside::default()
    });
    for _ in 0..ROUNDS {
        for ((pace, host), beside) in PACES.into_iter().zip(&mut all) {
            let (begin, cpu) = (cycles(), linuxcnc_cpu());
            let text = run(board, host, pace, program);
            let spent = linuxcnc_cpu().saturating_sub(cpu).as_secs_f64() * 1e6;
            let theirs = spent / (cycles() - begin).max(1.0);
            let ours = value(&text, "CPU per cycle:").trim_end_matches(" us");
            let ours = ours.parse().expect("a number");
            beside.pairs.push([ours, theirs]);
            value(&text, "packets out per cycle:").clone_into(&mut beside.packets);
            value(&text, "bytes per cycle:").clone_into(&mut beside.bytes);
        }
    }
    all
}

fn value<'a>(text: &'a str, what: &str) -> &'a str {
    let mut lines = text.lines();
    let value = lines.find_map(|line| line.strip_prefix(what));
    value.expect("mesa latency prints it").trim()
}

fn run(board: &str, host: u8, pace: &str, program: &Path) -> String {
    let address = Ipv4Addr::new(127, 97, 0, host);
    let arguments: Vec<&str> = board.split(' ').collect();
    let board = Board::start(address, &arguments);
    let output = Command::new(program)
        .args([
            "latency",
            "--addr",
            &address.to_string(),
            "--pace",
            pace,
            "--seconds",
            SECONDS,
        ])
        .output()
        .expect("mesa starts");
    drop(board);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "mesa latency: {}: {error}",
        output.status
    );
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Prints the medians, and the ratio of each pair.
pub fn print(beside: &[Beside]) {
    println!("CPU of a cycle beside one of LinuxCNC's at the same time, medians of {ROUNDS}:");
    for ((pace, _), beside) in PACES.into_iter().zip(beside) {
        let ours = median(beside.pairs.iter().map(|[ours, _]| *ours));
        let theirs = median(beside.pairs.iter().map(|[_, theirs]| *theirs));
        let ratios: Vec<f64> = beside.pairs.iter().map(|[o, t]| o / t).collect();
        println!(
            "paced by the {pace}: {:.2} of LinuxCNC's ({ratios:.2?}); {ours:.1} us, LinuxCNC {theirs:.1} us; \
             {} packets out, bytes {}",
            median(ratios.iter().copied()),
            beside.packets,
            beside.bytes,
        );
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The time a thread has run, from its `schedstat`.
fn cpu(path: &str) -> Duration {
    let text = fs::read_to_string(path).unwrap_or_default();
    let nanos = text.split(' ').next().and_then(|field| field.parse().ok());
    Duration::from_nanos(nanos.unwrap_or(0))
}
