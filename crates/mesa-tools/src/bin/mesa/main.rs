//! `mesa`: one command for everyone who owns a board.
//!
//! What it does is calls of the library; here are arguments, words and screens.

mod cabinet;
mod commands;
mod consent;
mod context;
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
mod words;

use std::io::{self, Write};
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};

use commands::Command;
use context::{Context, Ending};
use mesa_hal::runner::Stop;

/// Finds, shows, tests, sets up and simulates Mesa Electronics' motion I/O boards.
#[derive(Debug, Parser)]
#[command(name = "mesa", version, propagate_version = true, after_help = AFTER_HELP)]
struct Cli {
    /// Print what was found as JSON, for programs
    #[arg(long, global = true)]
    json: bool,
    /// As the `--yes` of the commands that ask: it may stand in front of them, and does nothing
    /// for the others, whose help does not name it.
    #[arg(long, global = true, hide = true)]
    yes: bool,
    #[command(subcommand)]
    command: Command,
}

const AFTER_HELP: &str = "\
Each command is tried without a board with --sim 7i92-7i77 or --sim 7i97:
  mesa info --sim 7i97

MESA_ADDR is the address of the board where neither --addr nor --sim is given.

Exits with 0 if it is done, 1 if the board or the machine says no, 2 for bad arguments,
130 after SIGINT (Ctrl-C), 143 after SIGTERM, 129 after SIGHUP. Whatever drives a board ends
with its outputs off and its ports stopped; what poke and raw write stays.

Colours are for terminals only; NO_COLOR turns them off.";

/// What the help of each command ends with.
const EXITS: &str = "\
Exits with 0 if it is done, 1 if the board or the machine says no, 2 for bad arguments, 130 after
Ctrl-C.";

/// The command line, with what all commands have in common.
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

/// Prints help, or why the arguments make no sense, and says how that ends.
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
            output::complain(format_args!("mesa: signals can not be caught: {error}"));
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
