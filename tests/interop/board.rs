//! A simulated board as a program of its own, for as long as a test needs it.

use std::{
    net::Ipv4Addr,
    process::{Child, Command, Stdio},
};

use crate::interop::{console::Console, sim_board};

/// A running board with its console.
pub struct Board {
    child: Child,
    pub console: Console,
}

impl Board {
    /// Starts it at an address that no other test uses, and waits until it listens.
    pub fn start(address: Ipv4Addr, arguments: &[&str]) -> Self {
        let mut child = Command::new(sim_board())
            .args(["--listen", &address.to_string()])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("sim_board starts");
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let console = Console::new(input, output);
        console.wait_for("help");
        Self { child, console }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
