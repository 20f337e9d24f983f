//! A simulated board as a program of its own, for as long as a test needs it.

use std::{
    net::{Ipv4Addr, SocketAddrV4},
    process::{Command, ExitStatus, Stdio},
};

use super::{
    Process, Scratch,
    console::{Console, Values, values},
    mesa, wait_until,
};

/// A running board with its console.
pub struct Board {
    process: Process,
    pub console: Console,
    pub address: SocketAddrV4,
    /// What it keeps its state in.
    state: Option<Scratch>,
}

impl Board {
    /// Starts it at an address that no other test uses, and waits until it listens. Arguments that
    /// come later win: `--port 0` is a free port.
    pub fn start(address: Ipv4Addr, arguments: &[&str]) -> Self {
        let mut child = Command::new(mesa())
            .args(["sim", "--listen", &address.to_string()])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("mesa sim starts");
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let console = Console::new(input, output);
        let line = console.wait_for("listening on ");
        let address = line.rsplit(' ').next().expect("an address");
        let address = address.parse().expect("an address");
        console.wait_for("help");
        Self {
            process: Process::new(child),
            console,
            address,
            state: None,
        }
    }

    /// One that keeps its state in a file, for as long as it is there.
    pub fn start_from(state: Scratch, address: Ipv4Addr, arguments: &[&str]) -> Self {
        let keep = [arguments, &["--state", state.path()]].concat();
        let mut board = Self::start(address, &keep);
        board.state = Some(state);
        board
    }

    /// Packets that it has received.
    pub fn received(&mut self) -> u64 {
        let network = self.console.show("network");
        let packets = network["network.received.packets"].parse();
        packets.expect("it is a count")
    }

    /// Waits until it has received so many more packets: somebody is at work with it.
    pub fn wait_for_packets(&mut self, more: u64) {
        let before = self.received();
        wait_until(format_args!("{more} packets more"), || {
            self.received() >= before + more
        });
    }

    /// As a power cut does.
    pub fn kill(&mut self) {
        self.process.child().kill().expect("it runs");
        self.wait();
    }

    pub fn wait(&mut self) -> ExitStatus {
        self.process.child().wait().expect("it is a child")
    }

    /// Ends it by a signal, and returns its summary.
    pub fn stop(mut self, signal: &str) -> Values {
        self.process.signal(signal);
        let status = self.wait();
        assert!(status.success(), "{status}");
        self.console.wait_for("summary");
        values(self.console.answer().expect("a summary"))
    }
}
