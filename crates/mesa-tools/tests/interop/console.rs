//! Commands to a simulated board, and its answers.

use std::{
    collections::BTreeMap,
    io::{Read, Write},
    sync::mpsc::Receiver,
};

use super::{PATIENCE, halcmd::lines_of};

/// Values that `show` printed, by name.
pub type Values = BTreeMap<String, String>;

/// The console of a running board.
pub struct Console {
    input: Box<dyn Write + Send>,
    lines: Receiver<String>,
}

impl Console {
    /// Creates a console from the board's input and output.
    pub fn new(input: impl Write + Send + 'static, output: impl Read + Send + 'static) -> Self {
        Self {
            input: Box::new(input),
            lines: lines_of(output),
        }
    }

    /// The next line that the board prints.
    pub fn line(&self) -> String {
        let line = self.lines.recv_timeout(PATIENCE);
        line.expect("the simulated board prints something")
    }

    /// Waits for a line that contains `text`.
    pub fn wait_for(&self, text: &str) -> String {
        let mut heard = Vec::new();
        loop {
            match self.lines.recv_timeout(PATIENCE) {
                Ok(line) if line.contains(text) => return line,
                Ok(line) => heard.push(line),
                Err(error) => panic!("{error}: no line with {text:?} after {heard:#?}"),
            }
        }
    }

    /// Executes a command and returns the lines of the answer, or the reason for a refusal.
    pub fn command(&mut self, command: &str) -> Result<Vec<String>, String> {
        self.raw(command.as_bytes());
        self.raw(b"\n");
        self.answer()
    }

    /// Sends arbitrary bytes.
    pub fn raw(&mut self, bytes: &[u8]) {
        let sent = self
            .input
            .write_all(bytes)
            .and_then(|()| self.input.flush());
        sent.expect("the simulated board runs");
    }

    /// The lines up to the end of an answer, or the reason for a refusal.
    pub fn answer(&self) -> Result<Vec<String>, String> {
        let mut answer = Vec::new();
        loop {
            let line = self.line();
            if line == "ok" {
                return Ok(answer);
            }
            if let Some(reason) = line.strip_prefix("error: ") {
                return Err(reason.to_owned());
            }
            answer.push(line);
        }
    }

    /// Executes a command that must be accepted.
    pub fn run(&mut self, command: &str) {
        if let Err(reason) = self.command(command) {
            panic!("`{command}`: {reason}");
        }
    }

    /// Returns the values that `show` prints for `what`.
    pub fn show(&mut self, what: &str) -> Values {
        let lines = self.command(&format!("show {what}")).expect("show works");
        values(lines)
    }
}

/// Lines of the form `name value`.
pub fn values(lines: impl IntoIterator<Item = String>) -> Values {
    let pair = |line: String| {
        let (name, value) = line.split_once(' ')?;
        Some((name.to_owned(), value.to_owned()))
    };
    lines.into_iter().filter_map(pair).collect()
}
