//! `mesa`: one command for all tasks around a board.
//!
//! The work is done by libraries; this binary has the arguments, texts and screens.

mod board;
mod commands;
mod machine;
mod ui;

use std::io::{self, Write};
use std::process::ExitCode;

use clap::builder::styling::Styles;
use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser};

use commands::{Command, GROUPS, Group, completion};
use mesa_hal::runner::Stop;
use ui::context::{Context, Ending, Failure};
use ui::hurry::Hurry;
use ui::output;

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
Commands for one board take --addr IP or --pci [ADDRESS]; or, to try them without a board,
--sim 7i92-7i77 or --sim 7i97:
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
    let all = Cli::command().mut_subcommands(with_exits);
    let groups = groups(&all);
    all.help_template(format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{groups}{}\n{{options}}{{after-help}}",
        heading("Options")
    ))
}

/// The list of commands in the help, by groups.
fn groups(all: &clap::Command) -> String {
    let name_style = *Styles::styled().get_literal();
    let names = GROUPS.iter().flat_map(|group| group.commands);
    let width = names.map(|name| name.len()).max().unwrap_or(0);
    let line = |name: &&str| {
        let about = all.find_subcommand(name).and_then(clap::Command::get_about);
        let about = about.map(ToString::to_string).unwrap_or_default();
        format!("  {name_style}{name:<width$}{name_style:#}  {about}\n")
    };
    let group = |group: &Group| {
        let lines: String = group.commands.iter().map(line).collect();
        format!("{}\n{lines}\n", heading(group.heading))
    };
    GROUPS.iter().map(group).collect()
}

fn heading(text: &str) -> String {
    let style = *Styles::styled().get_header();
    format!("{style}{text}:{style:#}")
}

/// Prints the help, or the error in the arguments, and returns the exit code.
fn explain(error: &clap::Error) -> ExitCode {
    if error.use_stderr() && is_json_asked() {
        return misuse(error).report(true);
    }
    output::printed(error.print().and_then(|()| io::stdout().flush()));
    if error.use_stderr() {
        return ExitCode::from(2);
    }
    ended(Ending::Done, false)
}

/// True if `--json` is among arguments that could not be parsed.
fn is_json_asked() -> bool {
    let mut options = std::env::args_os().take_while(|argument| argument != "--");
    options.any(|argument| argument == "--json")
}

/// The error in the arguments: its first paragraph as the message, the others as the advice.
fn misuse(error: &clap::Error) -> Failure {
    let text = match error.kind() {
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            "a command is missing\n\n`--help` lists the commands".to_owned()
        }
        _ => error.render().to_string(),
    };
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let (message, advice) = text.split_once("\n\n").unwrap_or((&text, ""));
    let message = words(message.trim_start_matches("error: "));
    match words(advice) {
        advice if advice.is_empty() => Failure::usage(message),
        advice => Failure::usage(format_args!("{message}; {advice}")).advising(advice),
    }
}

/// Exit code of a command that has printed its result.
fn ended(ending: Ending, is_json: bool) -> ExitCode {
    if let Some(error) = output::lost() {
        let what = format_args!("standard output: {error}");
        let failure = match ending {
            Ending::Stopped(signal) => Failure::stopped(signal, what),
            Ending::Done | Ending::Refused => Failure::refused(what),
        };
        return failure.report(is_json);
    }
    match ending {
        Ending::Done => ExitCode::SUCCESS,
        Ending::Refused => ExitCode::FAILURE,
        Ending::Stopped(signal) => signal.exit_code(),
    }
}

fn main() -> ExitCode {
    completion::answer(command_line);
    let cli = command_line().try_get_matches();
    let cli = match cli.and_then(|mut found| Cli::from_arg_matches_mut(&mut found)) {
        Ok(cli) => cli,
        Err(error) => return explain(&error.format(&mut command_line())),
    };
    let stop = match Stop::on_signals() {
        Ok(stop) => stop,
        Err(error) => {
            let what = format_args!("signals cannot be caught: {error}");
            return Failure::refused(what).report(cli.json);
        }
    };
    let context = Context {
        command_line,
        json: cli.json,
        hurry: Hurry::new(stop.clone()),
        stop,
    };
    match cli.command.run(&context) {
        Ok(ending) => ended(ending, cli.json),
        Err(failure) => failure.after(&context).report(cli.json),
    }
}

#[cfg(test)]
mod tests;
