//! `mesa completions` and `mesa man`: shell completions and manual pages.

use std::fs;
use std::path::PathBuf;

use clap::Args;
use clap_complete::Shell;

use crate::commands::completion;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::output::say;

/// Print the completions of a shell
///
/// The script asks `mesa` for the candidates: commands, options, files, the machines of `--sim`,
/// and the pins, terminals and signals of a simulated machine on the line. No board is asked.
#[derive(Debug, Args)]
#[command(after_help = "\
Print it again after an update of mesa.

Examples:
  mesa completions bash > ~/.local/share/bash-completion/completions/mesa
  mesa completions fish > ~/.config/fish/completions/mesa.fish")]
pub struct Completions {
    /// Shell to complete for
    #[arg(value_enum)]
    shell: Shell,
}

impl Completions {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let shell = self.shell.to_string();
        say(completion::script(&shell)
            .ok_or_else(|| Failure::refused("no script for this shell"))?);
        Ok(context.ending())
    }
}

/// Write manual pages: one for `mesa`, one for each command
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  mesa man ~/.local/share/man/man1 && man mesa-info")]
pub struct Man {
    /// Directory for the pages; made unless it exists
    #[arg(value_name = "DIRECTORY")]
    directory: PathBuf,
}

impl Man {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let made = fs::create_dir_all(&self.directory);
        let command_line = (context.command_line)();
        let written = made.and_then(|()| clap_mangen::generate_to(command_line, &self.directory));
        written.map_err(|error| {
            let (directory, advice) = (self.directory.display(), "name another directory");
            Failure::refused(format_args!("{directory}: {error}; {advice}")).advising(advice)
        })?;
        Ok(context.ending())
    }
}
