//! A simulated board as a separate process, for the duration of a test.

use std::{
    net::{Ipv4Addr, SocketAddrV4},
    process::{ExitStatus, Stdio},
};

use super::{
    Process, Scratch,
    console::{Console, Values, values},
    mesa, realtime, wait_until,
};

/// A running board with its console.
pub struct Board {
    process: Process,
    pub console: Console,
    pub address: SocketAddrV4,
    /// State file of the board.
    state: Option<Scratch>,
}

impl Board {
    /// Starts a board at an address that no other test uses, and waits until it listens. Later
    /// arguments take precedence: `--port 0` selects a free port.
    pub fn start(address: Ipv4Addr, arguments: &[&str]) -> Self {
        super::behind_the_feature();
        let mut child = realtime(mesa())
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

    /// Starts a board that keeps its state in a file, which is removed with the board.
    pub fn start_from(state: Scratch, address: Ipv4Addr, arguments: &[&str]) -> Self {
        let keep = [arguments, &["--state", state.path()]].concat();
        let mut board = Self::start(address, &keep);
        board.state = Some(state);
        board
    }

    /// Number of packets that the board has received.
    pub fn received(&mut self) -> u64 {
        let network = self.console.show("network");
        let packets = network["network.received.packets"].parse();
        packets.expect("it is a count")
    }

    /// Waits until the board has received `more` packets, as a sign that a client works with it.
    pub fn wait_for_packets(&mut self, more: u64) {
        let before = self.received();
        wait_until(format_args!("{more} packets more"), || {
            self.received() >= before + more
        });
    }

    /// Ends the board as a power cut does.
    pub fn kill(&mut self) {
        self.process.child().kill().expect("it runs");
        self.wait();
    }

    pub fn wait(&mut self) -> ExitStatus {
        self.process.child().wait().expect("it is a child")
    }

    /// Ends the board by a signal, and returns its summary.
    pub fn stop(mut self, signal: &str) -> Values {
        self.process.signal(signal);
        let status = self.wait();
        assert!(status.success(), "{status}");
        self.console.wait_for("summary");
        values(self.console.answer().expect("a summary"))
    }
}
