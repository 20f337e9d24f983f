//! Tests of the help of every command.

use std::any::TypeId;
use std::time::Duration;

use clap::{Arg, Command};

use super::*;

/// Width in characters at which clap wraps a line of help.
const WIDEST: usize = 100;

/// Every command with the words that call it, including commands that only have subcommands.
fn commands() -> Vec<(String, Command)> {
    fn walk(before: &str, command: Command, all: &mut Vec<(String, Command)>) {
        let words = format!("{before}{}", command.get_name());
        for below in command.get_subcommands() {
            walk(&format!("{words} "), below.clone(), all);
        }
        all.push((words, command));
    }
    let mut all = Vec::new();
    walk("", command_line(), &mut all);
    assert!(all.len() > 25, "{}", all.len());
    all
}

fn after_help(command: &Command) -> String {
    let help = command.get_after_help().map(ToString::to_string);
    help.unwrap_or_default()
}

/// Command lines among the indented lines of a text, without `sudo`, redirections and pipes.
fn examples(text: &str) -> Vec<String> {
    let text = text.replace("\\\n", " ");
    let lines = text.lines().filter_map(|line| line.strip_prefix("  "));
    let lines = lines.map(|line| line.strip_prefix("sudo ").unwrap_or(line));
    let lines = lines.filter(|line| line.starts_with("mesa "));
    let cut = |line: &str| {
        let end = line.find(['<', '>', '&', '|']).unwrap_or(line.len());
        line[..end].trim_end().to_owned()
    };
    lines.map(cut).collect()
}

/// Splits a command line into words, as a shell does.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut quote = None;
    for letter in line.chars() {
        let word = words.last_mut().expect("one at least");
        match (letter, quote) {
            ('\'' | '"', None) => quote = Some(letter),
            (_, Some(open)) if letter == open => quote = None,
            (' ', None) if word.is_empty() => {}
            (' ', None) => words.push(String::new()),
            _ => word.push(letter),
        }
    }
    words
}

#[test]
fn every_command_has_an_example_and_every_example_parses() {
    for (name, command) in commands() {
        let examples = examples(&after_help(&command));
        let own = |line: &String| line.starts_with(&name);
        assert!(examples.iter().any(own), "{name} has no example");
        for example in examples {
            if let Err(error) = Cli::try_parse_from(words(&example)) {
                panic!("{name}: {example}\n{error}");
            }
        }
    }
}

#[test]
fn each_command_is_in_one_group_of_the_help_with_what_it_does() {
    let all = command_line();
    let mut names: Vec<_> = all.get_subcommands().map(Command::get_name).collect();
    let groups = GROUPS
        .iter()
        .flat_map(|group| group.commands.iter().copied());
    let mut grouped: Vec<_> = groups.collect();
    names.sort_unstable();
    grouped.sort_unstable();
    assert_eq!(grouped, names);
    let help = command_line().render_help().to_string();
    for command in all.get_subcommands() {
        let about = command.get_about().map(ToString::to_string);
        let about = about.unwrap_or_default();
        let is_line = |line: &str| {
            let rest = line
                .strip_prefix("  ")
                .and_then(|line| line.strip_prefix(command.get_name()));
            rest.is_some_and(|rest| rest.starts_with(' ') && rest.trim() == about)
        };
        let lines = help.lines().filter(|line| is_line(line)).count();
        assert_eq!(lines, 1, "{}: {help}", command.get_name());
    }
    for line in help.lines() {
        assert!(line.chars().count() <= WIDEST, "{line}");
    }
    for group in &GROUPS {
        let heading = format!("\n{}:\n", group.heading);
        assert!(help.contains(&heading), "{heading}: {help}");
    }
}

#[test]
fn help_of_each_command_lists_its_exit_codes() {
    for (name, command) in commands() {
        let help = after_help(&command);
        let is_said = help.contains("Exits with 0") || command.has_subcommands();
        assert!(is_said, "{name}");
    }
    assert!(AFTER_HELP.contains("Exits with 0"));
}

/// Commands that ask have `--yes` as their own argument, from
/// [`Asks`](crate::board::consent::Asks).
#[test]
fn yes_is_in_the_help_of_commands_that_ask_and_fits_anywhere() {
    let asks: Vec<String> = commands()
        .into_iter()
        .filter(|(_, command)| {
            let mut arguments = command.get_arguments();
            arguments.any(|argument| argument.get_id() == "yes" && !argument.is_hide_set())
        })
        .map(|(name, _)| name)
        .collect();
    for name in ["set", "poke", "param set", "flash write", "reset", "doctor"] {
        assert!(asks.contains(&format!("mesa {name}")), "{name}: {asks:?}");
    }
    for name in [
        "",
        " list",
        " info",
        " pins",
        " watch",
        " peek",
        " param get",
    ] {
        assert!(!asks.contains(&format!("mesa{name}")), "{name}: {asks:?}");
    }
    for line in [
        "mesa --yes list",
        "mesa list --yes",
        "mesa pins --yes --sim 7i97",
    ] {
        Cli::try_parse_from(words(line)).expect("it does nothing there");
    }
    let poke = "poke 0:0x1000 1 --addr 10.10.10.10";
    for line in [format!("mesa --yes {poke}"), format!("mesa {poke} --yes")] {
        let found = command_line().try_get_matches_from(words(&line));
        let found = found.expect("a command line");
        let (_, poke) = found.subcommand().expect("a command");
        assert!(poke.get_flag("yes"), "{line}");
    }
    let mut list = command_line();
    list.build();
    let list = list.find_subcommand_mut("list").expect("a command");
    assert!(!list.render_help().to_string().contains("--yes"));
}

#[test]
fn every_number_has_its_range() {
    let numbers = [
        TypeId::of::<u8>(),
        TypeId::of::<u16>(),
        TypeId::of::<u32>(),
        TypeId::of::<u64>(),
        TypeId::of::<usize>(),
        TypeId::of::<i64>(),
        TypeId::of::<f64>(),
        TypeId::of::<Duration>(),
    ];
    let is_number = |argument: &&Arg| {
        let parsed = argument.get_value_parser().type_id();
        let takes = argument.get_action().takes_values();
        takes && numbers.iter().any(|number| parsed == *number)
    };
    let mut count = 0;
    for (name, command) in commands() {
        for argument in command.get_arguments().filter(is_number) {
            let help = argument.get_help().map(ToString::to_string);
            let help = help.unwrap_or_default();
            let has_range = help.split(" to ").skip(1).any(|upper| {
                let first = upper.chars().next();
                first.is_some_and(|first| first.is_ascii_digit())
            });
            let has_end = ["any number", "0 to one less than"];
            let has_end = has_end.iter().any(|end| help.contains(end));
            assert!(has_range || has_end, "{name} {}: {help}", argument.get_id());
            count += 1;
        }
    }
    assert!(count > 10, "{count} numbers were looked at");
}

/// The manual page lists them in this order, without the groups of the help.
#[test]
fn manual_page_lists_the_commands_by_name() {
    let all = command_line();
    let names = all.get_subcommands().map(clap::Command::get_name);
    let names: Vec<_> = names.filter(|name| *name != "help").collect();
    assert!(names.is_sorted(), "{names:?}");
}

#[test]
fn no_line_of_help_is_broken_where_it_was_not_meant() {
    for (name, command) in commands() {
        for line in after_help(&command).lines() {
            assert!(line.chars().count() <= WIDEST, "{name}: {line}");
        }
    }
}
