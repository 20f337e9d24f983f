//! Consent before an output is driven, a running machine is stopped, or a memory is written.

use std::fmt::{self, Display};
use std::io::{self, IsTerminal};
use std::net::SocketAddrV4;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use clap::Args;
use serde::Serialize;

use crate::context::{Context, Failure};
use crate::files;
use crate::output::complain;
use crate::target::{ChangedTarget, Found};

/// Interval of the checks for a signal while an answer is awaited.
const LOOK: Duration = Duration::from_millis(50);

/// Argument of a command that asks before it acts.
#[derive(Clone, Copy, Debug, Args)]
pub struct Asks {
    /// Do it without a question
    #[arg(long)]
    pub yes: bool,
}

/// Planned action of a command.
#[derive(Debug, Serialize)]
struct Planned<'a> {
    /// Always true: nothing was done.
    dry_run: bool,
    address: SocketAddrV4,
    would: &'a str,
}

impl Asks {
    /// Prints the planned action to standard error, and continues only with `--yes`, or after a
    /// person at a terminal has agreed. Because an answer takes time, an open board is then checked
    /// again, and left alone if another program drives it by now.
    pub fn consent(
        self,
        context: &Context,
        what: &str,
        board: Option<&Found>,
    ) -> Result<(), Failure> {
        self.agreed(context, &Question::before(what))?;
        board.map_or(Ok(()), Found::check_free)
    }

    fn agreed(self, context: &Context, question: &Question) -> Result<(), Failure> {
        let answer = if self.yes {
            complain(format_args!("mesa: {}", question.what));
            Ok(())
        } else {
            context.asked(question)
        };
        if let Some(signal) = context.stop.signal() {
            let message = format_args!("ended by {signal}; nothing was done");
            return Err(Failure::stopped(signal, message));
        }
        answer
    }

    /// Checks that a file [can be written](files::check) at `path`, and asks for consent if one
    /// exists there, before the work whose result the file takes.
    pub fn replaces(self, context: &Context, path: &Path) -> Result<(), Failure> {
        files::check(path)?;
        if path.exists() {
            self.replaces_all(context, &[path.to_owned()])?;
        }
        Ok(())
    }

    /// Asks for consent to replace files, which exist; nothing to ask if there are none.
    pub fn replaces_all(self, context: &Context, there: &[PathBuf]) -> Result<(), Failure> {
        if there.is_empty() {
            return Ok(());
        }
        self.agreed(context, &Question::of_files(there))
    }
}

/// A question, and the refusal where it cannot be asked.
struct Question {
    /// The facts.
    what: String,
    /// The question after the facts.
    prompt: &'static str,
    /// What follows the facts if there is no terminal.
    refusal: &'static str,
}

impl Question {
    /// Asks before an action.
    fn before(what: &str) -> Self {
        Self {
            what: what.to_owned(),
            prompt: ". Go on?",
            refusal: ": not a terminal, so nothing was done; add --yes to do it without a question",
        }
    }

    /// Asks before files are replaced.
    fn of_files(there: &[PathBuf]) -> Self {
        let names: Vec<_> = there
            .iter()
            .map(|path| path.display().to_string())
            .collect();
        let names = names.join(", ");
        if there.len() == 1 {
            return Self {
                what: format!("{names} already exists"),
                prompt: ". Replace it?",
                refusal: "; --yes replaces it",
            };
        }
        Self {
            what: format!("{names} already exist"),
            prompt: ". Replace them?",
            refusal: "; --yes replaces them",
        }
    }
}

impl Context {
    /// Asks for [consent](Asks::consent) to an action on a board. With `--dry-run` prints the
    /// action instead and returns `false`.
    pub fn agrees(
        &self,
        target: &ChangedTarget,
        found: &Found,
        what: &str,
    ) -> Result<bool, Failure> {
        let address = found.address;
        if !target.dry_run {
            let what = format!("{address}: {what}");
            target.asks.consent(self, &what, Some(found))?;
            return Ok(true);
        }
        self.print(&Planned {
            dry_run: true,
            address,
            would: what,
        })?;
        Ok(false)
    }

    fn asked(&self, question: &Question) -> Result<(), Failure> {
        let Question {
            what,
            prompt,
            refusal,
        } = question;
        if !io::stdin().is_terminal() {
            return Err(Failure::usage(format_args!("{what}{refusal}")));
        }
        complain(format_args!("mesa: {what}{prompt} [y/N]"));
        match self.answer()?.trim() {
            "y" | "Y" | "yes" => Ok(()),
            _ => Err(Failure::refused("nothing was done")),
        }
    }

    /// Reads a line of standard input; empty at its end, and after a signal.
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

impl Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { address, would, .. } = self;
        writeln!(f, "{address}: {would}; nothing was done")
    }
}
