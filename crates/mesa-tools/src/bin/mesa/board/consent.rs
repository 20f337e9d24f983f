//! Consent before an output is driven, a running machine is stopped, or a memory is written.

use std::fmt::Display;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use clap::Args;

use crate::board::target::Found;
use crate::ui::context::{Context, Failure};
use crate::ui::files;
use crate::ui::output::complain;

/// Interval of the checks for a signal while an answer is awaited.
const LOOK: Duration = Duration::from_millis(50);

/// Argument of a command that asks before it acts.
#[derive(Clone, Copy, Debug, Args)]
pub struct Asks {
    /// Do it without a question
    #[arg(long)]
    pub yes: bool,
}

/// Planned action of a command, in words that follow "would": `10.10.10.10:27181: would write ...`.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Board, remote or folder.
    place: Option<String>,
    /// Verb in the infinitive, and the rest.
    action: String,
}

impl Plan {
    pub fn new(action: impl Display) -> Self {
        Self {
            place: None,
            action: action.to_string(),
        }
    }

    pub fn at(place: impl Display, action: impl Display) -> Self {
        Self {
            place: Some(place.to_string()),
            ..Self::new(action)
        }
    }

    /// Text about the action, with a modal verb before it.
    fn sentence(&self, modal: &str) -> String {
        let action = &self.action;
        match &self.place {
            Some(place) => format!("{place}: {modal} {action}"),
            None => format!("{modal} {action}"),
        }
    }

    /// Text about the action that was not done, and the reason or the next step.
    fn not_done(&self, why: impl Display) -> String {
        format!("{}; nothing was done: {why}", self.sentence("would"))
    }
}

impl Asks {
    /// Prints the planned action to standard error, and continues only with `--yes`, or after a
    /// person at a terminal has agreed. Because an answer takes time, an open board is then checked
    /// again, and left alone if another program drives it by now.
    pub fn consent(
        self,
        context: &Context,
        plan: &Plan,
        board: Option<&Found>,
    ) -> Result<(), Failure> {
        let answer = if self.yes {
            complain(format_args!("mesa: {}", plan.sentence("will")));
            Ok(())
        } else {
            context.asked(plan)
        };
        if let Some(signal) = context.stop.signal() {
            let message = plan.not_done(format_args!("ended by {signal}"));
            return Err(Failure::stopped(signal, message));
        }
        answer?;
        board.map_or(Ok(()), Found::check_free)
    }

    /// As [`consent`](Self::consent), to a change of the board or its remotes that a signal does
    /// not interrupt from then on.
    pub fn consent_to_change(
        self,
        context: &Context,
        plan: &Plan,
        board: Option<&Found>,
    ) -> Result<(), Failure> {
        self.consent(context, plan, board)?;
        context.hurry.finish_first();
        Ok(())
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
        let exist = match there {
            [] => return Ok(()),
            [_] => "exists",
            _ => "exist",
        };
        let names = there.iter().map(|path| path.display().to_string());
        let names = names.collect::<Vec<_>>().join(", ");
        let plan = Plan::new(format_args!("replace {names}, which already {exist}"));
        self.consent(context, &plan, None)
    }
}

impl Context {
    fn asked(&self, plan: &Plan) -> Result<(), Failure> {
        if !io::stdin().is_terminal() {
            let advice = "add --yes";
            return Err(Failure::usage(plan.not_done(advice)).advising(advice));
        }
        complain(format_args!(
            "mesa: {}. Go on? [y/N]",
            plan.sentence("will")
        ));
        match self.answer()?.trim() {
            "y" | "Y" | "yes" => Ok(()),
            _ => Err(Failure::refused(plan.not_done("the answer was not y"))),
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
