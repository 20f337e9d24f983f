//! Values of a board by name, as `show` prints them, and rates of its counters.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use crate::machine::slot::Slot;

/// Values by name, parsed from console output, so that the screen and other programs show the same.
#[derive(Debug, Default)]
pub struct Values(BTreeMap<String, String>);

impl Values {
    /// Parses lines `name value`.
    pub fn parse(lines: &str) -> Self {
        let pairs = lines.lines().filter_map(|line| line.split_once(' '));
        Self(
            pairs
                .map(|(name, value)| (name.to_owned(), value.to_owned()))
                .collect(),
        )
    }

    /// A value as text; empty if absent.
    pub fn text(&self, name: &str) -> &str {
        self.0.get(name).map_or("", String::as_str)
    }

    /// A value as a number; 0 if absent.
    pub fn number(&self, name: &str) -> f64 {
        self.text(name).parse().unwrap_or(0.0)
    }

    pub fn is_on(&self, name: &str) -> bool {
        self.text(name) == "1"
    }

    /// True if the value exists.
    pub fn has(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    /// The names below `prefix.`, without it, and their values.
    pub fn under<'a>(&'a self, prefix: &str) -> impl Iterator<Item = (&'a str, &'a str)> + use<'a> {
        let prefix = format!("{prefix}.");
        let from = self.0.range(prefix.clone()..);
        from.map_while(move |(name, value)| Some((name.strip_prefix(&prefix)?, value.as_str())))
    }

    /// The slots of all remotes.
    pub fn slots(&self) -> Vec<Slot> {
        let names = self.0.range("remote.".to_owned()..);
        let names = names.map_while(|(name, _)| Slot::in_name(name));
        let slots: BTreeSet<_> = names.collect();
        slots.into_iter().collect()
    }

    /// The next part of each name below `prefix.`, without repetition.
    pub fn parts(&self, prefix: &str) -> Vec<&str> {
        let parts = self.under(prefix);
        let parts = parts.map(|(name, _)| name.split_once('.').map_or(name, |pair| pair.0));
        let mut parts: Vec<_> = parts.collect();
        parts.dedup();
        parts
    }
}

/// Rate of a counter over the last second.
#[derive(Debug, Default)]
pub struct Rate(VecDeque<(f64, f64)>);

/// Samples of one second, and the one before.
const SAMPLES: usize = 11;

impl Rate {
    /// Adds the counter's value at a time in seconds.
    pub fn push(&mut self, time: f64, count: f64) {
        // A restarted counter begins at 0.
        if self.0.back().is_some_and(|&(_, last)| count < last) {
            self.0.clear();
        }
        if self.0.len() == SAMPLES {
            self.0.pop_front();
        }
        self.0.push_back((time, count));
    }

    pub fn per_second(&self) -> f64 {
        match (self.0.front(), self.0.back()) {
            (Some(first), Some(last)) if last.0 > first.0 => {
                (last.1 - first.1) / (last.0 - first.0)
            }
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_found_by_name_and_by_what_they_belong_to() {
        let text =
            "remote.0.mode 2\nremote.0.device a b\nremote.1.mode 1\nremote.10.x 1\nestop 1\n";
        let values = Values::parse(text);
        assert_eq!(values.text("remote.0.device"), "a b");
        assert_eq!(
            (values.number("remote.0.mode"), values.number("none")),
            (2.0, 0.0)
        );
        assert!(values.is_on("estop") && values.has("estop") && !values.has("esto"));
        assert_eq!(values.parts("remote"), ["0", "1", "10"]);
        let first: Vec<_> = values.under("remote.1").collect();
        assert_eq!(first, [("mode", "1")]);
        assert_eq!(values.parts("wheel"), [""; 0]);
    }

    #[test]
    fn rate_is_that_of_the_last_second() {
        let mut rate = Rate::default();
        assert_eq!(rate.per_second(), 0.0);
        rate.push(0.0, 5.0);
        assert_eq!(rate.per_second(), 0.0);
        for n in 1..=20 {
            rate.push(f64::from(n) / 10.0, 5.0 + 200.0 * f64::from(n));
        }
        assert!((rate.per_second() - 2000.0).abs() < 1e-6);
        for n in 21..=31 {
            rate.push(f64::from(n) / 10.0, 4005.0);
        }
        assert_eq!(rate.per_second(), 0.0);
        rate.push(3.2, 7.0);
        assert_eq!(rate.per_second(), 0.0, "it began again");
    }
}
