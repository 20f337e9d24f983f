//! What is asked before an output is driven, a running machine is stopped, or a memory is written.

use std::fmt::{self, Display};
use std::io::{self, IsTerminal};
use std::net::SocketAddrV4;
use std::path::Path;
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use clap::Args;
use serde::Serialize;

use crate::context::{Context, Failure};
use crate::files;
use crate::output::complain;
use crate::target::{ChangedTarget, Found};

/// How often a person who is asked may have pressed Ctrl-C instead.
const LOOK: Duration = Duration::from_millis(50);

/// Of a command that asks before it does something.
#[derive(Clone, Copy, Debug, Args)]
pub struct Asks {
    /// Do it without asking
    #[arg(long)]
    pub yes: bool,
}

/// What a command would do.
#[derive(Debug, Serialize)]
struct Planned<'a> {
    /// Nothing was done.
    dry_run: bool,
    address: SocketAddrV4,
    would: &'a str,
}

impl Asks {
    /// Prints on standard error what is about to be done, and goes on only with `--yes`, or if a
    /// person at a terminal agrees, who may have taken his time: a board that is open is looked at
    /// again, and left alone if somebody else drives it by now.
    pub fn consent(
        self,
        context: &Context,
        what: &str,
        board: Option<&Found>,
    ) -> Result<(), Failure> {
        let answer = if self.yes {
            complain(format_args!("mesa: {what}"));
            Ok(())
        } else {
            context.asked(what)
        };
        if let Some(signal) = context.stop.signal() {
            let message = format_args!("ended by {signal}; nothing was done");
            return Err(Failure::stopped(signal, message));
        }
        answer?;
        board.map_or(Ok(()), Found::check_free)
    }

    /// Whether a file [can be written](files::check) there, and may take the place of one that is
    /// there: known before anything is done for what it shall have.
    pub fn replaces(self, context: &Context, path: &Path) -> Result<(), Failure> {
        files::check(path)?;
        if !path.exists() {
            return Ok(());
        }
        let path = path.display();
        self.consent(
            context,
            &format!("{path} is there already: it is replaced"),
            None,
        )
    }
}

impl Context {
    /// Whether to do to a board what was asked for: with `--dry-run` it is printed instead, and
    /// otherwise it needs [consent](Asks::consent).
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

    fn asked(&self, what: &str) -> Result<(), Failure> {
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

impl Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { address, would, .. } = self;
        writeln!(f, "{address}: {would}; nothing was done")
    }
}
