//! A simulated board as a program of its own, for as long as a test needs it.

use std::{
    net::{Ipv4Addr, SocketAddrV4},
    process::{Command, ExitStatus, Stdio},
};

use super::{
    Process,
    console::{Console, Values, values},
    mesa,
};

/// A running board with its console.
pub struct Board {
    process: Process,
    pub console: Console,
    pub address: SocketAddrV4,
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
        }
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
