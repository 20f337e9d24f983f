//! What is asked before an output is driven, a running machine is stopped, or a memory is written.

use std::io::{self, IsTerminal};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use crate::context::{Context, Failure};
use crate::output::complain;

/// How often a person who is asked may have pressed Ctrl-C instead.
const LOOK: Duration = Duration::from_millis(50);

impl Context {
    /// Prints on standard error what is about to be done, and goes on only with `--yes`, or if a
    /// person at a terminal agrees.
    pub fn consent(&self, what: &str) -> Result<(), Failure> {
        let answer = self.asked(what);
        match self.stop.signal() {
            Some(signal) => {
                let message = format_args!("ended by {signal}; nothing was done");
                Err(Failure::stopped(signal, message))
            }
            None => answer,
        }
    }

    fn asked(&self, what: &str) -> Result<(), Failure> {
        if self.yes {
            complain(format_args!("mesa: {what}"));
            return Ok(());
        }
        if !io::stdin().is_terminal() {
            let how = "nobody can be asked; give --yes if that is meant";
            return Err(Failure::usage(format_args!("{what}: {how}")));
        }
        complain(format_args!("mesa: {what}. Go on? [y/N]"));
        match self.answer()?.trim() {
            "y" | "Y" | "yes" => Ok(()),
            _ => Err(Failure::refused("nothing was done")),
        }
    }

    /// A line of standard input; empty after its end, and after a signal.
    fn answer(&self) -> io::Result<String> {
        let (sender, line) = sync_channel(1);
        std::thread::spawn(move || {
            let mut line = String::new();
            let read = io::stdin().read_line(&mut line);
            sender.send(read.map(|_| line))
        });
        while self.stop.signal().is_none() {
            match line.recv_timeout(LOOK) {
                Ok(line) => return line,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(String::new())
    }
}
