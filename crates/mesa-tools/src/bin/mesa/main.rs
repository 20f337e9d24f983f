//! `mesa`: one command for all tasks around a board.
//!
//! The work is done by libraries; this binary has the arguments, texts and screens.

mod commands;
mod consent;
mod context;
mod date;
mod files;
mod full_screen;
mod link;
mod modes;
mod number;
mod output;
mod pattern;
mod place;
mod running;
mod sim;
mod simulated;
mod target;

use std::io::{self, Write};
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};

use commands::Command;
use context::{Context, Ending};
use mesa_hal::runner::Stop;

/// Find, inspect, test, set up and simulate Mesa Electronics' motion I/O boards
#[derive(Debug, Parser)]
#[command(name = "mesa", version, propagate_version = true, after_help = AFTER_HELP)]
struct Cli {
    /// Print the result as JSON, for programs
    #[arg(long, global = true)]
    json: bool,
    /// Same as `--yes` of the commands that ask. May stand in front of any command; without effect
    /// on the others, whose help does not list it.
    #[arg(long, global = true, hide = true)]
    yes: bool,
    #[command(subcommand)]
    command: Command,
}

const AFTER_HELP: &str = "\
Commands for one board take --addr IP, or --sim 7i92-7i77 or --sim 7i97 to try them without a board:
  mesa info --sim 7i97

Without --addr and --sim, the address of the board is taken from MESA_ADDR. `list`, `sim`,
`completions` and `man` have no such board.

Exits with 0 if done, 1 if refused by the board or the machine, 2 for bad arguments, 130 after
SIGINT (Ctrl-C), 143 after SIGTERM, 129 after SIGHUP. Commands that drive a board end with its
outputs off and its ports stopped; values written by poke and raw remain.

Colours are for terminals only; NO_COLOR turns them off.";

/// Last paragraph of the help of each command.
const EXITS: &str = "\
Exits with 0 if done, 1 if refused by the board or the machine, 2 for bad arguments, 130 after
Ctrl-C.";

/// The command line, with the exit codes appended to the help of each command.
fn command_line() -> clap::Command {
    fn with_exits(command: clap::Command) -> clap::Command {
        let command = command.mut_subcommands(with_exits);
        if command.has_subcommands() {
            return command;
        }
        let help = command.get_after_help().map(ToString::to_string);
        command.after_help(format!("{}\n\n{EXITS}", help.unwrap_or_default()))
    }
    Cli::command().mut_subcommands(with_exits)
}

/// Prints the help, or the error in the arguments, and returns the exit code.
fn explain(error: &clap::Error) -> ExitCode {
    output::printed(error.print().and_then(|()| io::stdout().flush()));
    match error.use_stderr() {
        true => ExitCode::from(2),
        false if output::is_lost() => ExitCode::FAILURE,
        false => ExitCode::SUCCESS,
    }
}

fn main() -> ExitCode {
    let cli = command_line().try_get_matches();
    let cli = match cli.and_then(|mut found| Cli::from_arg_matches_mut(&mut found)) {
        Ok(cli) => cli,
        Err(error) => return explain(&error.format(&mut command_line())),
    };
    let stop = match Stop::on_signals() {
        Ok(stop) => stop,
        Err(error) => {
            output::complain(format_args!("mesa: signals cannot be caught: {error}"));
            return ExitCode::FAILURE;
        }
    };
    let context = Context {
        json: cli.json,
        stop,
    };
    match cli.command.run(&context) {
        Ok(Ending::Done) if !output::is_lost() => ExitCode::SUCCESS,
        Ok(Ending::Done | Ending::Refused) => ExitCode::FAILURE,
        Ok(Ending::Stopped(signal)) => signal.exit_code(),
        Err(failure) => {
            output::complain(format_args!("mesa: {failure}"));
            failure.exit_code()
        }
    }
}

#[cfg(test)]
mod tests;
