//! `mesa`: one command for everyone who owns a board.
//!
//! What it does is calls of the library; here are arguments, words and screens.

mod cabinet;
mod commands;
mod consent;
mod context;
mod files;
mod full_screen;
mod modes;
mod output;
mod pattern;
mod place;
mod running;
mod sim;
mod target;

use std::process::ExitCode;

use clap::Parser;

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
    /// Do what drives an output, stops a machine or writes to a memory without asking
    #[arg(long, global = true)]
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
with its outputs off and its ports stopped; what poke and raw write stays.";

fn main() -> ExitCode {
    let cli = Cli::parse();
    let stop = match Stop::on_signals() {
        Ok(stop) => stop,
        Err(error) => {
            output::complain(format_args!("mesa: signals can not be caught: {error}"));
            return ExitCode::FAILURE;
        }
    };
    let context = Context {
        json: cli.json,
        yes: cli.yes,
        stop,
    };
    match cli.command.run(&context) {
        Ok(Ending::Done) => ExitCode::SUCCESS,
        Ok(Ending::Refused) => ExitCode::FAILURE,
        Ok(Ending::Stopped(signal)) => signal.exit_code(),
        Err(failure) => {
            output::complain(format_args!("mesa: {failure}"));
            failure.exit_code()
        }
    }
}
