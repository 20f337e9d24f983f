//! Commands scheduled for a time, and conditions to wait for.

use std::collections::VecDeque;
use std::fmt::Write;
use std::time::Duration;

use super::answer::line;
use crate::ui::number;

/// Maximum number of scheduled commands.
const MAX_COMMANDS: usize = 1000;

/// Longest time that a command accepts, in seconds: a day.
const LONGEST: f64 = 86_400.0;

/// Default time limit of a `wait until`.
const PATIENCE: Duration = Duration::from_secs(60);

const NANOS: f64 = 1e9;

/// Scheduled commands in the order of their times.
#[derive(Debug, Default)]
pub struct Agenda {
    commands: VecDeque<(u64, String)>,
    done: u64,
    failed: u64,
}

impl Agenda {
    /// Checks that a command can be scheduled.
    pub fn takes(command: &str) -> Result<(), String> {
        match command.split_whitespace().next() {
            None => Err("expected at TIME COMMAND".to_owned()),
            Some(word @ ("at" | "wait" | "source" | "show" | "help" | "agenda" | "boards")) => {
                Err(format!("`{word}` cannot be scheduled"))
            }
            Some(_) => Ok(()),
        }
    }

    /// Schedules a command that [`takes`](Self::takes) accepts: at `2.5s` since the board's start,
    /// or `+2.5s` from now.
    pub fn add(&mut self, now: u64, time: &str, command: &str) -> Result<(), String> {
        let at = match time.strip_prefix('+') {
            Some(after) => now.saturating_add(parse_time(after)?.as_nanos() as u64),
            None => parse_time(time)?.as_nanos() as u64,
        };
        if at < now {
            let now = now as f64 / NANOS;
            return Err(format!(
                "{time} is over: it is {now:.3} s; +{time} is from now"
            ));
        }
        if self.commands.len() >= MAX_COMMANDS {
            return Err(format!("no more than {MAX_COMMANDS} commands wait"));
        }
        let index = self.commands.partition_point(|(other, _)| *other <= at);
        self.commands.insert(index, (at, command.to_owned()));
        Ok(())
    }

    /// Removes and returns the next due command.
    pub fn take(&mut self, now: u64) -> Option<String> {
        let (at, _) = self.commands.front()?;
        if *at > now {
            return None;
        }
        self.done += 1;
        self.commands.pop_front().map(|(_, command)| command)
    }

    /// Counts the last taken command as refused.
    pub fn failed(&mut self) {
        self.failed += 1;
    }

    /// The scheduled commands, and the number of executed ones.
    pub fn show(&self) -> String {
        let mut text = String::new();
        line(&mut text, "agenda.done", self.done);
        line(&mut text, "agenda.failed", self.failed);
        for (at, command) in &self.commands {
            let _ = writeln!(text, "agenda.{:.3} {command}", *at as f64 / NANOS);
        }
        text
    }
}

/// Parses a time: `2.5s`, `2.5` or `200ms`.
pub fn parse_time(text: &str) -> Result<Duration, String> {
    number::time(text, 0.0..=LONGEST)
}

/// Condition on a value.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    pub name: String,
    wanted: Wanted,
}

#[derive(Clone, Debug, PartialEq)]
enum Wanted {
    Equal(String),
    Above(f64),
    Below(f64),
}

impl Condition {
    /// Parses `NAME VALUE|>X|<X [within S]` to a condition and its time limit.
    pub fn parse(words: &[&str]) -> Result<(Self, Duration), String> {
        let (name, wanted, patience) = match *words {
            [name, wanted] => (name, wanted, PATIENCE),
            [name, wanted, "within", time] => (name, wanted, parse_time(time)?),
            _ => return Err("expected wait until NAME VALUE|>X|<X [within S]".to_owned()),
        };
        let limit = |text: &str| {
            let number = text.parse().ok().filter(|number: &f64| number.is_finite());
            number.ok_or_else(|| format!("`{text}` is no number"))
        };
        let wanted = if let Some(text) = wanted.strip_prefix('>') {
            Wanted::Above(limit(text)?)
        } else if let Some(text) = wanted.strip_prefix('<') {
            Wanted::Below(limit(text)?)
        } else {
            Wanted::Equal(wanted.to_owned())
        };
        let name = name.to_owned();
        Ok((Self { name, wanted }, patience))
    }

    /// True if a value meets the condition. Numbers are compared by value: `1` equals `1.00`.
    pub fn holds(&self, value: &str) -> bool {
        let number: Option<f64> = value.parse().ok();
        match &self.wanted {
            Wanted::Above(limit) => number.is_some_and(|number| number > *limit),
            Wanted::Below(limit) => number.is_some_and(|number| number < *limit),
            Wanted::Equal(wanted) => {
                wanted == value || (number.is_some() && wanted.parse().ok() == number)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    #[test]
    fn commands_come_in_the_order_of_their_times_and_are_bounded() {
        let mut agenda = Agenda::default();
        for (time, command) in [("2.5s", "c"), ("+1500ms", "b"), ("1", "a"), ("2.5", "d")] {
            agenda.add(SECOND / 2, time, command).unwrap();
        }
        assert_eq!(agenda.take(SECOND - 1), None);
        let order: String = std::iter::from_fn(|| agenda.take(3 * SECOND)).collect();
        assert_eq!(order, "abcd");
        for (time, command) in [("1s", "turn"), ("x", "turn"), ("-1s", "turn"), ("nan", "a")] {
            assert!(agenda.add(2 * SECOND, time, command).is_err(), "{time}");
        }
        for command in ["", "at 1s turn", "wait until x 1", "source x"] {
            assert!(Agenda::takes(command).is_err(), "{command}");
        }
        for _ in 0..MAX_COMMANDS {
            agenda.add(0, "1s", "a").unwrap();
        }
        assert!(agenda.add(0, "1s", "a").is_err());
    }

    #[test]
    fn condition_compares_numbers_as_numbers_and_words_as_words() {
        for (wanted, value, holds) in [
            ("1", "1", true),
            ("8", "8.0000", true),
            ("8", "8.0001", false),
            ("7i72", "7i72", true),
            ("on", "off", false),
            (">2.5", "2.5001", true),
            (">2.5", "2.5", false),
            ("<-1", "-1.5", true),
            ("<1", "word", false),
        ] {
            let (condition, patience) = Condition::parse(&["name", wanted]).unwrap();
            assert_eq!(condition.holds(value), holds, "{value} {wanted}");
            assert_eq!(patience, PATIENCE);
        }
        let (_, patience) = Condition::parse(&["x", "1", "within", "2.5"]).unwrap();
        assert_eq!(patience, Duration::from_millis(2500));
        for bad in [
            &["x"][..],
            &["x", ">"],
            &["x", ">nan"],
            &["x", "1", "in", "2"],
        ] {
            assert!(Condition::parse(bad).is_err(), "{bad:?}");
        }
    }
}
