//! The cost of `mesa watch --passive` for the driver that runs in LinuxCNC. Tests of other packages
//! include this file, with `halcmd.rs` beside it.

use std::{
    io::Read,
    path::Path,
    process::{Child, Command, Stdio},
    time::Duration,
};

use super::halcmd::{Halcmd, lines_of};

/// Pairs of times with and without a look in which the driver's packet errors are compared.
const PAIRS: usize = 7;

/// Each of these times, and the packets of a look in it: one in 50 ms.
const PHASE: Duration = Duration::from_millis(400);
const LOOKS: f64 = 8.0;

/// Comparisons: another load of the computer can spoil one.
const ATTEMPTS: usize = 4;

/// LinuxCNC loses no more packets in the times of a look than in those between. A look that cost a
/// cycle for each of its packets would fail. The look is one process, which is stopped in between,
/// because the start of a process costs more than its packets.
pub fn compare_errors(linuxcnc: &mut Halcmd, mesa: &Path) {
    let mut look = Look::start(linuxcnc, mesa, Stdio::piped());
    let lines = lines_of(look.output());
    let mut all = Vec::new();
    for _ in 0..ATTEMPTS {
        let mut more: Vec<f64> = (0..PAIRS)
            .map(|_| errors_more(linuxcnc, &mut look))
            .collect();
        more.sort_by(f64::total_cmp);
        println!("packet errors more beside {LOOKS} packets of a look: {more:?}");
        // Without the least and the largest, which another process has caused.
        let middle = more.get(1..PAIRS - 1).expect("several").iter();
        if middle.sum::<f64>() < LOOKS * (PAIRS - 2) as f64 / 2.0 {
            let lines = lines.try_iter().count();
            assert!(lines as f64 > LOOKS * PAIRS as f64 / 2.0, "{lines} looks");
            return;
        }
        all.push(more);
    }
    panic!("LinuxCNC loses packets beside a look: {all:?}");
}

/// Packet errors during a look, less those of the same time without it.
fn errors_more(linuxcnc: &mut Halcmd, look: &mut Look) -> f64 {
    let mut errors = |is_looking| {
        look.send(if is_looking { "CONT" } else { "STOP" });
        let before = linuxcnc.number("packet-error-total");
        std::thread::sleep(PHASE);
        linuxcnc.number("packet-error-total") - before
    };
    errors(true) - errors(false)
}

/// A look that is repeated until it is dropped.
pub struct Look(Child);

impl Look {
    /// Starts `mesa watch --passive`, which sends a packet every 50 ms.
    pub fn start(linuxcnc: &Halcmd, mesa: &Path, output: Stdio) -> Self {
        let mut command = linuxcnc.beside(mesa);
        command
            .args(["watch", "--passive", "--json", "--every", "50ms"])
            .args(["encoder.00", "--addr", "10.97.0.2"])
            .stdout(output);
        Self(command.spawn().expect("mesa starts"))
    }

    fn output(&mut self) -> impl Read + Send + use<> {
        self.0.stdout.take().expect("a pipe")
    }

    fn send(&mut self, signal: &str) {
        let mut kill = Command::new("kill");
        let sent = kill.args([&format!("-{signal}"), &self.0.id().to_string()]);
        assert!(sent.status().expect("kill runs").success());
    }
}

impl Drop for Look {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
